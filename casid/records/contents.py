"""List what was read of a file, how, and what was not."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from casid.keeping import by_fields

_MOST = 6  # names of one reason in a note


@dataclass(frozen=True, kw_only=True)
class Contents:
    """Content of a file: what was read and how, and what was not, with the reason.

    Attributes
    ----------
    read
        Channel -> where it stands in the file, its unit, and what was made of its numbers.
    unread
        Name in the file -> why it was not read.

    Examples
    --------
    >>> import casid as cs
    >>> record = cs.read_record("casid/cli/demo/m1.csv")
    >>> record.contents.read["alpha"]
    "column 'alpha'; in rad, as no unit is stated"
    """

    read: Mapping[str, str] = field(default_factory=dict)
    unread: Mapping[str, str] = field(default_factory=dict)

    to_dict = by_fields

    @property
    def note(self) -> str:
        """The remark that names what was not read; "" where all was."""
        if not self.unread:
            return ""
        reasons = dict[str, list[str]]()
        for name, why in self.unread.items():
            reasons.setdefault(why, []).append(f"'{name}'")
        parts = []
        for why, names in reasons.items():
            more = f" and {len(names) - _MOST} more" if len(names) > _MOST else ""
            parts.append(f"{', '.join(names[:_MOST])}{more} ({why})")
        return f"not read: {'; '.join(parts)}"
