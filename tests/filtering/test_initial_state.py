"""Where a simulation begins. Truth: the state that flew, and what a measured reading says of it."""

from __future__ import annotations

import numpy as np
import pytest
from diagnosis_flights import NOISE, flights, rough_file

import casid as cs
from casid.filtering.initial_state import fit_initial_state, measured_start
from casid.model.dynamics import aircraft_model
from casid.model.trim import trim
from problems.do328 import THRUST, V_TRIM, do328


def test_a_measured_state_begins_as_it_was_measured_whatever_is_wrong_with_the_file() -> None:
    """Drag of the file is twice that of the aircraft: the fit of the first seconds begins at another airspeed."""
    (record,) = flights(seed=3, count=1)
    file = rough_file().with_derivatives({"CD_0": 2.0 * do328().derivatives["CD_0"], "CL_0": 0.1})
    model, flown = aircraft_model(file), trim(do328(), V=V_TRIM, thrust=THRUST).state
    fitted = fit_initial_state(model, record, 5.0)
    start = measured_start(model, record, fitted)
    of_line = 2.0 / np.sqrt(25.0)  # 1-sigma of the end of a straight line through 25 readings, of that of a reading
    speed, angle = np.hypot(start[0], start[2]), np.arctan2(start[2], start[0])
    assert abs(speed - V_TRIM) < 4.0 * of_line * NOISE["V"] < abs(np.hypot(fitted[0], fitted[2]) - V_TRIM)
    assert abs(angle - np.arctan2(flown[2], flown[0])) < 4.0 * of_line * NOISE["alpha"]
    for name in ("p", "q", "r", "phi", "theta"):
        i = model.states.index(name)
        assert abs(start[i] - flown[i]) < 4.0 * of_line * NOISE[name]


def test_what_is_not_measured_stays() -> None:
    """Of a position and a velocity the position is measured, and an output that the input enters says nothing."""
    model = cs.define_model(
        "cart",
        states=["x", "v"],
        inputs=["u"],
        parameters={"k": 1.0},
        outputs=["place", "force"],
        dynamics=lambda s: {"x": s.v, "v": s.u - s.k * s.x},
        output=lambda s: {"place": 2.0 * s.x, "force": s.u - s.k * s.x},
    )
    t = np.arange(0.0, 4.0, 0.1)
    record = cs.Record(name="m", t=t, channels={"place": 3.0 + 0.5 * t, "force": 0.0 * t + 7.0, "u": 0.0 * t})
    assert measured_start(model, record, np.array([0.2, 0.4])) == pytest.approx([1.5, 0.4])
    assert measured_start(model, record.without("place"), np.array([0.2, 0.4])) == pytest.approx([0.2, 0.4])


@pytest.mark.parametrize("unit", [1e-6, 1e5])
def test_the_state_that_fits_best_is_the_same_in_any_unit(unit: float) -> None:
    model = cs.define_model(
        "decay",
        states=["x"],
        inputs=[],
        parameters={"k": 0.3},
        outputs=["x"],
        dynamics=lambda s: {"x": -s.k * s.x},
        output=lambda s: {"x": s.x},
    )
    t = np.linspace(0.0, 10.0, 41)
    x = np.exp(-0.3 * t) + 0.05 * np.random.default_rng(0).standard_normal(41)
    one, other = (fit_initial_state(model, cs.Record(name="r", t=t, channels={"x": u * x})) for u in (1.0, unit))
    assert other / unit == pytest.approx(one, rel=1e-6)
