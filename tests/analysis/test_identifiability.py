"""Identifiability in words. Truth: closed forms of least squares, symmetry, re-estimation with what was suggested."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2

from casid.analysis import identifiability
from casid.analysis.excitation import excitations
from casid.errors import InputError
from casid.estimation import EquationError, Problem, solve
from casid.model.simulate import simulate
from casid.model.system import define_model
from casid.records.record import Record
from problems.studies.designed_inputs import EXPERIMENTS

REPO = Path(__file__).resolve().parents[2]
ROLL = {"Lp": -3.0, "Lda": -8.0}
SIGMA = 0.005


def line(prior_std=None, nominal=None):
    """q = a delta_e + b delta_a: least squares."""
    return define_model(
        "line",
        states=("theta",),
        inputs=("delta_e", "delta_a"),
        parameters=nominal or {"a": 1.0, "b": 1.0},
        outputs=("q",),
        dynamics=lambda s: {"theta": -s.theta},
        output=lambda s: {"q": s.a * s.delta_e + s.b * s.delta_a},
        prior_std=prior_std,
    )


def line_record(correlation: float, seed: int = 0) -> Record:
    rng = np.random.default_rng(seed)
    first, other = rng.standard_normal((2, 200))
    second = correlation * first + np.sqrt(1 - correlation**2) * other
    q = 2.0 * first - 0.5 * second + 0.3 * rng.standard_normal(200)
    return Record(name="m1", t=0.1 * np.arange(200), channels={"delta_e": first, "delta_a": second, "q": q})


def roll(prior_std=None):
    return define_model(
        "roll",
        states=("p",),
        inputs=("delta_a",),
        parameters=ROLL,
        outputs=("p",),
        dynamics=lambda s: {"p": s.Lp * s.p + s.Lda * s.delta_a},
        output=lambda s: {"p": s.p},
        prior_std=prior_std,
    )


def roll_record(frequency_hz: float, seed: int = 0, name: str = "m1") -> Record:
    t = np.arange(0.0, 20.0, 0.04)
    record = Record(name=name, t=t, channels={"delta_a": 0.05 * np.sin(2 * np.pi * frequency_hz * t)})
    flown = simulate(roll(), record, np.zeros(1)).as_record()
    return flown.with_channels(p=flown["p"] + SIGMA * np.random.default_rng(seed).standard_normal(len(t)))


def test_inflation_is_that_of_correlated_regressors():
    """Two regressors with correlation r: singular values sqrt(1 +- r), variance inflated by 1/(1 - r^2)."""
    record = line_record(0.999)
    phi = record.matrix(["delta_e", "delta_a"])
    r = phi[:, 0] @ phi[:, 1] / np.sqrt((phi[:, 0] ** 2).sum() * (phi[:, 1] ** 2).sum())
    fit = solve(Problem(line(), [record], free=["*"], noise={"q": 0.3}))
    report = identifiability(fit)
    np.testing.assert_allclose(report.singular_values, np.sqrt([1 + r, 1 - r]), rtol=1e-6)
    assert report.condition == pytest.approx(np.sqrt((1 + r) / (1 - r)), rel=1e-6)
    for name in "ab":
        assert report.inflation[name] == pytest.approx(1 / np.sqrt(1 - r**2), rel=1e-6)
    (weak,) = report.weak
    # the change raises the sum of squared weighted residuals by one
    shift = phi @ [weak.change["a"], weak.change["b"]] / 0.3
    assert shift @ shift == pytest.approx(1.0, rel=1e-6)
    assert weak.change["a"] * weak.change["b"] < 0
    assert "a" in str(report) and "apart" not in weak.sentence and "from" in weak.sentence


def pair_fit(correlation: float):
    return solve(Problem(line(), [line_record(correlation)], free=["*"], noise={"q": 0.3}))


def test_orthogonal_regressors_are_told_apart():
    report = identifiability(pair_fit(0.0))
    assert not report.weak and not report.unseen and report.condition < 1.3
    assert "told apart from the others" in str(report)
    assert report.blends == {}
    for less in (replace(report, unseen={"a": None}), replace(identifiability(pair_fit(0.999)), unseen={})):
        assert bool(less.weak) != bool(less.unseen) and "told apart from the others" not in str(less)


def test_a_sum_is_all_that_is_seen_of_two_that_enter_together():
    model = define_model(
        "double",
        states=("theta",),
        inputs=("delta_e",),
        parameters={"a": 1.0, "b": 1.0, "c": 0.5, "d": 1.0},
        outputs=("q",),
        dynamics=lambda s: {"theta": -s.theta},
        output=lambda s: {"q": (s.a + s.b) * s.delta_e + s.c + 0.0 * s.d},
    )
    record = line_record(0.0).without("delta_a")
    report = identifiability(solve(Problem(model, [record], free=["*"], noise={"q": 0.3})))
    (weak,) = report.weak
    assert set(weak.change) == {"a", "b"} and weak.change["a"] == pytest.approx(-weak.change["b"])
    assert weak.cannot and weak.singular_value == 0.0 and weak.condition == np.inf
    # no manoeuvre changes that
    assert weak.help is None and "fix one" in weak.sentence
    assert "cannot tell a from b" in weak.sentence or "cannot tell b from a" in weak.sentence
    assert report.unseen == {"d": None} and "depends on d" in str(report)
    assert report.inflation["a"] == report.inflation["b"] == np.inf and report.inflation["c"] < 1.1


def test_slow_roll_hides_damping_behind_effectiveness_and_the_suggestion_cures_it():
    """At low frequency p = -Lda/Lp delta_a: only the ratio is seen. The gain is that of an estimation with both."""
    slow = roll_record(0.02)
    fit = solve(Problem(roll(), [slow], free=["*"], noise={"p": SIGMA}))
    report = identifiability(fit)
    (weak,) = report.weak
    ratio = weak.change["Lda"] / weak.change["Lp"]
    assert ratio == pytest.approx(ROLL["Lda"] / ROLL["Lp"], rel=0.1)
    assert "aileron delta_a moved by" in report.excitation[0].sentence
    suggested = weak.help
    assert suggested is not None and suggested.control == "delta_a" and suggested.gain > 3
    noisy = suggested.record["p"] + SIGMA * np.random.default_rng(1).standard_normal(len(suggested.record))
    both = solve(Problem(roll(), [slow, suggested.record.with_channels(p=noisy)], free=["*"], noise={"p": SIGMA}))
    names = list(fit.parameters)
    coordinate = report.vectors[:, -1] * np.sqrt(np.diagonal(np.linalg.inv(fit.covariance)))
    assert names == list(report.names)
    spread = [np.sqrt(coordinate @ f.covariance @ coordinate) for f in (fit, both)]
    assert spread[0] / spread[1] == pytest.approx(suggested.gain, rel=0.05)
    assert identifiability(both).condition < report.condition
    assert f"{suggested.gain:.1f} times more certain" in str(report)


def test_roll_excited_at_one_frequency_is_named_with_what_it_hides():
    report = identifiability(solve(Problem(roll(), [roll_record(0.05)], free=["*"], noise={"p": SIGMA})))
    sentence = report.weak[0].sentence
    found = float(sentence.split("tell Lp from Lda (aileron delta_a moved at ")[1].split(" Hz only)")[0])
    assert found == pytest.approx(0.05, abs=0.5 / 20.0)  # of the resolution of 20 s


def test_a_control_at_rest_is_what_its_derivative_needs():
    lateral, t = EXPERIMENTS["lateral"](), EXPERIMENTS["lateral"]().t
    record = lateral.record({"delta_a": 0.02 * np.sin(2.0 * np.pi * 0.3 * t)}, "m1")
    report = identifiability(solve(Problem(lateral.model, [record], free=["Cl_p", "Cl_delta_*"], noise=lateral.noise)))
    assert [m.control for m in report.excitation] == ["delta_a", "delta_r"]  # elevator: no part of lateral motion
    helped = report.unseen["Cl_delta_r"]
    assert len(report.unseen) == 1 and helped is not None and helped.control == "delta_r"
    assert "depends on Cl_delta_r; a doublet on delta_r" in str(report)


def test_the_advice_for_an_aircraft_is_right_when_it_is_flown():
    """Do 328, slow aileron: scatter of the hidden combination over 20 flights without and with the advised manoeuvre,
    flown by the true aircraft. Each within chi-square bounds of what the report says of it."""
    lateral, t, runs = EXPERIMENTS["lateral"](), EXPERIMENTS["lateral"]().t, 20
    doublet = 0.03 * (((t > 1) & (t < 2)) * 1.0 - ((t >= 2) & (t < 3)))
    flown = lateral.record({"delta_a": 0.01 * np.sin(2 * np.pi * 0.1 * t), "delta_r": doublet}, "m1")
    truth = dict(zip(lateral.model.parameters, lateral.model.nominal_vector(), strict=True))

    def estimated(*records: Record, seed: int):
        rng, noisy = np.random.default_rng([seed, len(records)]), []
        for record in records:
            drawn = {n: record[n] + s * rng.standard_normal(len(record)) for n, s in lateral.noise.items()}
            noisy.append(record.with_channels(**drawn))
        return solve(Problem(lateral.model, noisy, free=["Cl_[!0]*", "Cn_[!0]*"], noise=lateral.noise))

    fit = estimated(flown, seed=0)
    report = identifiability(fit)
    weak = report.weak[0]
    assert weak.help is not None and weak.help.gain > 5 and [m.control for m in weak.poor] == ["delta_a"]
    moves = {n: weak.help.record[n] - lateral.rest[n] for n in lateral.surfaces}
    advised = lateral.record(moves, "m2")
    coordinate = report.vectors[:, -1] * np.sqrt(np.diagonal(np.linalg.inv(fit.covariance)))
    said = np.sqrt(coordinate @ fit.covariance @ coordinate)
    low, high = np.sqrt(chi2.ppf([0.001, 0.999], runs) / runs)
    for records, expected in (((flown,), said), ((flown, advised), said / weak.help.gain)):
        fits = [estimated(*records, seed=seed) for seed in range(1, runs + 1)]
        off = [coordinate @ [f.values[n] - truth[n] for n in report.names] for f in fits]
        assert low < np.sqrt(np.mean(np.square(off))) / expected < high


def test_excitation_words_tell_the_band_and_who_rests():
    t = np.arange(0.0, 30.0, 0.02)
    quiet = 1e-4 * np.random.default_rng(0).standard_normal(len(t))
    wide = 0.05 * np.sin(2 * np.pi * 0.3 * t) + 0.05 * np.sin(2 * np.pi * 2.0 * t)
    channels = {"delta_e": wide, "delta_a": 0.1 + 0.05 * np.sin(2 * np.pi * 0.5 * t), "delta_r": quiet}
    moved = excitations([Record(name="m1", t=t, channels=channels)], list(channels))
    elevator, aileron, rudder = (m.sentence for m in moved)
    assert [m.poor for m in moved] == [False, True, True]
    assert "at 0.5 Hz only" in aileron and "moved by 0.05" in aileron
    low, high = (float(text) for text in elevator.split("between ")[1].removesuffix(" Hz").split(" and "))
    assert low == pytest.approx(0.3, abs=1 / 30) and high == pytest.approx(2.0, abs=1 / 30)
    assert rudder == "rudder delta_r did not move"


def test_the_blend_is_that_of_two_normal_distributions_whether_the_fit_used_the_prior_or_not():
    record, prior_std = line_record(0.9), {"a": 0.02, "b": 50.0}
    phi, z = record.matrix(["delta_e", "delta_a"]), record["q"]
    precision = np.diag([1 / 0.02**2, 1 / 50.0**2])
    posterior = np.linalg.inv(phi.T @ phi / 0.3**2 + precision)
    expected = posterior @ (phi.T @ z / 0.3**2 + precision @ [1.0, 1.0])
    alone = np.sqrt(np.diagonal(np.linalg.inv(phi.T @ phi / 0.3**2)))
    for prior in (False, True):
        fit = solve(Problem(line(prior_std), [record], free=["*"], noise={"q": 0.3}, prior=prior))
        blends = identifiability(fit).blends
        for i, name in enumerate("ab"):
            assert blends[name].value == pytest.approx(expected[i], rel=1e-6)
            assert blends[name].std == pytest.approx(np.sqrt(posterior[i, i]), rel=1e-6)
            assert blends[name].data_std == pytest.approx(alone[i], rel=1e-5)
        # twenty times tighter than the data: not moved; a thousand times looser: moved
        assert not blends["a"].moved and blends["b"].moved
        assert "did not move a (" in str(identifiability(fit))
        # a surprise is the distance of both over the scatter of their difference; b is independent of what a says
        fixed = solve(Problem(line({"b": 0.1}), [record], free=["b"], fixed={"a": 2.0}, noise={"q": 0.3}, prior=prior))
        free_std = 0.3 / np.sqrt((phi[:, 1] ** 2).sum())
        b = phi[:, 1] @ (z - 2.0 * phi[:, 0]) / (phi[:, 1] ** 2).sum()
        found = identifiability(fixed)
        assert found.blends["b"].surprise == pytest.approx((1.0 - b) / np.hypot(free_std, 0.1), rel=1e-6)
        assert "a-priori value of b" in str(found)


def test_equation_error_has_the_same_report_without_a_manoeuvre():
    record = roll_record(0.02)
    fit = solve(Problem(roll(), [record], free=["*"], cost=EquationError()))
    report = identifiability(fit)
    assert report.condition > 10 and report.weak[0].help is None


def test_an_unknown_control_is_named():
    fit = solve(Problem(roll(), [roll_record(0.02)], free=["*"], noise={"p": SIGMA}))
    with pytest.raises(InputError, match="delta_a"):
        identifiability(fit, controls=["delta_aa"])


def test_the_script_reports_the_demonstration_and_refuses_half_an_input(tmp_path, script_here):
    status, said, error = script_here("identifiability", "--out", tmp_path / "out")
    assert status == 0, error
    found = json.loads((tmp_path / "out" / "identifiability.json").read_text(encoding="utf-8"))
    # unit columns: the squares of the singular values sum to the number of parameters
    assert sum(value**2 for value in found["singular_values"]) == pytest.approx(len(found["names"]), rel=1e-9)
    assert all(direction["sentence"] in said for direction in found["weak"])
    assert set(found["blend"]) <= set(found["names"])
    status, _, error = script_here("identifiability", "flight.csv")
    assert status == 2 and "--aircraft" in error and error.count("\n") == 1


def test_two_dependencies_of_one_strength_are_not_mixed() -> None:
    """Two outputs of the same two regressors, which correlate by 0.995, and a faint third that sees a sum of both: the
    weak directions are shared out among all four parameters, and estimates correlate within an output."""
    rng, t = np.random.default_rng(4), 0.05 * np.arange(400)
    u = np.sin(t) + 0.3 * np.sin(3.1 * t)
    v = u + 0.1 * np.std(u) * rng.standard_normal(len(t))
    model = define_model(
        "two gains twice",
        states=["x"],
        inputs=["u", "v"],
        parameters={"a1": 1.0, "a2": 1.0, "b1": 1.0, "b2": 1.0},
        outputs=["y", "z", "both"],
        dynamics=lambda s: {"x": s.u - s.x},
        output=lambda s: {
            "y": s.a1 * s.u + s.a2 * s.v,
            "z": s.b1 * s.u + s.b2 * s.v,
            "both": 0.05 * (s.a1 + s.b1) * s.u,
        },
    )
    flown = simulate(model, Record(name="m1", t=t, channels={"u": u, "v": v}), np.zeros(1)).as_record("m1")
    noise = {"y": 0.01, "z": 0.01, "both": 0.01}
    found = identifiability(solve(Problem(model=model, records=[flown], free=["a*", "b*"], noise=noise)))
    assert len(found.weak) == 2
    for direction in found.weak:
        outputs = {name[0] for name in direction.change}
        assert len(direction.change) > 2 or len(outputs) == 1, direction
