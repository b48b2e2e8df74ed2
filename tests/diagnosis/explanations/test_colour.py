"""What is left by an explanation, what coloured readings are worth, and names on coloured noise."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter
from score_questions import a_question, moments, with_response

from casid.diagnosis.explanations.colour import left_by, searched_in_colour, worth
from casid.diagnosis.explanations.explanation import CauseColumn, RecordColumns, WhitenedInnovations
from casid.diagnosis.explanations.posterior import posterior
from casid.diagnosis.explanations.prior import Priors
from casid.diagnosis.explanations.search import search
from casid.diagnosis.numerics import ScoreNumerics


def test_what_is_left_is_the_expected_noise() -> None:
    """Of unit white noise in innovations with covariance S, given them: S^-1 (y - mean)."""
    priors = Priors(base=(0.0, 0.3))
    innovations = with_response(a_question(1), {0: 0.6, 4: -0.5})
    found = search(innovations, priors)
    kinds = {(one.setting.level > 0.0, bool(one.unknown), len(one.elements)): one for one in found.explanations}
    assert len(kinds) > 4
    for one in kinds.values():
        y, mean, S = moments(innovations, one, priors)
        np.testing.assert_allclose(
            np.concatenate(left_by(found.sums, priors, one)[0]), np.linalg.solve(S, y - mean), atol=1e-8
        )


def first_order(rho: float, n: int, rng: np.random.Generator) -> np.ndarray:
    """A first-order process of unit variance."""
    return lfilter([np.sqrt(1.0 - rho**2)], [1.0, -rho], rng.standard_normal(n + 200))[200:]


@pytest.mark.parametrize(("rho", "expected"), [(0.8, 1.0 / 9.0), (0.95, 1.0 / 39.0)])
@pytest.mark.parametrize("fitted", [0, 20])
def test_readings_of_a_first_order_process_are_worth_what_theory_says(rho: float, expected: float, fitted: int) -> None:
    """Unit variance, correlation rho^k: (1 - rho) / (1 + rho) of the readings, also where slow waves were fitted."""
    rng, n, found = np.random.default_rng(3), 16000, []
    waves = np.linalg.qr(np.cos(np.pi / n * np.outer(np.arange(n) + 0.5, np.arange(fitted))))[0]
    for _ in range(30):
        series = [first_order(rho, n, rng) for _ in range(2)]
        left = [e - waves @ (waves.T @ e) for e in series]
        found.append(worth(left, [waves, waves], ScoreNumerics()))
    assert np.median(found) == pytest.approx(expected, rel=0.2)


def test_white_readings_are_worth_all_of_them() -> None:
    """Of 200 channels with three stretches of 1300 readings each, fewer than 2 % are taken for coloured: by chi-square
    of twenty cosines 0.5 % are."""
    rng, nothing = np.random.default_rng(5), np.zeros((1300, 0))
    found = [worth([*rng.standard_normal((3, 1300))], [nothing] * 3, ScoreNumerics()) for _ in range(200)]
    assert np.mean(np.array(found) < Priors().white) < 0.02


def coloured(seed: int) -> WhitenedInnovations:
    """Slow causes, none of them there, and noise with a lag-1 correlation of 0.95."""
    rng = np.random.default_rng(seed)
    slow = lfilter([0.2], [1.0, -0.98], rng.standard_normal((400, 8)), axis=0)
    noise = lfilter([np.sqrt(1.0 - 0.95**2)], [1.0, -0.95], rng.standard_normal(500))[100:]
    record = RecordColumns(
        residual=noise,
        nuisance=np.ones((400, 1)),
        small=np.zeros((400, 0)),
        histories=(),
        shapes=slow,
        nodes=np.zeros(1),
    )
    causes = [
        CauseColumn(name=f"cause{i}", kind="slow", shape={0: i}, scales=(0.3, 1.0), log_prior=-2.5, matters=0.05)
        for i in range(8)
    ]
    return WhitenedInnovations(records=(record,), precision=np.ones(1), pull=np.zeros(1), causes=tuple(causes))


def test_coloured_noise_names_nothing_once_tempered() -> None:
    """Of 30 sets without any cause, taken as white most get a name; tempered by what is left a tenth of them do."""
    taken_as_white, allowed_for = 0, 0
    for seed in range(30):
        innovations = coloured(seed)
        found = search(innovations, Priors())
        taken_as_white += bool(posterior(found).named)
        allowed, worths = searched_in_colour(found, [np.zeros(400, dtype=int)])
        allowed_for += bool(posterior(allowed).named)
        assert worths[0] < 0.2
    assert taken_as_white > 15
    assert 10 * allowed_for <= taken_as_white


def test_white_innovations_are_left_as_they_are() -> None:
    found = search(a_question(3), Priors())
    channels = [np.zeros(len(record.residual), dtype=int) for record in found.innovations.records]
    assert searched_in_colour(found, channels) == (found, {0: 1.0})
