"""Truth: the mapped CasADi functions, which share no code with the emitted kernel below the symbolic model; numpy."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from estimation_cases import NOISE, START, flight, needs_compiler, short_period

from casid.estimation import MultipleShooting, OutputError, Problem, SingleShooting, solve
from casid.estimation.attempt import build_objective
from casid.estimation.transcriptions import kernel
from casid.estimation.transcriptions.kernel import shooting_offer
from casid.estimation.transcriptions.shooting import Shooting
from casid.model.simulate import simulate
from casid.model.system import Model, define_model
from casid.native import compiler
from casid.native.emitter import UnknownOperationError, emit
from casid.records.record import Record
from problems.bench.chain import chain_problem
from problems.paper.cases import Condition
from problems.paper.estimation import paper_problem
from problems.paper.truth import OUTPUTS, fly, noise_sigma
from problems.real import hfb320


def worst(ours: np.ndarray, theirs: np.ndarray) -> float:
    """Largest difference, relative to the largest entry."""
    return float(np.abs(ours - theirs).max() / max(np.abs(theirs).max(), 1e-300))


def compare(problem: Problem, method: MultipleShooting | SingleShooting) -> dict[str, float]:
    """Trajectory and blocks by the kernel against those by CasADi, at the start values."""
    objective = build_objective(problem, method)
    ours = objective.dynamics
    assert isinstance(ours, Shooting)
    rng = np.random.default_rng(3)
    point = objective.start()
    nodes = point.nodes + 0.01 * objective.scale * rng.standard_normal(point.nodes.shape)
    given = nodes, objective.parameters(point.theta)
    ours._offer.spent = np.inf
    built = ours._offer.get()
    assert built is not None
    fast = ours.trajectory(*given)
    fast_blocks = ours.blocks(fast, given[1], objective.whitening(objective.noise.levels))
    ours._offer._kernel = None
    slow = ours.trajectory(*given)
    slow_blocks = ours.blocks(slow, given[1], objective.whitening(objective.noise.levels))
    ours._offer._kernel = built
    squares = ((slow.y - objective.layout.z) ** 2 * objective.layout.present).sum(axis=1)
    assert fast.squares is not None
    found = {n: worst(getattr(fast, n), getattr(slow, n)) for n in ("states", "y", "end")}
    found["squares"] = worst(fast.squares, squares)
    names = ["hessian", "channel_gradient", "gradient", "transition", "end"]
    if slow_blocks.covariance is not None:
        names.append("covariance")
    found |= {f"blocks {n}": worst(getattr(fast_blocks, n), getattr(slow_blocks, n)) for n in names}
    return found


def do328_problem(case: str, closed: bool = False, missing: bool = False) -> Problem:
    flown = fly(Condition(case=case, manoeuvre=5, seed=1))
    sigma = noise_sigma(flown.exact)
    problem = paper_problem(flown, OutputError(), closed=closed, noise={name: sigma[name] for name in OUTPUTS})
    if not missing:
        return problem
    record, rng = problem.records[0], np.random.default_rng(4)
    holes = {n: np.where(rng.uniform(size=len(record)) < 0.3, np.nan, record[n]) for n in ("beta", "p", "q")}
    return Problem(
        problem.model,
        [record.with_channels(**holes)],
        free=problem.free,
        start=problem.start,
        noise=problem.noise,
        initial_state=problem.initial_state,
    )


@needs_compiler
@pytest.mark.parametrize("method", [SingleShooting(), MultipleShooting(interval=25), MultipleShooting(interval=1)])
@pytest.mark.parametrize("case", ["B", "D"])
def test_kernel_equals_casadi_on_the_do328(case, method):
    if case == "D" and isinstance(method, SingleShooting):
        pytest.skip("a departing simulation multiplies rounding without limit")
    found = compare(do328_problem(case), method)
    assert max(found.values()) < 1e-10, found


@needs_compiler
def test_kernel_equals_casadi_with_the_control_law_in_the_loop():
    found = compare(do328_problem("D", closed=True), SingleShooting())
    assert max(found.values()) < 1e-10, found


@needs_compiler
def test_kernel_equals_casadi_with_missing_samples():
    found = compare(do328_problem("B", missing=True), MultipleShooting(interval=25))
    assert max(found.values()) < 1e-10, found


@needs_compiler
@pytest.mark.parametrize("missing", [False, True])
def test_kernel_equals_casadi_with_correlated_noise(missing):
    problem, rng = do328_problem("B", missing=missing), np.random.default_rng(8)
    factor = np.array(list(problem.noise.values()))[:, None] * (np.eye(5) + 0.5 * np.tril(rng.standard_normal((5, 5))))
    found = compare(replace(problem, noise=factor @ factor.T), MultipleShooting(interval=25))
    assert max(found.values()) < 1e-10, found


@needs_compiler
def test_kernel_equals_casadi_with_process_noise():
    method = MultipleShooting(interval=10, process_noise={"q": 0.02, "d_delta_e": 0.001})
    found = compare(do328_problem("D"), method)
    assert max(found.values()) < 1e-10, found


@needs_compiler
def test_kernel_equals_casadi_with_many_states():
    """82 columns of 22 outputs, which are gathered in tiles."""
    found = compare(chain_problem(44, 38, 60), MultipleShooting(interval=20))
    assert max(found.values()) < 1e-10, found


@needs_compiler
def test_kernel_equals_casadi_on_hfb320(flight_data):
    problem = hfb320.problem(hfb320.record_from(flight_data / "hfb320_1_10.asc"))
    found = compare(problem, MultipleShooting(interval=20))
    assert max(found.values()) < 1e-10, found


def everything() -> Model:
    """One of every kind of operation that a model may contain, with its derivatives."""
    return define_model(
        "everything",
        states=("alpha", "q", "V"),
        inputs=("delta_e",),
        parameters={"a": 0.7, "b": 0.4, "c": 1.3},
        outputs=("alpha", "q", "nz"),
        disturbances=("w_q",),
        dynamics=lambda s: {
            "alpha": ca.atan2(s.q, 1 + s.alpha**2) - ca.sin(s.a * s.alpha) + ca.if_else(s.q > 0.1, s.b * s.q, s.q**2),
            "q": -ca.tanh(s.q * s.c) + ca.fmax(s.alpha, s.a * s.delta_e) + ca.exp(-s.b * s.V) + s.w_q,
            "V": ca.sqrt(s.V**2 + 1.0) / s.c + ca.fabs(s.q) / 9 + ca.asin(ca.cos(s.alpha) / 3) - ca.fmin(s.V, 2.0) * 2,
        },
        output=lambda s: {
            "alpha": ca.log(1.0 + s.V**2) + ca.tan(0.2 * s.alpha),
            "q": ca.constpow(1.5 + s.alpha**2, 1.7) * s.q + s.a,
            "nz": ca.sign(s.alpha) * ca.erf(s.b * s.q) + ca.atan(s.V) + ca.acos(0.1 * s.q),
        },
    )


@needs_compiler
@pytest.mark.parametrize("hold", ["linear", "held"])
def test_every_operation_unequal_records_own_parameters_irregular_time(hold):
    rng, records = np.random.default_rng(7), []
    for name, count in (("m1", 53), ("m2", 31), ("m3", 2), ("m4", 90)):
        t = np.cumsum(rng.uniform(0.01, 0.08, count))
        channels = {n: 0.3 * rng.standard_normal(count) for n in ("alpha", "q", "nz", "delta_e")}
        channels["q"][:: 3 + len(records)] = np.nan
        channels["V"] = np.full(count, 1.0)
        records.append(Record(name=name, t=t, channels=channels, hold=hold))
    problem = Problem(
        everything(),
        records,
        free=["a", "c"],
        per_record=["b"],
        start={"b[m2]": 0.6},
        noise={"alpha": 0.3, "q": 0.5, "nz": 2.0},
    )
    for interval in (7, 64, 1000):
        for noise in (None, {"q": 0.3, "w_q": 0.2}):
            found = compare(problem, MultipleShooting(interval=interval, process_noise=noise))
            assert max(found.values()) < 1e-11, (interval, noise, found)


@needs_compiler
def test_estimates_with_and_without_the_kernel_agree(own_cache, monkeypatch):
    def estimate() -> dict[str, float]:
        record = flight(noise=NOISE, rng=np.random.default_rng(0))
        found = solve(Problem(short_period(), [record], free=["*"], start=START))
        return found.values | {f"std {n}": found[n].std_corrected for n in found.values}

    without = estimate()
    assert not own_cache.exists()  # too small a task to compile anything
    monkeypatch.setattr(kernel, "_COMPILE_BASE", -1.0)
    with_kernel = estimate()
    assert len(list(own_cache.glob("*.so"))) == 1 and not list(own_cache.glob("building-*"))
    assert with_kernel == pytest.approx(without, rel=1e-8)


@needs_compiler
def test_two_processes_may_build_one_kernel_and_a_killed_one_leaves_nothing(own_cache):
    code = (
        "from casid.estimation.transcriptions import kernel\nkernel._COMPILE_BASE = -1.0\n"
        "import numpy as np\nfrom estimation_cases import NOISE, flight, short_period\n"
        "from casid.estimation import Problem, solve\n"
        "f = solve(Problem(short_period(), [flight(noise=NOISE, rng=np.random.default_rng(0))], free=['*']))\n"
        "print(repr(f['Za'].value))\n"
    )
    tests = str(Path(__file__).resolve().parents[2])
    environment = {**os.environ, "XDG_CACHE_HOME": str(own_cache.parent), "PYTHONPATH": tests}
    command = [sys.executable, "-c", code]

    def start() -> subprocess.Popen[str]:
        return subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment, start_new_session=True)

    killed = start()
    while not list(own_cache.glob("building-*/f.c")) and killed.poll() is None:
        time.sleep(0.001)
    os.killpg(killed.pid, signal.SIGKILL)
    killed.communicate()
    assert killed.returncode == -signal.SIGKILL
    both = [start(), start()]
    said = [process.communicate(timeout=120)[0] for process in both]
    assert said[0] == said[1] != ""
    assert [path.suffix for path in own_cache.iterdir()] == [".so"]


def test_an_unknown_operation_is_said_once_and_the_estimate_goes_on(caplog, monkeypatch):
    monkeypatch.setattr("casid.native.emitter.ARITHMETIC", {})
    kernel._say.cache_clear()
    model, x = short_period(), ca.SX.sym("x")
    with pytest.raises(UnknownOperationError, match="CasADi's OP_"):
        emit(ca.Function("f", [x], [x * x]), "f")
    record = flight(noise=NOISE, rng=np.random.default_rng(0))
    for _ in range(2):
        assert solve(Problem(model, [record], free=["*"], start=START)).converged
    expected = 1 if compiler.c_compiler() else 0
    assert sum("without the fast kernel" in r.message for r in caplog.records) == expected


def test_a_spline_of_casadi_is_called_so(caplog):
    kernel._say.cache_clear()
    wave = ca.interpolant("wave", "bspline", [np.linspace(-1.0, 1.0, 9)], np.sin(np.linspace(-1.0, 1.0, 9)))
    model = define_model(
        "spline",
        states=("x", "v"),
        inputs=("delta_e",),
        parameters={"a": 1.0, "b": 2.0},
        outputs=("x",),
        dynamics=lambda s: {"x": s.v, "v": -s.a * wave(s.x) - 0.1 * s.v + s.b * s.delta_e},
        output=lambda s: {"x": s.x},
    )
    record = flight(t=np.arange(0.0, 2.0, 0.1)).without("alpha", "q")
    record = record.with_channels(x=simulate(model, record, [0.1, 0.0]).output("x"))
    fit = solve(Problem(model, [record], free=["*"], start={"a": 0.8}))
    assert fit.converged and fit["a"].value == pytest.approx(1.0, abs=1e-5)
    said = [r.getMessage() for r in caplog.records]
    assert len(said) == (1 if compiler.c_compiler() else 0)
    assert all("calls a function of CasADi" in one for one in said)


def test_without_a_compiler_no_kernel_is_offered(monkeypatch):
    monkeypatch.setattr(kernel, "c_compiler", lambda: None)

    def never() -> tuple[ca.Function, ca.Function]:
        raise AssertionError("the source was written for nothing")

    offer = shooting_offer("m", never, 0)
    offer.spent = 1e9
    assert offer.get() is None
