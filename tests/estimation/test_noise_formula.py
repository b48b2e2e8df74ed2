"""Truth: the likelihood itself, minimised by scipy, and its closed form where there is one."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize

import casid as cs
from casid.errors import EstimationError, InputError

T = np.linspace(0.0, 5.0, 160)


def decay(**more) -> cs.Model:
    return cs.define_model(
        "decay",
        states=("c",),
        inputs=(),
        parameters={"k": 0.5, "c0": 2.0, "s_a": 0.05, "s_b": 0.05} | more,
        outputs=("y",),
        dynamics=lambda s: {"c": -s.k * s.c},
        output=lambda s: {"y": s.c},
        initial=lambda s: {"c": s.c0},
    )


def reading(sigma, seed: int, logarithmic: bool = False) -> cs.Record:
    """A decay of rate 0.7 from 3 with a 1-sigma of its value."""
    y = 3.0 * np.exp(-0.7 * T)
    noise = np.random.default_rng(seed).standard_normal(len(T)) * sigma(y)
    return cs.Record(name="r", t=T, channels={"y": y * np.exp(noise) if logarithmic else y + noise})


def likelihood(record: cs.Record, k: float, c0: float, sigma, logarithmic: bool = False) -> float:
    """ln of the density of all readings that are there."""
    there = np.isfinite(record["y"])
    z, y = record["y"][there], (c0 * np.exp(-k * T))[there]
    s = sigma(y) * np.ones(len(z))
    r = np.log(z / y) if logarithmic else z - y
    return float(-(0.5 * (r / s) ** 2 + np.log(s * np.sqrt(2 * np.pi)) + (np.log(z) if logarithmic else 0.0)).sum())


def optimum(record: cs.Record, cost, start) -> np.ndarray:
    found = minimize(
        lambda v: -cost(v), start, method="Nelder-Mead", options={"xatol": 1e-10, "fatol": 1e-12, "maxiter": 20000}
    )
    return found.x


@pytest.mark.parametrize("method", [cs.MultipleShooting(), cs.SingleShooting(), cs.Collocation()])
def test_a_constant_and_a_proportional_part_of_the_noise_are_estimated(method):
    record = reading(lambda y: 0.02 + 0.08 * y, 5)
    record = record.with_channels(y=np.where(np.arange(len(T)) % 7 == 3, np.nan, record["y"]))
    noise = {"y": cs.Noise(sigma=lambda s: s.s_a + s.s_b * s.y)}
    fit = cs.solve(cs.Problem(decay(), record, free=["*"], noise=noise), method)
    assert fit.converged, fit.status

    def cost(v):
        return likelihood(record, v[0], v[1], lambda y: v[2] + v[3] * y)

    wanted = optimum(record, cost, [0.7, 3.0, 0.02, 0.08])
    np.testing.assert_allclose(list(fit.values.values()), wanted, rtol=2e-4)
    assert fit.log_likelihood == pytest.approx(cost(wanted), abs=1e-3)
    size = fit["s_a"].value + fit["s_b"].value * fit.predictions["r"][:, 0]
    assert fit.noise["y"] == pytest.approx(np.sqrt(np.mean(size[np.isfinite(record["y"])] ** 2)), rel=1e-6)
    np.testing.assert_allclose(fit.residuals["r"][:, 0], record["y"] - fit.predictions["r"][:, 0])


def test_a_noise_that_is_a_parameter_is_the_noise_that_is_estimated():
    """Its maximum of likelihood is the root mean square of the residuals, its deviation sigma / sqrt(2 N)."""
    record = reading(lambda y: 0.04, 6)
    by_formula = cs.solve(
        cs.Problem(decay(), record, free=["k", "c0", "s_a"], noise={"y": cs.Noise(sigma=lambda s: s.s_a)})
    )
    plain = cs.solve(cs.Problem(decay(), record, free=["k", "c0"]))
    assert by_formula.log_likelihood == pytest.approx(plain.log_likelihood, abs=1e-5)
    assert by_formula["s_a"].value == pytest.approx(plain.noise["y"], rel=1e-6)
    assert by_formula["k"].value == pytest.approx(plain["k"].value, rel=1e-6)
    assert by_formula["s_a"].std_cramer_rao == pytest.approx(plain.noise["y"] / np.sqrt(2 * len(T)), rel=1e-3)
    known = cs.solve(cs.Problem(decay(), record, free=["k", "c0"], noise={"y": plain.noise["y"]}))
    assert by_formula["k"].std_cramer_rao == pytest.approx(known["k"].std_cramer_rao, rel=1e-3)


@pytest.mark.parametrize("start", [{}, {"s_a": 5.0, "k": 1.5}, {"s_a": 0.001}])
def test_log_normal_noise_is_normal_noise_of_the_logarithm(start):
    """ln c is a straight line in time: its regression has a closed form."""
    record = reading(lambda y: 0.1, 7, logarithmic=True)
    noise = {"y": cs.Noise(sigma=lambda s: s.s_a, logarithmic=True)}
    fit = cs.solve(cs.Problem(decay(), record, free=["k", "c0", "s_a"], log=["c0", "s_a"], noise=noise, start=start))
    slope, level = np.polyfit(T, np.log(record["y"]), 1)
    sigma = np.sqrt(np.mean((np.log(record["y"]) - level - slope * T) ** 2))
    assert fit.converged, fit.status
    np.testing.assert_allclose([fit.values[n] for n in ("k", "c0", "s_a")], [-slope, np.exp(level), sigma], rtol=1e-5)
    wanted = likelihood(record, -slope, np.exp(level), lambda y: sigma, logarithmic=True)
    assert fit.log_likelihood == pytest.approx(wanted, abs=1e-5)


def test_a_log_normal_noise_of_given_size_needs_no_parameter():
    record = reading(lambda y: 0.1, 8, logarithmic=True).with_channels(s=np.full(len(T), 0.1))
    fits = [
        cs.solve(cs.Problem(decay(), record, free=["k", "c0"], noise={"y": cs.Noise(sigma=s, logarithmic=True)}))
        for s in (0.1, "s")
    ]
    slope, level = np.polyfit(T, np.log(record["y"]), 1)
    for fit in fits:
        np.testing.assert_allclose(list(fit.values.values()), [-slope, np.exp(level)], rtol=1e-5)


def test_ipopt_finds_the_same():
    record = reading(lambda y: 0.02 + 0.08 * y, 5)
    problem = cs.Problem(decay(), record, free=["*"], noise={"y": cs.Noise(sigma=lambda s: s.s_a + s.s_b * s.y)})
    one, other = cs.solve(problem), cs.solve(problem, solver=cs.Ipopt(hessian="gauss-newton"))
    assert other.converged
    np.testing.assert_allclose(list(one.values.values()), list(other.values.values()), rtol=1e-6)


def test_what_cannot_be_is_refused():
    record = reading(lambda y: 0.1, 9)
    with pytest.raises(InputError, match="did you mean 's_a'"):
        cs.Problem(decay(), record, free=["k"], noise={"y": cs.Noise(sigma=lambda s: s.sa)})
    with pytest.raises(InputError, match="unknown channel"):
        cs.Problem(decay(), record, free=["k"], noise={"y": cs.Noise(sigma="w")})
    with pytest.raises(InputError, match="are positive"):
        low = record.with_channels(y=record["y"] - 1.0)
        cs.Problem(decay(), low, free=["k"], noise={"y": cs.Noise(sigma=0.1, logarithmic=True)})
    with pytest.raises(EstimationError, match="OutputError"):
        cs.Problem(decay(), record, free=["k"], cost=cs.EquationError(), noise={"y": cs.Noise(sigma=0.1)})
