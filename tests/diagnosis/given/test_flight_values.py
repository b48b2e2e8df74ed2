"""What flight says of a derivative beside an added term. Truth: the derivative of the polynomial that was flown."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from diagnosis_flights import flights

from casid.diagnosis.criteria import Criteria
from casid.diagnosis.evidence.evidence import weigh
from casid.diagnosis.flight.fit import fit
from casid.diagnosis.flight.flight import prepare
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.given.contradicted import FlightValue, contradicted, flight_values
from casid.model.causes.aerodynamics import aero_term, unsteady_aero
from problems.do328 import do328


@pytest.mark.parametrize("trim", [{"V": 115.0, "alpha": 0.11}, {"V": 115.0}])
def test_the_slope_at_the_trim_has_the_added_term(trim: dict[str, float]) -> None:
    """Cm = Cm_alpha alpha + b alpha^2: the slope is Cm_alpha + 2 b alpha, at the angle of attack of the trim. A file
    that does not state it gets that at the median of the flight."""
    bent = Attached(effect=aero_term("Cm", "alpha^2"), values={"value": -4.0})
    flight = prepare(replace(do328(), trim=trim), flights([bent], seed=3, count=2))
    fitted = fit(flight, [bent], flight.noise())
    found = flight_values(weigh(fitted))["Cm_alpha"]
    assert found.at_trim is not None
    alpha = trim.get("alpha", float(np.median(fitted.regressors["alpha"][fitted.batch.live])))
    slope, std = found.at_trim
    assert slope == pytest.approx(found.value + 2.0 * fitted[bent.name] * alpha)
    assert abs(slope - (do328().derivatives["Cm_alpha"] - 8.0 * alpha)) < 4.0 * std
    assert flight_values(weigh(fitted))["Cl_p"].at_trim is None


def test_a_file_must_differ_from_both_slopes_to_be_contradicted() -> None:
    """A table whose slope at trim is the file's looked contradicted, 0.06 for 0.375, beside an added alpha^2."""
    one = FlightValue(value=0.06, std=0.02, determined=True, at_trim=(0.37, 0.02))
    assert one.nearest(0.375).value == 0.37 and one.nearest(0.05).value == 0.06
    assert not one.against(0.375, 0.0, Criteria()) and not one.against(0.05, 0.0, Criteria())
    assert one.against(0.2, 0.1, Criteria()) and not one.against(0.2, 0.15, Criteria())


def test_what_is_told_of_a_linear_file_is_the_slope_at_its_trim() -> None:
    """Drag is 0.15 alpha + 1.4 alpha^2, trim 0.1 rad: a linear model has 0.43; a file of 0.17 may mean 0.15."""
    stated = do328().derivatives | {"CD_alpha": 0.17}
    one = FlightValue(value=0.15, std=0.01, determined=True, at_trim=(0.43, 0.01))
    file = replace(do328(), derivatives=stated, relative_uncertainty=0.1)
    assert contradicted(file, {"CD_alpha": one}) == ()
    far = replace(file, derivatives=stated | {"CD_alpha": 0.3})
    (told,) = contradicted(far, {"CD_alpha": one})
    assert told.flight == 0.43 and told.std == 0.01


def errors(found: Mapping[str, FlightValue], truth: Mapping[str, float]) -> np.ndarray:
    """Errors of the values that flight determines, in their own deviations."""
    known = [name for name, one in found.items() if name in truth and one.determined]
    return np.array([abs(found[name].value - truth[name]) / found[name].std for name in known])


def test_deviations_of_an_exactly_linear_aircraft_are_calibrated() -> None:
    """Errors of a normal distribution have a median of 0.67 deviations and a 90 % quantile of 1.64."""
    all_of_them = []
    for seed in range(4):
        flight = prepare(do328(), flights(seed=seed))
        all_of_them.append(errors(flight_values(weigh(fit(flight, (), flight.noise()))), do328().derivatives))
    ratio = np.concatenate(all_of_them)
    assert 0.3 < np.median(ratio) < 0.9
    assert 1.0 < np.quantile(ratio, 0.9) < 1.9


def test_deviations_hold_the_slopes_of_a_curved_aircraft() -> None:
    """The fitted model has no alpha^2; the slope along the flight is Cm_alpha + 2 b alpha at the middle."""
    bent = Attached(effect=aero_term("Cm", "alpha^2"), values={"value": -4.0})
    flight = prepare(do328(), flights([bent], seed=3))
    fitted = fit(flight, (), flight.noise())
    truth, alpha = dict(do328().derivatives), fitted.regressors["alpha"][fitted.batch.live]
    truth["Cm_alpha"] -= 8.0 * float(np.median(alpha))
    found = {name: one for name, one in flight_values(weigh(fitted)).items() if name != "Cm_0"}
    naive = abs(found["Cm_alpha"].value - truth["Cm_alpha"]) / fitted.std("Cm_alpha")
    assert naive > 3.0
    assert np.quantile(errors(found, truth), 0.95) < 2.5


def test_pitch_damping_has_room_for_a_wake_that_the_model_lacks() -> None:
    """Cm_alphadot was flown, 0.3 of Cm_q, and the model has none: records show the sum. The other slopes stay."""
    late = Attached(effect=unsteady_aero("Cm"), values={"value": -8.0})
    flight = prepare(do328(), flights([late], seed=3))
    fitted = fit(flight, (), flight.noise())
    found = flight_values(weigh(fitted))
    off = abs(fitted["Cm_q"] - do328().derivatives["Cm_q"])
    assert off > 10.0 * fitted.std("Cm_q")
    assert off < 2.0 * found["Cm_q"].std
    assert np.quantile(errors(found, do328().derivatives), 0.9) < 2.0
    assert found["Cl_p"].std < 3.0 * fitted.std("Cl_p")


def test_the_interval_of_a_value_reaches_every_other_explanation() -> None:
    """Two explanations change Cm_alpha by -0.4 and 0.3. Values that neither changes keep their deviations."""
    flight = prepare(do328(), flights(seed=3, count=2))
    evidence = weigh(fit(flight, (), flight.noise()))
    alone, beside = flight_values(evidence), flight_values(evidence, others=({"Cm_alpha": -0.4}, {"Cm_alpha": 0.3}))
    low, high = (beside["Cm_alpha"].value + side * 1.96 * beside["Cm_alpha"].std for side in (-1.0, 1.0))
    assert low <= alone["Cm_alpha"].value - 0.4 and high >= alone["Cm_alpha"].value + 0.3
    assert beside["Cm_alpha"].std == pytest.approx(np.hypot(alone["Cm_alpha"].std, 0.4 / 1.96), rel=0.05)
    assert all(beside[name].std == one.std for name, one in alone.items() if name != "Cm_alpha")
