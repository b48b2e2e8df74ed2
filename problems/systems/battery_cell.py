"""A battery cell with one RC pair: state of charge and voltage v1 [V] of the pair under a current i [A].

The voltage v [V] is read.
"""

from __future__ import annotations

from casid.model.system import Model, define_model
from problems.systems.system import System, levels

CAPACITY = 3600.0 * 2.5  # A s
NOMINAL = {"R0": 0.02, "R1": 0.015, "C1": 2000.0}  # resistances [ohm], capacitance [F]


def _rates(x, u, p):
    return {"soc": -u["i"] / CAPACITY, "v1": u["i"] / p["C1"] - x["v1"] / (p["R1"] * p["C1"])}


def model() -> Model:
    """Every number is known to 20 %; the voltage at rest is a line."""
    return define_model(
        "battery cell",
        states=("soc", "v1"),
        inputs=("i",),
        parameters=NOMINAL,
        prior_std={name: 0.2 * value for name, value in NOMINAL.items()},
        outputs=("v",),
        dynamics=lambda s: _rates(vars(s), vars(s), vars(s)),
        output=lambda s: {"v": 3.4 + 0.7 * s.soc - s.R0 * s.i - s.v1},
    )


def _reads(x, u, p):
    return {"v": 3.4 + 0.7 * x["soc"] - p["R0"] * u["i"] - x["v1"]}


SYSTEM = System(
    name="battery cell",
    model=model,
    rates=_rates,
    reads=_reads,
    inputs=lambda rng, t: {"i": levels(rng, t, -2.0, 5.0, 40.0)},
    start=lambda rng: {"soc": 0.8, "v1": 0.0},
    sigma={"v": 0.002},
    step=1.0,
    duration=600.0,
    faults=(
        ("missing_term", "v1", "v1", -0.03, -0.01),
        ("missing_term", "soc", "v1", -0.004, -0.002),  # a leak
        ("input_offset", "i", "", 0.15, 0.4),  # the shunt of the current
        ("input_scale", "i", "", 0.1, 0.25),
        ("sensor_delay", "v", "", 2.0, 6.0),
        ("sensor_lag", "v", "", 2.0, 6.0),
        ("parameter_change", "R0", "", 0.008, 0.02),  # in the cold
        ("parameter_change", "R1", "", 0.006, 0.012),
    ),
)
