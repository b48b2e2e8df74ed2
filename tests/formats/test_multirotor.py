"""Exports of multirotors. Truths: what RotorPy makes of its file, and the numbers of the aircraft read back."""

from __future__ import annotations

import json
import runpy
import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import pytest

import casid as cs
from casid.errors import InputError

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
