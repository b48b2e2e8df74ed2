"""A ship in Nomoto's model: heading psi [rad] and yaw rate r [rad/s] follow the rudder [rad] (Nomoto, 1957)."""

from __future__ import annotations

from casid.model.system import Model, define_model
from problems.systems.system import System, levels

NOMINAL = {"K": 0.06, "T": 12.0}  # yaw rate per rudder [1/s], time constant [s]


def _rates(x, u, p):
    return {"psi": x["r"], "r": (p["K"] * u["rudder"] - x["r"]) / p["T"]}


def model() -> Model:
    """Both numbers are known to 10 %."""
    return define_model(
        "ship",
        states=("psi", "r"),
        inputs=("rudder",),
        parameters=NOMINAL,
        prior_std={name: 0.1 * value for name, value in NOMINAL.items()},
        outputs=("psi", "r"),
        dynamics=lambda s: _rates(vars(s), vars(s), vars(s)),
        output=lambda s: {"psi": s.psi, "r": s.r},
    )


SYSTEM = System(
    name="ship",
    model=model,
    rates=_rates,
    reads=lambda x, u, p: x,
    inputs=lambda rng, t: {"rudder": levels(rng, t, -0.5, 0.5, 40.0)},
    start=lambda rng: {"psi": 0.0, "r": 0.0},
    sigma={"psi": 0.005, "r": 0.0002},
    step=1.0,
    duration=500.0,
    exact=("psi",),
    matters={"psi": 0.02},
    faults=(
        ("missing_term", "r", "r^3", -250.0, -80.0),  # the hull damps more in hard turns
        ("missing_term", "r", "rudder^3", -0.012, -0.005),  # the rudder stalls
        ("actuator_lag", "rudder", "", 2.0, 6.0),  # the steering gear
        ("input_delay", "rudder", "", 2.0, 5.0),
        ("input_limit", "rudder", "above", 0.2, 0.35),
        ("backlash", "rudder", "", 0.02, 0.06),
        ("sensor_scale", "r", "", 0.05, 0.15),
        ("sensor_bias", "r", "", 0.001, 0.003),
        ("sensor_delay", "psi", "", 2.0, 5.0),
        ("parameter_change", "K", "", 0.008, 0.02),  # another loading
    ),
)
