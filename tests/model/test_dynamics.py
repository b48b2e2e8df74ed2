"""Truth: conservation laws, symmetry, the rigid-body formula of a lever arm, order of Runge-Kutta, differences."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from casid.errors import InputError
from casid.model.aircraft import Aircraft, Inertia
from casid.model.dynamics import aircraft_model, flight_inputs
from casid.model.path import INPUTS, OUTPUTS, STATES, speed_of_sound
from casid.model.simulate import simulate
from casid.model.system import Model
from casid.model.trim import trim
from casid.records.record import Record
from problems.do328 import do328

ARMS = {"accelerometer": (3.1, -0.4, 0.7), "alpha_vane": (7.5, 1.2, -0.3), "beta_vane": (8.0, 0.2, -1.1)}
LATERAL_STATES = ("v", "p", "r", "phi")
LATERAL_INPUTS = ("delta_a", "delta_r")


def functions(model: Model) -> ca.Function:
    """(x, u, p, w) -> f, h."""
    return ca.Function("model", [model.x, model.u, model.p, model.w], [model.f, model.h])


def random_point(model: Model, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """State and inputs somewhere in flight, nothing at zero."""
    middle = {"u": 140.0, "v": 3.0, "w": 6.0, "rho": 0.9, "thrust": 1e4}
    spread = {"u": 10.0, "v": 3.0, "w": 3.0, "rho": 0.1, "thrust": 3e3}
    draw = {n: middle.get(n, 0.0) + spread.get(n, 0.2) * rng.standard_normal() for n in (*model.states, *model.inputs)}
    return np.array([draw[n] for n in model.states]), np.array([draw[n] for n in model.inputs])


def evaluate(model: Model, x: np.ndarray, u: np.ndarray, w: dict[str, float] | None = None) -> tuple[dict, dict]:
    """{state: derivative}, {output: value} at the nominal parameters."""
    disturbed = [(w or {}).get(name, 0.0) for name in model.disturbances]
    f, h = functions(model)(x, u, model.nominal_vector(), disturbed)
    return dict(zip(model.states, f.full()[:, 0], strict=True)), dict(zip(model.outputs, h.full()[:, 0], strict=True))


def body(**given) -> Aircraft:
    """A rigid body in a vacuum: one derivative, which is zero."""
    return replace(do328({"CL_0": 0.0}), **given)


def cruise(t: np.ndarray, **surfaces: np.ndarray) -> tuple[Record, np.ndarray]:
    """A record of inputs about the trim of the Do 328, and the trimmed state."""
    level = trim(do328(), V=144.0, thrust=10e3)
    channels = {name: np.full(len(t), value) for name, value in level.inputs.items()}
    for name, deflection in surfaces.items():
        channels[name] = channels[name] + deflection
    return Record(name="cruise", t=t, channels=channels), level.state


def doublet(t: np.ndarray, size: float = 0.03) -> np.ndarray:
    return size * np.sin(2.0 * np.pi * t / 2.0) * (t < 2.0)


# -- mechanics ---------------------------------------------------------------------------------------------------------


def inertia_tensor(of: Inertia) -> np.ndarray:
    return np.array([[of.Ixx, 0, -of.Ixz], [0, of.Iyy, 0], [-of.Ixz, 0, of.Izz]])


def test_energy_is_conserved_without_forces():
    """d/dt (m V^2/2 + omega I omega/2 + m g h) = 0 at any state, thrust off."""
    aircraft, rng = body(), np.random.default_rng(1)
    model, tensor = aircraft_model(aircraft), inertia_tensor(aircraft.inertia)
    for _ in range(20):
        x, u = random_point(model, rng)
        u[model.inputs.index("thrust")] = 0.0
        d, _ = evaluate(model, x, u)
        s = dict(zip(model.states, x, strict=True))
        omega, omegadot = x[3:6], np.array([d["p"], d["q"], d["r"]])
        climb = s["u"] * np.sin(s["theta"]) - np.cos(s["theta"]) * (
            s["v"] * np.sin(s["phi"]) + s["w"] * np.cos(s["phi"])
        )
        power = aircraft.mass * (x[:3] @ np.array([d["u"], d["v"], d["w"]]) + aircraft.gravity * climb)
        power += omega @ tensor @ omegadot
        assert abs(power) < 1e-9 * aircraft.mass * aircraft.gravity * np.linalg.norm(x[:3])


def test_angular_momentum_is_conserved_without_torque():
    """|I omega| of a tumbling body; the intermediate axis, so that the motion is not a plain spin."""
    aircraft = body(inertia=Inertia(Ixx=1.0e5, Iyy=1.8e5, Izz=2.4e5, Ixz=3e4))
    tensor = inertia_tensor(aircraft.inertia)
    t = np.arange(0.0, 20.0, 0.01)
    record = Record(name="vacuum", t=t, channels={n: np.full(len(t), float(n == "rho")) for n in INPUTS})
    flown = simulate(aircraft_model(aircraft), record, np.array([140.0, 0, 5.0, 0.1, 0.3, -0.05, 0, 0]))
    momentum = np.linalg.norm(flown.states[:, 3:6] @ tensor, axis=1)
    rate = np.linalg.norm(flown.states[:, 3:6] - flown.states[0, 3:6], axis=1)
    assert rate.max() > 0.1  # it does tumble
    np.testing.assert_allclose(momentum, momentum[0], rtol=1e-9)


def test_specific_force_is_acceleration_less_gravity():
    """At the c.g.: udot + q w - r v + g sin(theta) = ax, and so on; in level trim az = -g cos(theta)."""
    aircraft, rng = do328(), np.random.default_rng(2)
    model = aircraft_model(aircraft)
    x, u = random_point(model, rng)
    d, y = evaluate(model, x, u)
    g, (vel, omega, phi, theta) = aircraft.gravity, (x[:3], x[3:6], x[6], x[7])
    down = np.array([-np.sin(theta), np.cos(theta) * np.sin(phi), np.cos(theta) * np.cos(phi)])
    expected = np.array([d["u"], d["v"], d["w"]]) + np.cross(omega, vel) - g * down
    np.testing.assert_allclose([y["ax"], y["ay"], y["az"]], expected, rtol=1e-10, atol=1e-10)
    level = trim(aircraft, V=144.0, thrust=10e3)
    _, y = evaluate(model, level.state, np.array([level.inputs[n] for n in model.inputs]))
    assert y["az"] == pytest.approx(-g * np.cos(level.theta), rel=1e-9)


def test_instruments_off_the_centre_of_gravity_follow_the_rigid_body_formula():
    """a_P = a + omegadot x r + omega x (omega x r),  v_P = v + omega x r."""
    aircraft, rng = replace(do328(), **ARMS), np.random.default_rng(3)
    model, central = aircraft_model(aircraft), aircraft_model(do328())
    for _ in range(5):
        x, u = random_point(model, rng)
        d, y = evaluate(model, x, u)
        _, at_cg = evaluate(central, x, u)
        omega, omegadot = x[3:6], np.array([d["p"], d["q"], d["r"]])
        arm = np.array(ARMS["accelerometer"])
        centre = np.array([at_cg["ax"], at_cg["ay"], at_cg["az"]])
        expected = centre + np.cross(omegadot, arm) + np.cross(omega, np.cross(omega, arm))
        np.testing.assert_allclose([y["ax"], y["ay"], y["az"]], expected, rtol=1e-10)
        at_vane = x[:3] + np.cross(omega, np.array(ARMS["alpha_vane"]))
        assert y["alpha"] == pytest.approx(np.arctan2(at_vane[2], at_vane[0]), rel=1e-12)
        at_vane = x[:3] + np.cross(omega, np.array(ARMS["beta_vane"]))
        assert y["beta"] == pytest.approx(np.arcsin(at_vane[1] / np.linalg.norm(at_vane)), rel=1e-12)


def test_steady_wind_is_felt_through_the_air_alone():
    """Velocity of aircraft and air shifted alike: the same air data, forces and angular accelerations (Galilei)."""
    model, rng = aircraft_model(do328()), np.random.default_rng(4)
    x, u = random_point(model, rng)
    wind = np.array([12.0, -4.0, 3.0])
    d0, y0 = evaluate(model, x, u)
    d1, y1 = evaluate(
        model, x + np.r_[wind, np.zeros(5)], u, {f"wind_{a}": w for a, w in zip("xyz", wind, strict=True)}
    )
    for name in OUTPUTS:
        assert y1[name] == pytest.approx(y0[name], rel=1e-10, abs=1e-12), name
    assert d1["u"] - d0["u"] == pytest.approx(x[5] * wind[1] - x[4] * wind[2], rel=1e-9)


# -- symmetry and reductions -------------------------------------------------------------------------------------------


def test_mirrored_flight_is_flight_mirrored():
    """All lateral states and inputs reversed: lateral derivatives reverse, longitudinal ones stay."""
    model, rng = aircraft_model(do328()), np.random.default_rng(5)
    x, u = random_point(model, rng)
    flip_x = np.array([-1.0 if s in LATERAL_STATES else 1.0 for s in model.states])
    flip_u = np.array([-1.0 if i in LATERAL_INPUTS else 1.0 for i in model.inputs])
    d0, y0 = evaluate(model, x, u)
    d1, y1 = evaluate(model, flip_x * x, flip_u * u)
    lateral_outputs = ("beta", "p", "r", "phi", "ay", "pdot", "rdot")
    for name in model.states:
        assert d1[name] == pytest.approx((-1.0 if name in LATERAL_STATES else 1.0) * d0[name], rel=1e-9, abs=1e-12)
    for name in model.outputs:
        assert y1[name] == pytest.approx((-1.0 if name in lateral_outputs else 1.0) * y0[name], rel=1e-9, abs=1e-12)


def test_symmetric_flight_stays_symmetric_and_equals_the_longitudinal_model():
    t = np.arange(0.0, 10.0, 0.02)
    record, start = cruise(t, delta_e=doublet(t))
    flown = simulate(aircraft_model(do328()), record, start)
    for name in LATERAL_STATES:
        assert not flown.state(name).any(), name
    model = aircraft_model(do328(), axes="longitudinal")
    measured = flight_inputs(do328(), flown.as_record(), "longitudinal")
    reduced = simulate(model, measured, start[[STATES.index(s) for s in model.states]])
    for name in model.outputs:
        np.testing.assert_allclose(reduced.output(name), flown.output(name), rtol=1e-10, atol=1e-12, err_msg=name)


def test_lateral_model_is_the_full_one_with_the_longitudinal_motion_given():
    """At every sample of a mixed motion; what does not move comes out of the measured air data, rates and attitude."""
    t = np.arange(0.0, 10.0, 0.02)
    record, start = cruise(t, delta_e=0.5 * doublet(t), delta_a=doublet(t - 2.0), delta_r=0.5 * doublet(t - 4.0))
    full, model = aircraft_model(do328()), aircraft_model(do328(), axes="lateral")
    flown = simulate(full, record, start)
    assert np.ptp(flown.state("phi")) > 0.05 and np.ptp(flown.state("w")) > 1.0
    measured = flight_inputs(do328(), flown.as_record(), "lateral")
    rows = [STATES.index(s) for s in model.states]
    both = zip(flown.states[::25], measured.matrix(model.inputs)[::25], record.matrix(full.inputs)[::25], strict=True)
    for x, given, u in both:
        d, y = evaluate(full, x, u)
        reduced_d, reduced_y = evaluate(model, x[rows], given)
        np.testing.assert_allclose([reduced_d[s] for s in model.states], [d[s] for s in model.states], atol=1e-10)
        np.testing.assert_allclose([reduced_y[o] for o in model.outputs], [y[o] for o in model.outputs], atol=1e-10)


@pytest.mark.parametrize(("axes", "frozen", "rate"), [("longitudinal", "v", "r"), ("lateral", "w", "q")])
def test_the_velocity_of_the_other_plane_is_that_of_the_cg_wherever_the_vane_stands(axes: str, frozen: str, rate: str):
    """A vane 6 m ahead reads 6 m times the rate beside it; what is left is of second order."""
    aircraft = replace(do328(), alpha_vane=(6.0, 0.0, 0.0), beta_vane=(6.0, 0.0, 0.0))
    t = np.arange(0.0, 10.0, 0.02)
    record, start = cruise(t, delta_e=doublet(t), delta_a=doublet(t - 2.0), delta_r=doublet(t - 4.0))
    flown = simulate(aircraft_model(aircraft), record, start)
    measured = flight_inputs(aircraft, flown.as_record(), axes)
    turning = np.abs(6.0 * flown.state(rate)).max()
    assert turning > 0.3
    np.testing.assert_allclose(measured[frozen], flown.state(frozen), atol=0.05 * turning)


# -- numerics ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("hold", ["linear", "held"])
def test_runge_kutta_has_order_four(hold):
    """Halving the step divides the error by 16."""
    t = np.arange(0.0, 6.0, 0.2)
    record, start = cruise(t, delta_e=doublet(t), delta_a=0.02 * np.sin(t), delta_r=0.01 * np.cos(2.0 * t))
    record = replace(record, hold=hold)
    model = aircraft_model(do328())
    exact = simulate(model, record, start, substeps=64).states
    scale = model.scale_vector()
    errors = [np.abs((simulate(model, record, start, substeps=k).states - exact) / scale).max() for k in (2, 4, 8)]
    assert errors[0] / errors[1] == pytest.approx(16.0, rel=0.15)
    assert errors[1] / errors[2] == pytest.approx(16.0, rel=0.1)


@pytest.mark.parametrize("axes", ["full", "longitudinal", "lateral"])
def test_derivatives_agree_with_finite_differences(axes):
    """Central differences of f and h in state, input, parameter and disturbance."""
    model, rng = aircraft_model(replace(do328(), **ARMS), axes=axes), np.random.default_rng(6)
    symbols = (model.x, model.u, model.p, model.w)
    both = ca.vertcat(model.f, model.h)
    value = ca.Function("value", symbols, [both])
    x, u = random_point(model, rng)
    point = [x, u, model.nominal_vector(), np.zeros(len(model.disturbances))]
    for k, symbol in enumerate(symbols):
        exact = ca.Function("jacobian", symbols, [ca.jacobian(both, symbol)])(*point).full()
        for i, number in enumerate(point[k]):
            step = 1e-5 * max(1.0, abs(number))
            sides = []
            for sign in (1.0, -1.0):
                moved = [np.array(part) for part in point]
                moved[k][i] += sign * step
                sides.append(value(*moved).full()[:, 0])
            np.testing.assert_allclose(exact[:, i], (sides[0] - sides[1]) / (2 * step), rtol=1e-5, atol=1e-6)


def test_equation_error_form_closes_on_simulated_motion():
    """Coefficients from the accelerations equal the aerodynamic model on the same motion (paper eq. 6-8)."""
    aircraft = replace(do328(), accelerometer=(3.1, -0.4, 0.7), thrust_line_z=0.4)
    model, rng = aircraft_model(aircraft), np.random.default_rng(7)
    form = model.equation
    assert form is not None
    compare = ca.Function("equation", [form.m, model.p], [form.target, form.prediction])
    for _ in range(5):
        x, u = random_point(model, rng)
        _, y = evaluate(model, x, u)
        known = y | dict(zip(model.inputs, u, strict=True))
        target, prediction = compare([known[name] for name in form.channels], model.nominal_vector())
        np.testing.assert_allclose(target.full(), prediction.full(), rtol=1e-9, atol=1e-11)


def test_rates_are_made_dimensionless_with_the_rate_lengths():
    """p* = p s/V with the half span, q* = q l/V with the chord: pdot of a pure roll is Clp p s/V qbar S s / Ixx."""
    aircraft = body(derivatives={"Cl_p": -1.0, "Cm_q": -20.0}, inertia=Inertia(Ixx=1e5, Iyy=2e5, Izz=3e5, Ixz=0.0))
    model = aircraft_model(aircraft)
    x = np.array([144.0, 0, 0, 0.1, 0.05, 0, 0, 0])
    u = np.array([{"rho": 0.9}.get(name, 0.0) for name in model.inputs])
    d, _ = evaluate(model, x, u)
    qS = 0.5 * 0.9 * 144.0**2 * 40.0
    assert d["p"] == pytest.approx(qS * 10.4 * -1.0 * 0.1 * 10.4 / 144.0 / 1e5, rel=1e-12)
    assert d["q"] == pytest.approx(qS * 2.04 * -20.0 * 0.05 * 2.04 / 144.0 / 2e5, rel=1e-12)


# -- inputs of a model -------------------------------------------------------------------------------------------------


def test_inputs_come_from_the_record_or_from_trim_and_are_named_when_they_cannot():
    t = np.arange(0.0, 5.0, 0.1)
    surfaces = {name: np.zeros(len(t)) for name in ("delta_e", "delta_a", "delta_r")}
    bare = Record(name="m1", t=t, channels=surfaces)
    with pytest.raises(InputError, match="density"):
        flight_inputs(do328(), bare)
    high = bare.with_channels(altitude=np.full(len(t), 5000.0))
    ready = flight_inputs(do328(), high)
    assert ready["rho"][0] == pytest.approx(0.7361, rel=1e-3)  # standard atmosphere, ISO 2533
    assert (ready["thrust"] == 10e3).all() and any("thrust" in note for note in ready.notes)
    with pytest.raises(InputError, match="delta_a"):
        flight_inputs(do328(), high.without("delta_a"))
    assert not flight_inputs(do328(), high.without("delta_a", "delta_r"), "longitudinal")["delta_a"].any()
    with pytest.raises(InputError, match="thrust"):
        flight_inputs(replace(do328(), trim={"V": 144.0}), high)
    with pytest.raises(InputError, match="did you mean 'longitudinal'"):
        aircraft_model(do328(), axes="longitudnal")


def with_a_gap(record: Record, name: str) -> Record:
    values = record[name].copy() if name in record else np.zeros(len(record))
    values[20:23] = np.nan
    return record.with_channels(**{name: values})


@pytest.mark.parametrize("name", ["delta_e", "thrust", "rho"])
def test_a_gap_in_an_input_is_told_where_it_is(name):
    t = np.arange(0.0, 5.0, 0.1)
    record = Record(
        name="m1", t=t, channels={name: np.ones(len(t)) for name in ("delta_e", "delta_a", "delta_r", "rho")}
    )
    with pytest.raises(InputError, match=f"'m1', t = 2 s: the sample of input {name} is missing .nan., 3 in all"):
        flight_inputs(do328(), with_a_gap(record, name))


@pytest.mark.parametrize("axes", ["longitudinal", "lateral"])
@pytest.mark.parametrize("name", ["V", "alpha", "beta", "p", "q", "r", "phi", "theta"])
def test_a_gap_in_a_measured_state_that_does_not_move_is_filled(name, axes):
    """What a reduction takes from the record is an input of its model; a gap in phi once made it fall apart."""
    t = np.arange(0.0, 5.0, 0.1)
    states = {"V": 144.0, "alpha": 0.05, "beta": 0.0, "p": 0.0, "q": 0.0, "r": 0.0, "phi": 0.1, "theta": 0.05}
    channels = {"delta_e": 0.0, "delta_a": 0.0, "delta_r": 0.0, "rho": 0.7} | states
    record = Record(name="m1", t=t, channels={n: np.full(len(t), value) for n, value in channels.items()})
    ready = flight_inputs(do328(), with_a_gap(record, name), axes)
    assert np.isfinite(ready.matrix(aircraft_model(do328(), axes=axes).inputs)).all()
    with pytest.raises(InputError, match="unknown output"):
        aircraft_model(do328(), axes="lateral", outputs=["alpha"])


def test_a_simulation_that_diverges_says_when():
    t = np.arange(0.0, 200.0, 0.5)
    record, start = cruise(t, delta_e=doublet(t, 0.5))
    with pytest.raises(InputError, match="diverged at t ="):
        simulate(aircraft_model(do328()), record, start, {"Cm_alpha": 60.0, "Cm_q": 50.0})


@pytest.mark.parametrize(
    ("axes", "unneeded"),
    [("longitudinal", ("beta", "ay", "pdot", "rdot")), ("lateral", ("ax", "az", "qdot"))],
)
def test_equation_error_of_a_reduction_needs_the_channels_of_its_plane_alone(axes, unneeded):
    form = aircraft_model(do328(), axes=axes).equation
    assert form is not None
    record, _ = cruise(np.arange(0.0, 5.0, 0.1))
    bare = record.with_channels(V=np.full(50, 144.0))
    ready = flight_inputs(do328(), bare, axes)
    assert not set(form.channels) & (set(unneeded) - {"beta"})
    assert not (ready["beta"].any() if axes == "longitudinal" else ready["alpha"].any())


def test_speed_of_sound_is_that_of_the_standard_atmosphere_in_every_algebra() -> None:
    """ISO 2533 at 0, 5 and 11 km, constant above; a series gives a series, a symbol an expression, a float a float."""
    rho = np.array([1.2250, 0.73643, 0.36480, 0.19475])
    known = np.array([340.294, 320.545, 295.154, 295.069])
    found = speed_of_sound(rho)
    assert isinstance(found, np.ndarray) and found.shape == rho.shape
    np.testing.assert_allclose(found, known, rtol=3e-4)
    x = ca.SX.sym("rho")
    f = ca.Function("a", [x], [speed_of_sound(x)])
    np.testing.assert_allclose(f(rho[None]).full()[0], found, rtol=1e-14)
    assert isinstance(speed_of_sound(0.9), float)
