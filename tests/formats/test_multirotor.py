"""Exports of multirotors. Truths: what RotorPy makes of its file, and the numbers of the aircraft read back."""

from __future__ import annotations

import json
import runpy
import xml.etree.ElementTree as ET
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

import casid as cs
from casid.errors import InputError
from casid.formats.absorbed import absorbed
from casid.model.causes.loading import cg_offset

QUAD = cs.Aircraft(
    name="quad",
    mass=0.5,
    inertia=cs.Inertia(Ixx=3e-3, Iyy=4e-3, Izz=6e-3, Ixz=0.0),
    rotors=cs.Rotors(
        each=[
            cs.Rotor(
                name=f"m{i}",
                position=(0.1 * x, 0.12 * y, 0.0),
                spin=s,
                thrust=(0.0, 0.0, 5e-6),
                speed=True,
                torque=0.02,
                lag=0.04,
            )
            for i, (x, y, s) in enumerate([(1, 1, 1), (-1, 1, -1), (-1, -1, 1), (1, -1, -1)], start=1)
        ],
        drag=(0.02, 0.02, 0.01),
    ),
)


def test_rotorpy_makes_the_same_wrench_of_it(tmp_path):
    pytest.importorskip("rotorpy")
    from rotorpy.vehicles.multirotor import Multirotor

    path = tmp_path / "quad.py"
    cs.export(QUAD, path, to="rotorpy")
    parameters = runpy.run_path(str(path))["quad_params"]
    speeds = np.array([500.0, 520.0, 480.0, 510.0])
    craft = Multirotor(parameters, control_abstraction="cmd_motor_speeds", aero=False)
    force, moment = craft.compute_body_wrench(np.zeros(3), speeds, np.zeros(3))
    assert QUAD.rotors is not None
    thrusts = [one.static_thrust(u) for one, u in zip(QUAD.rotors.each, speeds, strict=True)]
    expected = np.zeros(3)
    for one, thrust in zip(QUAD.rotors.each, thrusts, strict=True):
        expected += np.cross(one.position, [0.0, 0.0, -thrust]) + [0.0, 0.0, one.spin * one.torque * thrust]
    assert -force[2] == pytest.approx(-sum(thrusts))
    np.testing.assert_allclose(np.diag([1.0, -1.0, -1.0]) @ moment, expected, rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("ahead", [0.0, 0.02])
def test_rotorpy_makes_the_same_forces_in_moving_air(tmp_path, ahead):
    """Drag and loss of thrust act at each hub by the speed of its rotor, of RotorPy's own blades and of casid's; also
    where all hubs lie behind the centre of gravity."""
    pytest.importorskip("rotorpy")
    from rotorpy.vehicles.multirotor import Multirotor

    assert QUAD.rotors is not None
    quad = replace(QUAD, rotors=replace(QUAD.rotors, inflow=0.03))
    cs.export(quad, tmp_path / "quad.py", to="rotorpy")
    parameters = runpy.run_path(str(tmp_path / "quad.py"))["quad_params"]
    speeds, flip = np.array([500.0, 560.0, 430.0, 510.0]), np.diag([1.0, -1.0, -1.0])
    velocity, omega = np.array([3.0, -2.0, 1.0]), np.array([0.8, -0.6, 1.1])
    parameters["rotor_pos"] = {name: np.array(at) - [ahead, 0.0, 0.0] for name, at in parameters["rotor_pos"].items()}
    craft = Multirotor(parameters, control_abstraction="cmd_motor_speeds", aero=True)
    force, moment = craft.compute_body_wrench(flip @ omega, speeds, flip @ velocity)
    model = cs.aircraft_model(quad, effects=[cg_offset("x")])
    f = ca.Function("f", [model.x, model.u, model.p, model.w], [model.f])
    state = [dict(zip("uvwpqr", [*velocity, *omega], strict=True)).get(name, 0.0) for name in model.states]
    values = model.nominal_vector({"cg_offset(x)": ahead})
    found = f(state, speeds, values, np.zeros(len(model.disturbances))).full()[:6, 0]
    J = np.diag([3e-3, 4e-3, 6e-3])
    linear = flip @ force / 0.5 + [0.0, 0.0, 9.80665] - np.cross(omega, velocity)
    angular = np.linalg.solve(J, flip @ moment - np.cross(omega, J @ omega))
    np.testing.assert_allclose(found, [*linear, *angular], rtol=1e-9)


def test_a_motor_model_has_the_numbers_of_each_rotor(tmp_path):
    path = tmp_path / "quad.sdf"
    cs.export(QUAD, path, to="gazebo")
    plugins = ET.parse(path).getroot().findall(".//plugin")
    assert [one.findtext("turningDirection") for one in plugins] == ["ccw", "cw", "ccw", "cw"]
    assert [float(one.findtext("motorConstant", "")) for one in plugins] == [5e-6] * 4
    assert {float(one.findtext("timeConstantUp", "")) for one in plugins} == {0.04}
    assert {float(one.findtext("momentConstant", "")) for one in plugins} == {0.02}


def test_a_frame_and_a_table_have_mass_geometry_and_motors(tmp_path):
    cs.export(QUAD, tmp_path / "frame.json", to="ardupilot-json")
    frame = json.loads((tmp_path / "frame.json").read_text())
    assert (frame["mass"], frame["num_motors"], frame["motor3_position"]) == (0.5, 4, [-0.1, -0.12, 0.0])
    assert frame["moment_inertia"] == [3e-3, 4e-3, 6e-3]
    cs.export(QUAD, tmp_path / "table.json", to="gym-json")
    table = json.loads((tmp_path / "table.json").read_text())
    assert (table["kf"], table["km"]) == (pytest.approx(5e-6), pytest.approx(1e-7))


def test_a_command_that_is_no_speed_has_no_motor_constant(tmp_path):
    assert QUAD.rotors is not None
    by_pwm = [replace(one, speed=False, thrust=(0.0, 1e-4)) for one in QUAD.rotors.each]
    other = replace(QUAD, rotors=replace(QUAD.rotors, each=by_pwm))
    with pytest.raises(InputError, match="motor constant"):
        cs.export(other, tmp_path / "quad.sdf", to="gazebo")


BY_COMMAND = replace(
    QUAD,
    mass=0.8,
    rotors=cs.Rotors(
        each=[
            replace(one, speed=False, thrust=(0.05, 1.0, 5.0), effectiveness=1.0 + 0.02 * i, lag=0.05)
            for i, one in enumerate(QUAD.rotors.each if QUAD.rotors else ())
        ],
    ),
)
HELD = [
    cs.EffectValue(kind="rotor_effectiveness", target="m2", value=-0.2),
    cs.EffectValue(kind="rotor_effectiveness", target="rotors", value=0.1),
    cs.EffectValue(kind="thrust_curve", target="rotors", term="slope", value=-0.4),
    cs.EffectValue(kind="thrust_curve", target="m3", term="curvature", value=0.3),
    cs.EffectValue(kind="rotor_torque", target="m1", value=0.3),
    cs.EffectValue(kind="rotor_position", target="m4", term="x", value=0.02),
    cs.EffectValue(kind="cg_offset", target="y", value=0.01),
    cs.EffectValue(kind="body_drag", target="z", value=0.2),
    cs.EffectValue(kind="rotor_inflow", value=0.04),
    cs.EffectValue(kind="mass", value=0.1),
    cs.EffectValue(kind="inertia", target="Iyy", value=1e-3),
]


@pytest.mark.parametrize("effect", HELD, ids=[f"{one.kind}-{one.target}" for one in HELD])
def test_an_effect_in_the_numbers_of_an_aircraft_flies_as_the_effect_itself(effect):
    """What an export writes is the aircraft that was diagnosed."""
    state = np.array([0.4, -0.2, 0.3, 0.5, -0.4, 0.3, 0.1, -0.2])
    inputs = np.array([0.5, 0.55, 0.48, 0.6])

    def rates(aircraft: cs.Aircraft) -> np.ndarray:
        model = cs.aircraft_model(aircraft)
        f = ca.Function("f", [model.x, model.u, model.p, model.w], [model.f])
        return f(state, inputs, model.nominal_vector(), np.zeros(len(model.disturbances))).full()[:, 0]

    plain = absorbed(BY_COMMAND.with_effects([effect]))
    assert not plain.left
    np.testing.assert_allclose(rates(plain.aircraft), rates(BY_COMMAND.with_effects([effect])), rtol=1e-12, atol=1e-12)
    assert np.abs(rates(plain.aircraft) - rates(BY_COMMAND)).max() > 1e-3


def test_the_lag_that_was_found_is_that_of_the_motor_model(tmp_path):
    slow = QUAD.with_effects([cs.EffectValue(kind="rotor_lag", target="rotors", value=0.03)])
    assert not any("lag" in line for line in cs.export(slow, tmp_path / "quad.sdf", to="gazebo"))
    plugins = ET.parse(tmp_path / "quad.sdf").getroot().findall(".//plugin")
    assert [float(one.findtext("timeConstantUp", "")) for one in plugins] == pytest.approx([0.07] * 4)


@pytest.mark.parametrize("expo", [0.0, 0.3, 0.65, 1.0])
def test_a_frame_has_the_exponent_and_the_throttle_of_hover_of_its_thrust_curve(tmp_path, expo):
    """Thrust over the largest is (1 - e) u + e u^2, as ArduPilot's MOT_THST_EXPO and PX4's THR_MDL_FAC have it."""
    assert QUAD.rotors is not None
    largest, share = 4.0, 0.5 * 9.80665 / 4.0
    curve = (0.0, (1.0 - expo) * largest, expo * largest)
    each = [replace(one, speed=False, thrust=curve, position=(*one.position[:2], 0.0)) for one in QUAD.rotors.each]
    quad = replace(QUAD, rotors=replace(QUAD.rotors, each=each))
    cs.export(quad, tmp_path / "frame.json", to="ardupilot-json")
    frame = json.loads((tmp_path / "frame.json").read_text())
    assert frame["propExpo"] == pytest.approx(expo, abs=1e-9)
    u = frame["hoverThrOut"]
    assert (1.0 - expo) * u + expo * u * u == pytest.approx(share / largest)
