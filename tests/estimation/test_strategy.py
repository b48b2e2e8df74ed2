"""Truth: the parameters that the data were made with by LSODA or matrix exponentials; the likelihood of LSODA."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pytest
from estimation_cases import NOISE, flight, short_period
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import least_squares

import casid as cs
from casid.estimation.attempt import attempted
from casid.estimation.integration import Attempt
from casid.estimation.solvers.objective import Objective
from casid.estimation.solvers.timed import timed
from casid.estimation.strategy import _no_worse_than_start

Motion = Callable[[float, np.ndarray], list[float]]


def recorded(motion: Motion, names: tuple[str, ...], x0: list[float], t: np.ndarray, sigma: float) -> cs.Record:
    """States by LSODA, with white noise."""
    found = solve_ivp(motion, (t[0], t[-1]), x0, "LSODA", t, rtol=1e-10, atol=1e-12)
    noise = sigma * np.random.default_rng(1).standard_normal(found.y.shape)
    return cs.Record(name="m1", t=t, channels=dict(zip(names, found.y + noise, strict=True)))


def system(name: str, states: tuple[str, ...], start: dict[str, float], slopes: Callable[[Any], dict]) -> cs.Model:
    return cs.define_model(
        name,
        states=states,
        inputs=(),
        parameters=start,
        outputs=states,
        dynamics=slopes,
        output=lambda s: {x: getattr(s, x) for x in states},
    )


def pendulum(start: float, sigma: float = 0.05, length: float = 10.0, angle: float = 0.5) -> cs.Problem:
    model = system("pendulum", ("a", "w"), {"p": start}, lambda s: {"a": s.w, "w": -s.p * ca.sin(s.a)})
    t = np.linspace(0.0, 50.0, 1000)
    record = recorded(lambda _, x: [x[1], -length * np.sin(x[0])], ("a", "w"), [angle, 0.0], t, sigma)
    return cs.Problem(model, [record], free=["p"])


def van_der_pol(start: float, mu: float) -> cs.Problem:
    model = system("vdp", ("x", "y"), {"mu": start}, lambda s: {"x": s.y, "y": s.mu * (1 - s.x**2) * s.y - s.x})
    t = np.linspace(0.0, 20.0, 401)
    record = recorded(lambda _, x: [x[1], mu * (1 - x[0] ** 2) * x[1] - x[0]], ("x", "y"), [2.0, 0.0], t, 0.05)
    return cs.Problem(model, [record], free=["mu"])


LORENZ = {"s": 10.0, "r": 28.0, "b": 8.0 / 3.0}


def lorenz(factor: float) -> cs.Problem:
    model = system(
        "lorenz",
        ("x", "y", "z"),
        {name: factor * value for name, value in LORENZ.items()},
        lambda s: {"x": s.s * (s.y - s.x), "y": s.x * (s.r - s.z) - s.y, "z": s.x * s.y - s.b * s.z},
    )
    s, r, b = LORENZ.values()
    t = np.linspace(0.0, 10.0, 501)
    motion: Motion = lambda _, x: [s * (x[1] - x[0]), x[0] * (r - x[2]) - x[1], x[0] * x[1] - b * x[2]]  # noqa: E731
    return cs.Problem(model, [recorded(motion, ("x", "y", "z"), [-8.0, 7.0, 27.0], t, 0.5)], free=["*"])


def unstable(growth: float, decay: float, dt: float = 0.06, seconds: float = 60.0) -> tuple[cs.Problem, dict]:
    """A short period with the poles `growth` and -`decay`, flown by a pilot that a control law helps; from the truth.
    Exact for an elevator that runs linearly between the samples, as it is recorded."""
    trace, product = growth - decay, -growth * decay
    truth = {"Za": -1.0, "Zde": -0.15, "Ma": -1.0 * (trace + 1.0) - product, "Mq": trace + 1.0, "Mde": -6.0}
    a = np.array([[truth["Za"], 1.0], [truth["Ma"], truth["Mq"]]])
    big = np.zeros((4, 4))
    big[:2, :2], big[:2, 2], big[2, 3] = a, [truth["Zde"], truth["Mde"]], 1.0
    over, gain = expm(big * dt), np.array([2.5, 1.2])
    rng, count = np.random.default_rng(3), int(seconds / dt)
    pilot = 0.03 * np.repeat(rng.standard_normal(count // 50 + 1), 50)[:count]
    x, u = np.zeros((count, 2)), np.zeros(count)
    x[0] = 0.01, -0.02
    u[0] = gain @ x[0] + pilot[0]
    for k in range(count - 1):
        known = over[:2, :2] @ x[k] + over[:2, 2] * u[k] + over[:2, 3] * (pilot[k + 1] - u[k]) / dt
        x[k + 1] = np.linalg.solve(np.eye(2) - np.outer(over[:2, 3], gain) / dt, known)
        u[k + 1] = gain @ x[k + 1] + pilot[k + 1]
    channels = {"delta_e": u} | {
        n: x[:, i] + NOISE[n] * rng.standard_normal(count) for i, n in enumerate(("alpha", "q"))
    }
    record = cs.Record(name="m1", t=dt * np.arange(count), channels=channels)
    return cs.Problem(short_period(truth), [record], free=["*"]), truth


def right(fit: cs.Fit, truth: dict[str, float]) -> bool:
    return all(abs(fit[name].value - value) < 4.0 * fit[name].std for name, value in truth.items())


@pytest.mark.parametrize("method", [cs.SingleShooting(), cs.MultipleShooting(interval=100), cs.MultipleShooting()])
@pytest.mark.parametrize("poles", [(1.6, 3.3), (0.5, 2.0), (3.0, 4.0)])
def test_an_unstable_aircraft_from_the_truth(poles, method):
    """Single shooting over 60 s multiplies an error by exp(60 x pole)."""
    problem, truth = unstable(*poles)
    fit = cs.solve(problem, method)
    assert fit.converged and right(fit, truth)


@pytest.mark.parametrize("method", [cs.SingleShooting(), cs.MultipleShooting()])
@pytest.mark.parametrize("start", [1.0, 5.0, 9.0, 20.0, 40.0])
def test_a_pendulum_from_afar(start, method):
    fit = cs.solve(pendulum(start), method)
    assert fit.converged and fit["p"].value == pytest.approx(10.0, abs=4.0 * fit["p"].std)


@pytest.mark.parametrize("start, contradicted", [(18.0, True), (10.0, False)])
def test_stretches_of_a_stiff_motion_are_judged_too(start, contradicted):
    """A pendulum behind a sensor of 10 microseconds, which explicit steps of a sample do not follow."""
    given = pendulum(start)
    model = cs.define_model(
        "sensed pendulum",
        states=("a", "w", "seen"),
        inputs=(),
        parameters={"p": start},
        outputs=("a", "w"),
        dynamics=lambda s: {"a": s.w, "w": -s.p * ca.sin(s.a), "seen": 1e5 * (s.a - s.seen)},
        output=lambda s: {"a": s.seen, "w": s.w},
        guess=lambda r: np.stack([r["a"], r["w"], r["a"]], axis=1),
    )
    posed = cs.Problem(model, given.records, free=["p"])
    begun = timed(cs.GaussNewton(iterations=3), time.perf_counter())
    assert attempted(posed, cs.SingleShooting(implicit=True), begun).doubtful is contradicted


@pytest.mark.parametrize("start", [0.5, 12.0, 60.0])
def test_a_pendulum_that_swings_widely(start):
    fit = cs.solve(pendulum(start, length=4.0, angle=2.8), cs.SingleShooting())
    assert not fit.converged or right(fit, {"p": 4.0})


@pytest.mark.parametrize("start", [1.0, 30.0, 40.0])
def test_what_is_not_found_is_not_claimed(start):
    """Noise as large as the motion, and a start far away."""
    fit = cs.solve(pendulum(start, sigma=0.3))
    assert right(fit, {"p": 10.0}) if fit.converged else fit.result is not cs.Results.CONVERGED


@pytest.mark.parametrize("factor", [0.5, 0.7, 1.4, 2.0])
def test_chaos(factor):
    fit = cs.solve(lorenz(factor), cs.SingleShooting())
    assert fit.converged and right(fit, LORENZ)


@pytest.mark.parametrize(("start", "mu"), [(3.0, 1.0), (2.0, 5.0), (6.0, 2.0), (0.1, 1.0)])
def test_van_der_pol_by_single_shooting(start, mu):
    fit = cs.solve(van_der_pol(start, mu), cs.SingleShooting())
    assert fit.converged and right(fit, {"mu": mu})


def test_another_way_is_said_and_a_named_solver_only_judged():
    found = cs.solve(van_der_pol(2.0, 5.0), cs.SingleShooting())
    assert found.remarks and found.remarks[0] == found.way and found.method == "MultipleShooting"
    alone = cs.solve(van_der_pol(2.0, 5.0), cs.SingleShooting(), cs.GaussNewton(iterations=300))
    assert alone.method == "SingleShooting" and not alone.converged
    assert alone.result is cs.Results.ANOTHER_MINIMUM and "MultipleShooting" in alone.status
    assert alone.log_likelihood < found.log_likelihood


def test_a_good_fit_has_no_second_way():
    fit = cs.solve(pendulum(9.0, sigma=0.05))
    assert fit.way == "" and fit.remarks == () and fit.result is cs.Results.CONVERGED


def test_a_model_that_cannot_follow_its_data_may_converge():
    """Slow residuals that no parameter takes away: the second opinion agrees, and the estimate is that of SciPy's."""
    rng = np.random.default_rng(0)
    t = np.linspace(0.0, 20.0, 401)
    y = np.exp(-0.3 * t) + 0.05 * np.sin(1.3 * t) + 0.002 * rng.standard_normal(len(t))
    model = system("decay", ("x",), {"a": 0.2}, lambda s: {"x": -s.a * s.x})
    record = cs.Record(name="m1", t=t, channels={"x": y})
    known = cs.InitialState(value={"x": 1.0}, std={"x": 0.0})
    fit = cs.solve(cs.Problem(model, [record], free=["a"], initial_state=known), cs.SingleShooting())
    rates = np.linspace(0.2, 0.4, 200_001)
    sums = np.array([np.square(y - np.exp(-a * t)).sum() for a in rates[::100]])
    assert fit.converged and fit["a"].value == pytest.approx(rates[::100][sums.argmin()], abs=2e-4)


def lsoda_misfit(problem: cs.Problem, p: float) -> float:
    """-ln(likelihood) of the pendulum with estimated noise, its initial state at the reading, by LSODA."""
    record = problem.records[0]
    motion = solve_ivp(
        lambda _, x: [x[1], -p * np.sin(x[0])], (0.0, record.t[-1]), [record["a"][0], record["w"][0]], "LSODA", record.t
    )
    off = motion.y - np.stack([record["a"], record["w"]])
    return float(len(record) * np.log(np.sqrt((off**2).mean(axis=1))).sum())


@pytest.mark.parametrize("start", [1.0, 9.7, 10.3, 35.0])
@pytest.mark.parametrize("solver", [cs.Automatic(iterations=3), cs.Automatic()])
def test_never_less_likely_than_the_start(start, solver):
    problem = pendulum(start, sigma=0.3)
    fit = cs.solve(problem, cs.SingleShooting(), solver)
    residuals = fit.residuals["m1"]
    ended = len(residuals) * np.log(np.sqrt((residuals**2).mean(axis=0))).sum()
    assert ended <= lsoda_misfit(problem, start) + 0.1


@pytest.mark.parametrize("start", [6.0, 5.6], ids=["the truth", "another"])
def test_a_start_and_an_end_are_compared_by_steps_that_are_short_enough(start: float) -> None:
    """Truth: an oscillation at 6 rad/s, read five times a second. With one step between readings it is late and decays,
    so that a search by such steps comes to a faster one; cut short there it left the truth for worse. A start that is
    worse than that one in short steps too is not returned."""
    model = system("oscillator", ("x", "v"), {"w": start}, lambda s: {"x": s.v, "v": -(s.w**2) * s.x})
    t = np.arange(0.0, 6.0, 0.2)
    record = cs.Record(name="m", t=t, channels={"x": np.cos(6.0 * t), "v": -6.0 * np.sin(6.0 * t)})
    known = cs.InitialState(value={"x": 1.0, "v": 0.0}, std={"x": 0.0, "v": 0.0})
    problem = cs.Problem(model, [record], free=["w"], noise={"x": 0.5, "v": 3.0}, initial_state=known)
    coarse = Objective(problem, cs.SingleShooting(substeps=1).dynamics(problem))
    found = cs.GaussNewton().minimise(coarse)
    assert found.converged and found.point.theta[0] > 6.05
    end = Attempt(objective=coarse, outcome=found, method=cs.SingleShooting())
    clock = timed(cs.GaussNewton(), time.perf_counter())
    taken = _no_worse_than_start(problem, cs.SingleShooting(), end, clock)
    assert taken.values["w"] == (start if start == 6.0 else found.point.theta[0])


def test_a_constrained_fit_is_as_good_as_the_free_one_allows():
    """From zero, with a bound that binds and with an equality that the free solution nearly satisfies."""
    problem, truth = unstable(1.6, 3.3)
    free = cs.solve(problem)
    zero = dict.fromkeys(truth, 0.0)
    for limits in (
        [cs.limit_parameter("Mde", lower=truth["Mde"], upper=truth["Mde"])],
        [cs.limit_parameter("Mq", upper=free["Mq"].value - 0.5 * free["Mq"].std)],
        [cs.limit_parameter("Za", upper=0.0), cs.limit_parameter("Zde", upper=0.0)],
    ):
        fit = cs.solve(
            cs.Problem(problem.model, problem.records, free=["*"], start=zero, constraints=limits),
            cs.MultipleShooting(interval=100),
        )
        assert fit.converged and fit.log_likelihood > free.log_likelihood - 10.0


def test_seconds_bound_everything():
    """Collocation from where single shooting is lost, IPOPT and all: the budget is that of the whole."""
    problem = lorenz(3.0)
    cs.solve(problem, cs.SingleShooting())  # compiled
    begin = time.process_time()  # of the processor: a busy machine takes longer for the same work
    fit = cs.solve(problem, cs.SingleShooting(), cs.Automatic(seconds=0.05))
    assert time.process_time() - begin < 1.0
    assert fit.converged or fit.result in cs.Results


def test_the_reason_of_an_end_by_time_is_the_time():
    """Two states that nobody reads are guessed by a smoother first; the guess is in the time too."""
    problem = lorenz(3.0)
    record = problem.records[0]
    unread = cs.Record(name="x", t=record.t, channels={"x": record["x"]})
    model = cs.define_model(
        "lorenz of which x is read",
        states=("x", "y", "z"),
        inputs=(),
        parameters=LORENZ,
        outputs=("x",),
        dynamics=lambda s: {"x": s.s * (s.y - s.x), "y": s.x * (s.r - s.z) - s.y, "z": s.x * s.y - s.b * s.z},
        output=lambda s: {"x": s.x},
    )
    start = {name: 3.0 * value for name, value in LORENZ.items()}
    begin = time.process_time()  # of the processor: a busy machine takes longer for the same work
    fit = cs.solve(cs.Problem(model, [unread], free=["*"], start=start), solver=cs.Automatic(seconds=0.1))
    assert time.process_time() - begin < 0.6
    assert fit.converged or (fit.result is cs.Results.STOPPED and "time of 0.1 s" in fit.reason)


def test_seconds_bound_ipopt():
    """From ten times the equations of Lorenz, where it does not end within 20 s; its programme is built in that time.
    A busy machine takes longer for the same work, hence the time of the processor. Half a second beyond is allowed: a
    step that was begun ends."""
    problem, begin = lorenz(10.0), time.process_time()
    fit = cs.solve(problem, cs.MultipleShooting(interval=10), cs.Ipopt(seconds=1.0))
    assert time.process_time() - begin < 1.5
    assert fit.result is cs.Results.STOPPED and "time" in fit.reason


def test_seconds_bound_a_programme_of_more_steps():
    """One of 150 times the steps is not begun where it would take longer than there is time."""
    problem = lorenz(10.0)
    cs.solve(problem, cs.MultipleShooting(interval=10, substeps=2), cs.Ipopt(seconds=0.3))
    begin = time.process_time()
    fit = cs.solve(problem, cs.MultipleShooting(interval=10, substeps=300), cs.Ipopt(seconds=1.0))
    assert time.process_time() - begin < 1.5
    assert fit.result is cs.Results.STOPPED and "time" in fit.reason


def test_a_simulation_that_grows_ends_at_the_best_solution_or_says_that_it_departed():
    problem, _ = unstable(1.6, 3.3)
    best = cs.solve(problem, cs.MultipleShooting(interval=10))
    fit = cs.solve(problem, cs.SingleShooting(), cs.GaussNewton())
    if fit.converged:
        assert fit.log_likelihood == pytest.approx(best.log_likelihood, abs=0.01)
    else:
        assert fit.result is cs.Results.DEPARTED and "MultipleShooting" in fit.status


def test_every_result_says_what_to_do():
    assert all(one.value.endswith(".") and len(one.value) > 30 for one in cs.Results)


def test_an_infinite_reading_is_refused():
    record = flight(noise=NOISE, rng=np.random.default_rng(0))
    infinite = np.where(np.arange(len(record)) == 7, np.inf, record["q"])
    with pytest.raises(cs.InputError, match="'q' is infinite at sample 7"):
        record.with_channels(q=infinite)


def evaluations(problem: cs.Problem, monkeypatch: pytest.MonkeyPatch, *how: Any) -> tuple[int, cs.Fit]:
    """Simulations and linearisations that one solve takes."""
    count = [0]
    for name in ("value", "linearise"):
        plain = getattr(Objective, name)

        def counted(self: Objective, *given: Any, plain: Callable = plain) -> Any:
            count[0] += 1
            return plain(self, *given)

        monkeypatch.setattr(Objective, name, counted)
    fit = cs.solve(problem, *how)
    monkeypatch.undo()
    return count[0], fit


def wide(count: int, used: int) -> cs.Problem:
    """A lag of `used` inputs, each with a gain, in a model of `count` gains."""
    rng, names = np.random.default_rng(0), [f"c{i}" for i in range(count)]
    model = cs.define_model(
        "wide",
        states=("x",),
        inputs=[f"u{i}" for i in range(used)],
        parameters=dict.fromkeys(names, 0.5),
        outputs=("y",),
        dynamics=lambda s: {"x": -s.x + sum(getattr(s, f"c{i}") * getattr(s, f"u{i}") for i in range(used))},
        output=lambda s: {"y": s.x},
    )
    t = 0.05 * np.arange(200)
    inputs = cs.Record(name="r", t=t, channels={f"u{i}": rng.standard_normal(200) for i in range(used)})
    flown = cs.simulate(model, inputs, [0.0], {n: (-1.0) ** i for i, n in enumerate(names)}).as_record("flown")
    read = flown["y"] + 0.01 * rng.standard_normal(200)
    return cs.Problem(model, cs.Record(name="r", t=t, channels=dict(inputs.channels) | {"y": read}), free=["*"])


def test_a_parameter_that_stands_in_no_equation_costs_nothing(monkeypatch):
    """No start makes it known, so that none is tried."""
    alone, fit = evaluations(wide(10, 10), monkeypatch)
    beside, other = evaluations(wide(11, 10), monkeypatch)
    assert fit.converged and other.result is cs.Results.NOT_IDENTIFIABLE and "c10" in other.status
    assert beside <= alone + 2
    assert other["c3"].value == pytest.approx(fit["c3"].value, rel=1e-6)


@pytest.mark.parametrize("count", [2, 3, 6, 12, 51])
def test_effort_follows_the_size_of_the_record(count, monkeypatch):
    """Readings of a decay that is fitted exactly, or with noise: whatever is tried costs a hundredth of a second per
    parameter, not minutes, where an evaluation takes 50 microseconds."""
    t = np.linspace(0.0, 5.0, count)
    y = np.exp(-0.5 * t) + (0.0 if count < 6 else 0.05) * np.random.default_rng(0).standard_normal(count)
    model = system("decay", ("x",), {"k": 0.2}, lambda s: {"x": -s.k * s.x})
    number, _ = evaluations(cs.Problem(model, cs.Record(name="r", t=t, channels={"x": y}), free=["k"]), monkeypatch)
    assert number < 4000


@pytest.mark.parametrize("factor", [3.0, 10.0])
@pytest.mark.parametrize("method", [cs.SingleShooting(), cs.MultipleShooting()])
def test_what_follows_a_start_that_does_not_converge_is_bounded(factor, method, monkeypatch):
    """Chaos from far away: at most five times what the method that was asked for may take by itself."""
    problem = lorenz(factor)
    alone, _ = evaluations(problem, monkeypatch, method, cs.GaussNewton())
    number, _ = evaluations(problem, monkeypatch, method)
    assert number < 5 * max(alone, 100 * (10 + 10 * len(problem.parameters)))


@pytest.mark.parametrize("method", [cs.MultipleShooting(interval=4), cs.SingleShooting(), cs.Collocation()])
@pytest.mark.parametrize("compiler", [True, False])
def test_an_output_may_be_no_number_where_it_is_not_read(method, compiler, monkeypatch):
    """A share that is 0/0 before anything is there: the rest of its readings by scipy, on the solution on paper."""
    if compiler:
        monkeypatch.setenv("CASID_COMPILE_FIRST", "1")
    else:
        monkeypatch.setattr("casid.estimation.transcriptions.kernel.c_compiler", lambda: None)
    t = np.linspace(0.0, 8.0, 17)
    share = np.full(17, np.nan)
    noise = 0.01 * np.random.default_rng(0).standard_normal(16)
    share[1:] = (1.0 - np.exp(-0.5 * t[1:])) / (0.5 * t[1:]) + noise
    model = cs.define_model(
        "share",
        states=("A", "B"),
        inputs=(),
        parameters={"k": 0.3},
        outputs=("share",),
        dynamics=lambda s: {"A": 0.5 - s.k * s.A, "B": s.k * s.A},
        output=lambda s: {"share": s.A / (s.A + s.B)},
        initial=lambda _: {"A": 0.0, "B": 0.0},
    )
    record = cs.Record(name="r", t=t, channels={"share": share})
    fit = cs.solve(cs.Problem(model, record, free=["k"], noise={"share": 0.01}), method)
    best = least_squares(lambda k: (1.0 - np.exp(-k * t[1:])) / (k * t[1:]) - share[1:], [0.3])
    assert fit.converged
    assert fit["k"].value == pytest.approx(best.x[0], abs=0.01 * fit["k"].std)
