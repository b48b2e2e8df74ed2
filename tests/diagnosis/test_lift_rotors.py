"""A VTOL, and a payload that is dropped. Truth: rotors and a wing by Newton and Euler in numpy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import casid as cs
from problems.rotors.newton import Craft, G, flight, quad

MASS, ARM, RHO = 3.0, 0.3, 1.225
INERTIA = np.diag([0.12, 0.14, 0.22])
HOVER = 0.25 * MASS * G
AREA, SPAN, CHORD = 0.4, 1.6, 0.25
CL, CD = (0.2, 4.5), (0.05, 0.6)  # at no angle of attack, and by it


def wing(air: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lift and drag of a wing without moments, at the velocity of the body through the air."""
    speed = np.linalg.norm(air)
    alpha = np.arctan2(air[2], air[0])
    pressure = 0.5 * RHO * speed**2 * AREA
    lift, drag = pressure * (CL[0] + CL[1] * alpha), pressure * (CD[0] + CD[1] * alpha)
    force = [lift * np.sin(alpha) - drag * np.cos(alpha), 0.0, -lift * np.cos(alpha) - drag * np.sin(alpha)]
    return np.array(force), np.zeros(3)


def craft(factor: np.ndarray, **more) -> Craft:
    places, spins = quad(ARM)
    return Craft(
        **{
            "places": places,
            "spins": spins,
            "mass": lambda t: MASS,
            "inertia": INERTIA,
            "thrust": lambda t, u: factor * 4.0 * HOVER * u**2,
            "input_for": lambda thrust: np.sqrt(np.clip(thrust / (4.0 * HOVER), 0.0, 1.0)),
            "torque": 0.02,
            "lag": 0.05,
        }
        | more
    )


def record(flown: dict[str, np.ndarray], **more: float) -> cs.Record:
    channels = {name: values for name, values in flown.items() if name != "t"}
    channels |= {name: np.full(len(flown["t"]), value) for name, value in more.items()}
    return cs.Record.from_arrays(name="flight", t=flown["t"], channels=channels, units=dict.fromkeys("pqr", "rad/s"))


def rotors() -> cs.Rotors:
    places, spins = quad(ARM)
    rows = enumerate(zip(places, spins, strict=True), start=1)
    return cs.Rotors(
        each=[
            cs.Rotor(
                name=f"m{i}",
                position=tuple(map(float, place)),
                spin=float(spin),
                thrust=(0.0, 0.0, 4.0 * HOVER),
                torque=0.02,
                lag=0.05,
                std=0.05,
            )
            for i, (place, spin) in rows
        ]
    )


J = cs.Inertia(Ixx=0.12, Iyy=0.14, Izz=0.22, Ixz=0.0)
VTOL = cs.Aircraft(
    name="vtol",
    mass=MASS,
    inertia=J,
    rotors=rotors(),
    area=AREA,
    moment_length_lateral=SPAN,
    moment_length_pitch=CHORD,
    rate_length_lateral=0.5 * SPAN,
    rate_length_pitch=0.5 * CHORD,
    force_axes="wind",
    derivatives={"CL_0": CL[0], "CL_alpha": CL[1], "CD_0": CD[0], "CD_alpha": CD[1]},
)


def test_surfaces_that_rest_while_rotors_move_are_no_fault():
    """Truth: a VTOL in hover, which its rotors control."""
    flown = flight(craft(np.ones(4), wing=wing), 6, size=1.0, speed=7.0)
    still = {"delta_e": 0.0, "delta_a": 0.0, "delta_r": 0.0, "thrust": 0.0, "rho": RHO}
    assert not cs.check([record(flown, **still)], VTOL).findings


@pytest.mark.slow
def test_a_weak_lift_rotor_of_a_vtol_is_named():
    factor = np.array([1.0, 1.0, 0.75, 1.0])
    flown = flight(craft(factor, wing=wing), 3, size=1.0, speed=7.0)
    still = {"delta_e": 0.0, "delta_a": 0.0, "delta_r": 0.0, "thrust": 0.0, "rho": RHO}
    found = cs.diagnose(VTOL, [record(flown, **still)])
    assert (found.causes[0].kind, found.causes[0].target) == ("rotor_effectiveness", "m3")
    assert found.causes[0].value == pytest.approx(-0.25, abs=0.04)
    assert len(found.causes) == 1


@pytest.mark.slow
def test_a_wrong_derivative_of_the_wing_of_a_vtol_is_told():
    """Truth: 4.5; the file has two thirds of it, and states no uncertainty."""
    flown = flight(craft(np.ones(4), wing=wing), 6, size=1.0, speed=7.0)
    wrong = replace(VTOL, derivatives={**VTOL.derivatives, "CL_alpha": 3.0})
    still = {"delta_e": 0.0, "delta_a": 0.0, "delta_r": 0.0, "thrust": 0.0, "rho": RHO}
    found = cs.diagnose(wrong, [record(flown, **still)])
    assert found.verdict == "values wrong" and not found.causes
    (told,) = (one for one in found.contradicted if one.parameter == "CL_alpha")
    assert told.flight == pytest.approx(CL[1], abs=3.0 * told.std)


@pytest.mark.slow
def test_a_payload_that_is_dropped_is_told_with_its_time():
    """The file has the mass at the start; a sixth of it is gone from 11 s on."""
    flown = flight(craft(np.ones(4), mass=lambda t: MASS if t < 11.0 else MASS - 0.5), 4, size=1.0)
    aircraft = cs.Aircraft(name="carrier", mass=MASS, inertia=J, rotors=rotors())
    found = cs.diagnose(aircraft, [record(flown)])
    dropped = found.causes[0]
    assert (dropped.kind, dropped.target) == ("mass_change", "")
    assert dropped.value == pytest.approx(-0.5 / MASS, abs=0.03)
    (interval,) = dropped.onset_s.values()
    assert interval[0] - 0.1 < 11.0 < interval[1] + 0.1


@pytest.mark.slow
def test_nothing_is_named_of_a_vtol_that_flies_as_its_file():
    flown = flight(craft(np.ones(4), wing=wing), 5, size=1.0, speed=7.0)
    still = {"delta_e": 0.0, "delta_a": 0.0, "delta_r": 0.0, "thrust": 0.0, "rho": RHO}
    found = cs.diagnose(replace(VTOL, name="as flown"), [record(flown, **still)])
    assert not found.causes
