"""White and slow noise of readings. Truth: dense covariance matrices, and processes drawn here."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from filter_cases import GUSTY, covariance, filtered, gusty_flight, gusty_short_period, process

from casid.filtering.kalman import kalman_filter, residual_column
from casid.filtering.slow import white_and_slow

_SLOW = {"alpha": ((0.004, 0.3), (0.002, np.inf)), "q": ((0.01, 0.05),)}


@pytest.mark.parametrize("plain", [True, False])
def test_density_with_slow_noise_is_that_of_the_dense_covariance(plain: bool) -> None:
    """What the filter of white noise leaves has the unit covariance, and besides what it makes of the slow noise."""
    linear, kalman, white = filtered(gusty_short_period(), [gusty_flight(2, samples=60)], GUSTY)
    slow = kalman_filter(linear, replace(GUSTY, slow=_SLOW), plain=plain)
    found = float(np.sum(slow.whiten(*residual_column(linear)) ** 2) + slow.log_determinant.sum())
    t, total = np.arange(60) * 0.02, np.eye(white.size)
    for channel, name in enumerate(linear.model.outputs):
        Y = np.zeros((60, 1, 2, 60))
        Y[np.arange(60), 0, channel, np.arange(60)] = 1.0
        through = kalman.whiten(Y, np.zeros((59, 1, 3, 60))).reshape(white.size, 60)
        total += through @ sum(covariance(t, *part) for part in _SLOW[name]) @ through.T
    flat = white.reshape(-1)
    dense = flat @ np.linalg.solve(total, flat) + np.linalg.slogdet(total)[1] + kalman.log_determinant.sum()
    assert found == pytest.approx(dense, rel=1e-9)


def test_slow_noise_is_no_part_of_the_motion_and_a_held_filter_takes_it_up() -> None:
    linear, kalman, _ = filtered(gusty_short_period(), [gusty_flight(2, samples=200)], GUSTY)
    noise = replace(GUSTY, slow=_SLOW)
    slow = kalman_filter(linear, noise)
    assert slow.smooth(*residual_column(linear))[0].shape == kalman.smooth(*residual_column(linear))[0].shape
    held = slow.along(linear, noise)
    np.testing.assert_array_equal(held.whiten(*residual_column(linear)), slow.whiten(*residual_column(linear)))
    taken_up = kalman.along(linear, noise)  # what it does not know no sample moves
    assert taken_up.gain.shape[2] == 6 and not taken_up.gain[:, :, 3:].any()


def test_slow_noise_of_a_long_record_is_filtered_in_stretches_as_in_one_pass() -> None:
    """Truth: the recursions in numpy, which take all samples at once."""
    linear, _, _ = filtered(gusty_short_period(), [gusty_flight(seed, f"m{seed}", 300) for seed in (1, 2)], GUSTY)
    noise = replace(GUSTY, slow=_SLOW)
    found, plain = (kalman_filter(linear, noise, plain=plain) for plain in (False, True))
    np.testing.assert_allclose(found.P, plain.P, rtol=1e-9, atol=1e-14)
    column = residual_column(linear)
    np.testing.assert_allclose(found.whiten(*column), plain.whiten(*column), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(("share", "tau"), [(0.0, 0.1), (0.3, 0.3), (0.5, 0.15), (0.5, 2.0)])
def test_parts_times_and_offsets_of_noise_are_found(share: float, tau: float) -> None:
    """Of four records of 26 s at 50 Hz with a seventh of the readings missing, each with an offset of its own. A share
    is known to some 10 %, and a slow part of 2 s from 26 independent values, to 30 %; none gains by chance 10 and more
    in fewer than 1 of 100."""
    rng, t = np.random.default_rng(4), np.tile(0.02 * np.arange(1300)[:, None], (1, 4))
    offsets = np.array([0.6, -1.0, 0.3, 0.0])
    slow = np.stack([process(rng, t[:, r], 1.0, tau) for r in range(4)], axis=1)
    values = np.sqrt(share) * slow + np.sqrt(1.0 - share) * rng.standard_normal((1300, 4)) + offsets
    seen = rng.random(values.shape) > 1.0 / 7.0
    (found,) = white_and_slow(t, np.where(seen, values, np.nan)[..., None], seen[..., None])
    assert np.all(np.abs(found.offsets - offsets) < 4.0 * found.stds)
    if share == 0.0:
        assert found.gain < 10.0
        assert found.stds == pytest.approx(1.0 / np.sqrt(seen.sum(axis=0)), rel=0.5)
        return
    assert found.white**2 == pytest.approx(1.0 - share, rel=0.1)
    assert found.slow**2 == pytest.approx(share, rel=0.25 if tau < 1.0 else 0.7)
    assert found.tau == pytest.approx(tau, rel=0.35 if tau < 1.0 else 0.8)
    assert found.gain > 100.0


def test_slow_noise_of_one_channel_is_none_of_another_nor_of_one_that_is_never_seen() -> None:
    rng, t = np.random.default_rng(5), np.tile(0.05 * np.arange(500)[:, None], (1, 2))
    slow = np.stack([process(rng, t[:, r], 1.0, 0.5) for r in range(2)], axis=1)
    values = np.stack([slow + rng.standard_normal((500, 2)), rng.standard_normal((500, 2)), np.zeros((500, 2))], axis=2)
    seen = np.ones(values.shape, dtype=bool)
    seen[..., 2] = False
    first, second, third = white_and_slow(t, values, seen)
    assert first.gain > 100.0 > 10.0 > second.gain and third.gain == 0.0 and np.isnan(third.offsets).all()
