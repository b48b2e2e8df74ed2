"""Proof of match on real flight. Truth: published output-error estimates of the HFB-320, flown on their own record."""

from __future__ import annotations

from pathlib import Path

import casid as cs
from problems.real import hfb320, hfb320_aircraft


def test_published_estimates_of_the_hfb320_keep_the_short_period_tolerances(flight_data: Path) -> None:
    """56 s open loop in turbulence. Without the damping in pitch the same test fails."""
    record = hfb320_aircraft.longitudinal(hfb320.record_from(flight_data / "hfb320_1_10.asc"))
    aircraft = hfb320_aircraft.aircraft()
    (one,) = (each for each in cs.proof_of_match(aircraft, record).tests if each.test.id == "2.c.10")
    assert one.passed is True
    undamped = aircraft.with_derivatives({"Cm_q": 0.0})
    (worse,) = (each for each in cs.proof_of_match(undamped, record).tests if each.test.id == "2.c.10")
    assert worse.passed is False
