"""Leaving out whole records, against regressions that leave them out."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from diagnosis_flights import flights

from casid.diagnosis.causes import still_matters
from casid.diagnosis.comparisons import all_passed
from casid.diagnosis.evidence.evidence import is_sure, jackknife, left_open, weigh
from casid.diagnosis.flight.fit import fit
from casid.diagnosis.flight.flight import prepare
from casid.diagnosis.flight.hypothesis import Attached
from casid.model.causes.air import gust
from casid.model.causes.controls import effectiveness_change
from casid.model.causes.instruments import structural_mode
from problems.do328 import do328


def _evidence(rng: np.random.Generator, apart: float):
    """Five records of 40 readings and two slots, the second of which differs between records by `apart`, 1-sigma."""
    columns = [rng.standard_normal((40, 2)) for _ in range(5)]
    white = np.stack([rng.standard_normal(40) + apart * rng.standard_normal() * c[:, 1] for c in columns], axis=1)
    grams = np.array([c.T @ c for c in columns])
    slopes = np.array([c.T @ white[:, r] for r, c in enumerate(columns)])
    sums = SimpleNamespace(
        grams=grams, slopes=slopes, slope=slopes.sum(axis=0), information=lambda _: grams.sum(axis=0)
    )
    fit = SimpleNamespace(white=white[..., None], slots=[SimpleNamespace(name="a"), SimpleNamespace(name="b")])
    return SimpleNamespace(columns=columns, fit=fit, scales={}, sums=sums)


def test_it_is_that_of_regressions_without_each_record() -> None:
    evidence = _evidence(np.random.default_rng(1), 0.5)
    sizes = []
    for left_out in range(5):
        kept = [r for r in range(5) if r != left_out]
        A = np.vstack([evidence.columns[r] for r in kept])
        y = np.concatenate([evidence.fit.white[:, r, 0] for r in kept])
        sizes.append(np.linalg.lstsq(A, y, rcond=None)[0][1])
    expected = np.sqrt(4.0 / 5.0 * np.sum((np.array(sizes) - np.mean(sizes)) ** 2))
    assert jackknife(evidence, "b", range(5)) == pytest.approx(expected, rel=1e-9)  # pyright: ignore


def test_it_holds_what_differs_between_records() -> None:
    """A size that differs by 0.5 between five records has a mean with a 1-sigma of 0.5 / sqrt(5), of which the 1-sigma
    by white noise, 0.07, knows nothing; two records tell nothing."""
    found = [jackknife(_evidence(np.random.default_rng(s), 0.5), "b", range(5)) for s in range(60)]  # pyright: ignore
    assert np.sqrt(np.mean(np.square(found))) == pytest.approx(0.5 / np.sqrt(5.0), rel=0.2)
    assert jackknife(_evidence(np.random.default_rng(1), 0.5), "b", range(2)) == 0.0  # pyright: ignore


def test_products_without_the_sensitivities_are_those_with_them() -> None:
    """Truth: the whole matrix of whitened sensitivities, multiplied; also that of the normal equations."""
    flight = prepare(do328(), flights(seed=3, count=2, duration_s=8.0))
    found = weigh(fit(flight, (), flight.noise(), extent=(2, 0.5)))
    every = np.concatenate([part for _, part in found.columns(32)], axis=3).swapaxes(0, 1)  # the innovations first
    assert len(found.terms) > 100 and every.shape == (*found.fit.white.shape, 1 + len(found.newton))
    own, rng = every[..., 1:], np.random.default_rng(2)
    for record in range(2):
        flat = own[:, record].reshape(-1, own.shape[3])
        np.testing.assert_allclose(found.sums.grams[record], flat.T @ flat, rtol=1e-9, atol=1e-9)
    expected = np.einsum("krij,krin->rjn", own, white := rng.standard_normal((*found.fit.white.shape, 3)))
    np.testing.assert_allclose(found.products(white), expected, rtol=0, atol=1e-10 * np.abs(expected).max())
    along = own @ (direction := rng.standard_normal(own.shape[3]))
    np.testing.assert_allclose(found.along(direction), along, rtol=0, atol=1e-10 * np.abs(along).max())


def test_straight_lines_between_samples_are_part_of_a_size() -> None:
    """Truth: a straight line between samples takes 1 - sinc^2(f dt) from what oscillates at f; a gust has none."""
    mode = Attached(effect=structural_mode("q"), values={"value": 0.8, "frequency_hz": 3.0, "damping": 0.03})
    wave = Attached(effect=gust("z"), values={"value": 4.0, "length": 1.6}, onsets={"m1": 12.0})
    flight = prepare(do328(), flights([mode, wave], seed=4, count=2))
    found = weigh(fit(flight, [mode, wave], flight.noise(), extent="settled"))
    of_mode, of_gust = (
        left_open(found, [slot.name for slot in found.fit.slots].index(one.name))[0] for one in (mode, wave)
    )
    assert of_mode == pytest.approx(0.8 * (1.0 - np.sinc(3.0 * 0.04) ** 2), rel=0.5)
    assert of_gust < 1e-5  # m/s, by the attitude between samples


def test_a_value_whose_interval_holds_zero_is_not_sure() -> None:
    """Two effects of one surface: a loss that was flown is sure, and one that was not is not."""
    flown = Attached(effect=effectiveness_change("delta_r"), values={"value": -0.3}, onsets={"m1": 8.0, "m2": 9.5})
    absent = Attached(effect=effectiveness_change("delta_e"), values={"value": 0.05}, onsets={"m1": 8.0, "m2": 9.5})
    flight = prepare(do328(), flights([flown], seed=6, count=2))
    evidence = weigh(fit(flight, [flown, absent], flight.noise()))
    assert is_sure(evidence, "effectiveness_change(delta_r)")
    assert all_passed(still_matters(evidence.fit, "effectiveness_change(delta_r)"))
    assert not is_sure(evidence, "effectiveness_change(delta_e)")
    assert not all_passed(still_matters(evidence.fit, "effectiveness_change(delta_e)"))
