"""Derived quantities. Truth: analytic responses, eigenvalues of a linear model, and the scatter over seeded noise."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from scipy.signal import TransferFunction, step

import casid as cs
from casid.acceptance.quantities import QUANTITIES, quantity
from casid.cli.options import DEMO

DT = 0.05
T = np.arange(0.0, 30.0, DT)
DECAY, OMEGA, DELAY = 0.08, 1.3, 0.4
FIRST = np.exp(-DECAY * T) * np.cos(OMEGA * T) + 0.2 + 0.01 * T
LATER = 3.0 * np.exp(-DECAY * T) * np.cos(OMEGA * (T - DELAY))
LAG = 1.0 - np.exp(-T / 2.5)
ZETA, NATURAL = 0.4, 1.2
STEP = step(TransferFunction([NATURAL**2], [1.0, 2.0 * ZETA * NATURAL, NATURAL**2]), T=T)[1]

# quantity -> responses, analytic value, relative accuracy without noise
KNOWN = {
    "period": ([FIRST], 2.0 * np.pi / OMEGA, 1e-6),
    "damping": ([FIRST], DECAY / np.hypot(DECAY, OMEGA), 1e-6),
    "time_to_half": ([FIRST], np.log(2.0) / DECAY, 1e-6),
    "time_between_peaks": ([LATER, FIRST], DELAY, 1e-6),
    "time_constant": ([LAG], 2.5, 1e-6),
    # from the closed form of the step response, by bisection: crossings of 0.1 and 0.9
    "rise_time": ([STEP], 1.2195, 1e-3),
    "overshoot": ([STEP], np.exp(-np.pi * ZETA / np.sqrt(1.0 - ZETA**2)), 2e-3),
}


def test_every_quantity_is_tested() -> None:
    assert set(KNOWN) == set(QUANTITIES)


@pytest.mark.parametrize("name", KNOWN)
def test_without_noise_the_analytic_value(name: str) -> None:
    responses, value, accuracy = KNOWN[name]
    assert quantity(name, T, responses).value == pytest.approx(value, rel=accuracy)


@pytest.mark.parametrize("name", KNOWN)
def test_deviations_cover(name: str) -> None:
    """Truth: 40 draws of noise; their scatter is the deviation, within what 40 draws tell (3 sigma of a variance)."""
    responses, _, _ = KNOWN[name]
    value, rng, off = quantity(name, T, responses).value, np.random.default_rng(5), []
    for _ in range(40):
        found = quantity(name, T, [y + rng.normal(0.0, 0.03, len(T)) for y in responses])
        off.append((found.value - value) / found.std)
    assert abs(np.mean(off)) < 3.0 / np.sqrt(40)
    assert 1.0 - 3.0 / np.sqrt(80) < np.std(off) < 1.0 + 3.0 / np.sqrt(80)


def test_coloured_residuals_widen_deviations() -> None:
    """Truth: noise with a correlation time of 0.5 s: white noise of that size would promise a fifth of the scatter.
    From one series the deviation is known to a third."""
    rng, shape = np.random.default_rng(6), np.exp(-np.arange(80) * DT / 0.5)
    off = []
    for _ in range(60):
        noise = np.convolve(rng.normal(size=len(T) + len(shape) - 1), shape, mode="valid")
        found = quantity("period", T, [FIRST + 0.05 * noise / np.linalg.norm(shape)])
        off.append((found.value - 2.0 * np.pi / OMEGA) / found.std)
    assert abs(np.std(off) - 1.0) < 1.0 / 3.0


def test_a_growing_oscillation_has_a_time_to_double() -> None:
    grows = quantity("time_to_half", T, [np.exp(0.05 * T) * np.sin(T)])
    assert grows.value == pytest.approx(-np.log(2.0) / 0.05, rel=1e-6)


@pytest.mark.parametrize("name", KNOWN)
def test_of_a_constant_nothing_is_told(name: str) -> None:
    found = quantity(name, T, [np.ones(len(T))] * len(KNOWN[name][0]))
    assert not np.isfinite(found.value) or found.std > abs(found.value) or not np.isfinite(found.std)


def _eigenvalues(axes: str) -> tuple[cs.Model, np.ndarray, np.ndarray, cs.Trim]:
    """Model of the demo's aircraft, its state matrix at trim and the state there."""
    aircraft = cs.Aircraft.read(DEMO / "aircraft.toml")
    level = cs.trim(aircraft, V=95.0, altitude=2500.0)
    model = cs.aircraft_model(aircraft, axes=axes)
    state = {"u": level.V * np.cos(level.alpha), "w": level.V * np.sin(level.alpha), "theta": level.theta}
    x = np.array([state.get(name, 0.0) for name in model.states])
    u = np.array([{**level.inputs, **state}.get(name, 0.0) for name in model.inputs])
    jacobian = ca.Function("A", [model.x, model.u, model.p, model.w], [ca.jacobian(model.f, model.x)])
    A = jacobian(x, u, model.nominal_vector(), np.zeros(len(model.disturbances))).full()
    return model, A, x, level


@pytest.mark.parametrize(("mode", "duration"), [(0, 200.0), (1, 8.0)])
def test_phugoid_and_short_period_are_those_of_the_eigenvalues(mode: int, duration: float) -> None:
    """A response in one mode of the aircraft alone, small enough to be linear, flown by the whole equations."""
    model, A, x, level = _eigenvalues("longitudinal")
    roots, vectors = np.linalg.eig(A)
    slow_first = np.argsort(np.abs(roots))
    root, shape = roots[slow_first][2 * mode], vectors[:, slow_first][:, 2 * mode]
    start = x + 1e-4 * (shape / np.abs(shape).max()).real * np.abs(x).max() * 0.1
    t = np.arange(0.0, duration, duration / 2000.0)
    channels = {name: np.full(len(t), level.inputs.get(name, 0.0)) for name in model.inputs}
    theta = cs.simulate(model, cs.Record(name="free", t=t, channels=channels), start).output("theta")
    found = {name: quantity(name, t, [theta]).value for name in ("period", "damping", "time_to_half")}
    assert found["period"] == pytest.approx(2.0 * np.pi / abs(root.imag), rel=2e-3)
    assert found["damping"] == pytest.approx(-root.real / abs(root), abs=1e-3)
    assert found["time_to_half"] == pytest.approx(np.log(2.0) / -root.real, rel=2e-2)


@pytest.mark.parametrize("phase", [-2.5, -0.8, 0.0, 0.8, 2.5])
def test_the_deviation_of_a_phase_is_that_of_its_sine_and_cosine(phase: float) -> None:
    """Truth: 0.3 s between the peaks of two oscillations, at any phase of both; the scatter of 40 draws."""
    first, later = (2.0 * np.exp(-DECAY * T) * np.cos(OMEGA * (T - late) + phase) for late in (0.0, 0.3))
    rng, off = np.random.default_rng(11), []
    for _ in range(40):
        found = quantity("time_between_peaks", T, [y + rng.normal(0.0, 0.05, len(T)) for y in (later, first)])
        off.append((found.value - 0.3) / found.std)
    assert 1.0 - 3.0 / np.sqrt(80) < np.std(off) < 1.0 + 3.0 / np.sqrt(80)
