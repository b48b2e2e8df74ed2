"""Linear models against responses in closed form, python-control, and flights that are simulated in the time domain."""

from __future__ import annotations

from dataclasses import replace

import control
import numpy as np
import pytest

import casid as cs
from casid.errors import InputError
from casid.model import causes  # noqa: F401  fills the register
from casid.model.causes.instruments import group_channels
from casid.model.effect import KINDS, Effect
from casid.model.flown_records import flown_records
from casid.model.simulate import simulate
from casid.model.trim import trim
from casid.records.record import Record
from problems.do328 import V_TRIM, do328

OMEGA = np.geomspace(0.5, 20.0, 25)


def pendulum() -> cs.Model:
    """A pendulum with a motor of time constant T: the linear model depends on the angle at which it hangs."""
    return cs.define_model(
        "pendulum",
        states=["angle", "rate", "motor"],
        inputs=["u"],
        parameters={"T": 0.2, "g_l": 9.0, "damping": 0.5},
        outputs=["angle", "acceleration"],
        dynamics=lambda s: {
            "angle": s.rate,
            "rate": -s.g_l * np.sin(s.angle) - s.damping * s.rate + s.motor,
            "motor": (s.u - s.motor) / s.T,
        },
        output=lambda s: {
            "angle": s.angle,
            "acceleration": -s.g_l * np.sin(s.angle) - s.damping * s.rate + s.motor,
        },
    )


@pytest.mark.parametrize("angle", [0.0, 0.9])
def test_the_response_is_that_in_closed_form(angle: float) -> None:
    """angle/u = exp(-s tau) / ((T s + 1) (s^2 + damping s + g_l cos(angle))), the acceleration s^2 of it."""
    linear = cs.linear_model(pendulum(), {"angle": angle}, values={"T": 0.3})
    s = 1j * OMEGA
    exact = 1.0 / ((0.3 * s + 1.0) * (s**2 + 0.5 * s + 9.0 * np.cos(angle)))
    assert linear.response("u", "angle", OMEGA) == pytest.approx(exact, rel=1e-12)
    assert linear.response("u", "acceleration", OMEGA, delay=0.1) == pytest.approx(exact * s**2 * np.exp(-0.1 * s))
    wn, zeta = np.sqrt(9.0 * np.cos(angle)), 0.25 / np.sqrt(9.0 * np.cos(angle))
    pair = wn * (-zeta + 1j * np.sqrt(1.0 - zeta**2))
    assert sorted(linear.eigenvalues, key=lambda r: r.imag) == pytest.approx([np.conj(pair), -1.0 / 0.3, pair])


def test_the_response_is_that_of_python_control() -> None:
    """An aircraft in trim: eight states, five inputs, all outputs at once."""
    aircraft = do328()
    linear = cs.linear_model(aircraft, trim(aircraft, V=V_TRIM, altitude=3000.0))
    peer = control.ss(linear.A, linear.B, linear.C, linear.D)
    found = peer.frequency_response(OMEGA).complex
    for i, output in enumerate(linear.outputs):
        for j, surface in enumerate(linear.inputs):
            scale = np.abs(found[i, j]).max() + 1e-30
            assert linear.response(surface, output, OMEGA) / scale == pytest.approx(found[i, j] / scale, abs=1e-9)
    assert np.sort_complex(linear.eigenvalues) == pytest.approx(np.sort_complex(peer.poles()))


def test_a_steady_flight_has_the_modes_of_an_aircraft() -> None:
    """Two pairs in the longitudinal motion, one pair and two real roots in the lateral one; the phugoid is near that of
    Lanchester, omega = sqrt(2) g / V, which neglects the change of lift and drag."""
    aircraft = do328()
    level = trim(aircraft, V=V_TRIM, altitude=3000.0)
    longitudinal = cs.linear_model(aircraft, level, axes="longitudinal").eigenvalues
    assert (longitudinal.imag != 0.0).all()
    assert np.abs(longitudinal[-1]) == pytest.approx(np.sqrt(2.0) * 9.81 / V_TRIM, rel=0.3)
    assert np.sum(cs.linear_model(aircraft, level, axes="lateral").eigenvalues.imag != 0.0) == 2


def test_a_point_by_medians_is_the_steady_flight_that_was_recorded() -> None:
    aircraft = do328()
    level = trim(aircraft, V=V_TRIM, altitude=3000.0)
    steady = {"V": V_TRIM, "alpha": level.alpha, "theta": level.theta} | level.inputs
    channels = {name: np.full(50, value) for name, value in steady.items()}
    flown = Record(name="m1", t=0.02 * np.arange(50), channels=channels)
    by_records = cs.linear_model(aircraft, flown, outputs=["q"])
    assert pytest.approx(cs.linear_model(aircraft, level, outputs=["q"]).A) == by_records.A
    assert by_records.point["w"] == pytest.approx(V_TRIM * np.sin(level.alpha))


@pytest.mark.parametrize(
    ("effects", "output"),
    [
        ([("actuator_lag", "delta_e", 0.12)], "q"),
        ([("input_delay", "delta_e", 0.1), ("actuator_lag", "delta_e", 0.05)], "q"),
        ([("sensor_delay", "alpha", 0.1)], "alpha"),
        ([("sensor_lag", "theta", 0.2)], "theta"),
        ([("sensor_scale", "q", 0.1), ("sensor_delay", "q", 0.04)], "q"),
    ],
)
def test_lags_and_delays_of_the_file_are_in_the_response(effects, output: str) -> None:
    """Truth: the aircraft flown in the time domain with a small oscillation of the elevator, its effects applied to
    time histories, by their steady oscillation."""
    aircraft = do328()
    level = trim(aircraft, V=V_TRIM, altitude=3000.0)
    values = [cs.EffectValue(kind=k, target=c, term=None, value=v, parameters={}) for k, c, v in effects]
    aircraft = replace(aircraft, effects=tuple(values))
    omega, dt = 2.0, 0.01
    t = dt * np.arange(4001)
    channels = {name: np.full(len(t), value) for name, value in level.inputs.items()}
    channels |= {
        name: np.full(len(t), value)
        for name, value in {"V": V_TRIM, "alpha": level.alpha, "theta": level.theta}.items()
    }
    channels |= {name: np.zeros(len(t)) for name in ("beta", "p", "q", "r", "phi")}
    channels["delta_e"] = channels["delta_e"] + 1e-5 * np.sin(omega * t)
    applied = flown_records(aircraft, [Record(name="m1", t=t, channels=channels)], "longitudinal")
    start = applied.model.guess(applied.records[0])[0]
    flown = simulate(applied.model, applied.records[0], start)
    read = flown.outputs[:, applied.model.outputs.index(output)]
    late = t >= 40.0 - 3.0 * 2.0 * np.pi / omega
    # a slow part of the phugoid stays beside the oscillation
    basis = np.stack([np.sin(omega * t), np.cos(omega * t), *(np.ones(len(t)), t, t**2, t**3, t**4)], axis=1)[late]
    fitted = np.linalg.lstsq(basis, read[late], rcond=None)[0]
    found = (fitted[0] + 1j * fitted[1]) / 1e-5
    linear = cs.linear_model(aircraft, level, axes="longitudinal")
    assert found == pytest.approx(linear.response("delta_e", output, [omega])[0], rel=5e-3)


def effects_with_a_transfer() -> list[Effect]:
    made = []
    for kind in KINDS.values():
        if not kind.needs_term:
            made += [kind.make(target) for target in kind.targets]
    return [effect for effect in made if effect.forms.transfer is not None]


@pytest.mark.parametrize("effect", effects_with_a_transfer(), ids=lambda effect: effect.name)
def test_transfer_functions_are_those_of_the_operators(effect: Effect) -> None:
    """Truth: what `series` or `output` makes of an oscillation, once it is steady."""
    omega, dt = 3.0, 0.002
    t = dt * np.arange(10001)
    values = {"value": 0.15, "onset": 1.0}
    channel = group_channels(effect.target)[0]
    known = {name: np.sin(omega * t) for name in group_channels(effect.target)}
    if effect.series is not None:
        acts = known[channel] + effect.series(t, known, values)[f"d_{channel}"]
    else:
        assert effect.output is not None
        acts = effect.output(t, known, values)[channel]
    late = (t > 10.0) & (t < 19.0)
    basis = np.stack([np.sin(omega * t), np.cos(omega * t)], axis=1)[late]
    fitted = np.linalg.lstsq(basis, acts[late], rcond=None)[0]
    assert effect.forms.transfer is not None
    assert effect.forms.transfer(np.array([1j * omega]), values)[0] == pytest.approx(
        fitted[0] + 1j * fitted[1], abs=1e-4
    )


def test_what_has_no_linear_response_is_named() -> None:
    aircraft = do328()
    play = cs.EffectValue(kind="dead_zone", target="delta_e", term=None, value=0.01, parameters={})
    linear = cs.linear_model(replace(aircraft, effects=(play,)), trim(aircraft, V=V_TRIM, altitude=3000.0))
    assert linear.not_linear == ("dead_zone(delta_e)",)


def test_what_cannot_be_linearised_is_refused() -> None:
    linear = cs.linear_model(pendulum(), {})
    for what, wrong in (
        ("did you mean 'angle'", lambda: linear.response("u", "angl", OMEGA)),
        ("unknown input", lambda: linear.response("angle", "angle", OMEGA)),
        ("did you mean 'rate'", lambda: cs.linear_model(pendulum(), {"rat": 1.0})),
        ("states and inputs by name", lambda: cs.linear_model(do328(), {"V": 1.0})),
        ("unknown parameter", lambda: cs.linear_model(pendulum(), {}, values={"x": 1.0})),
    ):
        with pytest.raises(InputError, match=what):
            wrong()
    bad = cs.define_model(
        "root",
        states=["x"],
        inputs=["u"],
        parameters={"a": 1.0},
        outputs=["y"],
        dynamics=lambda s: {"x": np.sqrt(s.x) * s.u},
        output=lambda s: {"y": s.x},
    )
    with pytest.raises(InputError, match="no derivatives"):
        cs.linear_model(bad, {"u": 1.0})


def test_a_held_input_acts_half_a_sample_later() -> None:
    """Truth: the model flown with inputs that are held, and its response estimated from these samples, away from the
    peak at 3 rad/s."""
    rng, dt = np.random.default_rng(3), 0.1
    t = dt * np.arange(6000)
    record = Record(name="m1", t=t, channels={"u": 1e-3 * rng.standard_normal(len(t))}, hold="held")
    flown = simulate(pendulum(), record, np.zeros(3)).as_record()
    found = cs.frequency_response(flown, "u", "angle", omega=[1.0, 1.5, 2.0, 4.0, 4.5, 5.0], windows=[60.0])
    linear = cs.linear_model(pendulum(), {})
    late = np.angle(found.response / linear.response("u", "angle", found.omega, delay=0.5 * dt))
    assert np.abs(late).max() < 0.03
    assert np.abs(np.angle(found.response / linear.response("u", "angle", found.omega))).max() > 0.2
