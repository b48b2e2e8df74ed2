"""Noise of channels that are rounded, converted or updated by a slower recorder. Truth: how the series were made."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal

from casid.records.noise import isolated, mean_over, pooled_sigma, quiet_windows, real_updates, resolution
from casid.records.noise_spectrum import density_sigma, high_band_holds, motion_edge
from casid.records.record import Record
from casid.records.thinning import spaced

T = np.arange(0.0, 20.0, 0.02)


def test_the_step_survives_a_conversion_of_units() -> None:
    """Steps of 0.01 deg, in rad by a factor that is itself rounded, and times a correction: neighbours of a level that
    differ by rounding are the same level."""
    degrees = np.round(3.0 * np.sin(T) / 0.01) * 0.01
    converted = np.where(np.arange(len(T)) % 2, degrees * np.pi / 180.0, degrees / 57.29577951308232)
    assert resolution(converted) == pytest.approx(0.01 * np.pi / 180.0, rel=1e-6)


def test_noise_below_the_step_is_not_believed_after_a_conversion() -> None:
    rng = np.random.default_rng(1)
    degrees = np.round((3.0 * np.sin(T) + 0.002 * rng.standard_normal(len(T))) / 0.01) * 0.01
    record = Record(name="m", t=T, channels={"beta": degrees * 0.017453292519943295})
    assert not high_band_holds([record], "beta", 0.5)


def quick(filtered: float | None) -> Record:
    """A rate of roll at 10 Hz that answers to a surface of steps within 0.15 s, with white noise before the anti-alias
    filter, whose corner is a part of half the sampling rate."""
    rng, fine = np.random.default_rng(4), np.arange(0.0, 80.0, 0.01)
    steps = np.where((fine > 10.0) & (fine < 40.0), np.sign(np.sin(2.0 * fine)), 0.0)
    p = signal.lfilter([1.0 / 16.0], [1.0, -15.0 / 16.0], 0.3 * steps)[::10]
    noise = rng.normal(0.0, 0.002, len(p))
    if filtered is not None:
        noise = signal.sosfilt(signal.butter(2, filtered, output="sos"), noise)
    return Record(name="m", t=fine[::10], channels={"p": p + noise})


def test_quick_motion_in_white_noise_is_no_filter() -> None:
    """The answer to steps reaches to the highest frequencies, but not where nothing moves."""
    assert high_band_holds([quick(None)], "p", 1.0)
    assert not high_band_holds([quick(0.4)], "p", 1.0)


def test_a_staircase_has_as_many_readings_as_updates() -> None:
    """A heading that is read once a second and held in between, 50 times."""
    psi = np.repeat(np.sin(0.3 * np.arange(20) + 0.1), 50)
    new = real_updates(T, psi)
    assert new.sum() == 19  # when the first one was read nobody knows
    assert set(np.flatnonzero(new) % 50) == {0}


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_coarse_steps_of_a_noisy_channel_are_no_updates(seed: int) -> None:
    rng = np.random.default_rng(seed)
    V = np.round((80.0 + np.sin(0.4 * T) + 0.02 * rng.standard_normal(len(T))) / 0.051) * 0.051
    assert real_updates(T, V).all()


def test_every_reading_of_a_smooth_channel_is_one() -> None:
    q = np.sin(T)
    assert real_updates(T, q).all()
    q[100:200] = np.nan
    assert real_updates(T, q).sum() == len(T) - 100


def test_spaced_readings() -> None:
    """One of each interval of 0.125 s, the first that is there."""
    values = np.ones(len(T))
    values[0] = np.nan
    at = np.flatnonzero(spaced(T, values, 0.125))
    assert at[0] == 1 and len(at) == 160
    assert np.all(np.floor(T[at[1:]] / 0.125 + 1e-6) == np.arange(1, 160))


@pytest.mark.parametrize("step", [0.02, 0.35, 1.0])
def test_coarse_steps_of_a_continuous_channel_are_its_noise_however_few_levels_it_has(step: float) -> None:
    """Error of rounding, uniform: step / sqrt(12). The high band takes it for Gaussian, which it is not, and reads up
    to a quarter more. An input may have few levels of its own."""
    t = np.arange(0.0, 20.0, 0.04)
    motion = 3.0 * np.sin(0.9 * t) + 0.8 * np.sin(3.1 * t + 0.3)
    coarse = step * np.round(motion / step)
    assert np.std(coarse - motion) == pytest.approx(step / np.sqrt(12.0), rel=0.15)
    assert pooled_sigma([coarse], continuous=True) == pytest.approx(step / np.sqrt(12.0), rel=0.25)
    if step == 1.0:
        assert len(np.unique(coarse)) < 10 and pooled_sigma([coarse]) < 0.01 * step


def test_a_channel_that_changes_by_one_step_at_a_time_is_coarse_and_not_held() -> None:
    """A triangle crosses its steps at even times, as a slower recorder updates; one that is held jumps by several."""
    t = np.arange(0.0, 20.0, 0.02)
    triangle = np.abs((t + 0.05) % 4.0 - 2.0)
    assert real_updates(t, 0.1 * np.round(triangle / 0.1)).all()
    held = real_updates(t, (0.01 * np.round((triangle + 0.3 * np.sin(7.0 * t)) / 0.01))[np.arange(1000) // 10 * 10])
    assert held.sum() == 99


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_a_cubic_has_no_reading_that_stands_alone_and_any_step_off_it_has(degree: int) -> None:
    """Off a cubic through its neighbours there is nothing but what was added: the one reading, whatever the slope."""
    x = np.linspace(-1.0, 1.0, 200)
    values = x**degree
    assert not isolated(values + 1e-9 * np.cos(np.arange(200.0) ** 2), 8.0).any()
    values[77] += 0.5
    assert list(np.flatnonzero(isolated(values, 8.0))) == [77]


@pytest.mark.parametrize(("steps", "alone"), [(1, False), (3, True)])
def test_one_step_of_a_converter_is_no_spike_and_three_are(steps: int, alone: bool) -> None:
    """A slow channel flickers by its last digit; three of them in one reading are more than that at 3 scatters."""
    values = np.floor(np.arange(400.0) / 10.0)  # of 40 levels, whose step is therefore known
    values[205] += steps
    assert bool(isolated(values, 3.0)[205]) == alone


@pytest.mark.parametrize(("count", "few"), [(63, True), (64, False)])
def test_a_short_series_is_not_judged(count: int, few: bool) -> None:
    values = 1e-3 * np.random.default_rng(5).standard_normal(count)
    values[30] = 5.0
    assert isolated(values, 8.0).any() != few


@pytest.mark.parametrize("level", [0.0, 5.0, -300.0])
def test_quiet_windows_do_not_depend_on_the_level_nor_the_sign(level: float) -> None:
    """What moves is a change: a surface that goes up from a trim of -17 deg moves as one that goes down from zero."""
    rng = np.random.default_rng(8)
    steps = np.interp(np.arange(400), [0, 100, 104, 200, 203, 300, 306, 399], [0, 0, 9, 9, 4, 4, -5, -5])
    values = steps + 0.1 * rng.standard_normal(400)
    truth = quiet_windows(values, 0.1)
    for other in (values + level, level - values):
        for mine, theirs in zip(quiet_windows(other, 0.1), truth, strict=True):
            np.testing.assert_array_equal(mine, theirs)
    assert (truth[1] - truth[0]).max() > 50


def test_residuals_of_a_simulation_that_departs_have_a_density_without_a_warning() -> None:
    """Truth: a warning is an error here; the density grows with the square of the series, beyond all numbers."""
    t = 0.02 * np.arange(400)
    for size in (1e3, 1e160, 1e300):
        record = Record(name="m", t=t, channels={"q": size * np.random.default_rng(1).standard_normal(400)})
        assert density_sigma([record], "q", (5.0, 10.0)) > 0.3 * min(size, 1e150)


def test_a_surface_at_rest_is_denoised_and_one_that_moves_is_late_nowhere() -> None:
    """Truth: the steps without their noise. At rest the mean of n readings scatters by sigma / sqrt(n); no window has
    readings from the other side of a step; a reading on its way stands alone."""
    rng, n = np.random.default_rng(9), 600
    truth = np.repeat([0.0, 8.0, 3.0, -6.0, -6.0, 2.0], n // 6)
    truth[300:303] = [0.0, -2.0, -4.0]
    values = truth + 0.1 * rng.standard_normal(n)
    first, last = quiet_windows(values, 0.1)
    assert (first >= 0).all() and (last < n).all() and (first <= last).all()
    mean = mean_over(values, first, last)
    np.testing.assert_allclose(mean[:5], [values[a : b + 1].mean() for a, b in zip(first[:5], last[:5], strict=True)])
    assert np.abs(mean - truth).max() < 0.4
    rests = np.abs(np.arange(n)[:, None] - [100, 200, 300, 500]).min(axis=1) > 12
    assert np.std((mean - truth)[rests]) < 0.05 and np.median((last - first)[rests]) >= 16


@pytest.mark.parametrize("hz", [0.4, 1.1, 3.0])
def test_the_motion_ends_where_its_angular_acceleration_does(hz: float) -> None:
    """Truth: a rate of one frequency, whose slope has it alone; of rates that rest there is no motion."""
    t = np.arange(0.0, 40.0, 0.02)
    wave = {"q": 0.1 * np.sin(2.0 * np.pi * hz * t)}
    assert motion_edge([Record(name="m", t=t, channels=wave)]) == pytest.approx(hz, abs=2.5 / 40.0)
    rest = {name: np.full(len(t), 0.02) for name in "pqr"}
    assert motion_edge([Record(name="m", t=t, channels=rest)]) == 0.0
    assert motion_edge([Record(name="m", t=t, channels={"theta": wave["q"]})]) == 0.0
