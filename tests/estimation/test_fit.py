"""What a fit can do once it is there. Truth: the flown short period, and the numbers that the fit itself has."""

from __future__ import annotations

import gc
import json
import weakref

import numpy as np
import pandas as pd
import pytest
from estimation_cases import NOISE, START, TRUTH, flight, short_period
from matplotlib import pyplot
from scipy.stats import norm

import casid as cs

COLUMNS = ["value", "std", "std_cramer_rao", "prior", "prior_std"]


@pytest.fixture(scope="module")
def fit() -> cs.Fit:
    records = [flight(name, noise=NOISE, rng=np.random.default_rng(k)) for k, name in enumerate(("m1", "m2"))]
    return cs.solve(cs.Problem(short_period(), records, free=["*"], start=START))


def test_a_data_frame_has_the_estimates(fit: cs.Fit) -> None:
    table = fit.to_frame()
    assert isinstance(table, pd.DataFrame) and list(table.columns) == COLUMNS and list(table.index) == list(TRUTH)
    for name, row in table.iterrows():
        assert [row[c] for c in COLUMNS] == [getattr(fit[str(name)], c) for c in COLUMNS]


def test_without_pandas_the_extra_is_named(fit: cs.Fit, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "pandas", None)
    with pytest.raises(cs.InputError, match=r"pip install 'casid\[pandas\]'"):
        fit.to_frame()


def test_latex_and_html_have_every_parameter(fit: cs.Fit) -> None:
    latex, html = fit.to_latex(), fit._repr_html_()
    assert latex.startswith(r"\begin{tabular}{lrrrrr}") and latex.endswith(r"\end{tabular}")
    for name in TRUTH:
        assert f"\n{name} & ${fit[name].value:.4g}$ &" in latex
        assert f">{name}</th>" in html and f"{fit[name].value:.6g}" in html


def test_a_plot_shows_what_was_measured(fit: cs.Fit) -> None:
    figure = fit.plot("m2")
    measured, fitted = figure.axes[0].lines
    assert figure.axes[0].get_title(loc="left") == "alpha [deg]"
    np.testing.assert_allclose(measured.get_ydata(), np.degrees(fit.problem.records[1]["alpha"]))
    np.testing.assert_allclose(fitted.get_ydata(), np.degrees(fit.predictions["m2"][:, 0]))
    assert pyplot.fignum_exists(figure.number)
    pyplot.close(figure)
    with pytest.raises(cs.InputError, match="did you mean 'm1'"):
        fit.plot("m11")


def test_another_record_is_predicted(fit: cs.Fit) -> None:
    """Truth: the exact flight from another initial state; the rest is the error of five estimates and of the step."""
    other = flight("m3", x0=(-0.03, 0.05), gain=1.5)
    predicted = fit.predict(other)
    for name in ("alpha", "q"):
        assert np.abs(predicted.output(name) - other[name]).max() < 0.03 * np.ptp(other[name])
    shifted = flight("m3", x0=(0.0, 0.0), gain=1.5)
    assert np.abs(shifted["q"] - other["q"]).max() > 0.1 * np.ptp(other["q"])  # the initial state mattered


def test_a_good_fit_has_no_remarks(fit: cs.Fit) -> None:
    assert fit.remarks == () and fit.to_dict()["remarks"] == []


def test_what_contradicts_the_file_is_said() -> None:
    """The file has Mde with the wrong sign, and Mq at 6 of its deviations; a wrong model misses q altogether."""
    record = flight(noise=NOISE, rng=np.random.default_rng(1))
    wrong = short_period({**TRUTH, "Mde": -TRUTH["Mde"], "Mq": -3.0}, prior_std={"Mq": 0.2})
    found = cs.solve(cs.Problem(wrong, [record], free=["*"], start=START))
    said = {remark.split(":")[0]: remark for remark in found.remarks}
    assert set(said) == {"Mq", "Mde"}
    away = (found["Mq"].value + 3.0) / 0.2
    assert f"{away:.1f} a-priori deviations" in said["Mq"] and "opposite sign" in said["Mde"]
    assert said["Mde"] in str(found) and json.loads(json.dumps(found.to_dict()))["remarks"] == list(found.remarks)
    missed = cs.solve(cs.Problem(wrong, [record], free=["Zde"], noise=NOISE))  # the elevator stays reversed
    assert missed.channels["q"].R2 < 0.0
    assert any(remark.startswith("q: R2 is -") for remark in missed.remarks)


def test_the_likelihood_is_that_of_the_residuals_and_is_shown(fit: cs.Fit) -> None:
    """Of normal noise, with its standard deviation at the optimum; where the cost is half the number of readings."""
    residuals = np.concatenate(list(fit.residuals.values()))
    sigma = np.array([fit.noise[name] for name in fit.problem.model.outputs])
    assert fit.log_likelihood == pytest.approx(norm.logpdf(residuals, scale=sigma).sum(), rel=1e-9)
    assert fit.cost == pytest.approx(0.5 * residuals.size, rel=1e-3)
    assert f"{fit.log_likelihood:.4f}" in str(fit)


@pytest.mark.parametrize("known", [False, True])
def test_standard_errors_of_few_samples_are_those_of_least_squares(known: bool) -> None:
    """A line through six samples: variance with N - f (Draper and Smith, Applied Regression Analysis, ch. 1). A start
    that the caller knows exactly is no unknown."""
    t = np.arange(6.0)
    record = cs.Record(
        name="m1", t=t, channels={"u": np.zeros(6), "y": 1.0 + 0.5 * t + np.array([1, -1, 1, -1, 1, -1])}
    )
    model = cs.define_model(
        "line",
        states=["y"],
        inputs=["u"],
        parameters={"slope": 0.5},
        outputs=["y"],
        dynamics=lambda s: {"y": s.slope},
        output=lambda s: {"y": s.y},
    )
    start = cs.InitialState(value={"y": 1.0}, std={"y": 1e-9}) if known else cs.InitialState(std={"y": 1e3})
    few = cs.solve(cs.Problem(model, record, free=["slope"], initial_state=start))
    phi = t[:, None] if known else np.stack([t, np.ones(6)], axis=1)
    _, squares, *_ = np.linalg.lstsq(phi, record["y"] - known, rcond=None)
    variance = squares[0] / (6 - phi.shape[1]) * np.linalg.inv(phi.T @ phi)[0, 0]
    assert few["slope"].std == pytest.approx(np.sqrt(variance), rel=1e-4)
    assert few.remarks == ()
    two = cs.solve(cs.Problem(model, record.between(0.0, 1.5), free=["slope"]))
    assert np.isnan(two["slope"].std) and any("as many unknowns as samples" in remark for remark in two.remarks)


def test_what_is_public_shows_itself_briefly(fit: cs.Fit) -> None:
    record = fit.problem.records[0]
    things = [record, fit, fit.problem, fit.problem.model, fit.uncertainty, fit.states["m1"], fit.predict(record)]
    things += [cs.identifiability(fit), fit.problem.initial_state]
    for thing in things:
        assert len(repr(thing).splitlines()) < 20 and len(repr(thing)) < 1500, type(thing)


def test_nothing_keeps_a_model_whose_fit_is_gone() -> None:
    model = short_period()
    fit = cs.solve(cs.Problem(model, flight(), free=list(TRUTH), noise=NOISE, start=START))
    assert fit.converged
    held = weakref.ref(model)
    del model, fit
    gc.collect()
    assert held() is None
