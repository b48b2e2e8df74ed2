"""Shapes of an input that a design may choose among: steps of free durations and sizes, or a sum of sines.

A shape turns a vector of unknowns into samples of one surface's deflection from rest, in units of its limit. The
edges of steps are smooth (a surface has a rate), so that the samples can be differentiated in the switching times.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from casid.arguments import number, whole
from casid.errors import InputError


@dataclass(frozen=True, kw_only=True)
class StepInput:
    """Pulses one after another, each with its own duration and size. Four are what a 3-2-1-1 has.

    Attributes
    ----------
    pulses
        How many.
    shortest_s
        Duration of each, at least [s].
    rise_s
        What an edge takes, about [s].

    Examples
    --------
    After the example of `Experiment`:

    >>> cs.design_input(experiment, cs.StepInput(pulses=2), starts=2).status
    'optimal'
    """

    pulses: int = 4
    shortest_s: float = 0.25
    rise_s: float = 0.12

    def __post_init__(self) -> None:
        whole(self.pulses, "Steps: pulses")
        number(self.shortest_s, "Steps: shortest_s", positive=True)
        number(self.rise_s, "Steps: rise_s", positive=True)

    def check(self, duration: float) -> None:
        """Check that the pulses fit into a record of a duration [s].

        Raises
        ------
        InputError
            When they do not fit into `duration` [s].
        """
        if self.pulses * self.shortest_s >= duration:
            raise InputError(f"Steps: {self.pulses} pulses of {self.shortest_s} s do not fit into {duration:g} s")

    def bounds(self, duration: float) -> tuple[np.ndarray, np.ndarray]:
        """Limits of the unknowns in a record of a duration [s]: rest before the pulses, their durations, sizes."""
        low = np.r_[2 * self.rise_s, np.full(self.pulses, self.shortest_s), np.full(self.pulses, -1.0)]
        return low, np.r_[np.full(1 + self.pulses, duration), np.ones(self.pulses)]

    def samples(self, unknowns: Any, t: np.ndarray) -> Any:
        """(N,) deflection at times `t` (N,) [s]; CasADi or numpy as the unknowns are."""
        tanh = np.tanh if isinstance(unknowns, np.ndarray) else ca.tanh
        width = 0.5 * self.rise_s
        begin = unknowns[0]
        total = 0.0
        for i in range(self.pulses):
            end = begin + unknowns[1 + i]
            size = unknowns[1 + self.pulses + i]
            total = total + 0.5 * size * (tanh((t - begin) / width) - tanh((t - end) / width))
            begin = end
        return total

    def ends(self, unknowns: Any) -> Any:
        """Time at which the last pulse ends [s]: not after the record."""
        return sum((unknowns[i] for i in range(1, 1 + self.pulses)), unknowns[0])

    def standard(self, unit_s: float, amplitude: float) -> np.ndarray:
        """The unknowns of a 3-2-1-1 of an amplitude whose shortest pulse takes `unit_s`; further pulses are at rest."""
        if self.pulses < 4:
            raise InputError(f"Steps: a 3-2-1-1 needs 4 pulses, got {self.pulses}")
        durations = np.r_[3 * unit_s, 2 * unit_s, unit_s, unit_s, np.full(self.pulses - 4, self.shortest_s)]
        sizes = np.r_[amplitude * np.array([1.0, -1.0, 1.0, -1.0]), np.zeros(self.pulses - 4)]
        return np.r_[max(0.5, 2 * self.rise_s), durations, sizes]

    def random(self, rng: np.random.Generator, duration: float) -> np.ndarray:
        """Unknowns to start from: pulses of random share of the duration [s], alternating."""
        share = rng.dirichlet(np.full(self.pulses + 1, 2.0))[: self.pulses]
        durations = self.shortest_s + share * 0.9 * (duration - self.pulses * self.shortest_s - 1.0)
        sign = rng.choice([-1.0, 1.0]) * (-1.0) ** np.arange(self.pulses)
        return np.r_[0.5, np.maximum(durations, self.shortest_s), sign * rng.uniform(0.3, 0.7, self.pulses)]


@dataclass(frozen=True, kw_only=True)
class Multisine:
    """Sines and cosines at multiples of 1/duration, faded in and out.

    Attributes
    ----------
    lines
        Number of multiples, from the first on.
    rise_s
        Time of the fade at each end [s].

    Examples
    --------
    After the example of `Experiment`:

    >>> cs.design_input(experiment, cs.Multisine(lines=3), starts=2).status
    'optimal'
    """

    lines: int = 8
    rise_s: float = 0.5

    def __post_init__(self) -> None:
        whole(self.lines, "Multisine: lines")
        number(self.rise_s, "Multisine: rise_s", positive=True)

    def check(self, duration: float) -> None:
        """Check that the fading fits into a record of a duration [s].

        Raises
        ------
        InputError
            When it does not fit into `duration` [s].
        """
        if 4 * self.rise_s > duration:
            raise InputError(f"Multisine: fading of {self.rise_s} s does not fit into {duration:g} s")

    def bounds(self, duration: float) -> tuple[np.ndarray, np.ndarray]:
        """Limits of the unknowns: amplitudes of the sines, then of the cosines."""
        return np.full(2 * self.lines, -1.0), np.ones(2 * self.lines)

    def samples(self, unknowns: Any, t: np.ndarray) -> Any:
        """(N,) deflection at times `t` (N,) [s]; CasADi or numpy as the unknowns are."""
        duration = t[-1] - t[0]
        inside = t - t[0]
        fade = np.tanh(inside / self.rise_s) * np.tanh((duration - inside) / self.rise_s)
        total: Any = 0.0
        for k in range(self.lines):
            angle = 2.0 * np.pi * (k + 1) * inside / duration
            total = total + unknowns[k] * (fade * np.sin(angle)) + unknowns[self.lines + k] * (fade * np.cos(angle))
        return total

    def ends(self, unknowns: Any) -> Any:
        """It fills the record."""
        return 0.0

    def random(self, rng: np.random.Generator, duration: float) -> np.ndarray:
        """Unknowns to start from: equal power in all lines, random phases."""
        phase = rng.uniform(0.0, 2.0 * np.pi, self.lines)
        return np.r_[np.sin(phase), np.cos(phase)] * 0.5 / np.sqrt(self.lines)


Shape = StepInput | Multisine
