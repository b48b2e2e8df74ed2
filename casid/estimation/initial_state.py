"""Hold what is known of the initial states of an estimation problem."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from casid.arguments import table_of


@dataclass(frozen=True, kw_only=True)
class InitialState:
    """Prior knowledge of the initial states. Each is free unless its 1-sigma is zero.

    An initial state without a 1-sigma is as free as the data decide. It has a prior only for what no reading
    determines: thirty times the size of its readings or its guess, and wider where that would weigh anything.

    A name with a record behind it, "x[m1]", is of that record alone. A model that says `initial` itself needs nothing
    here: what it names is held there exactly.

    Attributes
    ----------
    value
        State -> centre of the prior, and where the search begins; default: the first row of `model.guess(record)`.
    std
        State -> 1-sigma of the prior, 0: exactly the value; default: no knowledge.

    Examples
    --------
    The state x begins at rest, exactly, and y within 0.1 of 2.0:

    >>> import casid as cs
    >>> known = cs.InitialState(value={"x": 0.0, "y": 2.0}, std={"x": 0.0, "y": 0.1})
    >>> known.std["y"]
    0.1
    """

    value: Mapping[str, float] = field(default_factory=dict)
    std: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        table_of(self.value, "InitialState: value", "{'alpha': 0.1}")
        table_of(self.std, "InitialState: std", "{'alpha': 0.01}")

    def of(self, record: str) -> tuple[dict[str, float], dict[str, float]]:
        """Values and deviations of the record of a name, by state."""
        return of_record(self.value, record), of_record(self.std, record)


def of_record(table: Mapping[str, float], record: str) -> dict[str, float]:
    """Name -> value of a table whose names may have a record behind them, as it is for one record."""
    everywhere = {name: value for name, value in table.items() if not name.endswith("]") or ".onset[" in name}
    own = {name.rpartition("[")[0]: value for name, value in table.items() if name.endswith(f"[{record}]")}
    return everywhere | own
