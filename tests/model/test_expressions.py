"""Simulations that are Python functions of numpy: the truth is the same function of numbers."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np
import pytest

import casid as cs
from casid.errors import InputError
from casid.model.system import Model

DEPTHS, AREAS = [0.0, 0.5, 1.0, 2.0], [1.0, 1.3, 1.4, 2.0]


def simulation(s: Any) -> dict[str, Any]:
    """A tank whose area is a table of its depth, with a valve that opens above a level, in numpy alone."""
    area = np.interp(s.h, DEPTHS, AREAS)
    valve = np.where(s.h > s.level, np.sqrt(np.maximum(s.h - s.level, 1e-6)), 0.0)
    return {"h": (np.clip(s.pump, 0.0, 2.0) - s.drain * np.tanh(s.h) - valve) / area}


def tank(dynamics: Callable[[Any], dict[str, Any]]) -> Model:
    return cs.define_model(
        "tank",
        states=("h",),
        inputs=("pump",),
        parameters={"drain": 0.7, "level": 0.8},
        outputs=("h",),
        dynamics=dynamics,
        output=lambda s: {"h": s.h},
    )


def test_a_numpy_function_is_the_same_as_a_model() -> None:
    """Values to rounding, and its exact Jacobian to what differences of the numbers say."""
    model = tank(simulation)
    both = ca.Function("f", [model.x, model.u, model.p], [model.f, ca.jacobian(model.f, ca.vertcat(model.x, model.p))])
    rng, step = np.random.default_rng(5), 1e-6

    def numbers(h: float, pump: float, drain: float, level: float) -> float:
        return float(simulation(SimpleNamespace(h=h, pump=pump, drain=drain, level=level))["h"])

    for h, pump in zip(rng.uniform(0.05, 1.95, 50), rng.uniform(-0.5, 2.5, 50), strict=True):
        at = np.array([h, pump, 0.7, 0.8])
        value, slopes = (one.full()[0] for one in both(h, pump, [0.7, 0.8]))
        assert value[0] == pytest.approx(numbers(*at), rel=1e-13)
        for slope, i in zip(slopes, (0, 2, 3), strict=True):
            moved = step * np.eye(4)[i]
            assert slope == pytest.approx((numbers(*at + moved) - numbers(*at - moved)) / (2 * step), abs=1e-6)


def test_what_cannot_be_traced_is_said_in_one_line() -> None:
    with pytest.raises(InputError, match="write both cases") as caught:
        tank(lambda s: {"h": s.pump if s.h > 1.0 else -s.h})
    assert "\n" not in str(caught.value) and "dynamics" in str(caught.value)
