"""Shooting by implicit steps. Truth: scipy's LSODA at 1e-10, and the published optimum of a benchmark."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from conftest import data_folder
from estimation_cases import needs_compiler
from scipy.integrate import solve_ivp

import casid as cs
from casid.errors import EstimationError
from casid.estimation.attempt import build_objective


def robertson() -> cs.Model:
    """Robertson's kinetics, rates over nine orders of magnitude."""
    return cs.define_model(
        "robertson",
        states=("a", "b", "c"),
        inputs=(),
        parameters={"k1": 0.04, "k2": 3e7, "k3": 1e4},
        outputs=("ya", "yb", "yc"),
        dynamics=lambda s: {
            "a": -s.k1 * s.a + s.k3 * s.b * s.c,
            "b": s.k1 * s.a - s.k3 * s.b * s.c - s.k2 * s.b**2,
            "c": s.k2 * s.b**2,
        },
        output=lambda s: {"ya": s.a, "yb": 1e4 * s.b, "yc": s.c},
        state_scale={"b": 1e-5, "a": 1.0, "c": 1.0},
        initial=lambda s: {"a": 1.0, "b": 0.0, "c": 0.0},
    )


def by_lsoda(model: cs.Model, t: np.ndarray, values: Mapping[str, float]) -> np.ndarray:
    """(N, outputs) from the model's initial state; a model without inputs."""
    p = model.nominal_vector(values)
    f, h = (ca.Function("f", [model.x, model.p], [e]) for e in (model.f, model.h))
    slope = ca.Function("j", [model.x, model.p], [ca.jacobian(model.f, model.x)])
    begin = ca.Function("i", [model.p], [ca.vertcat(*[model.initial[s] for s in model.states])])(p).full()[:, 0]
    found = solve_ivp(
        lambda _, x: f(x, p).full()[:, 0],
        (t[0], t[-1]),
        begin,
        method="LSODA",
        t_eval=t,
        rtol=1e-10,
        atol=1e-14,
        jac=lambda _, x: slope(x, p).full(),
    )
    return np.array([h(x, p).full()[:, 0] for x in found.y.T])


@pytest.mark.parametrize("method", [cs.SingleShooting(implicit=True), cs.MultipleShooting(interval=5, implicit=True)])
def test_stiff_kinetics_over_nine_orders_of_magnitude(method):
    t = np.concatenate([[0.0], np.geomspace(1e-3, 1e4, 40)])
    model, rng = robertson(), np.random.default_rng(2)
    y = by_lsoda(model, t, {})
    sigma = {"ya": 0.01, "yb": 0.005, "yc": 0.01}
    noisy = {name: y[:, i] + sigma[name] * rng.standard_normal(len(t)) for i, name in enumerate(sigma)}
    start = {"k1": 0.08, "k2": 1e7, "k3": 2e4}
    problem = cs.Problem(
        model, cs.Record(name="m", t=t, channels=noisy), free=["*"], log=["*"], start=start, noise=sigma
    )
    fit = cs.solve(problem, method)
    assert fit.converged and fit.implicit and "implicit (Radau)" in fit.integrator
    for name, truth in model.nominal.items():
        assert abs(fit[name].value - truth) < 4.0 * fit[name].std
    checked = by_lsoda(model, t, fit.values)
    cost = [
        0.5 * sum(((noisy[n] - one[:, i]) ** 2).sum() / sigma[n] ** 2 for i, n in enumerate(sigma))
        for one in (checked, fit.predictions["m"])
    ]
    assert cost[0] == pytest.approx(cost[1], abs=0.01)


@needs_compiler
def test_the_kernel_agrees_with_numpy(own_cache, monkeypatch):
    """Motion and blocks, of two records with inputs and of several segments."""
    t, rng = np.arange(0.0, 5.0, 0.1), np.random.default_rng(4)
    model = cs.define_model(
        "van der Pol",
        states=("x", "v"),
        inputs=("u",),
        parameters={"mu": 3.0, "g": 1.0},
        outputs=("x", "v"),
        dynamics=lambda s: {"x": s.v, "v": s.mu * (1 - s.x**2) * s.v - s.g * s.x + s.u},
        output=lambda s: {"x": s.x, "v": s.v},
    )
    records = [
        cs.Record(name=n, t=t[:count], channels={c: rng.standard_normal(count) for c in ("u", "x", "v")}, hold=hold)
        for n, count, hold in (("m1", 50, "held"), ("m2", 31, "linear"))
    ]
    problem = cs.Problem(model, records, free=["*"], noise={"x": 0.1, "v": 0.2})
    method = cs.MultipleShooting(interval=7, substeps=2, implicit=True)

    def found():
        objective = build_objective(problem, method)
        value = objective.value(objective.start())
        return objective.dynamics.kernel, value.trajectory, objective.linearise(objective.start(), value).blocks

    monkeypatch.delenv("CASID_COMPILE_FIRST", raising=False)
    kernel, plain, plain_blocks = found()
    assert kernel is None
    monkeypatch.setenv("CASID_COMPILE_FIRST", "1")
    kernel, fast, fast_blocks = found()
    assert kernel is not None
    for name in ("states", "y", "end"):
        np.testing.assert_allclose(getattr(fast, name), getattr(plain, name), rtol=1e-11, atol=1e-11)
    for name in ("hessian", "gradient", "transition"):
        one, other = getattr(fast_blocks, name), getattr(plain_blocks, name)
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9 * np.abs(other).max())


def test_what_implicit_steps_cannot_do_is_refused():
    t = np.arange(0.0, 1.0, 0.1)
    record = cs.Record(name="m", t=t, channels={n: np.zeros(10) for n in ("ya", "yb", "yc")})
    problem = cs.Problem(robertson(), record, free=["k1"], noise={"ya": 1.0, "yb": 1.0, "yc": 1.0})
    with pytest.raises(EstimationError, match="process noise"):
        cs.solve(problem, cs.MultipleShooting(implicit=True, process_noise={"a": 0.1}))
    with pytest.raises(EstimationError, match="GaussNewton"):
        cs.solve(problem, cs.SingleShooting(implicit=True), cs.Ipopt())


def repressilator(nominal: Mapping[str, float]) -> cs.Model:
    """Elowitz and Leibler, Nature 403, 335 (2000), as the PEtab benchmark collection has it; time in min. Powers of
    concentrations have no number where these are negative, where collocation leads them."""

    def made(s, repressor):
        high, low = 60.0 * s.tps_active, 60.0 * s.tps_repr
        return low + s.KM**s.n_Hill * (high - low) / (s.KM**s.n_Hill + repressor**s.n_Hill)

    def dynamics(s):
        ln2 = float(np.log(2.0))
        repressors = {"X": s.Z_protein, "Y": s.X_protein, "Z": s.Y_protein}
        found = {
            "GFP": s.GFP_mRNA * s.eff_GFP / s.tau_mRNA_GFP - ln2 * s.GFP / s.tau_prot_GFP + made(s, s.X_protein),
            "GFP_mRNA": -ln2 * s.GFP_mRNA / s.tau_mRNA_GFP,
        }
        for name, repressor in repressors.items():
            rna, protein = getattr(s, f"{name}_mRNA"), getattr(s, f"{name}_protein")
            found[f"{name}_protein"] = rna * s.eff / s.tau_mRNA - ln2 * protein / s.tau_prot
            found[f"{name}_mRNA"] = made(s, repressor) - ln2 * rna / s.tau_mRNA
        return found

    states = [f"{g}_{kind}" for g in "XYZ" for kind in ("protein", "mRNA")] + ["GFP", "GFP_mRNA"]
    return cs.define_model(
        "repressilator",
        states=states,
        inputs=(),
        parameters=nominal,
        outputs=("fluorescence",),
        dynamics=dynamics,
        output=lambda s: {"fluorescence": np.log10(s.background + s.GFP * s.scale)},
        initial=lambda s: {name: getattr(s, f"init_{name}") for name in states},
    )


@pytest.fixture
def elowitz() -> tuple[cs.Problem, float]:
    """The problem from its published optimum, and what -ln L of the log10 of the data lacks to that of the data."""
    folder = data_folder("petab", "Elowitz_Nature2000/parameters_Elowitz_Nature2000.tsv")
    if folder is None:
        pytest.skip("no PEtab problems; put the benchmark collection's beside the flight data, as 'petab'")
    home = Path(folder) / "Elowitz_Nature2000"

    def rows(what: str) -> list[dict[str, str]]:
        with (home / f"{what}_Elowitz_Nature2000.tsv").open(encoding="utf-8") as file:
            return list(csv.DictReader(file, delimiter="\t"))

    table = {r["parameterId"]: r for r in rows("parameters") if r["parameterId"] != "sigma"}
    seen = [(float(r["time"]), float(r["measurement"])) for r in rows("measurementData")]
    t, z = np.array([0.0] + [one for one, _ in seen]), np.array([np.nan] + [value for _, value in seen])
    model = repressilator({name: float(r["nominalValue"]) for name, r in table.items()})
    limits = [
        cs.limit_parameter(n, lower=float(r["lowerBound"]), upper=float(r["upperBound"])) for n, r in table.items()
    ]
    record = cs.Record(name="m", t=t, channels={"fluorescence": np.log10(z)})
    problem = cs.Problem(model, record, free=["*"], log=["*"], constraints=limits)
    return problem, float(np.log(z[1:] * np.log(10.0)).sum())


PUBLISHED = -63.2027


@pytest.mark.slow
@pytest.mark.parametrize("method", [cs.MultipleShooting(), cs.Collocation()], ids=lambda m: type(m).__name__)
def test_a_published_optimum_is_not_left_for_worse(elowitz, method):
    """By LSODA at the estimates, and by the fit's own likelihood, which must be that of LSODA."""
    problem, constant = elowitz
    fit = cs.solve(problem, method)
    record = problem.records[0]
    off = (by_lsoda(problem.model, record.t, fit.values)[:, 0] - record["fluorescence"])[1:]
    by_truth = 0.5 * len(off) * (1.0 + np.log(2.0 * np.pi * np.mean(off**2))) + constant
    assert by_truth < PUBLISHED + 0.01
    assert constant - fit.log_likelihood == pytest.approx(by_truth, abs=0.01)


def growing(rate: float, level: float, t: np.ndarray) -> cs.Problem:
    """dx/dt = rate (x - c) from rest: x = c (1 - exp(rate t))."""
    model = cs.define_model(
        "growing",
        states=["x"],
        inputs=[],
        parameters={"rate": rate, "c": 1.5 * level},
        outputs=["y"],
        dynamics=lambda s: {"x": s.rate * (s.x - s.c)},
        output=lambda s: {"y": s.x},
        initial=lambda _: {"x": 0.0},
    )
    y = level * -np.expm1(rate * t) if rate * t[-1] < 100.0 else np.full(len(t), level)
    y = y + 0.01 * np.random.default_rng(4).standard_normal(len(t))
    return cs.Problem(model, [cs.Record(name="m", t=t, channels={"y": y})], free=["c"], noise={"y": 0.01})


def test_implicit_steps_are_short_enough_for_a_motion_that_grows():
    """Long implicit steps damp what grows: at a rate of 1000/s the state would stay at c, where no motion does. A rate
    that steps can follow is followed."""
    far = cs.solve(growing(1000.0, 2.0, np.arange(20.0)), cs.SingleShooting(implicit=True))
    assert not far.converged
    near = cs.solve(growing(3.0, 2.0, np.arange(4.0)), cs.SingleShooting(implicit=True))
    assert near.converged and abs(near["c"].value - 2.0) < 4.0 * near["c"].std
