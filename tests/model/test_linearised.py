"""Tables and own aerodynamics as derivatives: those of the aircraft that the tables were made of."""

from __future__ import annotations

from dataclasses import replace

import pytest

import casid as cs
from casid.model.linearised import given_slopes, linearised
from problems.do328 import do328


def test_slopes_of_tables_are_the_derivatives_that_they_were_made_of() -> None:
    """Increments of zero on tables of straight lines: the whole is the linear aircraft again."""
    linear = do328()
    lines = [
        cs.table("Cm", "alpha", [-0.5, 0.5], [0.839 + 0.127, -0.839 + 0.127], name="static"),
        cs.table("Cm", ["alpha", "mach"], [[-0.5, 0.5], [0.0, 1.0]], [[-26.0, -26.0]] * 2, times="q", name="damping"),
    ]
    made = {"Cm_alpha": 0.0, "Cm_0": 0.0, "Cm_q": 0.0}
    aircraft = replace(linear, derivatives={**linear.derivatives, **made}, tables=tuple(lines))
    whole = linearised(aircraft)
    assert whole.tables == ()
    for name, value in linear.derivatives.items():
        assert whole.derivatives[name] == pytest.approx(value, abs=1e-12), name
    assert given_slopes(linear) == {} and linearised(linear) is linear


def test_slopes_are_those_at_the_flight_point() -> None:
    """A table with a kink at 6 deg: the slope is the one below it in cruise, the one above it in slow flight."""
    kinked = cs.table("CL", "alpha", [-0.2, 0.1, 0.3], [-1.2, 0.6, 0.8], name="CL")
    aircraft = replace(do328(), tables=(kinked,))
    for alpha, slope in ((0.03, 6.0), (0.2, 1.0)):
        there = replace(aircraft, trim={**aircraft.trim, "alpha": alpha})
        assert given_slopes(there)["CL_alpha"] == pytest.approx(slope)
