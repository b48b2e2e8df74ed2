"""Effects that the vocabulary does not have, as laws that both simulators step along with the flight.

A law turns what the aircraft does into increments of coefficients, sample by sample, with a memory of its own.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from casid.errors import unknown

Signals = Mapping[str, float]
Law = Callable[[float, Signals], dict[str, float]]
# what a law may look at; JSBSim's logs and casid's simulation both have it
SIGNALS = ("V", "alpha", "beta", "p", "q", "r", "ay")
_TWO_PI = 2.0 * np.pi


@dataclass(frozen=True, kw_only=True)
class Outside:
    """An effect outside the catalogue.

    size        factor on the law of size 1: what a coefficient gets per unit of its drive (see `_LAWS`)
    frequency_hz, threshold   of what oscillates; of what breaks, in angle of attack [rad]
    V           [m/s] trim speed
    """

    kind: str
    target: str
    size: float
    V: float
    frequency_hz: float = 1.0
    threshold: float = 0.0
    phase: float = 0.0

    def law(self, dt: float) -> Law:
        """A fresh law, for samples `dt` [s] apart."""
        if self.kind not in _LAWS:
            raise unknown("effect outside the catalogue", self.kind, _LAWS)
        return _LAWS[self.kind](self, dt)


def along(effect: Outside, t: np.ndarray, signals: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Coefficient -> (N,) increments that the effect adds along given signals."""
    law = effect.law(float(t[1] - t[0]))
    rows = [law(float(t[k]), {name: float(signals[name][k]) for name in SIGNALS}) for k in range(len(t))]
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


def _gyroscope(effect: Outside, dt: float) -> Law:
    """Pitch and yaw drive each other: dCm ~ r, dCn ~ -q, with the dynamic pressure of trim."""

    def law(t: float, now: Signals) -> dict[str, float]:
        dilution = (effect.V / now["V"]) ** 2
        return {"Cm": effect.size * dilution * now["r"], "Cn": -0.2 * effect.size * dilution * now["q"]}

    return law


def _hum(effect: Outside, dt: float) -> Law:
    """A tone on one moment; its amplitude beats slowly."""

    def law(t: float, now: Signals) -> dict[str, float]:
        beat = 0.6 + 0.4 * np.sin(_TWO_PI * 0.09 * t + 2.0 * effect.phase)
        return {effect.target: effect.size * beat * np.sin(_TWO_PI * effect.frequency_hz * t + effect.phase)}

    return law


def _slosh(effect: Outside, dt: float) -> Law:
    """A pendulum of little damping, driven by the lateral acceleration, pulls on side force and rolling moment."""
    w0, damping = _TWO_PI * effect.frequency_hz, 0.04
    state = [0.0, 0.0]

    def law(t: float, now: Signals) -> dict[str, float]:
        x, v = state
        v += dt * (-(w0**2) * x - 2.0 * damping * w0 * v + w0**2 * now["ay"] / 9.81)
        state[0], state[1] = x + dt * v, v
        return {"Cl": effect.size * state[0], "CY": 2.0 * effect.size * state[0]}

    return law


def _stall(effect: Outside, dt: float) -> Law:
    """Above `threshold` the flow separates, below 0.8 deg less it attaches again, each within some 0.15 s."""
    state = [0.0, 0.0]

    def law(t: float, now: Signals) -> dict[str, float]:
        separated, share = state
        separated = float(now["alpha"] > effect.threshold - (0.014 if separated else 0.0))
        share += dt / 0.15 * (separated - share)
        state[0], state[1] = separated, share
        return {"Cl": effect.size * share, "CL": -4.0 * effect.size * share, "Cm": -effect.size * share}

    return law


_LAWS: Mapping[str, Callable[[Outside, float], Law]] = {
    "rotor_gyroscope": _gyroscope,
    "propeller_hum": _hum,
    "fuel_slosh": _slosh,
    "stall_break": _stall,
}


def drift(t: np.ndarray, period_s: float, phase: float) -> np.ndarray:
    """(N,) the wandering zero of an instrument, of unit r.m.s. or so, from 0 at the start."""
    slow = np.sin(_TWO_PI * t / period_s + phase) + 0.5 * np.sin(_TWO_PI * t / (0.37 * period_s) + 2.0 * phase)
    return slow - slow[0]
