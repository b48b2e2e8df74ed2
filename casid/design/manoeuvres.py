"""Manoeuvres that a pilot or an autopilot can fly: one surface, a shape with a name, a size within limits."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from casid.design.experiment import Experiment
from casid.design.input_shapes import StepInput

_UNITS_S = np.geomspace(0.2, 1.6, 7)  # of the shortest pulse; slower ones excite less of what is fast
_BEGIN_S = 0.5
_PULSES = {"doublet": 2, "double doublet": 4, "pulse train": 8}
_SWEEP_HZ = (0.1, 2.5)  # from the phugoid's end to beyond the short period


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
