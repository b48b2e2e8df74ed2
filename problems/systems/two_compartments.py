"""A drug in blood and tissue: amounts A1, A2 [mg], infused [mg/h], read as concentrations [mg/l]; time in h."""

from __future__ import annotations

from casid.model.system import Model, define_model
from problems.systems.system import System, levels

# rates of elimination and exchange [1/h], volumes of distribution [l]
NOMINAL = {"k10": 0.25, "k12": 0.35, "k21": 0.30, "V1": 20.0, "V2": 25.0}


def _rates(x, u, p):
    exchange = p["k12"] * x["A1"] - p["k21"] * x["A2"]
    return {"A1": u["infusion"] - p["k10"] * x["A1"] - exchange, "A2": exchange}


def _reads(x, u, p):
    return {"c1": x["A1"] / p["V1"], "c2": x["A2"] / p["V2"]}


def model() -> Model:
    """The volumes are known to 5 %, without which no tissue sample says an amount."""
    return define_model(
        "two compartments",
        states=("A1", "A2"),
        inputs=("infusion",),
        parameters=NOMINAL,
        prior_std={"V1": 1.0, "V2": 1.25},
        outputs=("c1", "c2"),
        dynamics=lambda s: _rates(vars(s), vars(s), vars(s)),
        output=lambda s: _reads(vars(s), vars(s), vars(s)),
        state_scale={"A1": 100.0, "A2": 100.0},
    )


SYSTEM = System(
    name="two compartments",
    model=model,
    rates=_rates,
    reads=_reads,
    inputs=lambda rng, t: {"infusion": levels(rng, t, 0.0, 60.0, 3.0)},
    start=lambda rng: {"A1": float(rng.uniform(0.0, 60.0)), "A2": float(rng.uniform(0.0, 60.0))},
    sigma={"c1": 0.05, "c2": 0.05},
    step=0.1,
    duration=48.0,
    faults=(
        ("missing_term", "A1", "A1^2", 0.0004, 0.0009),  # elimination that saturates
        ("missing_term", "A1", "A1*A2", -0.0008, -0.0003),
        ("input_delay", "infusion", "", 0.4, 1.0),
        ("actuator_lag", "infusion", "", 0.4, 1.2),
        ("input_limit", "infusion", "above", 35.0, 45.0),
        ("backlash", "infusion", "", 3.0, 7.0),
        ("sensor_bias", "c1", "", 0.3, 0.8),
        ("sensor_delay", "c2", "", 0.4, 1.0),
        ("sensor_lag", "c1", "", 0.4, 1.0),
        ("sensor_stuck", "c2", "", 1.0, 1.0),
        ("parameter_change", "k10", "", 0.05, 0.1),
        ("parameter_change", "k12", "", -0.12, -0.06),
    ),
)
