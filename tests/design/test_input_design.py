"""Optimal inputs. Truth: closed form of a static gain, the bound of an estimation on the record, simulated flights."""

from __future__ import annotations

import csv
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from estimation_cases import NOISE, TRUTH, short_period
from scipy.stats import chi2

from casid.design import Experiment, Multisine, StepInput, design_input, standard_3211
from casid.errors import EstimationError, InputError
from casid.estimation import Problem, solve
from casid.model.system import define_model
from problems.studies.designed_inputs import EXPERIMENTS, flown, volume, volume_std

REPO = Path(__file__).resolve().parents[2]
LIMIT, SURFACE = 0.04, 0.05


@cache
def experiment() -> Experiment:
    return Experiment(
        model=short_period(),
        surfaces={"delta_e": SURFACE},
        rest={"delta_e": 0.0},
        start=np.zeros(2),
        noise=NOISE,
        duration=8.0,
        dt=0.04,
        parameters=["*"],
        limits={"alpha": LIMIT},
    )


@cache
def designed(criterion: str = "D", pulses: int = 4):
    return design_input(experiment(), StepInput(pulses=pulses), criterion=criterion, starts=2)


def static(duration: float = 4.0, **options) -> Experiment:
    """q = a delta_e, one idle state: the bound is sigma / sqrt(sum of delta_e^2)."""
    model = define_model(
        "gain",
        states=("theta",),
        inputs=("delta_e",),
        parameters={"a": 2.0},
        outputs=("q",),
        dynamics=lambda s: {"theta": -s.theta},
        output=lambda s: {"q": s.a * s.delta_e},
    )
    return Experiment(
        model=model,
        surfaces={"delta_e": 0.1},
        rest={"delta_e": 0.02},
        start=np.zeros(1),
        noise={"q": 0.3},
        duration=duration,
        dt=0.05,
        parameters=["a"],
        **options,
    )


def test_the_best_pulse_of_a_static_gain_is_as_large_and_as_long_as_it_may_be():
    """Rest is 0.02: a pulse to 0.12 tells more than one to -0.08."""
    problem = static()
    design = design_input(problem, StepInput(pulses=1), starts=3)
    u = design.record["delta_e"]
    assert design.std["a"] == pytest.approx(0.3 / np.sqrt((u**2).sum()), rel=1e-9)
    begin, length, size = design.unknowns["delta_e"]
    assert size == pytest.approx(1.0, abs=1e-3)
    assert begin == pytest.approx(2 * 0.12, abs=0.01) and begin + length == pytest.approx(4.0, abs=0.01)


@pytest.mark.parametrize("shape", [StepInput(pulses=4), Multisine(lines=3)])
def test_the_bound_is_that_of_an_estimation_on_the_record(shape):
    design = design_input(experiment(), shape, starts=1)
    fit = solve(Problem(short_period(), [design.record], free=["*"], noise=NOISE))
    np.testing.assert_allclose(list(design.std.values()), [e.std for e in fit.parameters.values()], rtol=1e-6)
    relative = fit.covariance / np.outer(list(TRUTH.values()), list(TRUTH.values()))
    assert design.cost == pytest.approx(np.linalg.slogdet(relative)[1] / 5, rel=1e-6)
    assert np.abs(design.record["delta_e"]).max() <= SURFACE * 1.001
    assert np.abs(design.record["alpha"]).max() <= LIMIT * 1.001


@pytest.mark.parametrize("unit", [1e-6, 1e5])
def test_a_design_is_the_same_in_any_unit_of_its_states(unit):
    def std(size: float) -> float:
        problem = Experiment(
            model=define_model(
                "lag",
                states=("x",),
                inputs=("u",),
                parameters={"T": 0.5},
                outputs=("y",),
                dynamics=lambda s: {"x": (s.u - s.x) / s.T},
                output=lambda s: {"y": s.x},
            ),
            surfaces={"u": size},
            rest={"u": 0.0},
            start=np.zeros(1),
            noise={"y": 0.1 * size},
            duration=6.0,
            dt=0.1,
            parameters=["T"],
        )
        return standard_3211(problem).std["T"]

    assert std(unit) == pytest.approx(std(1.0), rel=1e-9)


def test_the_standard_input_is_a_3_2_1_1_at_its_limit():
    design = standard_3211(experiment())
    assert np.abs(design.record["alpha"]).max() == pytest.approx(LIMIT, rel=1e-3)
    durations, sizes = design.unknowns["delta_e"][1:5], design.unknowns["delta_e"][5:]
    np.testing.assert_allclose(durations / durations[-1], [3, 2, 1, 1])
    np.testing.assert_allclose(sizes / sizes[0], [1, -1, 1, -1])


def test_the_design_is_better_and_nothing_near_it_is_better_still():
    """Local optimality, by random small changes that keep all limits."""
    design, shape = designed(), StepInput(pulses=4)
    assert design.status == "optimal"
    assert design.cost < standard_3211(experiment()).cost - 0.3
    z, rng, tried = design.unknowns["delta_e"], np.random.default_rng(0), 0
    low, high = shape.bounds(8.0)
    for _ in range(40):
        trial = np.clip(z + 0.02 * rng.standard_normal(len(z)), low, high)
        record = experiment().record({"delta_e": SURFACE * shape.samples(trial, experiment().t)}, "trial")
        if np.abs(record["alpha"]).max() > LIMIT or shape.ends(trial) > 8.0:
            continue
        tried += 1
        covariance = solve(Problem(short_period(), [record], free=["*"], noise=NOISE)).covariance
        relative = covariance / np.outer(list(TRUTH.values()), list(TRUTH.values()))
        assert np.linalg.slogdet(relative)[1] / 5 >= design.cost - 1e-3
    assert tried >= 3


def test_a_start_that_bfgs_does_not_finish_ends_at_an_optimum(monkeypatch):
    """The exact Hessian takes over: IPOPT's conditions hold, and the limit is reached as at every optimum."""
    monkeypatch.setattr("casid.design.input_design._FIRST_ITERATIONS", 5)
    monkeypatch.setattr("casid.design.input_design._ITERATIONS", 0)
    shape, worse = StepInput(pulses=4), standard_3211(experiment(), criterion="A").cost
    monkeypatch.setattr("casid.design.input_design._EXACT_ITERATIONS", 0)
    begun = design_input(experiment(), shape, criterion="A", starts=1)
    monkeypatch.undo()
    monkeypatch.setattr("casid.design.input_design._FIRST_ITERATIONS", 5)
    monkeypatch.setattr("casid.design.input_design._ITERATIONS", 0)
    design = design_input(experiment(), shape, criterion="A", starts=1)
    assert begun.status.startswith("stopped") and design.status == "optimal"
    assert design.cost < begun.cost and design.cost < worse
    assert np.abs(design.record["alpha"]).max() == pytest.approx(LIMIT, rel=2e-3)


def test_each_criterion_is_best_in_its_own_measure():
    by_d, by_a = designed("D"), designed("A")

    def mean_variance(design):
        return np.mean([(design.std[n] / TRUTH[n]) ** 2 for n in TRUTH])

    assert by_a.cost == pytest.approx(np.log(mean_variance(by_a)), rel=1e-6)
    assert mean_variance(by_a) <= mean_variance(by_d) * (1 + 1e-3)


def test_flown_in_simulation_the_design_scatters_less_than_the_standard():
    """60 flights each: the scatter is the bound (chi-square), its volume smaller by more than chance (3 sigma)."""
    runs, problem = 60, experiment()
    volumes = []
    for design in (standard_3211(problem), designed()):
        estimates = flown(problem, design, runs, seed=3)
        assert len(estimates) == runs
        fit = solve(Problem(problem.model, [design.record], free=["*"], noise=NOISE))
        error = estimates - np.array(list(TRUTH.values()))
        squared = np.einsum("ri,ij,rj->", error, np.linalg.inv(fit.covariance), error)
        low, high = chi2.ppf([0.001, 0.999], error.size)
        assert low < squared < high
        volumes.append(volume(estimates, problem.sizes))
    # a log standard deviation from n runs is known to 1/sqrt(2 n), its mean over five axes to 1/sqrt(10 n); twice
    assert volumes[1] - volumes[0] < -3.0 / np.sqrt(5 * runs)


@pytest.mark.parametrize("criterion", ["D", "A"])
def test_the_volume_is_known_as_well_as_it_says(criterion):
    """Scatter over 400 draws of 100 normal estimates of three parameters, one of which dominates the trace."""
    rng, sizes = np.random.default_rng(0), np.array([1.0, 2.0, 5.0])
    draws = [sizes * [1.0, 0.2, 0.1] * rng.standard_normal((100, 3)) for _ in range(400)]
    scatter = np.std([volume(d, sizes, criterion) for d in draws])
    said = np.mean([volume_std(d, sizes, criterion) for d in draws])
    assert said == pytest.approx(scatter, rel=4 / np.sqrt(800))


def test_what_cannot_be_designed_is_said():
    with pytest.raises(InputError, match="delta_e"):
        replace(experiment(), surfaces={"delta_f": 0.1})
    with pytest.raises(InputError, match="positive"):
        replace(experiment(), limits={"alpha": 0.0})
    with pytest.raises(InputError, match="Mqq"):
        replace(experiment(), parameters=["Mqq"])
    with pytest.raises(InputError, match="rest"):
        replace(experiment(), rest={})
    with pytest.raises(InputError, match="'D' or 'A'"):
        design_input(experiment(), criterion="E")
    with pytest.raises(InputError, match="do not fit"):
        design_input(experiment(), StepInput(pulses=40))
    with pytest.raises(EstimationError, match="none fits"):
        standard_3211(static(duration=1.5))


def test_two_surfaces_share_the_record_and_keep_the_limits():
    """The lateral experiment, standard input: sideslip and bank at or below their limits, one of them reached."""
    lateral = EXPERIMENTS["lateral"]()
    record = standard_3211(lateral).record
    reached = [np.abs(record[name]).max() / limit for name, limit in lateral.limits.items()]
    reached += [np.abs(record[name]).max() / limit for name, limit in lateral.surfaces.items()]
    assert max(reached) == pytest.approx(1.0, abs=2e-3)
    moving = {name: record.t[np.abs(record[name]) > 1e-3] for name in lateral.surfaces}
    assert moving["delta_a"].max() < moving["delta_r"].min()


@pytest.mark.slow
def test_the_script_writes_table_page_and_records(tmp_path, script_here):
    asked = ("--experiment", "longitudinal", "--shape", "pulses4", "--runs", "20", "--starts", "1")
    status, _, error = script_here("design_input", *asked, "--out", tmp_path / "out")
    assert status == 0, error
    with (tmp_path / "out" / "design.csv").open(encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if row["input"] == "pulses4"]
    assert np.prod([float(row["bound / standard"]) for row in rows]) < 1.0
    assert (tmp_path / "out" / "design.html").read_text(encoding="utf-8").count("<img") == 2
    assert (tmp_path / "out" / "longitudinal_pulses4.csv").exists()


def test_the_script_refuses_wrong_names(script_here):
    status, _, error = script_here("design_input", "--experiment", "lateral2")
    assert status == 2 and "did you mean 'lateral'" in error
    status, _, error = script_here("design_input", "--runs", "5")
    assert status == 2 and "--runs 5" in error
