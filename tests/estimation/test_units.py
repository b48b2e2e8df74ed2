"""Neither estimates nor what is said of them depend on the units in which a problem is posed."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import casid as cs

T = np.linspace(0.0, 10.0, 120)
decades = st.floats(-14.0, 14.0)


def circuit(resistance: float, voltage: float, *, same: bool, limit: float | None = None) -> cs.Problem:
    """A resistor and a capacitor driven by a voltage, of which the current is read: R = 1.7, C = 0.6 in units of
    `resistance` and one second over it. With `same` a second resistor is in line with the first."""
    capacity = 1.0 / resistance
    names = {"R": 1.0 * resistance, "C": 1.0 * capacity} | ({"R2": 0.5 * resistance} if same else {})
    total = (lambda s: s.R + s.R2) if same else (lambda s: s.R)
    model = cs.define_model(
        "circuit",
        states=["v"],
        inputs=["u"],
        parameters=names,
        outputs=["i"],
        dynamics=lambda s: {"v": (s.u - s.v) / (total(s) * s.C)},
        output=lambda s: {"i": (s.u - s.v) / total(s)},
        state_scale={"v": voltage},
    )
    u = voltage * np.sign(np.sin(T))
    clean = circuit_current(1.7, 0.6)
    noise = 0.02 * voltage / resistance
    y = clean * voltage / resistance + noise * np.random.default_rng(0).standard_normal(len(T))
    limits = [] if limit is None else [cs.limit_parameter("R", lower=0.0, upper=limit * resistance)]
    record = cs.Record(name="r", t=T, channels={"u": u, "i": y})
    return cs.Problem(model, [record], free=["*"], noise={"i": noise}, constraints=limits)


def circuit_current(resistance: float, capacity: float) -> np.ndarray:
    model = cs.define_model(
        "plain",
        states=["v"],
        inputs=["u"],
        parameters={"R": resistance, "C": capacity},
        outputs=["i"],
        dynamics=lambda s: {"v": (s.u - s.v) / (s.R * s.C)},
        output=lambda s: {"i": (s.u - s.v) / s.R},
    )
    record = cs.Record(name="r", t=T, channels={"u": np.sign(np.sin(T))})
    return cs.simulate(model, record, [0.0]).output("i")


@settings(max_examples=12, deadline=None)
@given(decades, decades, st.sampled_from([None, 1.2, 3.0]))
def test_a_circuit_in_any_units_is_the_same(resistance: float, voltage: float, limit: float | None) -> None:
    size = {"R": 10.0**resistance, "C": 10.0**-resistance}
    plain = cs.solve(circuit(1.0, 1.0, same=False, limit=limit))
    other = cs.solve(circuit(10.0**resistance, 10.0**voltage, same=False, limit=limit))
    assert other.result is plain.result is cs.Results.CONVERGED, other.status
    for name, one in plain.parameters.items():
        found = other[name]
        assert found.value / size[name] == pytest.approx(one.value, rel=1e-6)
        assert found.std / size[name] == pytest.approx(one.std, rel=1e-5)
        assert np.divide(found.interval, size[name]) == pytest.approx(one.interval, rel=1e-5)
    assert len(other.remarks) == len(plain.remarks)
    if limit is None:
        told = [cs.identifiability(fit) for fit in (plain, other)]
        assert told[1].inflation == pytest.approx(told[0].inflation, rel=1e-4)
        assert told[1].unseen == told[0].unseen == {}


@settings(max_examples=4, deadline=None)
@given(decades, decades)
def test_resistors_in_line_are_told_as_one_in_any_units(resistance: float, voltage: float) -> None:
    fit = cs.solve(circuit(10.0**resistance, 10.0**voltage, same=True))
    assert fit.result is cs.Results.NOT_IDENTIFIABLE
    assert np.isnan(fit["R"].std) and np.isnan(fit["R2"].std) and fit["C"].std > 0.0
    assert fit["C"].value * 10.0**resistance == pytest.approx(0.6, rel=0.05)


@settings(max_examples=20, deadline=None)
@given(st.lists(decades, min_size=4, max_size=4), st.integers(0, 2**16))
def test_a_regression_in_any_units_is_that_of_least_squares(sizes: list[float], seed: int) -> None:
    """Truth: least squares by numpy in units in which all are of order one."""
    rng = np.random.default_rng(seed)
    units = 10.0 ** np.array(sizes)
    h = rng.standard_normal((60, 3))
    y = h @ [1.0, -2.0, 0.5] + 0.1 * rng.standard_normal(60)
    names = ("a", "b", "c")
    model = cs.define_regression(
        "line",
        inputs=["h0", "h1", "h2"],
        parameters=dict(zip(names, (units[3] / units[:3]).tolist(), strict=True)),
        outputs=["y"],
        output=lambda s: {"y": s.a * s.h0 + s.b * s.h1 + s.c * s.h2},
    )
    channels = {f"h{i}": units[i] * h[:, i] for i in range(3)} | {"y": units[3] * y}
    record = cs.Record(name="r", t=np.arange(60.0), channels=channels)
    fit = cs.solve(cs.Problem(model, [record], free=["*"]))
    best = np.linalg.lstsq(h, y, rcond=None)[0]
    assert fit.converged, fit.status
    assert np.array(list(fit.values.values())) * units[:3] / units[3] == pytest.approx(best, rel=1e-6, abs=1e-6)


@settings(max_examples=4, deadline=None)
@given(st.floats(0.3, 1.5), decades, st.sampled_from(["rate", "product"]))
def test_a_symmetry_with_an_unread_state_is_told(rate: float, decade: float, kind: str) -> None:
    """Truth: y is the same for d and z(0) as for c d and z(0)/c, so that no data hold d. Another reading of z does."""
    unit = 10.0**decade

    def posed(*outputs: str, known: bool = False) -> cs.Problem:
        model = cs.define_model(
            "hidden",
            states=["a", "z"],
            inputs=[],
            parameters={"k": 0.5, "d": 1.0 / unit},
            outputs=outputs,
            dynamics=lambda s: {"a": -s.k * s.a + s.d * s.z, "z": -rate * s.z},
            output=lambda s: {n: {"y": s.a if kind == "rate" else s.a + s.d * s.z, "z": s.z}[n] for n in outputs},
            state_scale={"z": unit},
        )
        a, z = np.exp(-0.7 * T), np.exp(-rate * T)
        forced = 3.0 * (a - z) / (rate - 0.7)
        clean = {"y": forced if kind == "rate" else forced + 3.0 * z, "z": 2.0 * z * unit}
        rng = np.random.default_rng(0)
        noise = {"y": 0.01, "z": 0.01 * unit}
        channels = {n: clean[n] + noise[n] * rng.standard_normal(len(T)) for n in outputs}
        given = {"a": 0.0} | ({"z": 2.0 * unit} if known else {})
        initial = cs.InitialState(value=given, std=dict.fromkeys(given, 0.0))
        record = cs.Record(name="r", t=T, channels=channels)
        return cs.Problem(model, [record], free=["*"], noise={n: noise[n] for n in outputs}, initial_state=initial)

    lost = cs.solve(posed("y"))
    assert lost.result is cs.Results.NOT_IDENTIFIABLE, lost.status
    assert np.isnan(lost["d"].std) and lost["k"].value == pytest.approx(0.7, abs=5 * lost["k"].std)
    assert "z" in lost.reason and "d" in lost.reason
    assert cs.identifiability(lost).exchanged == {"d": ("z",)}
    for better in (posed("y", "z"), posed("y", known=True)):
        fit = cs.solve(better)
        assert fit.converged, fit.status
        assert fit["d"].value * unit == pytest.approx(1.5, rel=0.05)
        assert not cs.identifiability(fit).exchanged
