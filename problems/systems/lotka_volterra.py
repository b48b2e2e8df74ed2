"""Prey and predators (Lotka 1925, Volterra 1926), in thousands, with a share of the prey harvested. Time in years."""

from __future__ import annotations

from casid.model.system import Model, define_model
from problems.systems.system import System, levels

# birth of prey, loss of prey per predator, birth of predators per prey, death of predators [1/year]
NOMINAL = {"a": 1.0, "b": 0.5, "c": 0.4, "d": 0.6}


def _rates(x, u, p):
    meetings = x["prey"] * x["pred"]
    return {
        "prey": p["a"] * x["prey"] - p["b"] * meetings - u["harvest"] * x["prey"],
        "pred": p["c"] * meetings - p["d"] * x["pred"],
    }


def model() -> Model:
    """Nothing is known but the nominal values, from which all four are fitted."""
    return define_model(
        "Lotka-Volterra",
        states=("prey", "pred"),
        inputs=("harvest",),
        parameters=NOMINAL,
        outputs=("prey", "pred"),
        dynamics=lambda s: _rates(vars(s), vars(s), vars(s)),
        output=lambda s: {"prey": s.prey, "pred": s.pred},
    )


SYSTEM = System(
    name="Lotka-Volterra",
    model=model,
    rates=_rates,
    reads=lambda x, u, p: x,
    inputs=lambda rng, t: {"harvest": levels(rng, t, 0.0, 0.5, 1.5)},
    start=lambda rng: {"prey": float(rng.uniform(0.8, 2.5)), "pred": float(rng.uniform(0.8, 2.0))},
    sigma={"prey": 0.03, "pred": 0.03},
    step=0.05,
    duration=24.0,
    faults=(
        ("missing_term", "prey", "prey^2", -0.1, -0.03),  # grass is scarce
        ("missing_term", "pred", "pred^2", -0.1, -0.03),
        ("input_delay", "harvest", "", 0.2, 0.6),
        ("actuator_lag", "harvest", "", 0.2, 0.8),
        ("input_limit", "harvest", "above", 0.25, 0.35),
        ("sensor_bias", "prey", "", 0.15, 0.4),
        ("sensor_delay", "pred", "", 0.2, 0.5),
        ("sensor_lag", "pred", "", 0.2, 0.6),
        ("sensor_stuck", "prey", "", 1.0, 1.0),
        ("parameter_change", "a", "", 0.1, 0.25),
        ("parameter_change", "d", "", 0.08, 0.2),
    ),
)
