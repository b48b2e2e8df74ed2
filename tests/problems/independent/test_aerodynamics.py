"""Tables, derivatives of the file, actuators, moving air and instruments of the independent simulator.

Truths: the tables' numbers, difference quotients, closed-form responses, spectra and statistics."""

from __future__ import annotations

import numpy as np
import pytest

from problems.independent.actuators import follow, lag, limited, played, spool
from problems.independent.air import across_path, along_path, gust, turbulence
from problems.independent.aircraft_file import OFF, STRUCTURE, fitted, guessed
from problems.independent.planes import JET, LIGHT, Plane
from problems.independent.sensors import Instruments, readings, recorded
from problems.independent.tables import Table

DEG = np.pi / 180.0


def test_a_table_has_its_numbers_and_straight_lines_between_and_beyond_them() -> None:
    line = Table(axes={"alpha": (0, 2, 6)}, values=(1.0, 2.0, 0.0))
    assert np.allclose(line.at({"alpha": DEG * np.array([0, 2, 6, 1, 4, 8, -2])}), (1, 2, 0, 1.5, 1, -1, 0))
    plane = Table(axes={"mach": (0.2, 0.6), "alpha": (0, 4)}, values=((0.0, 4.0), (8.0, 12.0)), factor="q")
    now = {"mach": np.array([0.2, 0.4, 0.6]), "alpha": DEG * np.array([4, 2, 1]), "q": np.array([1.0, 2.0, 3.0])}
    assert np.allclose(plane.at(now), (4.0, 12.0, 27.0))


def test_a_table_of_the_wrong_shape_is_refused() -> None:
    with pytest.raises(ValueError, match="over axes"):
        Table(axes={"alpha": (0, 2, 6)}, values=(1.0, 2.0))


def around(plane: Plane, rng: np.random.Generator, count: int = 4000) -> dict[str, np.ndarray]:
    wide = {"beta": 4.0, "delta_e": 2.0, "delta_a": 4.0, "delta_r": 4.0}
    points = {name: DEG * size * rng.uniform(-1.0, 1.0, count) for name, size in wide.items()}
    points |= {name: 0.02 * rng.uniform(-1.0, 1.0, count) for name in ("p", "q", "r")}
    points["alpha"] = DEG * rng.uniform(-0.5, 3.5, count)
    return points | {"mach": np.full(count, 0.53 if plane is JET else 0.164)}


@pytest.mark.parametrize("plane", [LIGHT, JET], ids=lambda plane: plane.name)
def test_derivatives_of_the_file_are_slopes_of_the_tables(plane: Plane) -> None:
    """A fit over a few degrees is the difference quotient over them, where the tables bend little."""
    fit = fitted(plane, around(plane, np.random.default_rng(5)))
    middle = {name: np.zeros(2) for name in ("beta", "delta_e", "delta_a", "delta_r", "p", "q", "r")}
    middle |= {"alpha": np.full(2, 1.5 * DEG), "mach": np.full(2, 0.53 if plane is JET else 0.164)}
    for name, variable, half in (
        ("CL", "alpha", 2.0 * DEG),
        ("Cm", "alpha", 2.0 * DEG),
        ("Cm", "delta_e", 2.0 * DEG),
        ("Cm", "q", 0.02),
        ("Cl", "p", 0.02),
        ("Cl", "beta", 4.0 * DEG),
        ("Cl", "delta_a", 4.0 * DEG),
        ("Cn", "beta", 4.0 * DEG),
        ("Cn", "delta_r", 4.0 * DEG),
        ("CY", "beta", 4.0 * DEG),
    ):
        ends = plane.coefficients(middle | {variable: middle[variable] + half * np.array([-1.0, 1.0])})[name]
        slope = (ends[1] - ends[0]) / (2.0 * half)
        assert fit.values[name][(variable,)] == pytest.approx(slope, rel=0.03), (name, variable)


@pytest.mark.parametrize("plane", [LIGHT, JET], ids=lambda plane: plane.name)
def test_the_file_is_off_by_the_stated_percentage_and_the_tables_are_no_lines(plane: Plane) -> None:
    fit = fitted(plane, around(plane, np.random.default_rng(5)))
    guess = guessed(fit, np.random.default_rng(6))
    for name in STRUCTURE:
        for term, value in guess[name].items():
            if abs(fit.values[name][term]) > 1e-9:
                assert OFF[0] - 0.01 < abs(value / fit.values[name][term] - 1.0) < OFF[1] + 0.01
    assert all(0.0 < left < 0.15 for left in fit.left.values())
    assert max(fit.left.values()) > 0.01


def test_a_servo_answers_a_step_and_a_ramp_as_a_second_order_system() -> None:
    w, d = 28.0, 0.8
    damped = w * np.sqrt(1.0 - d**2)
    dt = 0.005 / 16.0  # fine: the first step sees five sixths of the jump
    t = dt * np.arange(1601)
    command = np.ones((3201, 2)) * [1.0, -2.0]
    command[0] = 0.0
    step = follow(command, dt, w, d)
    exact = 1.0 - np.exp(-d * w * t) * (np.cos(damped * t) + d * w / damped * np.sin(damped * t))
    assert np.abs(step[:, 0] - exact).max() < 1e-3
    assert np.allclose(step[:, 1], -2.0 * step[:, 0])
    dt = 0.005
    t = dt * np.arange(201)
    ramp = follow(0.5 * dt * np.arange(401), dt, w, d)
    swing = 2.0 * d / w * np.cos(damped * t) + (2.0 * d**2 - 1.0) / damped * np.sin(damped * t)
    assert np.abs(ramp - (t - 2.0 * d / w + np.exp(-d * w * t) * swing)).max() < 2e-7


def test_an_engine_and_a_lag_answer_in_their_time_constant() -> None:
    dt, T = 0.005, 0.4
    t = dt * np.arange(401)
    ramp = np.repeat(np.arange(801)[:, None] * 0.5 * dt, 2, axis=1)
    exact = t - T * (1.0 - np.exp(-t / T))
    assert np.abs(spool(ramp, dt, T)[:, 0] - exact).max() < 1e-9
    behind = lag(ramp[::2], dt, np.array([T, 0.0]))
    assert np.abs(behind[:, 0] - exact).max() < 1e-12
    assert np.array_equal(behind[:, 1], ramp[::2, 1])


def test_a_limited_surface_keeps_to_its_rate_and_a_play_to_its_width() -> None:
    dt = 0.005
    t = dt * np.arange(1001)
    swing = np.sin(2.0 * t)[:, None] * [1.0, 1.0]
    after = limited(swing, dt, np.array([0.5, np.inf]))
    assert np.abs(np.diff(after[:, 0])).max() <= 0.5 * dt + 1e-15
    assert np.allclose(after[:, 1], swing[:, 1], atol=1e-14)
    loose = played(swing, np.array([0.1, 0.0]))
    assert np.abs(loose[:, 0] - swing[:, 0]).max() <= 0.1 + 1e-15
    assert np.allclose(loose[100:150, 0], (swing[:, 0] - 0.1)[100:150])  # on its way up it hangs by the play
    assert np.allclose(loose[:, 1], swing[:, 1], atol=1e-14)


def test_turbulence_has_the_variance_and_the_correlation_of_its_spectra() -> None:
    rng, T, dt = np.random.default_rng(11), 0.5, 0.1
    lag_s = round(0.5 / dt)
    for series, at_half in (
        (along_path(rng, 40_000, dt, 1.5, T), np.exp(-1.0)),  # exp(-tau / T)
        (across_path(rng, 40_000, dt, 1.5, T), 0.5 * np.exp(-1.0)),  # exp(-tau / T) (1 - tau / 2 T)
    ):
        assert np.var(series) == pytest.approx(1.5**2, rel=0.05)
        correlation = np.mean(series[lag_s:] * series[:-lag_s]) / np.var(series)
        assert correlation == pytest.approx(at_half, abs=0.04)


def test_rotation_of_the_air_is_the_gradient_of_its_velocity() -> None:
    """Over a long time the pitching of the air is what the velocity along z changes by, per metre flown."""
    velocity, rotation = turbulence(np.random.default_rng(3), 4000, 0.005, 1.0, 50.0, 10.0, 4.0)
    behind = round(4.0 / 50.0 / 0.005)
    turned = (velocity[behind:, 2] - velocity[:-behind, 2]) / (behind * 0.005 * 50.0)
    assert np.allclose(rotation[behind:, 1], -turned)


def test_a_gust_is_one_minus_cosine() -> None:
    t = np.linspace(0.0, 10.0, 1001)
    expected = np.where((t > 3.0) & (t < 5.0), 0.5 * (1.0 - np.cos(np.pi * (t - 3.0))), 0.0)
    assert np.allclose(gust(t, 3.0, 2.0), expected)


def turning() -> dict[str, np.ndarray]:
    """Steady turn rates and accelerations, as a log of one record."""
    n = 20_001
    x = np.zeros((n, 17))
    x[:, 6] = 1.0
    x[:, 10:13] = (0.2, -0.3, 0.4)
    flat = np.ones(n)
    log = {"x": x, "force": flat[:, None] * [1.0, 2.0, -9.0], "turning": flat[:, None] * [0.5, -0.7, 0.9]}
    return log | {"V": 60.0 * flat, "alpha": 0.05 * flat, "beta": 0.0 * flat, "thrust": 900.0 * flat, "rho": flat}


def test_an_accelerometer_reads_what_its_place_feels() -> None:
    """Rigid body: a + dw/dt x r + w x (w x r), and a shifted centre of gravity moves the other way."""
    x = 0.8
    p, q, r = 0.2, -0.3, 0.4
    expected = (1.0 - (q**2 + r**2) * x, 2.0 + (p * q + 0.9) * x, -9.0 + (p * r + 0.7) * x)
    read = readings(turning(), Instruments(accelerometer=(x, 0.0, 0.0)), np.zeros(3))
    assert np.allclose([read[name][0] for name in ("ax", "ay", "az")], expected)
    moved = readings(turning(), Instruments(), np.array([-x, 0.0, 0.0]))
    assert np.allclose([moved[name][0] for name in ("ax", "ay", "az")], expected)


def test_noise_is_white_of_its_size_and_what_is_not_measured_is_not_there() -> None:
    read = readings(turning(), Instruments(), np.zeros(3)) | dict.fromkeys(
        ("delta_e", "delta_a", "delta_r"), np.zeros(20_001)
    )
    t = 0.01 * np.arange(20_001)
    errors = Instruments(bias={"q": 0.01}, scale={"V": 0.05}, delay_s={"alpha": 0.1})
    samples = recorded(read, t, 2, LIGHT.noise, errors, np.random.default_rng(8))
    assert "pdot" not in samples
    assert len(samples["t"]) == 10_001
    for name, mean in (("q", -0.29), ("V", 63.0), ("alpha", 0.05), ("az", -9.0)):
        error = samples[name] - mean
        assert np.std(error) == pytest.approx(LIGHT.noise[name], rel=0.03)
        assert abs(np.mean(error)) < 4.0 * LIGHT.noise[name] / 100.0
        assert abs(np.mean(error[1:] * error[:-1])) < 0.04 * np.var(error)
    assert np.std(samples["thrust"]) == pytest.approx(0.005 * 900.0, rel=0.03)


def test_a_late_vane_reads_what_was() -> None:
    t = 0.01 * np.arange(301)
    read = {"alpha": np.sin(t), "rho": np.ones(301)}
    late = recorded(read, t, 1, {"alpha": 0.0}, Instruments(delay_s={"alpha": 0.1}), np.random.default_rng(1))
    assert np.allclose(late["alpha"][10:], np.sin(t - 0.1)[10:])
