"""A cause as a diagnosis reports it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from casid.diagnosis.decision import Gate
from casid.model.vocabulary import effect_title


@dataclass(frozen=True, eq=False, kw_only=True)
class Cause:
    """A named cause, or a minor one.

    Attributes
    ----------
    std
        Standard deviation of the value, corrected for model discrepancy and for differences between stretches of
        record.
    statistic
        Likelihood-ratio statistic: decrease of the deviance when the cause is added and everything is estimated again,
        with `dof` parameters. The model without the cause has the same scale of model discrepancy as the model with it.
    held_out_gain
        Increase of the log likelihood per sample of the held-out records; None for an event that does not recur there.
    onset_s
        Record -> interval [s] that contains the onset with 95 % probability; None for a cause that always acts.
    share
        Its size, in units of the smallest size that matters.
    gates
        Its acceptance gates beside all other causes and on the held-out records.
    probability
        Probability that this cause or one of its ambiguity set is present.
    alone
        Probability that this cause itself is present.
    log_odds
        Log odds against all explanations without it.

    Examples
    --------
    >>> import casid as cs
    >>> found = cs.diagnose("aircraft.toml", cs.read_records("flight/m*.csv"))  # doctest: +SKIP
    >>> [(cause.kind, cause.target, cause.value, cause.std) for cause in found.causes]  # doctest: +SKIP
    """

    kind: str
    target: str
    term: str | None
    value: float
    std: float
    unit: str
    records: tuple[str, ...]
    onset_s: Mapping[str, tuple[float, float]] | None
    statistic: float
    dof: int
    held_out_gain: float | None
    indistinguishable_from: tuple[Mapping[str, Any], ...]
    sentence: str
    parameters: Mapping[str, float]
    meaningful: bool
    share: float
    gates: tuple[Gate, ...] = ()
    probability: float | None = None
    alone: float | None = None
    log_odds: float | None = None

    @property
    def key(self) -> tuple[str, str, str | None]:
        """Kind, target and term."""
        return self.kind, self.target, self.term

    @property
    def statement(self) -> str:
        """Its sentence, and the other causes of its ambiguity set."""
        titles = (effect_title(one["kind"], one["target"], one["term"]) for one in self.indistinguishable_from)
        others = dict.fromkeys(titles)  # variants of a kind share a title
        alike = f" These data cannot tell that apart from {' or '.join(others)}." if others else ""
        return self.sentence + alike
