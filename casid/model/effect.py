"""What an effect is, and the register of causes.

A cause is one `@cause` function that returns an `Effect`: an extra piece at one station of the signal path. It enters
in one of three ways, and simulation, estimation, screening, extension of the aircraft file and the generator of hidden
effects all use the same definition:

change   symbolic: it changes the path at `station`; its value is a parameter of the model, 0 = absent
series   a time history at a disturbance station of the path, computed from the record (a lagged surface, a gust)
output   an operator on what an instrument reads (delay, lag)
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from casid.model.path import SignalPath
from casid.model.vocabulary import effect_unit

Values = Mapping[str, float]
Series = Mapping[str, np.ndarray]


@dataclass(frozen=True, kw_only=True)
class Effect:
    """One cause at one target.

    linear       the value is an amplitude that enters linearly at its null 0, so a score gives its size;
                 otherwise (lag, dead zone) sizes of `grid` are tried
    grid         values of the further parameters (and of "value" when not linear) that a screening tries
    timed        it begins at an onset [s] of its own in every record concerned
    meaningful   the smallest size that matters to an engineer, in `unit` (None: judged by its part of a coefficient)
    limit        the largest plausible size, in `unit`
    """

    kind: str
    target: str
    term: str | None = None
    linear: bool = True
    grid: tuple[Mapping[str, float], ...] = ({},)
    timed: bool = False
    meaningful: float | None = None
    limit: float = np.inf
    station: str | None = None
    change: Callable[[SignalPath, Any], None] | None = None
    series: Callable[[np.ndarray, Series, Values], dict[str, np.ndarray]] | None = None
    output: Callable[[np.ndarray, Series, Values], dict[str, np.ndarray]] | None = None

    @property
    def name(self) -> str:
        """Name of its parameter in a model and in tables, e.g. "actuator_lag(delta_e)"."""
        inside = self.target + (f":{self.term}" if self.term else "")
        return f"{self.kind}({inside})" if inside else self.kind

    @property
    def unit(self) -> str:
        """SI unit of the value."""
        return effect_unit(self.kind, self.target, self.term)

    @property
    def key(self) -> tuple[str, str, str | None]:
        return self.kind, self.target, self.term


CAUSES: dict[str, Callable[..., Effect]] = {}
TARGETS: dict[str, tuple[str, ...]] = {}


def cause(kind: str, targets: Iterable[str]) -> Callable[[Callable[..., Effect]], Callable[..., Effect]]:
    """Register a cause: the decorated function makes its Effect for a target (and a term)."""

    def register(make: Callable[..., Effect]) -> Callable[..., Effect]:
        CAUSES[kind] = make
        TARGETS[kind] = tuple(targets)
        return make

    return register
