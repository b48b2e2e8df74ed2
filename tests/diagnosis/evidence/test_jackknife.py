"""Leaving out whole records, against regressions that leave them out."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from casid.diagnosis.evidence.evidence import jackknife


def _evidence(rng: np.random.Generator, apart: float):
    """Five records of 40 readings and two slots, the second of which differs between records by `apart`, 1-sigma."""
    columns = [rng.standard_normal((40, 2)) for _ in range(5)]
    white = np.stack([rng.standard_normal(40) + apart * rng.standard_normal() * c[:, 1] for c in columns], axis=1)
    gram, slope = sum(c.T @ c for c in columns), sum(c.T @ white[:, r] for r, c in enumerate(columns))
    sums = SimpleNamespace(slope=slope, information=lambda _: gram)
    fit = SimpleNamespace(white=white[..., None], slots=[SimpleNamespace(name="a"), SimpleNamespace(name="b")])
    return SimpleNamespace(by_record=tuple(columns), fit=fit, scales={}, _sums=sums)


def test_it_is_that_of_regressions_without_each_record() -> None:
    evidence = _evidence(np.random.default_rng(1), 0.5)
    sizes = []
    for left_out in range(5):
        kept = [r for r in range(5) if r != left_out]
        A = np.vstack([evidence.by_record[r] for r in kept])
        y = np.concatenate([evidence.fit.white[:, r, 0] for r in kept])
        sizes.append(np.linalg.lstsq(A, y, rcond=None)[0][1])
    expected = np.sqrt(4.0 / 5.0 * np.sum((sizes - np.mean(sizes)) ** 2))
    assert jackknife(evidence, "b", range(5)) == pytest.approx(expected, rel=1e-9)  # pyright: ignore


def test_it_holds_what_differs_between_records() -> None:
    """A size that differs by 0.5 between five records has a mean with a 1-sigma of 0.5 / sqrt(5), of which the 1-sigma
    by white noise, 0.07, knows nothing; two records tell nothing."""
    found = [jackknife(_evidence(np.random.default_rng(s), 0.5), "b", range(5)) for s in range(60)]  # pyright: ignore
    assert np.sqrt(np.mean(np.square(found))) == pytest.approx(0.5 / np.sqrt(5.0), rel=0.2)
    assert jackknife(_evidence(np.random.default_rng(1), 0.5), "b", range(2)) == 0.0  # pyright: ignore
