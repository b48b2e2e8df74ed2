"""The shape of the thrust curve. Truth: a quadrotor by Newton and Euler in numpy, whose thrust is no square."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import casid as cs
from casid.formats.absorbed import absorbed
from problems.rotors.newton import Craft, G, flight, quad

MASS, ARM = 0.8, 0.106
INERTIA = np.diag([4.5e-3, 4.5e-3, 8.3e-3])
HOVER = 0.25 * MASS * G  # N of a rotor


def linear(t: float, u: np.ndarray) -> np.ndarray:
    """Thrust [N] of a motor whose electronics make it linear in the command; half of it hovers."""
    return HOVER * (0.1 + 1.8 * u)


def file(thrust: list[float]) -> cs.Aircraft:
    places, spins = quad(ARM)
    rotors = [
        cs.Rotor(
            name=f"m{i}",
            position=tuple(map(float, place)),
            spin=float(spin),
            thrust=tuple(thrust),
            torque=0.02,
            lag=0.05,
            std=0.2,
        )
        for i, (place, spin) in enumerate(zip(places, spins, strict=True), start=1)
    ]
    J = INERTIA.diagonal()
    inertia = cs.Inertia(Ixx=J[0], Iyy=J[1], Izz=J[2], Ixz=0.0)
    return cs.Aircraft(name="quad", mass=MASS, inertia=inertia, rotors=cs.Rotors(each=rotors))


@cache
def flown() -> cs.Record:
    places, spins = quad(ARM)
    craft = Craft(
        places=places,
        spins=spins,
        mass=lambda t: MASS,
        inertia=INERTIA,
        thrust=linear,
        input_for=lambda thrust: np.clip((thrust / HOVER - 0.1) / 1.8, 0.0, 1.0),
        torque=0.02,
        lag=0.05,
    )
    channels = flight(craft, 5)
    t = channels.pop("t")
    return cs.Record.from_arrays(name="hover", t=t, channels=channels, units=dict.fromkeys("pqr", "rad/s"))


@pytest.mark.slow
def test_a_thrust_that_is_linear_is_told_of_a_file_with_squares():
    found = cs.diagnose(file([0.0, 0.0, 4.0 * HOVER]), [flown()])
    named = {(one.kind, one.target, one.term): one for one in found.causes}
    slope = named["thrust_curve", "rotors", "slope"]
    # 1.8 HOVER for 4 HOVER, by the command of hover
    assert slope.value == pytest.approx(1.8 / 4.0 - 1.0, abs=0.06)
    assert "hover needs u = 0.5" in slope.sentence
    assert not [one for one in found.causes if one.kind != "thrust_curve"]
    rotors, u = absorbed(found.extended_aircraft).aircraft.rotors, np.linspace(0.47, 0.68, 9)
    assert rotors is not None
    for one in rotors.each:  # but for a bias of az of 0.3 m/s2, as large as such instruments have
        np.testing.assert_allclose(one.curve(u), linear(0.0, u), rtol=0.05)


@pytest.mark.slow
def test_nothing_is_told_of_a_file_with_the_curve_of_the_flight():
    found = cs.diagnose(file([0.1 * HOVER, 1.8 * HOVER]), [flown()])
    assert found.verdict == "adequate" and not found.causes
