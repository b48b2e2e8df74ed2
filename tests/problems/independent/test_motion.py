"""The independent equations of motion. Truths: conservation laws of free flight, geometry of rotations, momentum."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from problems.independent.atmosphere import G0, air_at
from problems.independent.motion import (
    ATTITUDE,
    POSITION,
    ROTATION,
    SLOSH,
    STATES,
    STEP_S,
    SURFACES,
    VELOCITY,
    Craft,
    Inputs,
    Loading,
    Slosh,
    acceleration,
    angles_of,
    integrate,
    quaternion_of,
    rotation_matrix,
)
from problems.independent.planes import JET, LIGHT, Plane
from problems.independent.trim import accelerations_at, level_flight

STEPS = 400


def still(steps: int, records: int = 1, **surfaces: float) -> Inputs:
    halves = 2 * steps + 1
    flat = np.zeros((halves, records))
    calm = np.zeros((halves, 3, records))
    surface = {name: flat + surfaces.get(name, 0.0) for name in SURFACES}
    return Inputs(surface=surface, throttle=flat, loss=flat + 1.0, wind=calm, spin=calm)


def craft_of(plane: Plane, records: int = 1) -> Craft:
    return Craft(plane=plane, loading=Loading(mass=np.full(records, plane.mass), cg=np.zeros((3, records))))


def tumbling() -> np.ndarray:
    x = np.zeros((STATES, 1))
    x[2] = -3000.0
    x[VELOCITY, 0] = (50.0, 3.0, -4.0)
    x[ATTITUDE] = quaternion_of(np.array([0.3]), np.array([-0.4]), np.array([1.1]))
    x[ROTATION, 0] = (0.9, -0.7, 0.5)
    return x


def test_without_air_energy_and_angular_momentum_are_conserved_and_the_path_is_a_parabola() -> None:
    """A tumbling body without aerodynamics: the momenta seen from the earth are those of the beginning."""
    vacuum = replace(JET, tables={name: () for name in JET.tables})
    log = integrate(craft_of(vacuum), still(STEPS), tumbling(), STEPS)
    x, t = log["x"][:, :, 0], STEP_S * np.arange(STEPS + 1)
    J = JET.tensor
    energy = 0.5 * np.einsum("ki,ij,kj->k", x[:, ROTATION], J, x[:, ROTATION])
    assert np.ptp(energy) < 1e-9 * energy[0]
    R = np.moveaxis(rotation_matrix(x[:, ATTITUDE].T), -1, 0)  # earth to body
    momentum = np.einsum("kji,kj->ki", R, x[:, ROTATION] @ J)
    assert np.abs(momentum - momentum[0]).max() < 1e-8 * np.abs(momentum[0]).max()
    assert np.abs(x[-1, ROTATION] - x[0, ROTATION]).max() > 0.05  # it did tumble
    v = R[0].T @ x[0, VELOCITY]
    fallen = x[0, POSITION] + np.outer(t, v) + 0.5 * np.outer(t**2, (0.0, 0.0, G0))
    assert np.abs(x[:, POSITION] - fallen).max() < 1e-6
    assert np.abs(log["force"]).max() == 0.0  # an accelerometer in free fall reads nothing


def test_drag_alone_takes_the_energy_that_it_should() -> None:
    """Rate of the total energy is force times velocity: the work of the air, by the readings of the accelerometer."""
    log = integrate(
        craft_of(LIGHT), still(STEPS), tumbling() * np.where(np.arange(STATES) < 10, 1.0, 0.1)[:, None], STEPS
    )
    x = log["x"][:, :, 0]
    energy = 0.5 * np.sum(x[:, VELOCITY] ** 2, axis=1) - G0 * x[:, 2]
    power = np.sum(log["force"][:, :, 0] * x[:, VELOCITY], axis=1)
    work = STEP_S * np.concatenate([[0.0], np.cumsum(0.5 * (power[1:] + power[:-1]))])
    assert np.abs(energy - energy[0] - work).max() < 2e-3 * np.ptp(work)


def test_a_rotation_matrix_is_that_of_the_angles() -> None:
    phi, theta, psi = np.array([0.3, -1.0]), np.array([-0.4, 0.7]), np.array([1.1, -2.5])
    R = rotation_matrix(quaternion_of(phi, theta, psi))
    assert np.allclose(R[0, 2], -np.sin(theta))
    assert np.allclose(R[1, 2], np.sin(phi) * np.cos(theta))
    assert np.allclose(np.einsum("ijn,kjn->ikn", R, R), np.eye(3)[:, :, None])
    assert np.allclose(np.array(angles_of(quaternion_of(phi, theta, psi))), np.array([phi, theta, psi]))


@pytest.mark.parametrize("plane", [LIGHT, JET], ids=lambda plane: plane.name)
def test_in_trim_nothing_accelerates(plane: Plane) -> None:
    """Also with a shifted centre of gravity and another mass."""
    loading = Loading(
        mass=plane.mass * np.array([1.0, 1.1, 0.9]), cg=0.08 * plane.chord * np.eye(3)[0][:, None] * [0, 1, -1]
    )
    craft = Craft(plane=plane, loading=loading)
    level = level_flight(craft)
    slope = accelerations_at(craft, np.array([level.alpha, level.elevator, level.throttle]))
    assert np.abs(slope[3:]).max() < 1e-10  # all but the position
    assert np.abs(slope[2]).max() < 1e-10  # level
    assert np.all((level.throttle > 0.1) & (level.throttle < 0.9))
    assert np.all(np.abs(level.elevator) < 0.1)


def test_a_heavier_aircraft_has_the_incidence_of_its_weight() -> None:
    """Lift is weight, but for the thrust: CL qbar S cos + ... by hand."""
    craft = craft_of(LIGHT)
    level = level_flight(craft)
    rho, _ = air_at(np.array([LIGHT.altitude]))
    inputs = replace(still(0, delta_e=float(level.elevator[0])), throttle=level.throttle[None])
    _, seen = acceleration(craft, inputs, 0, level.state)
    qS = 0.5 * rho * LIGHT.V**2 * LIGHT.area
    now = {name: np.zeros(1) for name in ("beta", "p", "q", "r", "delta_a", "delta_r")}
    now |= {"alpha": level.alpha, "delta_e": level.elevator, "mach": np.array([0.16])}
    CL = LIGHT.coefficients(now)["CL"]
    weight = LIGHT.mass * G0
    assert np.allclose(qS * CL + seen["thrust"] * np.sin(level.alpha), weight, rtol=1e-9)


def test_a_sloshing_mass_conserves_momentum() -> None:
    """Free of the air, the common centre of mass of aircraft and sloshing mass moves uniformly sideways."""
    vacuum = replace(JET, tables={name: () for name in JET.tables})
    mass = 500.0
    craft = replace(craft_of(vacuum), slosh=Slosh(mass=mass, frequency=4.0, damping=0.0, place=(0.0, 0.0, 0.0)))
    x = np.zeros((STATES, 1))
    x[ATTITUDE.start], x[VELOCITY.start], x[2] = 1.0, 100.0, -3000.0
    x[SLOSH.start] = 0.3
    log = integrate(craft, still(STEPS), x, STEPS)["x"][:, :, 0]
    centre = JET.mass * log[:, 1] + mass * log[:, SLOSH.start]
    assert np.abs(centre - centre[0]).max() < 1e-7 * abs(centre[0])
    assert np.ptp(log[:, 1]) > 0.01
    # two masses on a spring: the frequency is that of the reduced mass
    w = 4.0 * np.sqrt(JET.mass / (JET.mass - mass))
    assert np.allclose(log[:, SLOSH.start], 0.3 * np.cos(w * STEP_S * np.arange(STEPS + 1)), atol=1e-5)


def test_the_standard_atmosphere() -> None:
    """ISO 2533, table 5: density and speed of sound at sea level, 1500 m and 7000 m."""
    rho, sound = air_at(np.array([0.0, 1500.0, 7000.0]))
    assert np.allclose(rho, (1.225, 1.0581, 0.59), rtol=2e-3)
    assert np.allclose(sound, (340.294, 334.5, 312.3), rtol=1e-3)
