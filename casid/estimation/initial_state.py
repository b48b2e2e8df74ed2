"""What is known of the initial states of an estimation problem."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from casid.arguments import table_of


@dataclass(frozen=True, kw_only=True)
class InitialState:
    """What is known of the initial states: each is free, with a prior, unless its 1-sigma is zero.

    A name with a record behind it, "x[m1]", is of that record alone. A model that says `initial` itself needs nothing
    here: what it names is held there exactly.

    Attributes
    ----------
    value
        State -> centre of the prior; default: the first row of `model.guess(record)`.
    std
        State -> 1-sigma of the prior, 0: exactly the value; default: `model.state_scale`, which is weak.

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
