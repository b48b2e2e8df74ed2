"""Four tanks in two columns, two pumps, two three-way valves (Johansson, IEEE Trans. Control Syst. Technol. 8 (2000)).

Levels h1 to h4 [cm], pump voltages v1 and v2 [V]. The upper tanks 3 and 4 run into the lower ones.
"""

from __future__ import annotations

import numpy as np

from casid.model.library import Library
from casid.model.system import Model, define_model
from problems.systems.system import System, levels

AREA = {"1": 28.0, "2": 32.0, "3": 28.0, "4": 32.0}  # cm2
GRAVITY = 981.0  # cm/s2
NOMINAL = {"a1": 0.071, "a2": 0.057, "a3": 0.071, "a4": 0.057, "k1": 3.33, "k2": 3.35, "g1": 0.70, "g2": 0.60}
SQRT_SMOOTH = 1e-4  # cm2: an empty tank has a slope


def _out(a, h):
    return a * (2.0 * GRAVITY) ** 0.5 * (h * h + SQRT_SMOOTH) ** 0.25


def _rates(x, u, p):
    into3, into4 = (1.0 - p["g2"]) * p["k2"] * u["v2"], (1.0 - p["g1"]) * p["k1"] * u["v1"]
    out = {i: _out(p[f"a{i}"], x[f"h{i}"]) for i in "1234"}
    into = {
        "1": out["3"] + p["g1"] * p["k1"] * u["v1"],
        "2": out["4"] + p["g2"] * p["k2"] * u["v2"],
        "3": into3,
        "4": into4,
    }
    return {f"h{i}": (into[i] - out[i]) / AREA[i] for i in "1234"}


def model() -> Model:
    """All eight constants are known to 5 %."""
    return define_model(
        "quadruple tank",
        states=("h1", "h2", "h3", "h4"),
        inputs=("v1", "v2"),
        parameters=NOMINAL,
        prior_std={name: 0.05 * value for name, value in NOMINAL.items()},
        outputs=("h1", "h2", "h3", "h4"),
        dynamics=lambda s: _rates(vars(s), vars(s), vars(s)),
        output=lambda s: {name: getattr(s, name) for name in ("h1", "h2", "h3", "h4")},
    )


SYSTEM = System(
    name="quadruple tank",
    model=model,
    rates=_rates,
    reads=lambda x, u, p: x,
    inputs=lambda rng, t: {name: levels(rng, t, 1.5, 5.0, 60.0) for name in ("v1", "v2")},
    start=lambda rng: dict(zip(("h1", "h2", "h3", "h4"), rng.uniform([10, 10, 2, 2], [14, 14, 4, 4]), strict=True)),
    sigma=dict.fromkeys(("h1", "h2", "h3", "h4"), 0.05),
    step=2.0,
    duration=800.0,
    regressors={"sqrt(h3)": lambda s: np.sqrt(s["h3"]), "sqrt(h4)": lambda s: np.sqrt(s["h4"])},
    library=Library(
        regressors={
            "sqrt(h3)": lambda s: (s.h3**2 + SQRT_SMOOTH) ** 0.25,
            "sqrt(h4)": lambda s: (s.h4**2 + SQRT_SMOOTH) ** 0.25,
        }
    ),
    faults=(
        ("missing_term", "h3", "sqrt(h3)", -0.05, -0.02),  # a leak
        ("missing_term", "h4", "sqrt(h4)", -0.05, -0.02),
        ("actuator_lag", "v1", "", 10.0, 30.0),
        ("input_delay", "v2", "", 8.0, 20.0),
        ("input_limit", "v1", "above", 3.2, 4.0),
        ("rate_limit", "v2", "", 0.02, 0.06),
        ("sensor_bias", "h2", "", 1.0, 2.0),
        ("sensor_lag", "h1", "", 15.0, 40.0),
        ("sensor_delay", "h3", "", 10.0, 25.0),
        ("sensor_stuck", "h4", "", 1.0, 1.0),
        ("parameter_change", "k1", "", -0.6, -0.3),
        ("parameter_change", "g2", "", 0.06, 0.12),
    ),
)
