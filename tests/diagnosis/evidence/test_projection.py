"""The projection of responses off what is fitted is a least-squares fit of both together."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from casid.diagnosis.evidence.fingerprints import Projection

_LENGTHS, _SLOTS, _RESPONSES = (40, 55), 3, 2


def _evidence(rng: np.random.Generator):
    """Of slots without a prior, at a point that is not their best one, and the innovations there."""
    columns = [rng.standard_normal((n, _SLOTS)) for n in _LENGTHS]
    longest = max(_LENGTHS)
    padded = [np.vstack([c, np.zeros((longest - len(c), _SLOTS))]) for c in columns]
    white = np.stack([np.r_[rng.standard_normal(n), np.zeros(longest - n)] for n in _LENGTHS], axis=1)[..., None]
    covariance = np.linalg.inv(sum(c.T @ c for c in padded))
    newton = covariance @ sum(c.T @ white[:, r, 0] for r, c in enumerate(padded))
    fit = SimpleNamespace(white=white)
    return SimpleNamespace(by_record=tuple(padded), covariance=covariance, newton=newton, fit=fit)


def _together(columns: list[np.ndarray], responses: np.ndarray, white: np.ndarray) -> np.ndarray:
    """Truth: sizes of the responses in one least-squares fit with all slots."""
    return np.linalg.lstsq(np.hstack([np.vstack(columns), responses]), white, rcond=None)[0][_SLOTS:]


@pytest.mark.parametrize("by_record", [False, True])
def test_sizes_are_those_of_one_fit_with_all_slots(by_record: bool) -> None:
    rng = np.random.default_rng(3)
    evidence = _evidence(rng)
    own = [rng.standard_normal((max(_LENGTHS), _RESPONSES)) for _ in _LENGTHS]
    white = np.concatenate([evidence.fit.white[:, r, 0] for r in range(len(own))])
    if by_record:
        innovations = (evidence.fit.white[:, r, 0] for r in range(len(own)))
        products = zip(evidence.by_record, own, innovations, strict=True)
        cross, match = zip(*((c.T @ m, m.T @ e) for c, m, e in products), strict=True)
        grams = np.array([m.T @ m for m in own])
        left = Projection.by_record(evidence, grams, (np.array(cross), np.array(match)))  # pyright: ignore
        zero = np.zeros_like(own[0])
        responses = np.block([[own[0], zero], [zero, own[1]]])
    else:
        left = Projection.shared(evidence, dict(enumerate(own)))  # pyright: ignore
        responses = np.vstack(own)
    expected = _together(list(evidence.by_record), responses, white)
    assert np.linalg.solve(left.gram, left.match) == pytest.approx(expected, rel=1e-9)


def test_what_slots_can_do_has_nothing_left() -> None:
    """Symmetry: a response that is a sum of the slots' is not seen beside them."""
    evidence = _evidence(np.random.default_rng(5))
    mixed = {r: c @ np.array([[1.0], [-2.0], [0.5]]) for r, c in enumerate(evidence.by_record)}
    left = Projection.shared(evidence, mixed)  # pyright: ignore
    assert left.gram == pytest.approx(0.0, abs=1e-9) and left.match == pytest.approx(0.0, abs=1e-9)
