"""Readings in steps. Truth: the steps, and the digits of what is written."""

from __future__ import annotations

import numpy as np
import pytest

import casid as cs
from casid.errors import InputError
from casid.model.in_force import is_slow_instrument
from casid.records.channel_ranges import channel_table
from problems.do328 import do328

T = 0.02 * np.arange(800)
STEP = 0.05
SIGMA = 0.01


def slow(*effects: cs.EffectValue) -> cs.Model:
    model = cs.define_model(
        "lag",
        states=["x"],
        inputs=["u"],
        parameters={"T": 0.5},
        outputs=["x"],
        dynamics=lambda s: {"x": (s.u - s.x) / s.T},
        output=lambda s: {"x": s.x},
    )
    return model.with_effects(effects) if effects else model


def steps(target: str, size: float = STEP, records: tuple[str, ...] = ()) -> cs.EffectValue:
    return cs.EffectValue(kind="sensor_resolution", target=target, value=size, records=records)


def commanded(name: str = "m1") -> cs.Record:
    return cs.Record(name=name, t=T, channels={"u": np.sin(1.3 * T) + 0.4 * np.sin(4.1 * T)})


def test_a_simulation_rounds_what_is_read_and_what_is_recorded_of_an_input() -> None:
    plain = cs.simulate(slow(), commanded(), [0.2])
    read = cs.simulate(slow(steps("x"), steps("u", 0.25)), commanded(), [0.2])
    np.testing.assert_array_equal(read.states, plain.states)  # the motion is that of the true input
    np.testing.assert_allclose(read.output("x"), STEP * np.round(plain.output("x") / STEP), atol=1e-12)
    np.testing.assert_allclose(read.as_record()["u"], 0.25 * np.round(commanded()["u"] / 0.25), atol=1e-12)
    elsewhere = cs.simulate(slow(steps("x", records=("m2",))), commanded(), [0.2])
    np.testing.assert_array_equal(elsewhere.outputs, plain.outputs)


def test_what_is_late_is_rounded_as_it_is_read() -> None:
    late = cs.EffectValue(kind="sensor_delay", target="x", value=0.1)
    whole, rounded = (cs.simulate(slow(late, *one), commanded(), [0.2]).output("x") for one in ((), (steps("x"),)))
    np.testing.assert_allclose(rounded, STEP * np.round(whole / STEP), atol=1e-12)


def test_the_samples_tell_the_step_and_a_fit_its_variance() -> None:
    """By the samples it is known to rounding; by a variance of s^2 / 12 beside the noise to some percent, and only with
    the noise known. A fit takes it as noise: nothing of it is a parameter."""
    truth = slow(steps("x"))
    noise = SIGMA * np.random.default_rng(4).standard_normal(len(T))
    exact = cs.simulate(slow(), commanded(), [0.0]).output("x")
    record = commanded().with_channels(x=STEP * np.round((exact + noise) / STEP))
    (row,) = [one for one in channel_table([record]) if one.name == "x"]
    assert row.step == pytest.approx(STEP, rel=1e-12)
    assert truth.parameters == ("T",)
    fit = cs.solve(cs.Problem(truth, [record], free=["T"]))
    found = fit.parameters["T"]
    assert abs(found.value - 0.5) < 4.0 * found.std
    by_variance = np.sqrt(12.0 * (fit.noise["x"] ** 2 - SIGMA**2))
    assert by_variance == pytest.approx(STEP, rel=0.1)
    assert abs(by_variance - STEP) > 1e6 * abs(row.step - STEP)


@pytest.mark.parametrize("unit", [1.0, np.pi / 180.0])
def test_a_channel_of_the_table_has_its_step_or_none(unit: float) -> None:
    """In another unit, too, written with six digits; noise of its own has none, nor has a command of three levels."""
    rng = np.random.default_rng(2)
    coarse = np.round(unit * 0.5 * np.round(3.0 * np.sin(T)), 6)
    fine = np.round(unit * 0.1 * np.round(40.0 * np.sin(T) + rng.normal(size=len(T))), 6)
    channels = {"alpha": coarse, "q": fine, "p": rng.normal(size=len(T)), "delta_e": 0.02 * np.sign(np.sin(T))}
    found = {one.name: one.step for one in channel_table([cs.Record(name="m1", t=T, channels=channels)])}
    to_degrees = 180.0 / np.pi
    assert found["alpha"] == pytest.approx(0.5 * unit * to_degrees, rel=1e-3)
    assert found["q"] == pytest.approx(0.1 * unit * to_degrees, rel=1e-3)
    assert np.isnan(found["p"]) and np.isnan(found["delta_e"])


def test_an_aircraft_has_it_in_readings_and_surfaces() -> None:
    start = cs.trim(do328(), V=144.0, thrust=10e3)
    channels = {name: np.full(len(T), size) for name, size in start.inputs.items()}
    channels["delta_e"] = channels["delta_e"] + 0.02 * np.sin(T)
    record = cs.Record(name="m1", t=T, channels=channels)
    entries = [steps("q", 0.01), steps("delta_e", 0.004)]
    model = cs.aircraft_model(do328().with_effects(entries))
    assert not any(is_slow_instrument(one.effect) or one.is_history for one in model.effects)
    read = cs.simulate(model, record, start.state).as_record()
    table = {one.name: one.step for one in channel_table([read])}
    assert table["q"] == pytest.approx(np.degrees(0.01), rel=1e-9)
    np.testing.assert_allclose(read["delta_e"] / 0.004, np.round(read["delta_e"] / 0.004), atol=1e-9)
    with pytest.raises(InputError, match="unknown rotor 'm1'"):
        do328().with_effects([steps("m1")])
