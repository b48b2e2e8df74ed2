"""One fault of the data, as in diagnosis.json."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

Handled = Literal["excluded", "corrected", "reported"]


@dataclass(frozen=True, kw_only=True)
class Finding:
    """A fault of the data.

    Attributes
    ----------
    kind, target
        Of the vocabulary, `data_stuck` of `beta`.
    records
        Names of those that have it.
    intervals_s
        Record -> intervals [s] that are concerned; empty: the whole record.
    value, std
        Its size with 1-sigma in `unit`, where it has one: the factor of a wrong unit.
    handled
        "excluded": these samples take no part; "corrected": the data are judged as they should read; "reported":
        neither can be done, so that nothing which rests on them can be judged.
    odds
        Of a sign, a unit or a swap against records that are well, 1e6 to 1 at most; None of samples.
    indistinguishable_from
        Kind and target of other faults that explain these data as well.

    Examples
    --------
    >>> import casid as cs
    >>> record = cs.read_record("casid/cli/demo/m1.csv")
    >>> beta = record["beta"].copy()
    >>> beta[300:600] = beta[300]  # the vane freezes for six seconds
    >>> found = cs.check([record.with_channels(beta=beta)])
    >>> found.findings[0].kind, found.findings[0].target
    ('data_stuck', 'beta')
    """

    kind: str
    target: str
    records: tuple[str, ...]
    intervals_s: Mapping[str, tuple[tuple[float, float], ...]] = field(default_factory=dict)
    value: float | None = None
    std: float | None = None
    unit: str | None = None
    handled: Handled
    sentence: str
    odds: float | None = None
    indistinguishable_from: tuple[Mapping[str, str], ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """One entry of `data` in diagnosis.json.

        Returns
        -------
        dict
            Numbers, texts, lists and tables, as JSON holds them.
        """
        return {
            "kind": self.kind,
            "target": self.target,
            "records": list(self.records),
            "intervals_s": {record: [list(one) for one in parts] for record, parts in self.intervals_s.items()},
            "value": self.value,
            "std": self.std,
            "unit": self.unit,
            "handled": self.handled,
            "odds": self.odds,
            "sentence": self.sentence,
            "indistinguishable_from": [dict(one) for one in self.indistinguishable_from],
        }
