"""Theil's coefficient and its parts: histories whose error is of one kind alone, and the identity of the parts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import casid as cs
from casid.acceptance.theil import theil_of
from casid.cli.options import DEMO

T = np.linspace(0.0, 2.0 * np.pi, 1000, endpoint=False)


@pytest.mark.parametrize(
    ("measured", "simulated", "kind"),
    [
        (np.sin(T), np.sin(T) + 0.3, "bias"),
        (np.sin(T), 1.5 * np.sin(T), "variance"),
        (np.sin(T), np.cos(T), "covariance"),
    ],
)
def test_errors_of_one_kind(measured, simulated, kind) -> None:
    found = theil_of(measured, simulated)
    assert getattr(found, kind) == pytest.approx(1.0, abs=1e-9)


def test_coefficient_by_its_formula() -> None:
    rng = np.random.default_rng(3)
    z, y = rng.normal(1.0, 2.0, 500), rng.normal(0.5, 1.0, 500)
    found = theil_of(np.r_[z, np.nan], np.r_[y, 0.0])
    assert found.coefficient == pytest.approx(
        np.linalg.norm(z - y) / (np.linalg.norm(z) + np.linalg.norm(y)), rel=1e-12
    )
    r = np.corrcoef(z, y)[0, 1]
    square = np.mean((z - y) ** 2)
    assert found.covariance == pytest.approx(2.0 * (1.0 - r) * z.std() * y.std() / square, rel=1e-9)
    assert found.bias + found.variance + found.covariance == pytest.approx(1.0)
    assert theil_of(z, z).coefficient == 0.0 and theil_of(z, -z).coefficient == pytest.approx(1.0)
    with pytest.raises(cs.InputError, match="no sample"):
        theil_of(np.array([np.nan]), np.array([1.0]))


def test_of_records_flown_open_loop() -> None:
    found = cs.theil(DEMO / "aircraft.toml", [DEMO / "m1.csv", DEMO / "m4.csv"])
    assert list(found) == ["m1", "m4"]
    assert all(0.0 <= one.coefficient <= 1.0 for channels in found.values() for one in channels.values())


def test_a_flight_that_diverges_has_none() -> None:
    aircraft = cs.Aircraft.read(DEMO / "aircraft.toml").with_derivatives({"Cm_alpha": 60.0, "Cm_q": 900.0})
    assert cs.theil(aircraft, [DEMO / "m1.csv"]) == {"m1": {}}


def test_a_flight_begins_as_the_first_five_seconds_are_fitted() -> None:
    """An unmeasured state at the start is that of the readings up to 5 s; later ones only weigh in the noise."""
    record = cs.read_record(DEMO / "m1.csv")
    record = replace(record, channels={n: v for n, v in record.channels.items() if n not in ("theta", "alpha")})

    def moved(begin: float) -> float:
        there = (record.t > begin) & (record.t < begin + 0.9)
        spoilt = record.with_channels(q=record["q"] + np.where(there, 0.02, 0.0))
        first, second = (cs.theil(DEMO / "aircraft.toml", [one])["m1"]["V"].rms for one in (record, spoilt))
        return abs(first - second)

    assert moved(5.05) < 0.1 * moved(4.05)
