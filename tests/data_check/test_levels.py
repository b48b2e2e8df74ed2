"""The numbers of the check of data, each given another value. Truth: what the formula of its docstring makes of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest

import casid as cs
from casid.data_check.criteria import DataCriteria
from casid.data_check.levels import level_terms
from casid.data_check.reading import Read, Reading, smooth
from casid.data_check.response import Response
from casid.model.aircraft import Aircraft
from casid.records.record import Record
from problems.blind.sets import fly_set
from problems.faults.fault import DataFault, with_fault

Flown = tuple[Aircraft, Sequence[Record]]


@pytest.fixture(scope="module")
def flown() -> Flown:
    one = fly_set("do328", "clean-1", 1)
    return one.aircraft, one.records[:2]


def read(record: Record, reading: Reading, criteria: DataCriteria) -> Read:
    return Read(smooth(record, criteria.quick, criteria), reading)


def lift(aircraft: Aircraft, criteria: DataCriteria) -> Callable[[Read], float]:
    channels = frozenset(("alpha", "V", "rho", "az"))
    return next(term for uses, term in level_terms(aircraft, 9.81, criteria) if uses == channels)


def test_a_window_of_one_sample_leaves_a_record_as_it_is(flown: Flown) -> None:
    """Limit: no smoothing, so that no sample is at an edge."""
    record = flown[1][0]
    found = smooth(record, record.dt, DataCriteria(fewest=1))
    np.testing.assert_allclose(found.values["q"], record["q"], rtol=1e-9, atol=1e-12)
    assert found.known["q"].all()


def test_what_cannot_be_costs_as_much_as_odds_of_rounding(flown: Flown) -> None:
    """Air of negative density, by every level that knows density alone."""
    criteria = DataCriteria()
    negative = read(flown[1][0], Reading(factor={"rho": -1.0}), criteria)
    found = [term(negative) for uses, term in level_terms(None, 9.81, criteria) if uses == {"rho"}]
    assert criteria.impossible in found and set(found) <= {criteria.impossible, 0.0}
    assert 1.0 + np.exp(criteria.impossible) > 1.0 == 1.0 + 0.4 * np.exp(criteria.impossible)


def test_a_derivative_of_the_other_sign_costs_as_much_as_the_impossible(
    flown: Flown, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The elevator turned round in the file alone: the evidence differs by what its sign may cost at most."""
    aircraft, records = flown
    turned = aircraft.with_derivatives({"Cm_delta_e": -aircraft.derivatives["Cm_delta_e"]})

    def likelihood(impossible: float) -> float:
        monkeypatch.setattr(DataCriteria, "impossible", impossible)
        criteria = DataCriteria(outlier=1e-9)
        return Response(turned, criteria).likelihood([read(one, Reading(), criteria) for one in records])

    assert likelihood(-20.0) - likelihood(-21.0) == pytest.approx(1.0, abs=1e-6)


def test_the_errors_of_a_lift_curve_settle(flown: Flown) -> None:
    """Twice as many iterations change nothing; one is not enough."""
    aircraft, (record, _) = flown
    heavy = replace(aircraft, mass=2.0 * aircraft.mass, trim={})  # by the constants of the file it does not fly

    def likelihood(criteria: DataCriteria) -> float:
        return lift(heavy, criteria)(read(record, Reading(), criteria))

    settled = likelihood(DataCriteria())
    assert likelihood(DataCriteria(steps=24)) == pytest.approx(settled, rel=1e-6)
    assert likelihood(DataCriteria(steps=1)) != pytest.approx(settled, rel=1e-3)


def test_factors_of_time_agree_within_the_criterion(flown: Flown) -> None:
    """Time stretched by five is found where relations may differ by a tenth, and not where they may not differ."""
    aircraft, records = flown
    stretched = with_fault(DataFault(kind="data_unit", target="t", records=("m1", "m2"), value=5.0), records, seed=3)
    found = cs.check(stretched, aircraft)
    assert ("data_unit", "t") in {(one.kind, one.target) for one in found.findings}
    refused = cs.check(stretched, aircraft, criteria=DataCriteria(fair=1e-9))
    assert ("data_unit", "t") not in {(one.kind, one.target) for one in refused.findings}
