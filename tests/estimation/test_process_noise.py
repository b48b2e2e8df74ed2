"""Truth: with known noise a linear system with process noise is one linear least-squares problem, written out here."""

from __future__ import annotations

import numpy as np
import pytest
from estimation_cases import NOISE, TRUTH, flight, short_period
from scipy.linalg import expm

from casid.errors import EstimationError, InputError
from casid.estimation import EquationError, GaussNewton, InitialState, Ipopt, MultipleShooting, Problem, solve
from casid.estimation.attempt import build_objective
from casid.model.system import define_model
from casid.records.record import Record

PRECISE = GaussNewton(tolerance=1e-9)


def drift_model():
    """A random walk observed with an unknown offset: theta' = q + w, measured theta; the rate q has a bias."""
    return define_model(
        "walk",
        states=("theta",),
        inputs=("q",),
        parameters={"bias": 0.0},
        outputs=("theta",),
        disturbances=("w_theta",),
        state_scale={"theta": 1.0},
        dynamics=lambda s: {"theta": s.q - s.bias + s.w_theta},
        output=lambda s: {"theta": s.theta},
    )


def walk_record(seed: int = 0) -> Record:
    rng = np.random.default_rng(seed)
    t = np.cumsum(rng.uniform(0.05, 0.15, 40))
    q = rng.standard_normal(40)
    steps = (q[:-1] - 0.4) * np.diff(t) + 0.3 * np.sqrt(np.diff(t)) * rng.standard_normal(39)
    theta = np.concatenate([[0.0], np.cumsum(steps)]) + 0.05 * rng.standard_normal(40)
    return Record(name="m1", t=t, channels={"q": q, "theta": theta}, hold="held")


@pytest.mark.parametrize("driver", ["theta", "w_theta"])
@pytest.mark.parametrize("solver", [PRECISE, Ipopt()])
def test_soft_defects_are_generalised_least_squares(driver, solver):
    record = walk_record()
    dt, count = np.diff(record.t), len(record)
    # unknowns: all states, then the bias
    measure = np.hstack([np.eye(count), np.zeros((count, 1))]) / 0.05
    walk = np.hstack([np.eye(count)[1:] - np.eye(count)[:-1], dt[:, None]]) / (0.3 * np.sqrt(dt))[:, None]
    prior = np.zeros((1, count + 1))
    prior[0, 0] = 1.0
    system = np.vstack([measure, walk, prior])
    right = np.concatenate([record["theta"] / 0.05, record["q"][:-1] * dt / (0.3 * np.sqrt(dt)), record["theta"][:1]])
    expected = np.linalg.lstsq(system, right, rcond=None)[0]
    covariance = np.linalg.inv(system.T @ system)
    known = InitialState(std={"theta": 1.0})
    given = Problem(drift_model(), [record], free=["bias"], noise={"theta": 0.05}, initial_state=known)
    fit = solve(given, MultipleShooting(interval=1, process_noise={driver: 0.3}), solver)
    assert fit.converged, fit.status
    assert fit["bias"].value == pytest.approx(expected[-1], rel=1e-7)
    assert fit["bias"].std_cramer_rao == pytest.approx(np.sqrt(covariance[-1, -1]), rel=1e-9)
    np.testing.assert_allclose(fit.states["m1"].trajectory[:, 0], expected[:-1], atol=1e-8)


def test_covariance_of_an_interval_is_that_of_the_linear_system():
    """Truth: Van Loan's integral of exp(As) G G' exp(As)' over the interval; noise held per sample, so to O(dt^2)."""
    record = flight(t=0.005 * np.arange(81), hold="held")
    problem = Problem(short_period(), [record], free=["Za"], noise=NOISE)
    objective = build_objective(problem, MultipleShooting(interval=40, process_noise={"alpha": 0.02, "q": 0.3}))
    point = objective.start()
    blocks = objective.linearise(point, objective.value(point)).blocks
    assert blocks is not None and blocks.covariance is not None
    a = np.array([[TRUTH["Za"], 1.0], [TRUTH["Ma"], TRUTH["Mq"]]])
    power = np.diag([0.02**2, 0.3**2])
    big = expm(np.block([[-a, power], [np.zeros((2, 2)), a.T]]) * 0.2)
    expected = big[2:, 2:].T @ big[:2, 2:]
    np.testing.assert_allclose(blocks.covariance[0], expected, rtol=1e-3)


def test_soft_defects_become_hard_as_the_noise_goes_to_zero():
    record = flight(noise=NOISE, rng=np.random.default_rng(3))
    given = Problem(short_period(), [record], free=["*"], noise=NOISE)
    hard = solve(given, MultipleShooting(interval=5), PRECISE)
    gaps = []
    for size in (1e-3, 1e-4, 1e-5, 1e-7):
        soft = solve(given, MultipleShooting(interval=5, process_noise={"alpha": size, "q": size}), PRECISE)
        assert soft.converged, soft.status
        gaps.append(max(abs(soft[n].value - hard[n].value) for n in TRUTH))
    assert gaps[1] < gaps[0] and gaps[2] < 0.1 * gaps[1] and gaps[3] < 1e-7
    # once it is small against the measurement noise, the effect goes with the variance, the square of the intensity
    assert gaps[2] / gaps[1] == pytest.approx(1e-2, rel=0.05)


def test_process_noise_explains_what_noise_free_dynamics_cannot():
    """A gust-driven short period: the bound without process noise misses the truth, with it it does not."""
    rng = np.random.default_rng(12)
    clean = flight(t=np.arange(0.0, 8.0, 0.02), hold="held")
    a = np.array([[TRUTH["Za"], 1.0], [TRUTH["Ma"], TRUTH["Mq"]]])
    shift = np.zeros((len(clean), 2))
    for k in range(len(clean) - 1):
        shift[k + 1] = shift[k] + 0.02 * a @ shift[k] + np.sqrt(0.02) * np.array([0.01, 0.05]) * rng.standard_normal(2)
    flown = clean.with_channels(
        alpha=clean["alpha"] + shift[:, 0] + NOISE["alpha"] * rng.standard_normal(len(clean)),
        q=clean["q"] + shift[:, 1] + NOISE["q"] * rng.standard_normal(len(clean)),
    )
    given = Problem(short_period(), [flown], free=["*"], noise=NOISE)
    hard = solve(given, MultipleShooting(interval=1))
    soft = solve(given, MultipleShooting(interval=1, process_noise={"alpha": 0.01, "q": 0.05}))

    def distance(fit) -> float:
        error = np.array([fit[n].value - TRUTH[n] for n in TRUTH])
        return float(error @ np.linalg.solve(fit.covariance, error))

    assert distance(soft) < 20.5 < distance(hard)  # chi-square, 5 degrees of freedom, 0.999
    assert soft.channels["q"].rms < hard.channels["q"].rms


def test_what_process_noise_needs_is_said():
    given = Problem(drift_model(), [walk_record()], free=["bias"])
    with pytest.raises(EstimationError, match="give Problem"):
        solve(given, MultipleShooting(process_noise={"theta": 0.1}))
    known = Problem(drift_model(), [walk_record()], free=["bias"], noise={"theta": 0.05})
    with pytest.raises(InputError, match="did you mean 'theta'"):
        solve(known, MultipleShooting(process_noise={"thta": 0.1}))
    pure = Problem(drift_model(), [walk_record()], free=["bias"], noise={"thetadot": 0.05}, cost=EquationError())
    with pytest.raises(EstimationError, match="simulates nothing"):
        solve(pure, MultipleShooting(process_noise={"theta": 0.1}))
    with pytest.raises(InputError, match="expected a positive number"):
        MultipleShooting(process_noise={"theta": 0.0})
