"""The compiled kernel of collocation against numpy, the step against the whole system of equations, refined meshes."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from estimation_cases import NOISE, START, cut, flight, needs_compiler, short_period

import casid as cs
from casid.estimation.attempt import build_objective
from casid.estimation.solvers.objective import Objective
from casid.estimation.solvers.point import SolverStep
from problems.every_problem import demo_problem


def everything() -> cs.Problem:
    """Three unequal records with gaps, inputs held and linear, a parameter for each record."""
    rng, records = np.random.default_rng(7), []
    for name, count in (("m1", 53), ("m2", 2), ("m3", 34)):
        t = np.cumsum(rng.uniform(0.01, 0.08, count))
        channels = {n: 0.3 * rng.standard_normal(count) for n in ("alpha", "q", "nz", "delta_e", "de2")}
        channels["q"][::3] = np.nan
        records.append(cs.Record(name=name, t=t, channels=channels, hold={"de2": "held"}))
    model = cs.define_model(
        "all",
        states=("alpha", "q"),
        inputs=("delta_e", "de2"),
        parameters={"a": 0.7, "b": -0.4, "c": 1.3},
        outputs=("alpha", "q", "nz"),
        dynamics=lambda s: {
            "alpha": ca.atan2(s.q, 1 + s.alpha**2) - ca.sin(s.a * s.alpha) + s.de2 * s.b,
            "q": -ca.tanh(s.q * s.c) + s.a * s.delta_e + 4.0 * s.alpha * s.q,
        },
        output=lambda s: {"alpha": s.alpha, "q": s.q + s.b * s.delta_e, "nz": ca.tan(0.2 * s.alpha) * s.c + s.a},
    )
    return cs.Problem(model, records, free=["a", "c"], per_record=["b"], start={"b[m2]": 0.6}, noise=_COVARIANCE)


_COVARIANCE = np.array([[0.09, 0.02, 0.0], [0.02, 0.25, 0.1], [0.0, 0.1, 4.0]])


def disturbed(objective: Objective):
    """A point where nothing is satisfied."""
    rng, point = np.random.default_rng(3), objective.start()
    nodes, points = (v + 0.05 * rng.standard_normal(v.shape) for v in (point.nodes, point.points))
    return replace(point, nodes=nodes, points=points)


def found(problem: cs.Problem, method: cs.Collocation):
    objective = build_objective(problem, method)
    point = disturbed(objective)
    value = objective.value(point)
    linear = objective.linearise(point, value)
    rows = np.zeros((0,))
    whole = slice(0, objective.layout.segments)
    slabs = objective.dynamics.slabs(
        value.trajectory, objective.parameters(point.theta), objective.whitening(value.noise.levels), whole
    )
    rows = np.concatenate([slab.rows.ravel() for slab in slabs])
    return objective, value, linear, rows, objective.step(point, value, linear, 0.0)


@needs_compiler
@pytest.mark.parametrize("degree, substeps", [(1, 1), (3, 1), (2, 3), (9, 1)])
def test_the_kernel_agrees_with_numpy(degree, substeps, own_cache, monkeypatch):
    method, problem = cs.Collocation(degree=degree, substeps=substeps), everything()
    monkeypatch.delenv("CASID_COMPILE_FIRST", raising=False)
    plain_objective, *plain = found(problem, method)
    assert plain_objective.dynamics.kernel is None
    monkeypatch.setenv("CASID_COMPILE_FIRST", "1")
    fast_objective, *fast = found(everything(), method)
    assert fast_objective.dynamics.kernel is not None
    for name in ("y", "gap", "end", "states"):
        close(getattr(fast[0].trajectory, name), getattr(plain[0].trajectory, name))
    for name in ("hessian", "channel_gradient", "gradient", "transition", "end"):
        close(getattr(fast[1].blocks, name), getattr(plain[1].blocks, name))
    close(fast[1].blocks.lift.shift, plain[1].blocks.lift.shift)
    close(fast[2], plain[2])
    for name in ("theta", "nodes", "points", "slope", "curvature", "price"):
        close(getattr(fast[3], name), getattr(plain[3], name), 1e-9)


def close(ours, theirs, tolerance: float = 1e-11) -> None:
    np.testing.assert_allclose(ours, theirs, rtol=tolerance, atol=tolerance * np.abs(theirs).max(initial=1e-300))


@pytest.mark.parametrize("degree, substeps", [(3, 1), (2, 2)])
def test_the_step_is_that_of_all_unknowns_at_once(degree, substeps):
    """Truth: parameters, nodes and every interior state in one dense system of optimality, by the programme that IPOPT
    takes: its Jacobians are CasADi's, and nothing is eliminated."""
    whole = cs.Problem(short_period(), [flight("m1"), flight("m2")], free=["*"], start=START, noise=NOISE)
    problem, method = cut(whole, 60), cs.Collocation(degree=degree, substeps=substeps)
    objective = build_objective(problem, method)
    point = disturbed(objective)
    value = objective.value(point)
    ours = objective.step(point, value, objective.linearise(point, value), 0.0)
    theirs = dense_step(objective, point, value)
    for name in ("theta", "nodes", "points", "slope", "curvature"):
        close(getattr(ours, name), getattr(theirs, name), 1e-7)
    assert ours.price > 0.1 * theirs.price  # of the order of the largest multiplier


def dense_step(objective: Objective, point, value) -> SolverStep:
    from casid.estimation.solvers.nlp import Packing, build, data, variables

    ones = np.ones_like(point.theta)
    x, d = Packing(variables(objective, point, ones)), Packing(data(objective, value.noise, ones, 1.0))
    programme = build(objective, x, d)
    functions = ca.Function(
        "all",
        [programme.x, programme.p],
        [programme.residual, ca.jacobian(programme.residual, programme.x), programme.g]
        + [ca.jacobian(programme.g, programme.x)],
    )
    at = x.pack(variables(objective, point, ones)), d.pack(data(objective, value.noise, ones, 1.0))
    r, jr, g, jg = (np.asarray(e.full()) for e in functions(*at))
    count, equations = jr.shape[1], len(g)
    system = np.block([[jr.T @ jr, jg.T], [jg, np.zeros((equations, equations))]])
    right = -np.concatenate([jr.T @ r, g])
    solved = np.linalg.solve(system, right)[:, 0]
    step, multipliers = solved[:count], solved[count:]
    parts = x.unpack(step)
    return SolverStep(
        theta=parts["theta"][:, 0],
        nodes=parts["nodes"].T * objective.scale,
        noise=point.noise,
        points=parts["points"].T.reshape(point.points.shape) * objective.scale,
        slope=float((jr.T @ r)[:, 0] @ step),
        curvature=float(np.square(jr @ step).sum()),
        price=float(np.abs(multipliers).max()),
        limit_multipliers=np.zeros(0),
    )


def test_a_finer_mesh_begins_on_the_polynomials_of_the_coarser_one():
    """Of polynomials of degree 3 in time nothing is lost, and the equations stay satisfied."""
    model = cs.define_model(
        "parabola",
        states=("x", "v"),
        inputs=("a",),
        parameters={"g": 2.0},
        outputs=("x",),
        dynamics=lambda s: {"x": s.v, "v": s.g * s.a},
        output=lambda s: {"x": s.x},
    )
    t = np.arange(0.0, 4.0, 0.25)
    record = cs.Record(name="m", t=t, channels={"a": np.sin(t), "x": np.zeros(len(t))})
    problem = cs.Problem(model, record, free=["g"], noise={"x": 1.0})
    coarse, fine = (build_objective(problem, cs.Collocation(substeps=k)) for k in (1, 3))
    fit = cs.GaussNewton().minimise(coarse)
    points = fine.dynamics.refined(coarse.dynamics, fit.point.nodes, fit.point.points)
    value = fine.value(replace(fit.point, points=points))
    assert value.worst() < 1e-12
    np.testing.assert_allclose(value.trajectory.y[:, ::3], fit.value.trajectory.y, atol=1e-12)


def test_an_aircraft_by_collocation_is_that_by_shooting():
    """Truth: the same likelihood, and estimates within a hundredth of their standard deviations."""
    by_shooting, by_collocation = (
        cs.solve(cut(demo_problem(), 500), m) for m in (cs.MultipleShooting(), cs.Collocation())
    )
    assert by_shooting.converged and by_collocation.converged
    assert by_collocation.log_likelihood == pytest.approx(by_shooting.log_likelihood, abs=0.01)
    for name in by_shooting.values:
        assert abs(by_collocation[name].value - by_shooting[name].value) < 0.01 * by_shooting[name].std


@needs_compiler
@pytest.mark.slow
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="the peak is read from /proc")
def test_an_aircraft_by_collocation_takes_seconds_and_megabytes():
    """24 parameters, two records, 1.5 s and 800 MB at most, in a process of its own; compiling is left out."""
    code = (
        "import time, casid as cs\nfrom pathlib import Path\n"
        "from problems.every_problem import demo_problem\n"
        "problem = demo_problem()\ncs.solve(problem, cs.Collocation())\n"
        "begin = time.process_time()\nfit = cs.solve(problem, cs.Collocation())\n"
        "peak = Path('/proc/self/status').read_text().partition('VmHWM:')[2].split()[0]\n"
        "print(time.process_time() - begin, float(peak) / 1e3, fit.converged)"
    )
    environment = os.environ | {"CASID_COMPILE_FIRST": "1"}
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment)
    seconds, megabytes, converged = ran.stdout.split()
    assert converged == "True" and float(seconds) < 1.5 and float(megabytes) < 800.0
