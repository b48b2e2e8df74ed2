"""Parameters drawn from a distribution over records. Truth: the linear mixed model, its covariance written out in
numpy: closed forms for balanced records, the restricted likelihood on a grid for others."""

from __future__ import annotations

import numpy as np
import pytest

import casid as cs
from casid.errors import InputError

SIGMA = 0.3


def line(**more) -> cs.Model:
    return cs.define_regression(
        "line",
        inputs=["u"],
        parameters={"a": 0.0, "b": 0.0},
        outputs=["y"],
        output=lambda s: {"y": s.a * s.u + s.b},
        **more,
    )


def records(sizes: list[int], spread: float, seed: int = 1, slope: float = 2.0) -> list[cs.Record]:
    """Every record has its own intercept, 1 on average, and noise."""
    rng, found = np.random.default_rng(seed), []
    for i, n in enumerate(sizes):
        u = rng.uniform(-1.0, 1.0, n)
        y = slope * u + 1.0 + spread * rng.standard_normal() + SIGMA * rng.standard_normal(n)
        found.append(cs.Record(name=f"m{i}", t=np.arange(float(n)), channels={"u": u, "y": y}))
    return found


def mixed(some: list[cs.Record], spread: float) -> tuple[float, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """-ln of the restricted likelihood, (slope, mean) by generalised least squares, their covariance, and best linear
    unbiased predictions of the intercepts with their variances (Robinson, Stat. Sci. 6, 1991)."""
    y, u = (np.concatenate([r[name] for r in some]) for name in ("y", "u"))
    which = np.repeat(np.arange(len(some)), [len(r) for r in some])
    Z = (which[:, None] == np.arange(len(some))).astype(float)
    X = np.stack([u, np.ones_like(u)], axis=1)
    V = SIGMA**2 * np.eye(len(y)) + spread**2 * Z @ Z.T
    inverse = np.linalg.inv(V)
    covariance = np.linalg.inv(X.T @ inverse @ X)
    beta = covariance @ X.T @ inverse @ y
    left = y - X @ beta
    value = 0.5 * (np.linalg.slogdet(V)[1] - np.linalg.slogdet(covariance)[1] + left @ inverse @ left)
    drawn = beta[1] + spread**2 * Z.T @ inverse @ left
    # of intercept = mean + deviation: joint covariance of Henderson's equations
    W = np.concatenate([X, Z], axis=1)
    joint = W.T @ W / SIGMA**2 + np.diag([0.0, 0.0, *np.full(len(some), 1.0 / spread**2)])
    C = np.linalg.inv(joint)
    pick = np.concatenate([np.tile([0.0, 1.0], (len(some), 1)), np.eye(len(some))], axis=1)
    return value, beta, covariance, drawn, np.diagonal(pick @ C @ pick.T)


def problem(some: list[cs.Record], scale: float = np.inf) -> cs.Problem:
    return cs.Problem(line(), some, free=["a"], per_record=["b"], spread={"b": scale}, noise={"y": SIGMA})


def test_balanced_records_are_the_analysis_of_variance() -> None:
    """Without a slope: spread^2 = variance of the record means less noise^2/n (Searle, Variance Components, 3.6)."""
    some = [r.with_channels(u=np.zeros(len(r))) for r in records([12] * 8, 0.5, slope=0.0)]
    posed = cs.Problem(line(), some, per_record=["b"], spread={"b": np.inf}, noise={"y": SIGMA})
    fit = cs.solve(posed)
    means = np.array([r["y"].mean() for r in some])
    expected = np.sqrt(means.var(ddof=1) - SIGMA**2 / 12)
    found = fit.population["b"]
    assert fit.converged and found.spread == pytest.approx(expected, rel=2e-3)
    assert found.mean == pytest.approx(means.mean(), rel=1e-6)
    assert found.mean_std == pytest.approx(np.sqrt(means.var(ddof=1) / 8), rel=2e-3)
    keep = found.spread**2 / (found.spread**2 + SIGMA**2 / 12)
    drawn = means.mean() + keep * (means - means.mean())
    assert [fit.values[f"b[m{i}]"] for i in range(8)] == pytest.approx(drawn.tolist(), rel=1e-4)


@pytest.mark.parametrize("scale", [np.inf, 0.2], ids=["flat prior", "half-normal prior"])
def test_unbalanced_records_are_the_mixed_model(scale: float) -> None:
    some = records([3, 5, 8, 20, 2, 40], 0.5)
    grid = np.linspace(0.05, 2.0, 1951)
    value = np.array([mixed(some, s)[0] + 0.5 * (s / scale) ** 2 for s in grid])
    fit = cs.solve(problem(some, scale))
    found, best = fit.population["b"], int(value.argmin())
    assert fit.converged and found.spread == pytest.approx(grid[best], abs=2e-3)
    inside = grid[value <= value[best] + 1.92]
    assert found.interval == pytest.approx((inside[0], inside[-1]), abs=3e-3)
    _, beta, covariance, drawn, variance = mixed(some, found.spread)
    assert (fit.values["a"], found.mean) == pytest.approx(tuple(beta), rel=1e-4)
    assert (fit["a"].std_cramer_rao, found.mean_std) == pytest.approx(tuple(np.sqrt(np.diag(covariance))), rel=1e-3)
    assert [fit.values[f"b[m{i}]"] for i in range(6)] == pytest.approx(drawn.tolist(), rel=1e-3)
    assert [fit[f"b[m{i}]"].std_cramer_rao for i in range(6)] == pytest.approx(np.sqrt(variance).tolist(), rel=1e-3)
    assert "over records" in str(fit) and fit.to_dict()["population"]["b"]["spread"] == found.spread


def test_records_that_do_not_differ_have_no_spread() -> None:
    """Where the records differ by less than their noise explains, as records of one intercept do half of the time."""
    some = next(r for r in (records([10] * 5, 0.0, seed=s) for s in range(20)) if mixed(r, 1e-3)[0] < mixed(r, 0.02)[0])
    found = cs.solve(problem(some))
    assert found.population["b"].spread == 0.0 and found.population["b"].interval[1] > 0.0
    together = cs.solve(cs.Problem(line(), some, free=["a", "b"], noise={"y": SIGMA}))
    assert found.population["b"].mean == pytest.approx(together.values["b"], rel=1e-4)
    assert found.population["b"].mean_std == pytest.approx(together["b"].std_cramer_rao, rel=1e-3)


def test_estimated_noise_counts_as_in_the_analysis_of_variance() -> None:
    """Within a hundredth: the mean square within records, and the spread that goes with it."""
    some = [r.with_channels(u=np.zeros(len(r))) for r in records([12] * 8, 0.5, slope=0.0)]
    fit = cs.solve(cs.Problem(line(), some, per_record=["b"], spread={"b": np.inf}))
    means = np.array([r["y"].mean() for r in some])
    within = np.sum([((r["y"] - r["y"].mean()) ** 2).sum() for r in some]) / (8 * 11)
    assert fit.population["b"].spread == pytest.approx(np.sqrt(means.var(ddof=1) - within / 12), rel=0.01)


def test_a_dynamic_system_by_logarithms() -> None:
    """Time constants of twelve records, log-normal: mean and spread within their errors, and every record's own value
    nearer to the truth than that of the record alone, on average."""
    rng = np.random.default_rng(4)
    lag = cs.define_model(
        "lag",
        states=("x",),
        inputs=("u",),
        parameters={"T": 0.3},
        outputs=("x",),
        dynamics=lambda s: {"x": (s.u - s.x) / s.T},
        output=lambda s: {"x": s.x},
    )  # short records with much noise: alone they say little
    t, some, truth = 0.05 * np.arange(40), [], 0.5 * np.exp(0.2 * rng.standard_normal(12))
    still = cs.Record(name="s", t=t, channels={"u": np.where(t > 0.2, 1.0, 0.0)})
    for i, value in enumerate(truth):
        x = cs.simulate(lag, still, [0.0], {"T": value}).output("x") + 0.15 * rng.standard_normal(40)
        some.append(still.with_channels(x=x).renamed(f"m{i}"))
    rest = cs.InitialState(value={"x": 0.0}, std={"x": 0.0})
    common = {"per_record": ["T"], "log": ["T"], "noise": {"x": 0.15}, "initial_state": rest}
    fit, alone = cs.solve(cs.Problem(lag, some, spread={"T": 0.5}, **common)), cs.solve(cs.Problem(lag, some, **common))
    found = fit.population["T"]
    assert fit.converged and found.logarithmic
    assert abs(found.mean - np.log(0.5)) < 3.0 * found.mean_std
    assert found.interval[0] < 0.2 < found.interval[1]
    off = [np.square(np.log(list(f.values.values())) - np.log(truth)).mean() for f in (fit, alone)]
    assert off[0] < off[1]


def test_what_makes_no_sense_is_refused() -> None:
    some = records([5, 5], 0.5)
    with pytest.raises(InputError, match="per-record parameter"):
        cs.Problem(line(), some, free=["a", "b"], spread={"b": 1.0})
    with pytest.raises(InputError, match="two or more"):
        cs.Problem(line(), some[:1], free=["a"], per_record=["b"], spread={"b": 1.0})
    with pytest.raises(InputError, match="spread"):
        problem(some, -1.0)
