"""A pendulum that hangs from a cart: position x [m] and angle phi [rad] are read, a force F [N] pushes the cart."""

from __future__ import annotations

import casadi as ca
import numpy as np

from casid.model.system import Model, define_model
from problems.systems.system import System, levels

GRAVITY = 9.81  # m/s2
# masses of cart and bob [kg], length [m], friction of the cart [N s/m]
NOMINAL = {"M": 1.0, "m": 0.3, "l": 0.5, "b": 0.8}


def _rates(x, u, p, sin=np.sin, cos=np.cos):
    s, c, w = sin(x["phi"]), cos(x["phi"]), x["w"]
    push = u["F"] - p["b"] * x["v"]
    v = (push + p["m"] * s * (p["l"] * w * w + GRAVITY * c)) / (p["M"] + p["m"] * s * s)
    return {"x": x["v"], "v": v, "phi": w, "w": -(v * c + GRAVITY * s) / p["l"]}


def model() -> Model:
    """The cart is known to 5 %, which makes the force one; kinematics are beyond doubt."""
    return define_model(
        "pendulum on a cart",
        states=("x", "v", "phi", "w"),
        inputs=("F",),
        parameters=NOMINAL,
        prior_std={"M": 0.05},
        outputs=("x", "phi"),
        dynamics=lambda s: _rates(vars(s), vars(s), vars(s), ca.sin, ca.cos),
        output=lambda s: {"x": s.x, "phi": s.phi},
        state_scale={"v": 0.5, "w": 2.0},
    )


SYSTEM = System(
    name="pendulum on a cart",
    model=model,
    rates=_rates,
    reads=lambda x, u, p: {"x": x["x"], "phi": x["phi"]},
    inputs=lambda rng, t: {"F": levels(rng, t, -4.0, 4.0, 0.5)},
    start=lambda rng: {"x": 0.0, "v": 0.0, "phi": float(rng.uniform(-0.3, 0.3)), "w": 0.0},
    sigma={"x": 0.003, "phi": 0.005},
    step=0.02,
    duration=16.0,
    exact=("x", "phi"),
    matters={"x": 0.02},
    faults=(
        ("missing_term", "w", "w", -0.3, -0.1),  # friction of the hinge
        ("missing_term", "v", "x", -1.5, -0.5),  # a spring to the wall
        ("dry_friction", "v", "", 0.2, 0.5),  # of the rails
        ("dry_friction", "w", "", 0.2, 0.5),
        ("hysteresis", "v", "", 0.2, 0.5),
        ("dead_zone", "F", "", 0.3, 0.8),
        ("input_limit", "F", "above", 1.5, 2.5),
        ("input_delay", "F", "", 0.03, 0.1),
        ("actuator_lag", "F", "", 0.04, 0.12),
        ("rate_limit", "F", "", 5.0, 12.0),
        ("second_order_actuator", "F", "", 0.05, 0.12),
        ("sensor_bias", "phi", "", 0.1, 0.25),
        ("sensor_delay", "phi", "", 0.03, 0.08),
        ("sensor_lag", "x", "", 0.04, 0.1),
        ("sensor_stuck", "phi", "", 1.0, 1.0),
        ("parameter_change", "m", "", 0.06, 0.12),
        ("parameter_change", "b", "", 0.2, 0.4),
    ),
)
