"""Colour of residuals. Truth: matrices written out, ordinary least squares, the Yule-Walker equations."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import solve_discrete_lyapunov, toeplitz
from scipy.signal import lfilter

from casid.estimation.residual_colour import (
    ORDER,
    Colour,
    WhitePiece,
    _Filter,
    autoregression,
    coloured_score,
    estimated,
    gathered,
    noise_autocovariance,
    variance_scatter,
)

A = np.array([1.0, -1.4, 0.7])


def autocovariance(lags: int, a: np.ndarray = A, variance: float = 1.0) -> np.ndarray:
    """(lags,) of an autoregression: its impulse response against itself."""
    response = np.asarray(lfilter([1.0], a, np.r_[1.0, np.zeros(4000)]))
    return variance * np.array([response[: len(response) - k] @ response[k:] for k in range(lags)])


def drawn(count: int, a: np.ndarray, seed: int) -> np.ndarray:
    return np.asarray(lfilter([1.0], a, np.random.default_rng(seed).standard_normal(count + 500)))[500:]


def pieces_of(rows: np.ndarray, residuals: np.ndarray, size: int) -> list[WhitePiece]:
    """One channel of one record in pieces."""
    columns = np.arange(rows.shape[1])
    return [
        WhitePiece(channel=0, record=0, columns=columns, rows=rows[i : i + size], residuals=residuals[i : i + size])
        for i in range(0, len(rows), size)
    ]


def score_of(parts: list[WhitePiece]) -> np.ndarray:
    """Without a prior, all parameters free."""
    sums, count = gathered(parts), len(parts[0].columns)
    noise = noise_autocovariance(sums, np.zeros((count, count)), np.eye(count))
    return coloured_score({0: estimated(noise[0], sums[0].count)}, sums, parts, count)


def test_levinson_solves_the_equations_of_yule_and_walker():
    found = autoregression(autocovariance(9, variance=3.0), 10**6)
    np.testing.assert_allclose(found.a[:3], A, atol=1e-9)
    assert found.variance == pytest.approx(3.0, rel=1e-9)


def test_white_noise_has_no_memory_and_residuals_without_noise_end_the_recursion():
    white = autoregression(np.r_[2.0, np.zeros(8)], 1000)
    assert white.white and white.variance == 2.0
    assert autoregression(np.zeros(9), 1000).variance == 0.0
    assert autoregression(np.ones(9), 1000).variance == 1.0  # a constant is predicted without error


def pope(a: np.ndarray) -> np.ndarray:
    """Count times the bias of the coefficients by least squares without a mean: Pope, J. Time Ser. Anal. 11 (1990)."""
    order = len(a) - 1
    companion, first, one = np.eye(order, k=-1), np.zeros((order, order)), np.eye(order)
    companion[0], first[0, 0] = -a[1:], 1.0
    covariance, b = solve_discrete_lyapunov(companion, first), companion.T
    inner = b @ np.linalg.inv(one - b @ b)
    inner = inner + sum(z * np.linalg.inv(one - z * b) for z in np.linalg.eigvals(companion))
    return np.real(inner[0] @ np.linalg.inv(covariance))


@pytest.mark.parametrize("reflections", [[-0.9], [0.5, -0.3], [-0.7, 0.5, 0.2], [-0.8, 0.6, -0.4, 0.3, 0.2]])
def test_the_bias_taken_off_is_that_of_least_squares(reflections):
    a = np.ones(1)
    for r in reflections:
        a = np.append(a, 0.0) + r * np.append(a, 0.0)[::-1]
    count = 10**5
    found = estimated(autocovariance(ORDER + 1, a), count)
    np.testing.assert_allclose(count * (a - found.a)[1:], pope(a), rtol=1e-4)


def test_least_squares_of_few_samples_have_the_coefficient_of_the_noise_in_the_mean():
    """250 samples of noise with a pole at 0.9, 1000 draws: known to 2.6 standard deviations of their mean."""
    count, a, draws = 250, np.array([1.0, -0.9]), []
    for seed in range(1000):
        noise = drawn(count, a, seed)
        lagged = noise[:-1] @ noise[:-1], noise[:-1] @ noise[1:]
        draws.append([f(np.array(lagged) / count, count).a[1] for f in (autoregression, estimated)])
    raw, less = np.mean(draws, axis=0) - a[1]
    chance = 2.6 * np.std(draws, axis=0)[1] / np.sqrt(1000)
    assert raw > 0.005 and abs(less) < chance, (raw, less, chance)


def test_the_bias_does_not_take_the_noise_beyond_stationarity():
    found = estimated(autocovariance(2, np.array([1.0, -0.999])), 100)
    assert -1.0 < found.a[1] < -0.999


@pytest.mark.parametrize("a", [A, np.array([1.0, -0.99])])
def test_the_score_is_that_of_the_covariance_matrix(a):
    """Recursive filter and the ringing after the end against the sum over all pairs of samples."""
    rows = np.random.default_rng(0).standard_normal((60, 3)).cumsum(axis=0)
    run = _Filter(Colour(a=a, variance=2.5), np.arange(3))
    for start, stop in ((0, 1), (1, 20), (20, 60)):
        run.add(rows[start:stop])
    expected = rows.T @ toeplitz(autocovariance(60, a, 2.5)) @ rows
    score = np.zeros((3, 3))
    run.spread(score)
    np.testing.assert_allclose(score, expected, rtol=1e-8)


def test_pieces_give_what_the_whole_record_gives():
    rows, noise = np.random.default_rng(1).standard_normal((700, 2)).cumsum(axis=0) / 10, drawn(700, A, 2)
    scores = [score_of(pieces_of(rows, noise, size)) for size in (700, 700 // 3, 5)]
    for score in scores[1:]:
        np.testing.assert_allclose(score, scores[0], rtol=1e-9)


def test_records_of_the_same_parameters_are_summed_without_running_into_each_other():
    """Lagged products and covariance matrices of each record for itself, written out; two records of their own
    parameters besides."""
    rng, parts = np.random.default_rng(7), []
    information, lagged, count = np.zeros((5, 5)), np.zeros(ORDER + 1), 0
    for record, (length, columns) in enumerate(((300, [0, 1]), (201, [0, 1]), (257, [2, 4]), (303, [0, 1]))):
        rows, noise = rng.standard_normal((length, 2)), drawn(length, A, record)
        for piece in pieces_of(rows, noise, 97):
            parts.append(replace(piece, record=record, columns=np.array(columns)))
        information[np.ix_(columns, columns)] += rows.T @ toeplitz(autocovariance(length, A, 2.5)) @ rows
        lagged += [noise[: length - k] @ noise[k:] for k in range(ORDER + 1)]
        count += length
    sums = gathered(parts)
    assert sums[0].count == count and sums[0].block == 1
    nothing = np.zeros((5, 5))
    np.testing.assert_allclose(sums[0].autocovariance(nothing[0], nothing), lagged / count, rtol=1e-10)
    score = coloured_score({0: Colour(a=A, variance=2.5)}, sums, parts, 5)
    np.testing.assert_allclose(score, information, rtol=1e-9)


def test_memory_does_not_grow_with_the_records():
    rng = np.random.default_rng(8)
    rows, noise = rng.standard_normal((100, 30)), rng.standard_normal(100)
    peaks = []
    for records in (5, 50):
        tracemalloc.start()
        gathered(replace(piece, record=r) for r in range(records) for piece in pieces_of(rows, noise, 100))
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 1.2 * peaks[0]


def test_slow_noise_far_below_white_noise_is_found_in_the_means_of_blocks():
    """A twentieth of the variance, correlated over two seconds at 50 Hz, twelve times the white density at rest: mean
    variance of the estimates over its true value, 100 draws. Single samples would need an order that nobody gathers."""
    count, slow, rng = 1000, np.array([1.0, -0.99]), np.random.default_rng(5)
    t = np.arange(count) / count
    rows = np.column_stack([np.cos(np.pi * k * t) for k in range(2, 7)])
    project = np.linalg.pinv(rows)
    part = 0.05 / autocovariance(1, slow)[0]
    true = np.diagonal(project @ (toeplitz(autocovariance(count, slow, part)) + 0.95 * np.eye(count)) @ project.T)
    inverse, found = np.linalg.inv(rows.T @ rows), []
    for _ in range(100):
        white, seed = rng.standard_normal(count), int(rng.integers(1 << 30))
        noise = np.sqrt(part) * drawn(count, slow, seed) + np.sqrt(0.95) * white
        parts = pieces_of(rows, noise - rows @ (project @ noise), 97)
        assert gathered(parts)[0].block == 8
        found.append(np.diagonal(inverse @ score_of(parts) @ inverse))
    ratio = np.sqrt(np.mean(found, axis=0) / true)
    assert (ratio > 0.7).all() and (ratio < 1.2).all(), ratio


def test_rough_sensitivities_keep_single_samples():
    rows = np.random.default_rng(1).standard_normal((1000, 2))
    assert gathered(pieces_of(rows, rows[:, 0], 100))[0].block == 1


def test_white_residuals_of_least_squares_have_the_variance_over_degrees_of_freedom():
    """Fifteen parameters of sixty samples: the mean square is a quarter too small."""
    rng, nothing = np.random.default_rng(0), np.zeros((15, 15))
    ratios = []
    for _ in range(20):
        rows, noise = rng.standard_normal((60, 15)), 3.0 * rng.standard_normal(60)
        residuals = noise - rows @ np.linalg.lstsq(rows, noise, rcond=None)[0]
        parts = pieces_of(rows, residuals, 60)
        if autoregression(gathered(parts)[0].autocovariance(np.zeros(15), nothing), 60).white:
            score = score_of(parts)
            ratios.append(score[0, 0] / (rows.T @ rows)[0, 0] / (residuals @ residuals / 45))
    # the fixed point of v = (rss + 15 v)/60 by two rounds from rss/60: 1 - 1/4^3 of it
    assert len(ratios) > 5
    np.testing.assert_allclose(ratios, 1 - 0.25**3, rtol=1e-9)


def test_what_a_fit_absorbs_of_slow_noise_is_put_back():
    """Regressors and noise in the same low band: mean of the variances over their true value, 300 draws."""
    count, rng = 250, np.random.default_rng(3)
    t = np.arange(count) / count
    rows = np.column_stack([np.ones(count), *(np.cos(np.pi * k * t) for k in (1, 2, 3))])
    project, a = np.linalg.pinv(rows), np.array([1.0, -0.9])
    true = np.diagonal(project @ toeplitz(autocovariance(count, a)) @ project.T)
    found = {"plain": [], "counted": []}
    inverse = np.linalg.inv(rows.T @ rows)
    for _ in range(300):
        noise = drawn(count, a, int(rng.integers(1 << 30)))
        residuals = noise - rows @ (project @ noise)
        parts = pieces_of(rows, residuals, count)
        sums = gathered(parts)
        raw = autoregression(sums[0].autocovariance(np.zeros(4), np.zeros((4, 4))), count)
        found["plain"].append(np.diagonal(inverse @ coloured_score({0: raw}, sums, parts, 4) @ inverse))
        found["counted"].append(np.diagonal(inverse @ score_of(parts) @ inverse))
    plain, counted = (np.sqrt(np.mean(v, axis=0) / true) for v in found.values())
    assert (plain < 0.85).all() and (counted > plain + 0.08).all() and (counted < 1.1).all()


@pytest.mark.parametrize("size", [1, 37, 400])  # pieces shorter than a block complete none
def test_the_scatter_of_a_variance_is_that_of_its_autoregression(size):
    """Slopes of the variances by differences, with the covariance of coefficients that Yule and Walker's have."""
    rng, count = np.random.default_rng(4), 400
    rows = np.cumsum(rng.standard_normal((count, 3)), axis=0) * np.hanning(count)[:, None]  # dies out before its end
    parts = pieces_of(rows, rng.standard_normal(count), size)
    sums, inverse = gathered(parts), np.linalg.inv(rows.T @ rows)
    assert sums[0].block in (1, 2, 4, 8)

    def variances(a: np.ndarray, variance: float) -> np.ndarray:
        score = coloured_score({0: Colour(a=a, variance=variance)}, sums, parts, 3)
        return np.diagonal(inverse @ score @ inverse)

    order, blocks = len(A) - 1, sums[0].count
    slopes = np.array([(variances(A + h, 2.5) - variances(A - h, 2.5)) / 2e-5 for h in 1e-5 * np.eye(order + 1)[1:]])
    lags = autocovariance(order, variance=2.5)
    spread = 2.5 * np.linalg.inv(lags[np.abs(np.subtract.outer(np.arange(order), np.arange(order)))]) / blocks
    of_variance = (variances(A, 3.5) - variances(A, 2.5)) * 2.5
    truth = np.einsum("ji,jk,ki->i", slopes, spread, slopes) + 2.0 * of_variance**2 / blocks
    found = variance_scatter({0: Colour(a=A, variance=2.5)}, sums, parts, inverse)
    np.testing.assert_allclose(found, truth, rtol=1e-6)
