"""Rotors on the signal path. Truths: the laws of Newton and Euler in numpy, symmetry, equilibrium, limits."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import casid as cs
from casid.errors import InputError
from casid.model import operators
from casid.model.causes.controls import effectiveness_change
from casid.model.causes.loading import cg_offset
from casid.model.causes.rotors import (
    added_mass,
    body_drag,
    mass_change,
    rotor_effectiveness,
    rotor_inflow,
    rotor_lag,
    rotor_limit,
    rotor_position,
    rotor_swap,
    rotor_tilt,
    rotor_torque,
)
from casid.model.rotors import acting_inputs

ARM, TORQUE, MASS = 0.12, 0.016, 0.9
WHERE = {"m1": (1, 1, 1), "m2": (-1, 1, -1), "m3": (-1, -1, 1), "m4": (1, -1, -1)}
PLACES = {name: np.array([ARM * x, ARM * y, -0.01]) for name, (x, y, _) in WHERE.items()}
SPIN = {name: spin for name, (_, _, spin) in WHERE.items()}
COEFFICIENT = 3e-6
INERTIA = np.diag([8e-3, 9e-3, 15e-3])
ROTORS = cs.Rotors(
    each=[
        cs.Rotor(
            name=name,
            position=tuple(PLACES[name]),
            spin=SPIN[name],
            thrust=(0.0, 0.0, COEFFICIENT),
            torque=TORQUE,
            speed=True,
            inertia=2e-5,
        )
        for name in WHERE
    ],
    drag=(0.1, 0.2, 0.3),
)
QUAD = cs.Aircraft(name="quad", mass=MASS, inertia=cs.Inertia(Ixx=8e-3, Iyy=9e-3, Izz=15e-3, Ixz=0.0), rotors=ROTORS)
EVERY = (
    "p",
    "q",
    "r",
    "phi",
    "theta",
    "psi",
    "ax",
    "ay",
    "az",
    "v_north",
    "v_east",
    "v_down",
    "north",
    "east",
    "altitude",
)


def rates(aircraft: cs.Aircraft, state: np.ndarray, speeds: np.ndarray, effects=(), values=None) -> dict[str, float]:
    """State -> its derivative, output -> its value, by the model."""
    model = cs.aircraft_model(aircraft, outputs=EVERY, effects=effects)
    f = ca.Function("f", [model.x, model.u, model.p, model.w], [model.f, model.h])
    p = model.nominal_vector({one.name: value for one, value in zip(effects, values or (), strict=True)})
    found, read = f(state, speeds, p, np.zeros(len(model.disturbances)))
    names = [*(f"{s}dot" for s in model.states), *model.outputs]
    return dict(zip(names, [*found.full()[:, 0], *read.full()[:, 0]], strict=True))


def by_hand(state: np.ndarray, speeds: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(force per mass and gravity in body axes, angular acceleration) of the quad by the laws of motion."""
    velocity, omega, (phi, theta, psi) = state[:3], state[3:6], state[6:9]
    force, moment, hover = np.zeros(3), np.zeros(3), np.sqrt(MASS * 9.80665 / (4.0 * COEFFICIENT))
    for name, speed in zip(WHERE, speeds, strict=True):
        at_hub = velocity + np.cross(omega, PLACES[name])
        drag = -np.array([0.1, 0.2, 0.3]) / 4.0 * speed / hover * at_hub
        force, moment = force + drag, moment + np.cross(PLACES[name], drag)
        thrust = np.array([0.0, 0.0, -COEFFICIENT * speed**2])
        spinning = np.array([0.0, 0.0, -SPIN[name] * 2e-5 * speed])  # against its reaction torque
        force += thrust
        moment += np.cross(PLACES[name], thrust) + [0.0, 0.0, SPIN[name] * TORQUE * COEFFICIENT * speed**2]
        moment -= np.cross(omega, spinning)
    down = Rotation.from_euler("ZYX", [psi, theta, phi]).inv().apply([0.0, 0.0, 9.80665])
    linear = force / MASS + down - np.cross(omega, velocity)
    return linear, np.linalg.solve(INERTIA, moment - np.cross(omega, INERTIA @ omega))


MOVED = np.array([2.0, -1.0, 0.7, 0.8, -0.5, 1.1, 0.2, -0.3, 0.6, 1.0, 2.0, 3.0])
SPEEDS = np.array([850.0, 870.0, 820.0, 900.0])


def test_force_and_moment_are_those_of_newton_and_euler():
    found = rates(QUAD, MOVED, SPEEDS)
    linear, angular = by_hand(MOVED, SPEEDS)
    np.testing.assert_allclose([found[f"{s}dot"] for s in "uvw"], linear, rtol=1e-12)
    np.testing.assert_allclose([found[f"{s}dot"] for s in "pqr"], angular, rtol=1e-12)


def test_velocity_over_ground_is_the_velocity_turned_by_the_attitude():
    found = rates(QUAD, MOVED, SPEEDS)
    over_ground = Rotation.from_euler("ZYX", MOVED[[8, 7, 6]]).apply(MOVED[:3])
    np.testing.assert_allclose([found["v_north"], found["v_east"], found["v_down"]], over_ground, rtol=1e-12)
    assert found["northdot"] == pytest.approx(found["v_north"], rel=1e-12)
    assert found["eastdot"] == pytest.approx(found["v_east"], rel=1e-12)


def test_nothing_depends_on_where_it_is_and_where_it_heads():
    elsewhere = MOVED.copy()
    elsewhere[8:] += [1.7, 50.0, -40.0, 30.0]
    before, after = rates(QUAD, MOVED, SPEEDS), rates(QUAD, elsewhere, SPEEDS)
    for name in ("udot", "vdot", "wdot", "pdot", "qdot", "rdot", "phidot", "thetadot", "ax", "ay", "az"):
        assert after[name] == pytest.approx(before[name], rel=1e-12)


def test_a_quad_that_is_turned_by_a_quarter_is_the_same_quad():
    """Moved to the arm on its right each rotor makes the moments of its neighbour, turned likewise; yaw changes sign
    with the spin."""
    round_quad = replace(
        QUAD,
        inertia=cs.Inertia(Ixx=8e-3, Iyy=8e-3, Izz=15e-3, Ixz=0.0),
        rotors=replace(ROTORS, drag=(0.0, 0.0, 0.0), each=[replace(one, inertia=0.0) for one in ROTORS.each]),
    )
    still = np.zeros(12)
    one = rates(round_quad, still, np.array([900.0, 850.0, 850.0, 850.0]))
    next_one = rates(round_quad, still, np.array([850.0, 900.0, 850.0, 850.0]))
    assert (next_one["pdot"], next_one["qdot"]) == pytest.approx((-one["qdot"], one["pdot"]), rel=1e-9)
    assert next_one["rdot"] == pytest.approx(-one["rdot"], rel=1e-9)


def test_hover_is_a_trim():
    level = cs.trim(QUAD, V=0.0)
    speed = np.sqrt(MASS * 9.80665 / (4.0 * COEFFICIENT))
    assert list(level.rotors.values()) == pytest.approx([speed] * 4, rel=1e-9)
    found = rates(QUAD, np.r_[level.state, np.zeros(4)], np.array(list(level.rotors.values())))
    assert max(abs(found[f"{s}dot"]) for s in ("u", "v", "w", "p", "q", "r")) < 1e-9
    assert found["az"] == pytest.approx(-9.80665)


def test_forward_flight_is_a_trim_that_leans_against_the_drag():
    fast = cs.trim(QUAD, V=6.0)
    assert fast.theta < -0.05
    found = rates(QUAD, np.r_[fast.state, np.zeros(4)], np.array(list(fast.rotors.values())))
    assert max(abs(found[f"{s}dot"]) for s in ("u", "v", "w", "p", "q", "r")) < 1e-8
    assert found["v_north"] == pytest.approx(6.0) and found["v_down"] == pytest.approx(0.0, abs=1e-12)


def test_an_overweight_has_no_trim():
    heavy = replace(QUAD, rotors=replace(ROTORS, each=[replace(one, thrust=(0.0, 1e-3, -1e-6)) for one in ROTORS.each]))
    with pytest.raises(InputError, match="no input gives a thrust"):
        cs.trim(heavy, V=0.0)


@pytest.mark.parametrize(
    ("effect", "value", "same"),
    [
        (rotor_effectiveness("m3"), -0.2, {"m3": {"thrust": (0.0, 0.0, 0.8 * COEFFICIENT)}}),
        (rotor_effectiveness("rotors"), 0.1, {n: {"thrust": (0.0, 0.0, 1.1 * COEFFICIENT)} for n in WHERE}),
        (rotor_torque("m2"), -2.0, {"m2": {"torque": -TORQUE}}),
        (rotor_position("m1", "x"), 0.03, {"m1": {"position": (ARM + 0.03, ARM, -0.01)}}),
        (rotor_tilt("m1", "x"), 0.2, {"m1": {"axis": (0.0, np.sin(0.2), -np.cos(0.2))}}),
        (rotor_tilt("m2", "y"), 0.2, {"m2": {"axis": (-np.sin(0.2), 0.0, -np.cos(0.2))}}),
        (rotor_limit("m4"), 1.5, {"m4": {"thrust": (0.0, 0.0, 1.5 / 900.0**2)}}),
        (rotor_limit("m4"), 9.0, {}),
    ],
)
def test_a_cause_is_the_file_with_another_number(effect, value, same):
    """But for drag: a weak rotor is as fast as before at the same input, and one of a weaker file is not."""
    bare = replace(ROTORS, drag=(0.0, 0.0, 0.0))
    other = replace(bare, each=[replace(one, **same.get(one.name, {})) for one in ROTORS.each])
    with_it = rates(replace(QUAD, rotors=bare), MOVED, SPEEDS, [effect], [value])
    without = rates(replace(QUAD, rotors=other), MOVED, SPEEDS)
    for name, found in with_it.items():
        assert found == pytest.approx(without[name], rel=1e-10, abs=1e-12)


def test_drag_and_inflow_are_the_numbers_of_the_file():
    bare = replace(QUAD, rotors=replace(ROTORS, drag=(0.0, 0.2, 0.3)))
    assert rates(bare, MOVED, SPEEDS, [body_drag("x")], [0.1]) == pytest.approx(rates(QUAD, MOVED, SPEEDS), rel=1e-10)
    other = replace(QUAD, rotors=replace(ROTORS, inflow=0.05))
    with_it, without = rates(QUAD, MOVED, SPEEDS, [rotor_inflow()], [0.05]), rates(other, MOVED, SPEEDS)
    assert with_it == pytest.approx(without, rel=1e-10)
    climb = np.zeros(12)
    climb[2] = -2.0  # 2 m/s up, along the thrust
    loss = rates(replace(other, rotors=replace(other.rotors, drag=(0, 0, 0))), climb, SPEEDS)["az"]
    hover = np.sqrt(MASS * 9.80665 / (4.0 * COEFFICIENT))
    lost = 0.05 * 2.0 * COEFFICIENT * hover * float(SPEEDS.sum())
    assert loss == pytest.approx(-(COEFFICIENT * float(SPEEDS @ SPEEDS) - lost) / MASS, rel=1e-9)


@pytest.mark.parametrize("axis", "xyz")
def test_a_disturbance_of_an_equation_of_force_is_in_no_other_wherever_the_centre_of_gravity_is(axis):
    """So that a cause does not change the noise under which it is compared."""
    effect = cg_offset(axis)
    model = cs.aircraft_model(QUAD, outputs=EVERY, effects=[effect])
    f = ca.Function("f", [model.x, model.u, model.p, model.w], [ca.jacobian(model.f, model.w)])
    p = model.nominal_vector({effect.name: 0.04})
    slopes = f(MOVED, SPEEDS, p, np.zeros(len(model.disturbances))).full()
    rows = [model.states.index(name) for name in "uvwpqr"]
    columns = [model.disturbances.index(f"f_{name}") for name in "uvwpqr"]
    np.testing.assert_allclose(slopes[np.ix_(rows, columns)], np.eye(6), atol=1e-12)


def test_a_mass_at_a_hub_is_a_point_of_the_body():
    """Momentum: force over whole mass at the new centre of gravity, and the parallel axis theorem for the moments."""
    point, still = 0.1, np.zeros(12)
    bare = replace(QUAD, rotors=replace(ROTORS, drag=(0.0, 0.0, 0.0)))
    found = rates(bare, still, SPEEDS, [added_mass("m3")], [point])
    assert found["wdot"] == pytest.approx(9.80665 - COEFFICIENT * float(SPEEDS @ SPEEDS) / (MASS + point), rel=1e-9)
    centre = point / (MASS + point) * PLACES["m3"]
    thrusts = COEFFICIENT * SPEEDS**2
    moment = sum(np.cross(PLACES[n] - centre, [0.0, 0.0, -T]) for n, T in zip(WHERE, thrusts, strict=True))
    moment[2] += sum(SPIN[n] * TORQUE * T for n, T in zip(WHERE, thrusts, strict=True))
    at = PLACES["m3"]
    inertia = INERTIA + MASS * point / (MASS + point) * (at @ at * np.eye(3) - np.outer(at, at))
    np.testing.assert_allclose([found[f"{s}dot"] for s in "pqr"], np.linalg.solve(inertia, moment), rtol=1e-9)


def test_battery_voltage_scales_all_thrust():
    sagging = replace(QUAD, rotors=replace(ROTORS, voltage=cs.Voltage(exponent=1.5, reference=12.0)))
    model = cs.aircraft_model(sagging, outputs=["az"])
    h = ca.Function("h", [model.x, model.u, model.p, model.w], [model.h])
    calm = np.zeros(len(model.disturbances))
    at = [float(h(np.zeros(8), np.r_[SPEEDS, U], model.nominal_vector(), calm)) for U in (12.0, 9.0)]
    assert at[1] / at[0] == pytest.approx(0.75**1.5, rel=1e-12)
    assert model.inputs[-1] == "battery"


def test_a_rotor_that_rises_unlike_it_falls_follows_a_step_up_and_down():
    """Truth: the exponentials of both time constants. The slopes: differences."""
    t = np.arange(0.0, 2.0, 0.001)
    step = np.where((t >= 0.1) & (t < 1.0), 1.0, 0.0)

    def found(sizes):
        return {"u": operators.uneven_lag(t, step, sizes["rise"], sizes["fall"])}

    sizes = {"rise": 0.05, "fall": 0.2}
    series, slopes = operators.with_slopes(found, sizes)
    up, down = (t > 0.1) & (t < 0.99), t > 1.01
    np.testing.assert_allclose(series["u"][up], 1.0 - np.exp(-(t[up] - 0.0995) / 0.05), atol=1e-3)
    np.testing.assert_allclose(series["u"][down], np.exp(-(t[down] - 0.9995) / 0.2), atol=1e-3)
    for name in sizes:
        more, less = (found({**sizes, name: sizes[name] + h})["u"] for h in (1e-6, -1e-6))
        np.testing.assert_allclose(slopes[name]["u"], (more - less) / 2e-6, atol=1e-4)
    np.testing.assert_allclose(operators.uneven_lag(t, step, 0.05, 0.05), operators.lag(t, step, 0.05), atol=1e-7)


@pytest.mark.parametrize(
    ("kind", "target", "term", "value", "start"),
    [
        ("rotor_tilt", "m1", "x", 0.1, 0.0),
        ("rotor_limit", "m1", None, 1.6, 2.4),
        ("rotor_rise_fall", "rotors", None, 0.1, 0.01),
    ],
)
def test_the_size_of_a_cause_of_a_rotor_is_found(kind, target, term, value, start):
    """In a short flight whose inputs move by themselves, with noise; the start is many deviations away."""
    slow = replace(QUAD, rotors=replace(ROTORS, each=[replace(one, lag=0.03) for one in ROTORS.each]))
    t = np.arange(0.0, 1.0, 0.005)
    moves = {n: 840.0 + 80.0 * np.sign(np.sin(9.0 * t + i)) for i, n in enumerate(WHERE)}
    given = cs.Record(name="m1", t=t, channels=moves)

    def model(size):
        entry = cs.EffectValue(kind=kind, target=target, term=term, value=size)
        return cs.aircraft_model(slow.with_effects([entry]), outputs=["p", "q", "r", "az"])

    truth = model(value)
    flight = cs.simulate(truth, given, np.zeros(len(truth.states))).as_record()
    rng = np.random.default_rng(1)
    noise = {"p": 0.005, "q": 0.005, "r": 0.005, "az": 0.05}
    read = flight.with_channels(**{n: flight[n] + s * rng.standard_normal(len(t)) for n, s in noise.items()})
    free = [n for n in model(start).parameters if n.startswith(kind)]
    fit = cs.solve(cs.Problem(model(start), [read], free=free, noise=noise))
    assert abs(fit.parameters[free[0]].value - value) < 4.0 * fit.parameters[free[0]].std
    assert abs(start - value) > 10.0 * fit.parameters[free[0]].std


def test_lag_and_delay_act_once_however_often_a_record_is_made_ready():
    """Truth: the step response of a first-order lag behind a delay."""
    t = np.arange(0.0, 1.0, 0.001)
    slow = replace(QUAD, rotors=replace(ROTORS, each=[replace(one, lag=0.05, delay=0.1) for one in ROTORS.each]))
    step = np.where(t > 0.2, 900.0, 800.0)
    record = cs.Record(name="step", t=t, channels={name: step for name in WHERE})
    ready = cs.flight_inputs(slow, record)
    again = cs.flight_inputs(slow, ready)
    after = t > 0.32
    expected = 800.0 + 100.0 * (1.0 - np.exp(-(t[after] - 0.3005) / 0.05))
    np.testing.assert_allclose(ready["m1"][after], expected, atol=0.1)
    np.testing.assert_array_equal(again["m1"], ready["m1"])
    known = {name: ready[name] for name in ready.channels}
    moved = rotor_lag("m1").series(t, known, {"value": -0.05})  # pyright: ignore[reportOptionalCall]
    np.testing.assert_allclose(ready["m1"] + moved["d_m1"], np.interp(t - 0.1, t, step), atol=1e-9)


def test_interchanged_inputs_and_a_loss_in_mid_record():
    t = np.arange(0.0, 1.0, 0.01)
    record = cs.Record(name="r", t=t, channels={n: 800.0 + 10.0 * i + t for i, n in enumerate(WHERE)})
    ready = cs.flight_inputs(QUAD, record)
    known = {name: ready[name] for name in ready.channels}
    swapped = rotor_swap("m1+m4").series(t, known, {"value": 1.0})  # pyright: ignore[reportOptionalCall]
    np.testing.assert_allclose(ready["m1"] + swapped["d_m1"], ready["m4"])
    np.testing.assert_allclose(ready["m4"] + swapped["d_m4"], ready["m1"])
    lost = effectiveness_change("m2").series(t, known, {"value": -0.3, "onset": 0.5})  # pyright: ignore[reportOptionalCall]
    np.testing.assert_allclose(lost["d_thrust_m2"][60:], -0.3 * COEFFICIENT * ready["m2"][60:] ** 2, rtol=1e-12)
    assert not lost["d_thrust_m2"][:50].any()


def test_a_wing_with_rotors_hovers_and_flies():
    """A VTOL at rest has finite forces, those of its rotors; in fast flight its wing has those of the wing alone."""
    demo = cs.Aircraft.read("casid/cli/demo/aircraft.toml")
    both = replace(demo, rotors=ROTORS)
    names, wing = ("V", "alpha", "az"), cs.aircraft_model(demo, outputs=["V", "alpha", "az"])
    model = cs.aircraft_model(both, outputs=names)
    f = ca.Function("f", [model.x, model.u, model.p, model.w], [model.f, model.h, ca.jacobian(model.f, model.x)])
    inputs = {"rho": 1.0, "thrust": 0.0} | dict.fromkeys(WHERE, 800.0)
    u = [inputs.get(name, 0.0) for name in model.inputs]
    at_rest = [part.full() for part in f(np.zeros(8), u, model.nominal_vector(), np.zeros(len(model.disturbances)))]
    assert all(np.isfinite(part).all() for part in at_rest)
    assert at_rest[1][2, 0] == pytest.approx(-(4.0 * COEFFICIENT * 800.0**2 - 0.0) / demo.mass, rel=1e-3)
    fast = np.array([95.0, 1.0, 3.0, 0.1, 0.05, 0.02, 0.1, 0.05])
    u = [{"rho": 1.0, "thrust": 1e4, "delta_e": -0.02}.get(name, 0.0) for name in model.inputs]
    found = f(fast, u, model.nominal_vector(), np.zeros(len(model.disturbances)))[0].full()[:, 0]
    g = ca.Function("g", [wing.x, wing.u, wing.p, wing.w], [wing.f])
    alone = g(fast, u[: len(wing.inputs)], wing.nominal_vector(), np.zeros(len(wing.disturbances))).full()[:, 0]
    np.testing.assert_allclose(found[:3], alone[:3], rtol=2e-4, atol=2e-4)  # rotors that stand have no drag


@pytest.mark.parametrize(
    ("table", "says"),
    [
        ('name = "m1"\nposition = [1, 0]\nspin = 1', "position"),
        ('name = "m1"\nposition = [1, 0, 0]\nspin = 2', "spin"),
        ('name = "m1"\nposition = [1, 0, 0]\nspin = 1\nlags = 0.1', "did you mean 'lag'"),
        ('name = "q"\nposition = [1, 0, 0]\nspin = 1', "give the input another name"),
        ('name = "m1"\nposition = [1, 0, 0]\nspin = 1\nthrust = [1.0]', "depends on the input"),
        ('name = "m1"\nposition = [1, 0, 0]\nspin = 1\nthrust = { coefficient = -1.0 }', "positive"),
        ('name = "m1"\nposition = [1, 0, 0]\nspin = 1\naxis = [0, 0, 0]', "direction"),
    ],
)
def test_a_wrong_rotor_is_said(tmp_path, table, says):
    head = (
        "[aircraft]\nmass = 1.0\ninertia = { Ixx = 1.0, Iyy = 1.0, Izz = 1.0, Ixz = 0.0 }\n[rotors]\nthrust = [0, 1]\n"
    )
    path = tmp_path / "quad.toml"
    path.write_text(f"{head}[[rotors.each]]\n{table}\n")
    with pytest.raises(InputError, match=says):
        cs.Aircraft.read(path)


def test_what_is_written_is_read_back_equal(tmp_path):
    rotors = replace(
        ROTORS,
        inflow=0.02,
        voltage=cs.Voltage(reference=16.0),
        relative_uncertainty=0.1,
        each=[replace(one, lag=0.01 * i, effectiveness=1.0 - 0.1 * i, std=0.02) for i, one in enumerate(ROTORS.each)],
    )
    effect = cs.EffectValue(kind="rotor_effectiveness", target="m2", value=-0.1)
    quad = replace(QUAD, rotors=rotors).with_effects([effect])
    quad.write(tmp_path / "quad.toml")
    assert cs.Aircraft.read(tmp_path / "quad.toml") == quad
    with pytest.raises(InputError, match="m2"):
        replace(QUAD, rotors=rotors).with_effects([replace(effect, target="m22")])


def test_a_mass_that_is_dropped_is_accelerated_no_more():
    """From the onset on the rotors lift (1 + v) of the mass: T / ((1 + v) m) in place of T / m."""
    t = np.linspace(0.0, 4.0, 41)
    record = cs.Record(name="hover", t=t, channels={name: np.full(41, 850.0) for name in WHERE})
    known = acting_inputs(ROTORS, MASS, record)
    change = mass_change().series
    assert change is not None
    added = change(t, known, {"value": -0.2, "onset": 2.0})["f_w"]
    lift = 4.0 * COEFFICIENT * 850.0**2 / MASS
    np.testing.assert_allclose(added[t < 1.95], 0.0, atol=1e-12)
    np.testing.assert_allclose(-lift + added[t > 2.05], -lift / 0.8, rtol=1e-12)
