"""What is known of derivatives before the records."""

from __future__ import annotations

from dataclasses import replace

import pytest
from diagnosis_flights import flights

from casid.diagnosis.criteria import Criteria
from casid.diagnosis.flight.flight import prepare
from casid.diagnosis.flight.hypothesis import prior
from casid.model.aircraft import Aircraft
from casid.model.usual_derivatives import USUAL_DERIVATIVES
from problems.do328 import do328


def stds(aircraft: Aircraft, *names: str) -> list[float]:
    flight = prepare(aircraft, flights(seed=1, count=1, duration_s=8.0), Criteria())
    _, weight = prior(flight, flight.model(), names)
    return [float(one) ** -0.5 for one in weight]


def without(*names: str) -> Aircraft:
    plane = do328()
    return replace(plane, derivatives={**plane.derivatives, **dict.fromkeys(names, 0.0)})


def test_a_derivative_that_the_file_has_at_zero_is_as_large_as_in_aircraft() -> None:
    """Truth: the table; and of one with a value that it may be three times that."""
    plane = without("Cm_q", "Cl_r")
    pitch, yaw = USUAL_DERIVATIVES["Cm_q"], USUAL_DERIVATIVES["Cl_r"]
    assert "Cm_alphadot" not in USUAL_DERIVATIVES
    by_rate = 0.5 * plane.moment_length_pitch / plane.rate_length_pitch
    across = 0.5 * plane.moment_length_lateral / plane.rate_length_lateral
    assert stds(plane, "Cm_q", "Cl_r") == pytest.approx([pitch * by_rate, yaw * across])
    assert stds(plane, "Cm_alpha") == pytest.approx([3.0 * abs(plane.derivatives["Cm_alpha"])])


def test_rates_by_another_length_have_derivatives_by_that_length() -> None:
    """A symmetry: q c/V is twice q c/2V, and its derivative half."""
    plane = without("Cm_q")
    doubled = replace(plane, rate_length_pitch=2.0 * plane.rate_length_pitch)
    (one,), (half,) = stds(plane, "Cm_q"), stds(doubled, "Cm_q")
    assert half == pytest.approx(0.5 * one)


def test_the_sizes_are_those_of_the_aircraft_that_come_with_jsbsim() -> None:
    """Truth: the tangents of their tables at a lift coefficient of 0.4, to the digits that the table has."""
    pytest.importorskip("jsbsim")
    from problems.jsbsim.derivative_sizes import fleet, sizes

    found = sizes(fleet())
    assert len(found) == 35
    for name, size in found.items():
        assert USUAL_DERIVATIVES[name] == pytest.approx(size, rel=0.05), name
