"""What the pilot does: multi-step inputs on the surfaces and the throttle, as flight-test cards.

A card is a list of `Steps`; levels are multiples of the airframe's own input size, durations multiples of its own
time unit, so that one card excites a trainer and an airliner alike. `commands` turns a card into time histories.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from casid.errors import unknown

SURFACES: tuple[str, ...] = ("delta_e", "delta_a", "delta_r")
CONTROLS: tuple[str, ...] = (*SURFACES, "throttle")
_PITCH_3211 = ((3, 1), (2, -1), (1, 1), (1, -1))
_DOUBLET = ((1, 1), (1, -1))
_TRIPLE = ((1, 1), (2, -1), (1, 1))


@dataclass(frozen=True, kw_only=True)
class Steps:
    """A multi-step input: from `start_s` on, `levels` are (duration in time units, level in input sizes) pairs."""

    control: str
    start_s: float
    levels: tuple[tuple[float, float], ...]
    size: float = 1.0


def _steps(control: str, start_s: float, levels: tuple[tuple[float, float], ...], size: float = 1.0) -> Steps:
    return Steps(control=control, start_s=start_s, levels=levels, size=size)


CARDS: Mapping[str, tuple[Steps, ...]] = MappingProxyType(
    {
        "pitch_roll_yaw": (
            _steps("delta_e", 1.5, _PITCH_3211),
            _steps("delta_a", 9.0, _TRIPLE),
            _steps("delta_r", 15.5, _DOUBLET),
            _steps("delta_e", 22.0, _DOUBLET, -0.9),
        ),
        "yaw_roll_thrust": (
            _steps("delta_r", 1.5, _TRIPLE, -0.9),
            _steps("delta_a", 8.5, _DOUBLET, -1.0),
            _steps("delta_e", 13.0, _DOUBLET, 1.2),
            _steps("throttle", 16.0, ((5, 1), (4, -1)), 1.0),
            _steps("delta_r", 20.5, _DOUBLET, 0.8),
            _steps("delta_e", 23.5, ((1, -1), (1, 1)), 0.8),
        ),
        "pitch_then_coupled": (
            _steps("delta_e", 1.5, ((1, 1), (1, -1), (2, 1), (3, -1)), -0.85),
            _steps("throttle", 7.0, ((8, -1),), 1.0),
            _steps("delta_a", 10.0, _DOUBLET, 1.1),
            _steps("delta_r", 12.0, _DOUBLET, -1.0),
            _steps("delta_e", 17.5, _PITCH_3211, 0.7),
            _steps("delta_a", 24.0, _DOUBLET, -0.8),
        ),
        "roll_yaw_pitch": (
            _steps("delta_a", 1.5, _TRIPLE, -0.9),
            _steps("delta_e", 7.5, ((2, -1), (2, 1)), 0.8),
            _steps("delta_r", 13.0, _PITCH_3211, 0.75),
            _steps("delta_e", 20.0, _TRIPLE, -1.0),
            _steps("delta_a", 24.5, _DOUBLET, 0.7),
        ),
    }
)


def commands(
    card: str,
    t: np.ndarray,
    *,
    sizes: Mapping[str, float],
    units_s: Mapping[str, float],
    rng: np.random.Generator,
) -> dict[str, np.ndarray]:
    """Deviations of the controls from trim, name -> (N,); surfaces [rad], throttle [1].

    sizes     input size per control (surfaces in rad, throttle normalised)
    units_s   time unit per control [s]
    rng       a pilot repeats nothing exactly: starts vary by 0.15 s, levels by 6 %, 1-sigma
    Raises InputError for an unknown card. Edges take some 0.2 s, as a hand on a control does.
    """
    if card not in CARDS:
        raise unknown("manoeuvre", card, CARDS)
    out = {name: np.zeros_like(t) for name in CONTROLS}
    for steps in CARDS[card]:
        start = steps.start_s + 0.15 * rng.standard_normal()
        for duration, level in steps.levels:
            stop = start + duration * units_s[steps.control]
            amplitude = level * steps.size * sizes[steps.control] * (1 + 0.06 * rng.standard_normal())
            out[steps.control] += amplitude * (_edge(t - start) - _edge(t - stop))
            start = stop
    return out


def _edge(t: np.ndarray, rise_s: float = 0.2) -> np.ndarray:
    """Smooth step from 0 to 1 over `rise_s` (raised cosine)."""
    x = np.clip(t / rise_s, 0.0, 1.0)
    return 0.5 - 0.5 * np.cos(np.pi * x)
