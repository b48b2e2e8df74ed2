"""A DC motor with friction: current i [A] and speed omega [rad/s] under a voltage V [V]."""

from __future__ import annotations

import casadi as ca
import numpy as np

from casid.model.library import Library
from casid.model.system import Model, define_model
from problems.systems.system import System, levels

# resistance [ohm], inductance [H], torque constant [N m/A], inertia [kg m2], viscous [N m s] and dry friction [N m]
NOMINAL = {"R": 2.0, "L": 0.1, "K": 0.1, "J": 2.0e-3, "b": 1.0e-3, "Tc": 0.03}
CREEP = 0.5  # rad/s, about which dry friction reverses


def _rates(x, u, p, tanh=np.tanh):
    friction = p["b"] * x["omega"] + p["Tc"] * tanh(x["omega"] / CREEP)
    return {
        "i": (u["V"] - p["R"] * x["i"] - p["K"] * x["omega"]) / p["L"],
        "omega": (p["K"] * x["i"] - friction) / p["J"],
    }


def model() -> Model:
    """Inductance and inertia are known to 5 %; everything else is fitted from its nominal value."""
    return define_model(
        "DC motor",
        states=("i", "omega"),
        inputs=("V",),
        parameters=NOMINAL,
        prior_std={name: 0.05 * NOMINAL[name] for name in ("L", "J")},
        outputs=("i", "omega"),
        dynamics=lambda s: _rates(vars(s), vars(s), vars(s), ca.tanh),
        output=lambda s: {"i": s.i, "omega": s.omega},
    )


SYSTEM = System(
    name="DC motor",
    model=model,
    rates=_rates,
    reads=lambda x, u, p: x,
    inputs=lambda rng, t: {"V": levels(rng, t, -10.0, 10.0, 0.4)},
    start=lambda rng: {"i": 0.0, "omega": 0.0},
    sigma={"i": 0.02, "omega": 0.3},
    step=0.01,
    duration=8.0,
    regressors={"omega*|omega|": lambda s: s["omega"] * np.abs(s["omega"])},
    library=Library(regressors={"omega*|omega|": lambda s: s.omega * ca.fabs(s.omega)}),
    faults=(
        ("missing_term", "omega", "omega*|omega|", -0.03, -0.01),  # a fan on the shaft
        ("dead_zone", "V", "", 0.6, 1.5),
        ("input_limit", "V", "above", 4.0, 6.0),
        ("input_limit", "V", "below", -6.0, -4.0),
        ("input_delay", "V", "", 0.02, 0.06),
        ("actuator_lag", "V", "", 0.02, 0.06),
        ("backlash", "V", "", 0.4, 1.0),
        ("hysteresis", "V", "", 0.6, 1.2),
        ("rate_limit", "V", "", 15.0, 40.0),
        ("second_order_actuator", "V", "", 0.03, 0.08),
        ("sensor_bias", "i", "", 0.2, 0.5),
        ("sensor_delay", "omega", "", 0.03, 0.08),
        ("sensor_lag", "omega", "", 0.03, 0.1),
        ("sensor_stuck", "omega", "", 1.0, 1.0),
        ("parameter_change", "R", "", 0.3, 0.6),  # a hot winding
        ("parameter_change", "Tc", "", 0.015, 0.03),
    ),
)
