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
    sensitivities = np.stack(padded, axis=1)  # (samples, records, slots)
    return SimpleNamespace(
        fit=SimpleNamespace(white=white),
        covariance=covariance,
        newton=newton,
        sensitivities=sensitivities,
        products=lambda own: np.einsum("krs,krin->rsn", sensitivities, own),
    )


def _together(evidence: SimpleNamespace, responses: np.ndarray) -> np.ndarray:
    """Truth: sizes of the responses in one least-squares fit with all slots, one record after the other."""
    columns, white = (of.swapaxes(0, 1) for of in (evidence.sensitivities, evidence.fit.white))
    both = np.hstack([columns.reshape(-1, _SLOTS), responses])
    return np.linalg.lstsq(both, white.reshape(-1), rcond=None)[0][_SLOTS:]


@pytest.mark.parametrize("by_record", [False, True])
def test_sizes_are_those_of_one_fit_with_all_slots(by_record: bool) -> None:
    rng = np.random.default_rng(3)
    evidence = _evidence(rng)
    own = rng.standard_normal((max(_LENGTHS), len(_LENGTHS), 1, _RESPONSES))
    if by_record:
        grams = np.einsum("krin,krim->rnm", own, own)
        match = np.einsum("krin,kri->rn", own, evidence.fit.white)
        left = Projection.by_record(evidence, grams, (evidence.products(own), match))  # pyright: ignore
        zero = np.zeros_like(own[:, 0, 0])
        responses = np.block([[own[:, 0, 0], zero], [zero, own[:, 1, 0]]])
    else:
        left = Projection.shared(evidence, own)  # pyright: ignore
        responses = np.vstack([own[:, 0, 0], own[:, 1, 0]])
    expected = _together(evidence, responses)
    assert np.linalg.solve(left.gram, left.match) == pytest.approx(expected, rel=1e-9)


def test_what_slots_can_do_has_nothing_left() -> None:
    """Symmetry: a response that is a sum of the slots' is not seen beside them."""
    evidence = _evidence(np.random.default_rng(5))
    mixed = evidence.sensitivities[:, :, None] @ np.array([[1.0], [-2.0], [0.5]])
    left = Projection.shared(evidence, mixed)  # pyright: ignore
    assert left.gram == pytest.approx(0.0, abs=1e-9) and left.match == pytest.approx(0.0, abs=1e-9)
