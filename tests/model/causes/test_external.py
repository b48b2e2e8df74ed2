"""Pose and motion over ground of one instrument: one clock, one frame. Truth: rotations of SciPy, and a quad."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import casid as cs
from casid.model.causes.instruments import SENSOR_GROUPS
from casid.model.effects import catalogue
from casid.model.in_force import History, InForce
from problems.do328 import do328
from problems.rotors.newton import G, quad

POSE = SENSOR_GROUPS["external"]
WITHOUT_ATTITUDE = SENSOR_GROUPS["ground"]


def hovering() -> cs.Aircraft:
    places, spins = quad(0.1)
    rotors = [
        cs.Rotor(name=f"m{i}", position=tuple(map(float, at)), spin=float(spin), thrust=(0.0, 2.0 * G), torque=0.02)
        for i, (at, spin) in enumerate(zip(places, spins, strict=True), start=1)
    ]
    inertia = cs.Inertia(Ixx=0.02, Iyy=0.02, Izz=0.04, Ixz=0.0)
    return cs.Aircraft(name="quad", mass=4.0, inertia=inertia, rotors=cs.Rotors(each=rotors))


def of_group(outputs: tuple[str, ...], aircraft: cs.Aircraft | None = None) -> set[str]:
    found = catalogue(aircraft or hovering(), outputs)
    return {one.name for one in found if one.target in ("external", "ground", "attitude")}


def test_the_group_is_offered_where_a_motion_over_ground_is_measured() -> None:
    inertial = ("p", "q", "r", "ax", "ay", "az")
    with_attitude = of_group((*inertial, *POSE))
    for kind in ("sensor_delay", "sensor_lag", "clock_drift"):
        assert {f"{kind}({name})" for name in ("external", "ground", "attitude")} <= with_attitude
    assert {"sensor_misalignment(external:x)", "sensor_misalignment(ground:y)"} <= with_attitude
    alone = of_group((*inertial, "north", "east", "altitude"))  # both groups are the same then
    assert "sensor_delay(external)" in alone and "sensor_delay(ground)" not in alone
    barometer = of_group((*inertial, "phi", "theta", "altitude"))
    assert barometer == {"sensor_delay(attitude)", "sensor_lag(attitude)", "clock_drift(attitude)"}


def test_an_aeroplane_without_motion_over_ground_has_no_such_cause() -> None:
    outputs = cs.aircraft_model(do328()).outputs
    assert not {one for one in of_group((*outputs, "altitude", "psi"), do328()) if "attitude" not in one}


def test_a_group_of_which_one_channel_is_measured_has_the_name_of_that() -> None:
    found = {one.name for one in catalogue(hovering(), ("p", "phi", "az"))}
    assert "sensor_delay(phi)" in found and "sensor_delay(attitude)" not in found
    rates = {one.name for one in catalogue(do328(), ("q", "qdot", "alpha"))}
    assert "sensor_delay(q)" in rates and not {"sensor_delay(inertial)", "sensor_delay(air_data)"} & rates
    axes = {one.name for one in catalogue(do328(), ("q", "ax", "az", "alpha"))}
    assert {"accelerometer_position(x)", "accelerometer_position(z)", "sensor_delay(inertial)"} <= axes


def test_all_its_channels_have_one_delay_and_one_clock() -> None:
    t = 0.02 * np.arange(200)
    record = cs.Record(name="m1", t=t, channels={name: np.sin(t + i) for i, name in enumerate(POSE)})
    for kind, late in (("sensor_delay", 0.05 + 0.0 * t), ("clock_drift", 0.05 / 1.05 * t)):
        value = cs.EffectValue(kind=kind, target="external", value=0.05)
        model = cs.aircraft_model(hovering().with_effects([value]), outputs=POSE)
        (one,) = model.effects
        series, _ = History(of=InForce(effect=one.effect, name=one.name, value=value), stations=()).at(
            record, one.parameters
        )
        assert {f"time of {name}" for name in POSE} == set(series)
        for found in series.values():
            np.testing.assert_allclose(found, -late, atol=1e-12)
        assert value.sentence == "" and value.unit in ("s", "s/s")


MOTION = {"u": 2.0, "v": -1.0, "w": 0.5, "p": 0.0, "q": 0.0, "r": 0.0, "phi": 0.4, "theta": -0.3, "psi": 3.0}
MOTION |= {"north": 5.0, "east": -3.0, "altitude": 2.0}


def read(entries: list[cs.EffectValue]) -> dict[str, float]:
    model = cs.aircraft_model(hovering().with_effects(entries), outputs=POSE)
    h = ca.Function("h", [model.x, model.u, model.p, model.w], [model.h])
    still = np.zeros(len(model.disturbances))
    found = h([MOTION[name] for name in model.states], np.full(4, 0.5), model.nominal_vector(), still)
    return dict(zip(model.outputs, found.full()[:, 0].tolist(), strict=True))


@pytest.mark.parametrize("axis", ["x", "y", "z"])
@pytest.mark.parametrize("size", [0.1, -0.3])
@pytest.mark.parametrize("target", ["external", "ground"])
def test_a_frame_that_is_turned_turns_position_velocity_and_attitude(target: str, size: float, axis: str) -> None:
    """North, east and down of the frame are turned about one of them; a heading of 3 rad goes on beyond pi."""
    plain = read([])
    turned = read([cs.EffectValue(kind="sensor_misalignment", target=target, term=axis, value=size)])
    back = Rotation.from_rotvec(size * np.eye(3)["xyz".index(axis)]).inv()
    for names, up in ((("north", "east", "altitude"), -1.0), (("v_north", "v_east", "v_down"), 1.0)):
        before, after = (np.array([one[name] for name in names]) * [1.0, 1.0, up] for one in (plain, turned))
        np.testing.assert_allclose(after, back.apply(before), atol=1e-12)
    own, seen = (Rotation.from_euler("ZYX", [one[a] for a in ("psi", "theta", "phi")]) for one in (plain, turned))
    expected = back * own if target == "external" else own
    np.testing.assert_allclose(seen.as_matrix(), expected.as_matrix(), atol=1e-12)
    assert abs(turned["psi"] - plain["psi"]) < 0.5
