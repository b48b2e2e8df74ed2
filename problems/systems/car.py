"""The single-track model of a car at 25 m/s: lateral velocity v [m/s] and yaw rate r [rad/s] under the steering [rad].

Lateral acceleration [m/s2] and yaw rate are read.
"""

from __future__ import annotations

from casid.model.system import Model, define_model
from problems.systems.system import System, levels

SPEED = 25.0  # m/s
AHEAD = 1.2  # m, axles from the c.g.
BEHIND = 1.5
MASS = 1500.0  # kg
INERTIA = 2500.0  # kg m2
NOMINAL = {"Cf": 8e4, "Cr": 9e4}  # cornering stiffness [N/rad]


def _forces(x, u, p):
    front = p["Cf"] * (u["steer"] - (x["v"] + AHEAD * x["r"]) / SPEED)
    rear = -p["Cr"] * (x["v"] - BEHIND * x["r"]) / SPEED
    return front, rear


def _rates(x, u, p):
    front, rear = _forces(x, u, p)
    return {
        "v": (front + rear) / MASS - SPEED * x["r"],
        "r": (AHEAD * front - BEHIND * rear) / INERTIA,
    }


def _reads(x, u, p):
    return {"ay": sum(_forces(x, u, p)) / MASS, "r": x["r"]}


def model() -> Model:
    """Both stiffnesses are known to 10 %."""
    return define_model(
        "car",
        states=("v", "r"),
        inputs=("steer",),
        parameters=NOMINAL,
        prior_std={name: 0.1 * value for name, value in NOMINAL.items()},
        outputs=("ay", "r"),
        dynamics=lambda s: _rates(vars(s), vars(s), vars(s)),
        output=lambda s: _reads(vars(s), vars(s), vars(s)),
        state_scale={"v": 0.5, "r": 0.1},
    )


SYSTEM = System(
    name="car",
    model=model,
    rates=_rates,
    reads=_reads,
    inputs=lambda rng, t: {"steer": levels(rng, t, -0.03, 0.03, 1.0)},
    start=lambda rng: {"v": 0.0, "r": 0.0},
    sigma={"ay": 0.05, "r": 0.002},
    step=0.02,
    duration=12.0,
    faults=(
        ("missing_term", "r", "r^3", -60.0, -20.0),  # tyres that saturate
        ("missing_term", "v", "v^3", 1.0, 3.0),
        ("input_delay", "steer", "", 0.04, 0.1),
        ("actuator_lag", "steer", "", 0.05, 0.12),
        ("dead_zone", "steer", "", 0.002, 0.005),
        ("backlash", "steer", "", 0.002, 0.005),
        ("hysteresis", "steer", "", 0.003, 0.006),
        ("sensor_bias", "r", "", 0.01, 0.03),
        ("sensor_scale", "ay", "", 0.08, 0.2),
        ("sensor_lag", "ay", "", 0.05, 0.15),
        ("sensor_delay", "r", "", 0.04, 0.1),
        ("parameter_change", "Cr", "", -2e4, -1e4),  # a soft tyre
    ),
)
