"""Initial states that are not given: as free as the data decide, in any unit, and told with their errors."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import curve_fit, least_squares

import casid as cs

T = np.linspace(0.0, 10.0, 41)


def decay(output: str, rate: float = 0.2) -> cs.Model:
    return cs.define_model(
        "decay",
        states=["x"],
        inputs=[],
        parameters={"k": rate},
        outputs=[output],
        dynamics=lambda s: {"x": -s.k * s.x},
        output=lambda s: {output: s.x},
    )


def readings(size: float, seed: int = 0) -> np.ndarray:
    return size * (np.exp(-0.3 * T) + 0.05 * np.random.default_rng(seed).standard_normal(len(T)))


def fitted(size: float, output: str, noise: bool, seed: int = 0, starts: int | None = None, **more) -> cs.Fit:
    record = cs.Record(name="r", t=T, channels={output: readings(size, seed)})
    sigma = {output: 0.05 * size} if noise else None
    return cs.solve(cs.Problem(decay(output), record, free=["k"], noise=sigma, **more), starts=starts)


@pytest.mark.parametrize("noise", [True, False], ids=["given", "estimated"])
@pytest.mark.parametrize("output", ["x", "y"])
@pytest.mark.parametrize("size", [1e-12, 1e-5, 1.0, 1e3, 1e5, 1e12])
def test_the_size_of_a_state_changes_nothing(size, output, noise):
    """Truth: least squares of the exponential, by scipy, in units of the size."""
    (first, rate), covariance = curve_fit(lambda t, a, k: a * np.exp(-k * t), T, readings(1.0), [1.0, 0.2])
    fit = fitted(size, output, noise)
    assert fit.converged, fit.status
    assert fit["k"].value == pytest.approx(rate, rel=1e-4)
    initial = fit.initial_states["r"]["x"]
    assert initial.value / size == pytest.approx(first, rel=1e-4)
    if not noise:  # scipy estimates it from the residuals too
        assert fit["k"].std_cramer_rao == pytest.approx(np.sqrt(covariance[1, 1]), rel=1e-3)
        assert initial.std_cramer_rao / size == pytest.approx(np.sqrt(covariance[0, 0]), rel=1e-3)


@pytest.mark.parametrize("zero", [0.0, 273.15])
@pytest.mark.parametrize("output", ["T", "reading"])
def test_nor_does_where_the_unit_begins(zero, output):
    """Truth: curve_fit's least squares of a cup that cools to 20 degrees, in degrees Celsius and in Kelvin."""
    t = np.linspace(0.0, 60.0, 61)
    y = 20.0 + 70.0 * np.exp(-0.05 * t) + 5.0 * np.random.default_rng(0).standard_normal(61)
    best, _ = curve_fit(lambda t, first, k: 20.0 + (first - 20.0) * np.exp(-k * t), t, y, [80.0, 0.03])
    model = cs.define_model(
        "cup",
        states=["T"],
        inputs=[],
        parameters={"k": 0.03},
        outputs=[output],
        dynamics=lambda s: {"T": -s.k * (s.T - 20.0 - zero)},
        output=lambda s: {output: s.T},
    )
    fit = cs.solve(cs.Problem(model, cs.Record(name="r", t=t, channels={output: y + zero}), free=["k"]))
    assert fit.converged and fit["k"].value == pytest.approx(best[1], rel=1e-4)
    assert fit.initial_states["r"]["T"].value - zero == pytest.approx(best[0], rel=1e-4)


def test_a_state_that_nobody_reads_is_free_too():
    """Truth: the parabola of a fall from 10 km by linear least squares; speed and height have sizes of their own."""
    t = np.linspace(0.0, 40.0, 81)
    y = 1e4 - 300.0 * t - 0.5 * 9.81 * t**2 + 20.0 * np.random.default_rng(1).standard_normal(81)
    design = np.stack([np.ones(81), t, -0.5 * t**2], axis=1)
    height, speed, g = np.linalg.lstsq(design, y, rcond=None)[0]
    deviations = 20.0 * np.sqrt(np.diagonal(np.linalg.inv(design.T @ design)))
    model = cs.define_model(
        "body",
        states=["y", "v"],
        inputs=[],
        parameters={"g": 8.0},
        outputs=["height"],
        dynamics=lambda s: {"y": s.v, "v": -s.g},
        output=lambda s: {"height": s.y},
    )
    record = cs.Record(name="r", t=t, channels={"height": y})
    fit = cs.solve(cs.Problem(model, record, free=["g"], noise={"height": 20.0}))
    assert fit.converged and fit["g"].value == pytest.approx(g, rel=1e-6)
    initial = fit.initial_states["r"]
    assert [initial["y"].value, initial["v"].value] == pytest.approx([height, speed], rel=1e-5)
    assert [initial["y"].std_cramer_rao, initial["v"].std_cramer_rao, fit["g"].std_cramer_rao] == pytest.approx(
        deviations, rel=1e-4
    )


def test_a_guess_that_is_far_too_small_does_not_hold():
    """The model's own guess is 1e-9 times the motion; truth: scipy's least squares."""
    y = readings(1.0)

    def off(v):
        return v[0] * np.exp(-v[1] * T) - y

    best = least_squares(off, [1.0, 0.2], xtol=1e-14, ftol=1e-14, gtol=1e-14).x
    model = cs.define_model(
        "decay",
        states=["x"],
        inputs=[],
        parameters={"k": 0.2},
        outputs=["y"],
        dynamics=lambda s: {"x": -s.k * s.x},
        output=lambda s: {"y": s.x},
        guess=lambda record: np.full((len(record), 1), 1e-9),
    )
    fit = cs.solve(cs.Problem(model, cs.Record(name="r", t=T, channels={"y": y}), free=["k"], noise={"y": 0.05}))
    assert fit.converged, fit.status
    assert fit["k"].value == pytest.approx(best[1], rel=1e-4)
    assert fit.initial_states["r"]["x"].value == pytest.approx(best[0], rel=1e-4)


def test_what_is_given_and_contradicted_is_told():
    given = cs.InitialState(value={"x": 5.0}, std={"x": 0.5})
    fit = fitted(1.0, "y", noise=True, initial_state=given)
    initial = fit.initial_states["r"]["x"]
    assert initial.prior == 5.0 and initial.prior_std == 0.5 and abs(initial.value - 5.0) > 1.5
    told = [remark for remark in fit.remarks if "x[r]" in remark]
    assert len(told) == 1 and f"{abs(initial.value - 5.0) / 0.5:.1f} deviations" in told[0]
    assert not any("x[r]" in remark for remark in fitted(1.0, "y", noise=True).remarks)


def test_an_exact_initial_state_has_no_error():
    fit = fitted(1.0, "y", noise=True, initial_state=cs.InitialState(value={"x": 1.0}, std={"x": 0.0}))
    initial = fit.initial_states["r"]["x"]
    assert initial.value == 1.0 and initial.std == 0.0 and initial.interval == (1.0, 1.0)


@pytest.mark.slow
def test_intervals_of_initial_states_hold_the_truth():
    """Truth: 1 in 300 drawn records of 41 readings with estimated noise; 95 % +- 3.8 % at three deviations."""
    held = 0
    for seed in range(300):
        low, high = fitted(1.0, "y", noise=False, seed=seed, starts=1).initial_states["r"]["x"].interval
        held += low <= 1.0 <= high
    assert 0.912 * 300 <= held <= 0.988 * 300
