"""Truth: the rigid body, whose moments of inertia obey the triangle inequality, and the size of the aircraft."""

from __future__ import annotations

import pytest

import casid as cs
from casid.diagnosis.criteria import SizeCriteria
from casid.diagnosis.flight.bounds import inertia_bounds, possible
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.gates import is_possible
from casid.model.causes.instruments import accelerometer_position, vane_position
from casid.model.causes.loading import cg_offset, inertia, mass
from casid.model.causes.rotors import rotor_position
from problems.do328 import do328

BY = SizeCriteria()


@pytest.mark.parametrize("component", ["Ixx", "Iyy", "Izz"])
def test_an_inertia_stays_that_of_a_rigid_body(component: str) -> None:
    aircraft = do328()
    low, high = inertia_bounds(component, aircraft, BY)
    assert low < 0.0 < high
    for change in (low, high):
        I = {c: getattr(aircraft.inertia, c) + change * (c == component) for c in ("Ixx", "Iyy", "Izz")}  # noqa: E741
        assert 2.0 * max(I.values()) <= sum(I.values()) * (1.0 + 1e-12)
        assert 0.5 <= I[component] / getattr(aircraft.inertia, component) <= 1.5


def test_what_no_aircraft_has_is_not_is_possible() -> None:
    aircraft = do328()
    span = 2.0 * aircraft.rate_length_lateral
    cases = (
        (mass(), 0.49 * aircraft.mass, 0.51 * aircraft.mass),
        (mass(), -0.49 * aircraft.mass, -0.51 * aircraft.mass),
        (cg_offset("z"), 0.25 * aircraft.moment_length_pitch, -0.7 * aircraft.moment_length_pitch),
        (vane_position("beta"), 0.6 * span, 2.0 * span),
        (accelerometer_position("x"), 0.5 * span, 2.0 * span),
        (inertia("Izz"), 0.05 * aircraft.inertia.Izz, aircraft.inertia.Ixx + aircraft.inertia.Iyy),
        (inertia("Iyy"), -0.1 * aircraft.inertia.Iyy, -0.6 * aircraft.inertia.Iyy),
    )
    for effect, believed, refused in cases:
        bounded = possible(effect, aircraft, BY)
        assert is_possible(Attached(effect=bounded, values={"value": believed})), effect.name
        assert not is_possible(Attached(effect=bounded, values={"value": refused})), effect.name


def test_a_multirotor_hovers_about_what_lies_between_its_rotors() -> None:
    """Decks make Ixx of a Crazyflie 2.6e-5 of 1.657e-5 kg m2; the sum of the other two is the rigid body's limit."""
    each = [
        cs.Rotor(name=f"m{i}", position=(0.0325 * x, 0.0325 * y, 0.0), spin=x * y, thrust=(0.0, 1e-5))
        for i, (x, y) in enumerate([(1, 1), (-1, 1), (-1, -1), (1, -1)], start=1)
    ]
    J = cs.Inertia(Ixx=1.657e-5, Iyy=1.666e-5, Izz=2.926e-5, Ixz=0.0)
    quad, arm = cs.Aircraft(name="quad", mass=0.032, inertia=J, rotors=cs.Rotors(each=each)), 0.046
    for effect, believed, refused in (
        (rotor_position("m2", "x"), 0.9 * arm, -1.1 * arm),
        (cg_offset("y"), -0.9 * arm, 1.1 * arm),
        (inertia("Ixx"), 0.943e-5, J.Iyy + J.Izz - 0.9 * J.Ixx),
    ):
        bounded = possible(effect, quad, BY)
        assert is_possible(Attached(effect=bounded, values={"value": believed})), effect.name
        assert not is_possible(Attached(effect=bounded, values={"value": refused})), effect.name
