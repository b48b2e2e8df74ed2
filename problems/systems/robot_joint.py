"""A motor with a gear that turns a link against gravity: angle q [rad] and rate w [rad/s] under a voltage V [V]."""

from __future__ import annotations

import casadi as ca
import numpy as np

from casid.model.library import Library
from casid.model.system import Model, define_model
from problems.systems.system import System, levels

# per volt [rad/s2/V], of the rate [1/s], of a level link [rad/s2]
NOMINAL = {"gain": 14.0, "damping": 3.0, "gravity": 20.0}
CREEP = 0.05  # rad/s, about which dry friction reverses


def _rates(x, u, p, sin=np.sin):
    return {"q": x["w"], "w": p["gain"] * u["V"] - p["damping"] * x["w"] - p["gravity"] * sin(x["q"])}


def model() -> Model:
    """Gain and gravity are known to 10 %, the damping to 20 %."""
    return define_model(
        "robot joint",
        states=("q", "w"),
        inputs=("V",),
        parameters=NOMINAL,
        prior_std={"gain": 1.4, "damping": 0.6, "gravity": 2.0},
        outputs=("q", "w"),
        dynamics=lambda s: _rates(vars(s), vars(s), vars(s), ca.sin),
        output=lambda s: {"q": s.q, "w": s.w},
    )


SYSTEM = System(
    name="robot joint",
    model=model,
    rates=_rates,
    reads=lambda x, u, p: x,
    inputs=lambda rng, t: {"V": levels(rng, t, -3.0, 3.0, 0.7)},
    start=lambda rng: {"q": 0.0, "w": 0.0},
    sigma={"q": 0.005, "w": 0.1},
    step=0.01,
    duration=8.0,
    exact=("q",),
    regressors={"tanh(w)": lambda s: np.tanh(s["w"] / CREEP)},
    library=Library(regressors={"tanh(w)": lambda s: ca.tanh(s.w / CREEP)}),
    faults=(
        ("missing_term", "w", "tanh(w)", -6.0, -2.0),  # dry friction
        ("missing_term", "w", "w^3", -0.1, -0.03),
        ("dead_zone", "V", "", 0.2, 0.6),
        ("input_limit", "V", "above", 1.5, 2.2),
        ("input_delay", "V", "", 0.02, 0.06),
        ("actuator_lag", "V", "", 0.02, 0.08),
        ("sensor_bias", "q", "", 0.05, 0.15),
        ("sensor_scale", "w", "", 0.08, 0.2),
        ("sensor_delay", "q", "", 0.02, 0.06),
        ("sensor_lag", "w", "", 0.02, 0.06),
        ("parameter_change", "gravity", "", 2.0, 5.0),  # a load in the hand
    ),
)
