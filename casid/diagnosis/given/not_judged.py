"""What the records or the file leave open: said beside every verdict, "adequate" above all."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, kw_only=True)
class NotJudged:
    """Something that was not judged, `what`, and `because` of which channel, surface or want of excitation."""

    what: str
    because: str

    @property
    def sentence(self) -> str:
        """In words."""
        return f"Not judged: {self.what}, because {self.because}."

    def to_dict(self) -> dict[str, Any]:
        """One entry of `not_judged` in diagnosis.json."""
        return {"what": self.what, "because": self.because}
