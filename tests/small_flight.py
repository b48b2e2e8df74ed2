"""A small flight with a known cause, for the tests of the report and of `casid diagnose`."""

from __future__ import annotations

import numpy as np

from casid.model.aircraft import Aircraft
from casid.model.dynamics import aircraft_model
from casid.model.simulate import simulate
from casid.model.trim import trim
from casid.records.record import Record
from problems.do328 import V_TRIM, do328

NAMES = ("first", "second")
HIDDEN = 8.0  # Cm_alpha^2 [1/rad2] that flies and that the aircraft file does not know
NOISE = {
    "V": 0.1,
    "alpha": 1e-3,
    "beta": 1e-3,
    "p": 5e-4,
    "q": 5e-4,
    "r": 5e-4,
    "phi": 5e-4,
    "theta": 5e-4,
    "ax": 0.02,
    "ay": 0.02,
    "az": 0.05,
    "delta_e": 1e-4,
    "delta_a": 1e-4,
    "delta_r": 1e-4,
    "thrust": 30.0,
}
DURATION_S, RATE_HZ = 8.0, 25.0


def aircraft_file() -> Aircraft:
    """What the user believes: the Do 328 as it was published."""
    return do328()


def records(seed: int = 7, rudder: float = 0.05) -> list[Record]:
    """Two records of the Do 328 with the hidden term: 3-2-1-1 on all surfaces, white noise on all that is measured;
    `rudder` [rad] is how far that one moves."""
    rng = np.random.default_rng(seed)
    truth = aircraft_file().with_terms({"Cm": {"alpha^2": HIDDEN}})
    model, level = aircraft_model(truth), trim(truth, V=V_TRIM, altitude=3000.0)
    t = np.arange(0.0, DURATION_S, 1.0 / RATE_HZ)
    found = []
    for name, sign in zip(NAMES, (1.0, -1.0), strict=True):
        channels = {channel: np.full(len(t), value) for channel, value in level.inputs.items()}
        channels["delta_e"] = channels["delta_e"] + sign * 0.05 * multistep(t, 0.4, 0.5)
        channels["delta_a"] = channels["delta_a"] + 0.05 * multistep(t, 3.5, 0.3)
        channels["delta_r"] = channels["delta_r"] + sign * rudder * multistep(t, 5.0, 0.3)
        flown = simulate(model, Record(name=name, t=t, channels=channels), level.state).as_record(name)
        noisy = {o: flown[o] + rng.normal(0.0, sigma, len(t)) for o, sigma in NOISE.items()}
        found.append(flown.without(*(c for c in flown.channels if c not in (*channels, *NOISE))).with_channels(**noisy))
    return found


def multistep(t: np.ndarray, start: float, step: float) -> np.ndarray:
    """The 3-2-1-1 input: steps of 3, 2, 1 and 1 times `step` seconds, of size 1 and alternating sign, through a servo
    of time constant 0.08 s, as a surface moves."""
    edges = start + step * np.cumsum([0.0, 3.0, 2.0, 1.0, 1.0])
    heights = (1.0, -2.0, 2.0, -2.0, 1.0)
    return sum(h * -np.expm1(-np.maximum(t - edge, 0.0) / 0.08) for h, edge in zip(heights, edges, strict=True))
