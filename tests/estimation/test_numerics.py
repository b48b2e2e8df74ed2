"""Truth: finite differences, closed forms of trivial systems, the order of Runge-Kutta, dense linear algebra."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from estimation_cases import TRUTH, elevator, exact, flight, matrices, short_period

from casid.estimation import Collocation, GaussNewton, MultipleShooting, Problem, SingleShooting, solve
from casid.estimation.attempt import build_objective
from casid.estimation.solvers.fixed_point import FixedPoint
from casid.estimation.solvers.kkt import BandedKKT
from casid.estimation.solvers.point import Point
from casid.estimation.solvers.quadratic import parameter_step
from casid.estimation.transcriptions.kernel import shooting_offer
from casid.estimation.transcriptions.steps import stage_functions
from casid.model.system import Model, define_model
from casid.native.compiler import c_compiler
from casid.records.record import Record


def pendulum():
    return define_model(
        "pendulum",
        states=("phi", "p"),
        inputs=("delta_a",),
        parameters={"k": 4.0, "c": 0.3, "b": 1.5, "bias": 0.01},
        outputs=("phi", "p", "pdot"),
        disturbances=("w_p",),
        dynamics=lambda s: {"phi": s.p, "p": -s.k * ca.sin(s.phi) - s.c * s.p * s.p + s.b * s.delta_a + s.w_p},
        output=lambda s: {"phi": s.phi, "p": s.p + s.bias, "pdot": -s.k * ca.sin(s.phi) - s.c * s.p * s.p},
    )


def pendulum_problem() -> Problem:
    rng = np.random.default_rng(0)
    t = np.cumsum(rng.uniform(0.05, 0.15, 23))
    names = ("phi", "p", "pdot", "delta_a")
    record = Record(name="m1", t=t, channels={n: 0.3 * rng.standard_normal(23) for n in names})
    return Problem(pendulum(), [record], free=["k", "b", "bias", "c"], noise={"phi": 0.1, "p": 0.2, "pdot": 0.4})


def numerical(function, at: np.ndarray) -> np.ndarray:
    """(values, len(at)) central differences."""
    columns = []
    for i in range(len(at)):
        h = 1e-5 * max(abs(at[i]), 1.0)
        up, down = at.copy(), at.copy()
        up[i] += h
        down[i] -= h
        columns.append((function(up) - function(down)) / (2 * h))
    return np.stack(columns, axis=-1)


def rows_of(objective, value, parameters) -> np.ndarray:
    """(K, L, o, n+f) of all slabs together."""
    layout = objective.layout
    everything = slice(0, layout.segments)
    rows = None
    for slab in objective.dynamics.slabs(
        value.trajectory, parameters, objective.whitening(objective.noise.levels), everything
    ):
        if rows is None:
            rows = np.full((layout.segments, layout.length, *slab.rows.shape[2:]), np.nan)
        rows[slab.segments, slab.samples] = slab.rows
    assert rows is not None
    return rows


@pytest.mark.parametrize("kernel", [False, True])
@pytest.mark.parametrize("samples", [4096, 16])
@pytest.mark.parametrize("method", [SingleShooting(), MultipleShooting(interval=5), MultipleShooting(interval=1)])
def test_block_derivatives_against_finite_differences(method, samples, kernel, monkeypatch):
    if kernel and c_compiler() is None:
        pytest.skip("no C compiler on this machine")
    monkeypatch.setattr("casid.estimation.transcriptions.shooting._SLAB_SAMPLES", samples)
    monkeypatch.setenv("CASID_COMPILE_FIRST", "1" if kernel else "")
    problem = pendulum_problem()
    objective = build_objective(problem, method)
    point = objective.start()
    n, theta = 2, point.theta
    value, parameters = objective.value(point), objective.parameters(theta)
    blocks = objective.dynamics.blocks(value.trajectory, parameters, objective.whitening(objective.noise.levels))
    rows = rows_of(objective, value, parameters)
    flat = rows.reshape(len(rows), -1, rows.shape[3])
    np.testing.assert_allclose(blocks.hessian, flat.transpose(0, 2, 1) @ flat, rtol=1e-10, atol=1e-12)
    weights = np.diagonal(objective.whitening(objective.noise.levels), axis1=1, axis2=2)[objective.layout.pattern]
    for segment in range(objective.layout.segments):

        def outputs(z: np.ndarray, segment=segment) -> np.ndarray:
            nodes = point.nodes.copy()
            nodes[segment] = z[:n]
            trajectory = objective.dynamics.trajectory(nodes, objective.parameters(z[n:]))
            weighted = (trajectory.y * weights)[segment]
            return np.concatenate([weighted.ravel(), trajectory.end[segment]])

        expected = numerical(outputs, np.concatenate([point.nodes[segment], theta]))
        found = np.concatenate([flat[segment], blocks.transition[segment]])
        np.testing.assert_allclose(found, expected, atol=2e-7 * np.abs(expected).max())


@pytest.mark.parametrize("method", [MultipleShooting(interval=5), Collocation(degree=2)])
def test_slope_of_the_cost_and_of_the_defects_along_a_step(method):
    """The linear model that a step was computed from is the derivative of what is evaluated."""
    objective = build_objective(pendulum_problem(), method)
    point = objective.start()
    value = objective.value(point)
    step = objective.step(point, value, objective.linearise(point, value), 0.0)

    def along(length: np.ndarray) -> np.ndarray:
        moved = Point(
            theta=point.theta + length[0] * step.theta,
            nodes=point.nodes + length[0] * step.nodes,
            noise=point.noise,
            points=None if point.points is None else point.points + length[0] * step.points,
        )
        at = objective.value(moved)
        return np.concatenate([[at.cost], at.defects.ravel(), at.gap.ravel()])

    slopes = numerical(along, np.zeros(1))[:, 0]
    assert step.slope == pytest.approx(slopes[0], rel=1e-6)
    # a full step would satisfy the linearised constraints
    np.testing.assert_allclose(slopes[1:], -np.concatenate([value.defects.ravel(), value.gap.ravel()]), atol=1e-6)


def integrator():
    return define_model(
        "integrator",
        states=("theta",),
        inputs=("q",),
        parameters={"scale": 1.0},
        outputs=("theta",),
        dynamics=lambda s: {"theta": s.scale * s.q},
        output=lambda s: {"theta": s.theta},
    )


@pytest.mark.parametrize("method", [SingleShooting(), MultipleShooting(interval=7)])
def test_inputs_between_samples_are_exact(method):
    """The integral of a linear input is the trapezoidal sum, of a held one the rectangular sum of what came before."""
    rng = np.random.default_rng(2)
    t = np.cumsum(rng.uniform(0.1, 0.4, 30))
    q = rng.standard_normal(30)
    sums = {"linear": 0.5 * (q[1:] + q[:-1]) * np.diff(t), "held": q[:-1] * np.diff(t)}
    for hold, steps in sums.items():
        theta = np.concatenate([[0.0], np.cumsum(steps)])
        record = Record(name="m1", t=t, channels={"q": q, "theta": theta}, hold=hold)
        objective = build_objective(Problem(integrator(), [record], free=["scale"]), method)
        value = objective.value(objective.start())
        flat = value.trajectory.y.reshape(-1)[objective.layout.sample[0]]
        np.testing.assert_allclose(flat, theta, atol=1e-13)
        assert value.worst() < 1e-13


def test_order_of_the_integration_is_four():
    errors = []
    for dt in (0.1, 0.05, 0.025):
        # knots of the input stay samples on every grid, so that the input is the same function of time
        t = dt * np.arange(int(round(6.0 / dt)) + 1)
        coarse = np.arange(0.0, 6.05, 0.1)
        u = np.interp(t, coarse, elevator(coarse))
        x = exact(*matrices(TRUTH), t, u[:, None], np.zeros(2), "linear")
        record = Record(name="m1", t=t, channels={"delta_e": u, "alpha": x[:, 0], "q": x[:, 1]})
        objective = build_objective(Problem(short_period(), [record], free=["Za"]), SingleShooting())
        trajectory = objective.value(objective.start()).trajectory
        errors.append(np.abs(trajectory.states[0] - x).max())
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert (np.abs(orders - 4.0) < 0.2).all(), orders


def test_collocation_integrates_with_order_two_d_minus_one():
    """Radau collocation of degree 2: order 3 (Hairer and Wanner, Solving ODEs II, theorem IV.5.2)."""
    errors = []
    for dt in (0.1, 0.05, 0.025):
        t = dt * np.arange(int(round(4.0 / dt)) + 1)
        record = Record(
            name="m1", t=t, channels={"delta_e": np.zeros(len(t)), "alpha": np.zeros(len(t)), "q": np.zeros(len(t))}
        )
        x = exact(*matrices(TRUTH), t, np.zeros((len(t), 1)), np.array([0.1, 0.0]), "held")
        objective = build_objective(Problem(short_period(), [record], free=["Za"]), Collocation(degree=2))
        point = objective.start()
        blocks = objective.linearise(point, objective.value(point)).blocks
        assert blocks is not None
        # the equations are linear: one Newton step solves them, and the transition is then that of the scheme
        end = np.array([0.1, 0.0])
        for transition in blocks.transition:
            end = transition[:, :2] @ end
        errors.append(np.abs(end - x[-1]).max())
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert (np.abs(orders - 3.0) < 0.2).all(), orders


def ring(n: int) -> Model:
    """n states in a ring, with the rate of each of five parameters in turn."""
    names = [f"x{i}" for i in range(n)]
    return define_model(
        "ring",
        states=names,
        inputs=(),
        parameters={f"k{i}": 1.0 for i in range(5)},
        outputs=("x0",),
        dynamics=lambda s: {
            name: getattr(s, f"k{i % 5}") * (getattr(s, names[i - 1]) - getattr(s, name))
            for i, name in enumerate(names)
        },
        output=lambda s: {"x0": s.x0},
    )


@pytest.mark.parametrize("by_kernel", [False, True])
@pytest.mark.parametrize("soft", [False, True])
@pytest.mark.parametrize(("n", "m"), [(2, 6), (18, 4), (18, 1)])
def test_banded_step_equals_a_dense_solution(soft, by_kernel, n, m):
    """Truth: the same optimality system, written out densely and solved by numpy."""
    solver = None
    if by_kernel:
        offer = shooting_offer("ring", lambda: stage_functions(ring(n), np.arange(5), ()), 0)
        offer.spent = np.inf
        solver = offer.get()
    if by_kernel and solver is None:
        pytest.skip("no C compiler on this machine")
    rng = np.random.default_rng(6)
    f = 5
    factors = rng.standard_normal((m, n + f + 2, n + f))
    hessian, gradient = factors.transpose(0, 2, 1) @ factors, rng.standard_normal((m, n + f))
    transition, d = rng.standard_normal((m, n, n + f)), rng.standard_normal((m - 1, n))
    a, b = transition[..., :n], transition[..., n:]
    root = rng.standard_normal((m - 1, n, 2))
    q = root @ root.transpose(0, 2, 1) if soft else np.zeros((m - 1, n, n))  # singular on purpose
    states, ties = n * m, n * (m - 1)
    system, right = np.zeros((states + f + ties,) * 2), np.zeros(states + f + ties)
    for j in range(m):
        where = np.r_[n * j : n * (j + 1), states : states + f]
        system[np.ix_(where, where)] += hessian[j]
        right[where] -= gradient[j]
    constraint = np.zeros((ties, states + f))
    for j in range(m - 1):
        row = slice(n * j, n * (j + 1))
        constraint[row, n * (j + 1) : n * (j + 2)] = np.eye(n)
        constraint[row, row] = -a[j]
        constraint[row, states:] = -b[j]
        system[states + f + n * j : states + f + n * (j + 1), states + f + n * j : states + f + n * (j + 1)] = -q[j]
    system[states + f :, : states + f] = constraint
    system[: states + f, states + f :] = constraint.T
    right[states + f :] = d.ravel()
    expected = np.linalg.solve(system, right)
    scale = np.tile([100.0, 0.01], n // 2)
    reduced = BandedKKT(m, n).solve(hessian, gradient, transition, d, q if soft else None, scale, solver)
    dp, _ = parameter_step(reduced.hessian, reduced.gradient, np.zeros((0, f)), np.zeros(0), np.zeros(0))
    found = np.concatenate([(reduced.ds0 - reduced.ds_p @ dp).ravel(), dp, (reduced.l0 - reduced.l_p @ dp).ravel()])
    np.testing.assert_allclose(found, expected, rtol=1e-8, atol=1e-10 * np.abs(expected).max())


def test_rounding_is_not_reported_as_failure():
    """A tolerance that no arithmetic can meet ends at the solution all the same, not in "no descent"."""
    record = flight(noise={"alpha": 0.002, "q": 0.004}, rng=np.random.default_rng(0))
    given = Problem(short_period(), [record], free=["*"])
    usual, strict = solve(given), solve(given, solver=GaussNewton(tolerance=1e-18))
    assert strict.converged or "iterations" in strict.status
    for name in TRUTH:
        assert strict[name].value == pytest.approx(usual[name].value, rel=1e-7)


def test_short_last_segment_and_unequal_records_are_only_padding():
    """A record whose length is no multiple of the interval simulates as one that is."""
    records = [flight("m1", t=np.arange(0.0, 3.0, 0.02)), flight("m2", t=np.arange(0.0, 4.5, 0.02))]
    problem = Problem(short_period(), records, free=["*"])
    for interval in (7, 64, 1000):
        objective = build_objective(problem, MultipleShooting(interval=interval))
        value = objective.value(objective.start())
        flat = value.trajectory.y.reshape(-1, 2)
        for r, record in enumerate(records):
            np.testing.assert_allclose(flat[objective.layout.sample[r]], record.matrix(["alpha", "q"]), atol=2e-8)
        assert value.worst() < 1e-6


def test_extrapolation_ends_at_the_fixed_point_of_an_affine_map_after_one_image_more_than_unknowns():
    shrink, shift = np.diag([0.9, 0.6, -0.5, 0.1]) + 0.1 * np.eye(4, k=1), np.array([1.0, -2.0, 0.5, 3.0])
    truth = np.linalg.solve(np.eye(4) - shrink, shift)
    plain, x, found = np.zeros(4), np.zeros(4), FixedPoint()
    for _ in range(5):
        plain, x = shrink @ plain + shift, found.following(x, shrink @ x + shift)
    np.testing.assert_allclose(x, truth, rtol=1e-10)
    assert np.abs(plain - truth).max() > 0.1 * np.abs(truth).max()
