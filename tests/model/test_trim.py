"""Truth: nothing accelerates in trim; numbers that follow from Table 2 of AIAA 2010-34."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from casid.errors import InputError
from casid.model.aircraft import Aircraft
from casid.model.dynamics import aircraft_model, standard_density
from casid.model.simulate import simulate
from casid.model.trim import Trim, trim
from casid.records.record import Record
from problems.do328 import DESTABILISED, do328


def acceleration(aircraft: Aircraft, at: Trim) -> np.ndarray:
    """(states,) derivative of the state at a trim."""
    model = aircraft_model(aircraft)
    f = ca.Function("f", [model.x, model.u, model.p, model.w], [model.f])
    u = [at.inputs[name] for name in model.inputs]
    return f(at.state, u, model.nominal_vector(), np.zeros(len(model.disturbances))).full()[:, 0]


@pytest.mark.parametrize("climb", [0.0, 0.05, -0.03])
@pytest.mark.parametrize("derivatives", [None, DESTABILISED])
def test_nothing_accelerates(climb, derivatives):
    aircraft = replace(do328(derivatives), thrust_line_z=0.3)
    at = trim(aircraft, V=144.0, altitude=3000.0, climb_angle=climb)
    assert np.abs(acceleration(aircraft, at)).max() < 1e-9
    rate_of_climb = at.state[0] * np.sin(at.theta) - at.state[2] * np.cos(at.theta)
    assert rate_of_climb == pytest.approx(144.0 * np.sin(climb), abs=1e-9)
    assert at.rho == pytest.approx(standard_density(np.array(3000.0)))


def test_do328_cruise_as_the_paper_has_it():
    """144 m/s and 10 kN: qbar about 9.26 kPa, density 0.893, CL 0.28, alpha 0.55 deg, elevator 3.3 to 3.5 deg."""
    aircraft = do328()
    at = trim(aircraft, V=144.0, thrust=10e3)
    qbar = 0.5 * at.rho * 144.0**2
    assert at.rho == pytest.approx(0.893, abs=2e-3)
    assert qbar == pytest.approx(9.26e3, rel=2e-3)
    assert 3.3 < np.degrees(at.delta_e) < 3.5
    # lift carries what the thrust does not, drag is the thrust: read off the forces, independent of the solver
    d = aircraft.derivatives
    CL = d["CL_0"] + d["CL_alpha"] * at.alpha + d["CL_delta_e"] * at.delta_e
    CD = d["CD_0"] + d["CD_alpha"] * at.alpha
    weight = aircraft.mass * aircraft.gravity
    assert CL * qbar * aircraft.area + 10e3 * np.sin(at.alpha) == pytest.approx(weight, rel=1e-9)
    assert CD * qbar * aircraft.area == pytest.approx(10e3 * np.cos(at.alpha), rel=1e-9)
    assert abs(CL - 0.28) < 5e-3
    # the source's 0.55 deg is without the lift of the elevator
    assert np.degrees((CL - d["CL_0"]) / d["CL_alpha"]) == pytest.approx(0.55, abs=0.02)


def test_thrust_and_density_are_two_ways_to_one_trim():
    given_thrust = trim(do328(), V=144.0, thrust=10e3)
    given_density = trim(do328(), V=144.0, rho=given_thrust.rho)
    for name in ("alpha", "theta", "delta_e", "thrust"):
        assert getattr(given_density, name) == pytest.approx(getattr(given_thrust, name), rel=1e-9)


def test_a_trimmed_aircraft_stays_where_it_is():
    at = trim(do328(), V=144.0, thrust=10e3)
    t = np.arange(0.0, 30.0, 0.05)
    record = Record(name="trim", t=t, channels={n: np.full(len(t), v) for n, v in at.inputs.items()})
    flown = simulate(aircraft_model(do328()), record, at.state)
    np.testing.assert_allclose(flown.states, np.broadcast_to(at.state, flown.states.shape), atol=1e-9)


def test_what_cannot_be_trimmed_is_said():
    with pytest.raises(InputError, match="either a density"):
        trim(do328(), V=144.0)
    with pytest.raises(InputError, match="either a density"):
        trim(do328(), V=144.0, rho=0.9, thrust=10e3)
    without_elevator = do328({"CL_alpha": 6.0, "CD_0": 0.03, "Cm_0": 0.1})
    with pytest.raises(InputError, match="no steady flight"):
        trim(without_elevator, V=144.0, rho=0.9)
