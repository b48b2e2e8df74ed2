"""Truth: the scatter of many estimates from independent noise, and closed forms of ordinary least squares."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from estimation_cases import NOISE, TRUTH, flight, short_period
from scipy.stats import chi2

from casid.estimation import MultipleShooting, Problem, RangeWeights, SingleShooting, solve
from casid.estimation.uncertainty import Uncertainty
from casid.model.system import define_model
from casid.records.record import Record

RUNS = 80
TIME = np.arange(0.0, 7.0, 0.05)


def scatter(noise, disturb, method=None):
    """(RUNS, parameters) estimates, (RUNS, parameters, parameters) covariances and corrected ones."""
    model, clean = short_period(), flight(t=TIME, hold="held")
    estimates, covariances, corrected = [], [], []
    for run in range(RUNS):
        rng = np.random.default_rng([7, run])
        record = clean.with_channels(**{n: clean[n] + disturb(n, rng) for n in NOISE})
        fit = solve(Problem(model, [record], free=["*"], noise=noise), method or MultipleShooting())
        assert fit.converged
        estimates.append(list(fit.values.values()))
        covariances.append(fit.covariance)
        corrected.append(fit.covariance_corrected)
    return np.array(estimates), np.array(covariances), np.array(corrected)


def white(name: str, rng: np.random.Generator) -> np.ndarray:
    return NOISE[name] * rng.standard_normal(len(TIME))


@pytest.mark.parametrize("noise", [NOISE, None, RangeWeights()], ids=["given", "estimated", "range weights"])
def test_covariance_is_the_scatter_under_white_noise(noise):
    estimates, covariances, corrected = scatter(noise, white)
    error = estimates - np.array(list(TRUTH.values()))
    # sum of squared Mahalanobis distances: chi-square with RUNS * parameters degrees of freedom
    squared = np.einsum("ri,rij,rj->", error, np.linalg.inv(covariances), error)
    low, high = chi2.ppf([0.001, 0.999], error.size)
    assert low < squared < high
    ratio = np.sqrt((error**2).mean(axis=0) / np.diagonal(covariances.mean(axis=0)))
    bounds = np.sqrt(chi2.ppf([0.0005, 0.9995], RUNS) / RUNS)
    assert ((bounds[0] < ratio) & (ratio < bounds[1])).all(), ratio
    # residuals without colour need no correction
    corrected_ratio = np.sqrt(np.diagonal(corrected.mean(axis=0)) / np.diagonal(covariances.mean(axis=0)))
    np.testing.assert_allclose(corrected_ratio, 1.0, atol=0.12)


def test_coloured_residuals_need_the_correction():
    """First-order noise with lag-one correlation 0.9: the bound is far too small, the corrected one is not."""

    def coloured(name: str, rng: np.random.Generator) -> np.ndarray:
        noise = np.zeros(len(TIME))
        noise[0] = rng.standard_normal()
        for k in range(1, len(TIME)):
            noise[k] = 0.9 * noise[k - 1] + np.sqrt(1 - 0.9**2) * rng.standard_normal()
        return NOISE[name] * noise

    estimates, covariances, corrected = scatter(None, coloured)
    spread = estimates.std(axis=0)
    optimistic = spread / np.sqrt(np.diagonal(covariances.mean(axis=0)))
    honest = spread / np.sqrt(np.diagonal(corrected.mean(axis=0)))
    assert np.median(optimistic) > 1.5
    assert (np.abs(np.log(honest)) < np.abs(np.log(optimistic))).all()
    # what the fit absorbs of the noise is missing in the residuals: some optimism stays on a record of 7 s
    assert np.median(honest) < 1.3 and (honest < 1.5).all()


def static_model():
    """y = a u + b with one idle state that is not measured."""
    return define_model(
        "line",
        states=("theta",),
        inputs=("delta_e",),
        parameters={"a": 0.0, "b": 0.0},
        outputs=("q",),
        dynamics=lambda s: {"theta": -s.theta},
        output=lambda s: {"q": s.a * s.delta_e + s.b},
    )


def line_record(seed: int = 0) -> Record:
    rng = np.random.default_rng(seed)
    u = rng.standard_normal(60)
    channels = {"delta_e": u, "q": 2.0 * u - 0.5 + 0.3 * rng.standard_normal(60)}
    return Record(name="m1", t=0.1 * np.arange(60), channels=channels)


@pytest.mark.parametrize("method", [SingleShooting(), MultipleShooting(interval=7)])
def test_a_line_has_the_covariance_of_ordinary_least_squares(method):
    record = line_record()
    phi = np.stack([record["delta_e"], np.ones(60)], axis=1)
    expected, residual = np.linalg.lstsq(phi, record["q"], rcond=None)[:2]
    given = solve(Problem(static_model(), [record], free=["*"], noise={"q": 0.3}), method)
    np.testing.assert_allclose(list(given.values.values()), expected, rtol=1e-8)
    np.testing.assert_allclose(given.covariance, 0.3**2 * np.linalg.inv(phi.T @ phi), rtol=1e-9)
    estimated = solve(Problem(static_model(), [record], free=["*"]), method)
    np.testing.assert_allclose(estimated.covariance, residual / 58 * np.linalg.inv(phi.T @ phi), rtol=1e-6)
    a, b = (estimated[name] for name in "ab")
    bound = estimated.covariance[0, 1] / (a.std_cramer_rao * b.std_cramer_rao)
    assert estimated.correlation("a", "b") == pytest.approx(bound)


def test_a_departed_motion_leaves_nothing_known():
    """Sensitivities that grew to 1e150 make an information matrix of garbage: no parameter is known, no exception."""
    problem = SimpleNamespace(parameters=("a", "b"), start_vector=np.ones(2))
    levels = SimpleNamespace(proportional=False, share=np.ones(1))
    limits = SimpleNamespace(free_directions=lambda *_: np.eye(2))
    objective: Any = SimpleNamespace(limits=limits, problem=problem)
    linear: Any = SimpleNamespace(hessian=-1e300 * np.ones((2, 2)), point=SimpleNamespace(theta=np.ones(2)))
    value: Any = SimpleNamespace(noise=SimpleNamespace(levels=levels))
    nothing = Uncertainty(objective=objective, value=value, linear=linear, limit_multipliers=np.zeros(0))
    assert nothing.confused == ("a", "b")
    assert np.isnan(nothing.covariance).all() and np.isnan(nothing.corrected).all()


def test_parameters_that_cannot_be_told_apart_are_named():
    model = define_model(
        "double",
        states=("theta",),
        inputs=("delta_e",),
        parameters={"a": 1.0, "b": 1.0, "c": 0.0},
        outputs=("q",),
        dynamics=lambda s: {"theta": -s.theta},
        output=lambda s: {"q": (s.a + s.b) * s.delta_e + s.c},
    )
    fit = solve(Problem(model, [line_record()], free=["*"], noise={"q": 0.3}))
    assert not fit.converged
    assert "a, b" in fit.status and "c" not in fit.status.split("tell")[1].split("apart")[0].replace("a, b", "")
    assert np.isnan(fit["a"].std)
    # a prior on one of them makes the problem whole
    cured = define_model(
        "double",
        states=("theta",),
        inputs=("delta_e",),
        parameters={"a": 1.0, "b": 1.0, "c": 0.0},
        outputs=("q",),
        dynamics=lambda s: {"theta": -s.theta},
        output=lambda s: {"q": (s.a + s.b) * s.delta_e + s.c},
        prior_std={"a": 0.1},
    )
    fit = solve(Problem(cured, [line_record()], free=["*"], noise={"q": 0.3}, prior=True))
    assert fit.converged and fit["a"].std_cramer_rao == pytest.approx(0.1, rel=1e-6)
