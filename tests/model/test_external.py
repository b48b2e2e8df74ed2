"""A simulation outside CasADi: the truth is the same equations as expressions, and their derivatives by hand."""

from __future__ import annotations

import pickle
from collections.abc import Mapping
from typing import Any

import casadi as ca
import numpy as np
import pytest

import casid as cs
from casid.errors import InputError
from casid.model.system import Model
from casid.records.record import Record

NAMES = ("h", "pump", "drain")


def plain(v: Mapping[str, np.ndarray]) -> dict[str, Any]:
    """A draining tank, N points at once, by a loop that nothing can trace."""
    flow = np.array([float(d) * np.tanh(float(h)) for h, d in zip(v["h"], v["drain"], strict=True)])
    return {"h": v["pump"] - flow}


def tank(dynamics: Any) -> Model:
    return cs.define_model(
        "tank",
        states=("h",),
        inputs=("pump",),
        parameters={"drain": 1.0},
        outputs=("h", "out"),
        dynamics=dynamics,
        output=lambda s: {"h": s.h, "out": s.drain * np.tanh(s.h)},
    )


def traced() -> Model:
    return tank(lambda s: {"h": s.pump - s.drain * np.tanh(s.h)})


def records() -> list[Record]:
    """Two of 8 s; the flow meter reads 0.2 too much, the drain is 1.2."""
    found = []
    for k in range(2):
        rng, t = np.random.default_rng(k), np.arange(0.0, 8.0, 0.1)
        pump = np.interp(t, np.arange(9.0), rng.uniform(0.0, 1.1, 9))
        flown = cs.simulate(
            traced(), Record(name=f"m{k}", t=t, channels={"pump": pump}), [0.4], {"drain": 1.2}
        ).as_record(f"m{k}")
        noise = rng.normal(scale=0.005, size=(2, len(t)))
        found.append(flown.with_channels(h=flown["h"] + noise[0], out=flown["out"] + 0.2 + noise[1]))
    return found


def test_all_columns_of_a_jacobian_cost_one_batch() -> None:
    """Of three arguments six points, central differences, however many outputs and columns are asked for."""
    counted = []

    def product(v: Mapping[str, np.ndarray]) -> dict[str, Any]:
        counted.append(len(v["a"]))
        return {"f": v["a"] * v["b"] * v["c"], "g": v["a"] - v["c"]}

    x = ca.SX.sym("x", 3)
    space = type("S", (), {name: x[i] for i, name in enumerate("abc")})
    found = cs.external_function(product, ("a", "b", "c"), ("f", "g"))(space)
    both = ca.vertcat(found["f"], found["g"])
    slope = ca.Function("slope", [x], [ca.jacobian(both, x)])
    for at in ([1.0, 2.0, 3.0], [2.0, 2.0, 5.0]):
        a, b, c = at
        counted.clear()
        np.testing.assert_allclose(slope(at).full(), [[b * c, a * c, a * b], [1.0, 0.0, -1.0]], rtol=1e-8, atol=1e-9)
        assert counted == [6]


def test_derivatives_of_first_and_second_order() -> None:
    """Of f = sin(a) b^2 exp(c) and g = a b + c^3 at arguments of sizes 1, 1000 and 0.01."""
    f = cs.external_function(
        lambda v: {
            "f": np.sin(v["a"]) * (v["b"] / 1e3) ** 2 * np.exp(1e2 * v["c"]),
            "g": v["a"] * v["b"] / 1e3 + (1e2 * v["c"]) ** 3,
        },
        ("a", "b", "c"),
        ("f", "g"),
        sizes={"b": 1e3, "c": 1e-2},
    )
    x = ca.SX.sym("x", 3)
    space = type("S", (), {name: x[i] for i, name in enumerate("abc")})
    both = f(space)
    scaled = [x[0], x[1] / 1e3, 1e2 * x[2]]
    truth = {
        "f": ca.sin(scaled[0]) * scaled[1] ** 2 * ca.exp(scaled[2]),
        "g": scaled[0] * scaled[1] + scaled[2] ** 3,
    }
    size, at = ca.DM([1.0, 1e3, 1e-2]), [0.7, 1300.0, -0.004]
    for name, expression in truth.items():
        for order, tolerance in ((ca.gradient, 1e-9), (lambda y, z: ca.hessian(y, z)[0], 1e-6)):
            of = ca.Function("of", [x], [order(both[name], x), order(expression, x)])
            found, exact = (np.asarray(one.full()) for one in of(at))
            scale = size.full() if found.shape[1] == 1 else size.full() @ size.full().T
            np.testing.assert_allclose(found * scale, exact * scale, atol=tolerance)


@pytest.mark.slow
def test_a_fault_is_found_through_it_as_through_expressions() -> None:
    flown = records()
    opaque = tank(cs.external_function(plain, NAMES, ("h",)))
    found = [cs.diagnose(model, flown) for model in (traced(), opaque)]
    for one in found:
        assert [(c.kind, c.target) for c in one.causes] == [("sensor_bias", "out")]
        assert one.causes[0].value == pytest.approx(0.2, abs=0.01)
    assert found[1].causes[0].value == pytest.approx(found[0].causes[0].value, rel=1e-6)
    drains = [{p.name: p.extended for p in one.parameters}["drain"] for one in found]
    assert drains[1] == pytest.approx(drains[0], rel=1e-6)


@pytest.mark.parametrize(
    ("function", "says"),
    [
        (lambda v: {"g": v["h"]}, "returned no 'h'"),
        (lambda v: v["h"], "expected arrays by name"),
        (lambda v: {"h": np.zeros(7)}, r"shape \(7,\) for 2 points"),
        (lambda v: {"h": v["h"] * v["q"]}, "looks at 'q', which is not among what it takes: h, pump, drain"),
    ],
)
def test_a_wrong_function_is_said_before_it_runs(function: Any, says: str) -> None:
    with pytest.raises(InputError, match=says):
        cs.external_function(function, NAMES, ("h",))


def test_it_cannot_be_kept() -> None:
    with pytest.raises(InputError, match="cannot be kept"):
        pickle.dumps(tank(cs.external_function(plain, NAMES, ("h",))))


def test_bad_arguments() -> None:
    for arguments, says in (
        (("plain", NAMES, ("h",)), "expected one of arrays by name"),
        ((plain, (), ("h",)), "one name at least"),
        ((plain, NAMES, ("h",), {"hh": 1.0}), "unknown name 'hh'"),
        ((plain, NAMES, ("h",), {"h": 0.0}), "size of 'h'"),
    ):
        with pytest.raises(InputError, match=says):
            cs.external_function(*arguments)


def test_two_functions_of_the_same_arguments_stay_two() -> None:
    """One for the dynamics and one for the output: x' = a (1 - x), y = a^2 x, seen through as expressions are."""
    takes, t = ("x", "a"), np.arange(0.0, 3.0, 0.05)

    def model(dynamics: Any, output: Any) -> Model:
        return cs.define_model(
            "m", states=("x",), inputs=(), parameters={"a": 1.0}, outputs=("x",), dynamics=dynamics, output=output
        )

    plain = model(lambda s: {"x": s.a * (1.0 - s.x)}, lambda s: {"x": s.a**2 * s.x})
    opaque = model(
        cs.external_function(lambda v: {"x": v["a"] * (1.0 - v["x"])}, takes, ("x",)),
        cs.external_function(lambda v: {"x": v["a"] ** 2 * v["x"]}, takes, ("x",)),
    )
    flown = cs.simulate(plain, Record(name="m", t=t, channels={}), [0.1], {"a": 1.3}).as_record("m")
    record = flown.with_channels(x=flown["x"] + np.random.default_rng(5).normal(scale=0.01, size=len(t)))
    fits = [cs.solve(cs.Problem(one, [record], free=["a"])) for one in (plain, opaque)]
    assert all(fit.converged for fit in fits)
    assert fits[1]["a"].value == pytest.approx(fits[0]["a"].value, rel=1e-7)
    assert fits[1]["a"].std == pytest.approx(fits[0]["a"].std, rel=1e-6)


def test_all_segments_and_samples_are_one_call() -> None:
    """A record of ten times the samples takes about as many calls, each of more points, for the same iterations."""
    calls = []

    def rates(v: Mapping[str, np.ndarray]) -> dict[str, Any]:
        calls.append(len(v["h"]))
        return {"h": v["pump"] - v["drain"] * np.tanh(v["h"])}

    found = []
    for count in (200, 2000):
        t = 0.05 * np.arange(count)
        pump = Record(name="m", t=t, channels={"pump": 0.5 + 0.4 * np.sin(t)})
        flown = cs.simulate(traced(), pump, [0.4], {"drain": 1.2}).as_record("m")
        noise = np.random.default_rng(1).normal(scale=0.01, size=(2, count))
        record = flown.with_channels(h=flown["h"] + noise[0], out=flown["out"] + noise[1])
        problems = [
            cs.Problem(tank(d), [record], free=["drain"]) for d in (cs.external_function(rates, NAMES, ("h",)),)
        ]
        calls.clear()
        fit = cs.solve(problems[0], cs.MultipleShooting(interval=20))
        assert fit.converged
        found.append((len(calls) / fit.iterations, max(calls)))
    assert found[1][0] < 1.5 * found[0][0]
    assert found[1][1] == pytest.approx(10 * found[0][1], rel=0.1)


@pytest.mark.parametrize("method", [cs.SingleShooting(), cs.MultipleShooting(interval=10), cs.Collocation()])
def test_an_error_at_some_points_says_which(method: Any) -> None:
    """The level rises above 0.5, where the function raises: one line with the first such point."""

    def rates(v: Mapping[str, np.ndarray]) -> dict[str, Any]:
        if np.any(v["h"] > 0.5):
            raise ValueError("overflow")
        return {"h": v["pump"] - v["drain"] * np.tanh(v["h"])}

    t = 0.1 * np.arange(60)
    flown = cs.simulate(traced(), Record(name="m", t=t, channels={"pump": np.full(60, 0.9)}), [0.1]).as_record("m")
    opaque = tank(cs.external_function(rates, NAMES, ("h",)))
    with pytest.raises(InputError, match=r"raised ValueError: overflow at h = 0\.[5-9]\d*, pump = 0\.9, drain = 1;"):
        cs.solve(cs.Problem(opaque, [flown], free=["drain"]), method)
    for integrator in ("runge-kutta", "cvodes"):
        with pytest.raises(InputError, match=r"overflow at h = 0\.5\d+, pump = 0\.9, drain = 1;"):
            cs.simulate(opaque, flown, [0.1], integrator=integrator)


def test_a_value_that_is_none_is_traced_to_its_arguments() -> None:
    opaque = tank(cs.external_function(lambda v: {"h": v["pump"] + np.sqrt(0.5 - v["h"])}, NAMES, ("h",)))
    pump = Record(name="m", t=0.1 * np.arange(60), channels={"pump": np.full(60, 3.0)})
    with pytest.raises(InputError, match=r"derivative of 'h' is no number: .* where h = 0\.[5-9]\d* and pump = 3"):
        cs.simulate(opaque, pump, [0.1])
