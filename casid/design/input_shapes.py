"""Shapes of an input that a design may choose among: steps of free durations and sizes, or a sum of sines.

And manoeuvres that a pilot or an autopilot can fly: one surface, a shape with a name, a size within limits.

A shape turns a vector of unknowns into samples of one surface's deflection from rest, in units of its limit. The
edges of steps are smooth (a surface has a rate), so that the samples can be differentiated in the switching times.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from casid.arguments import number, whole
from casid.design.experiment import Experiment
from casid.errors import InputError

# of the manoeuvres that can be flown
_UNITS_S = np.geomspace(0.2, 1.6, 7)  # of the shortest pulse; slower ones excite less of what is fast
_BEGIN_S = 0.5
_PULSES = {"doublet": 2, "double doublet": 4, "pulse train": 8}
_SWEEP_HZ = (0.1, 2.5)  # from the phugoid's end to beyond the short period


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


@dataclass(frozen=True, eq=False, kw_only=True)
class Manoeuvre:
    """A movement of one surface about its rest."""

    surface: str  # what moves
    words: str  # its shape, "3-2-1-1 with a shortest pulse of 0.40 s"
    moves: np.ndarray  # (N,) deflection, the largest 1


def flyable(experiment: Experiment) -> Iterator[Manoeuvre]:
    """Doublets, pulse trains, 3-2-1-1 and a sweep on each surface of an experiment, those that fit into its time."""
    t = experiment.t
    for surface in experiment.surfaces:
        for unit in _UNITS_S:
            shape = StepInput(rise_s=min(0.12, 0.5 * unit), shortest_s=0.1)
            if _BEGIN_S + 7 * unit < experiment.duration:
                moves = shape.samples(shape.standard(unit, 1.0), t)
                yield Manoeuvre(surface=surface, words=f"3-2-1-1 with a shortest pulse of {unit:.2f} s", moves=moves)
            for name, pulses in _PULSES.items():
                if _BEGIN_S + pulses * unit < experiment.duration:
                    alternating = [(-1.0) ** k for k in range(pulses)]
                    unknowns = np.r_[_BEGIN_S, np.full(pulses, unit), alternating]
                    train = StepInput(pulses=pulses, rise_s=shape.rise_s, shortest_s=0.1)
                    words = f"{name} with pulses of {unit:.2f} s"
                    yield Manoeuvre(surface=surface, words=words, moves=train.samples(unknowns, t))
        low, high = _SWEEP_HZ
        rest = np.minimum(1.0, np.minimum(t, t[-1] - t) / _BEGIN_S)  # it begins and ends at rest
        phase = 2.0 * np.pi * (low * t + 0.5 * (high - low) * t**2 / t[-1])
        yield Manoeuvre(surface=surface, words=f"sweep from {low:g} to {high:g} Hz", moves=rest * np.sin(phase))
