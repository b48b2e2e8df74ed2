"""Hysteresis of an input and of the friction of a speed. Truth: the differential equation, and what it is in its
limits."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import casid as cs
from casid.errors import InputError
from casid.model import operators
from casid.model.in_force import History, InForce
from problems.do328 import do328

T = 0.02 * np.arange(500)
WAVE = np.interp(T, [0.0, 1.0, 2.5, 3.0, 5.0, 8.0, 10.0], [0.0, 1.0, -0.6, 0.2, 0.2, -1.0, 0.5])


def value(target: str, size: float, **parameters: float) -> cs.EffectValue:
    return cs.EffectValue(kind="hysteresis", target=target, value=size, parameters=parameters)


def cart(creep: float | None = None) -> cs.Model:
    """A mass on a spring that is pushed; with dry friction of 0.3, which reverses over a creep."""
    model = cs.define_model(
        "cart",
        states=["x", "v"],
        inputs=["u"],
        parameters={"k": 4.0, "c": 0.4},
        outputs=["x", "v"],
        dynamics=lambda s: {"x": s.v, "v": s.u - s.k * s.x - s.c * s.v},
        output=lambda s: {"x": s.x, "v": s.v},
    )
    if creep is None:
        return model
    return model.with_effects([cs.EffectValue(kind="dry_friction", target="v", value=0.3, parameters={"creep": creep})])


def pushed() -> cs.Record:
    return cs.Record(name="m1", t=T, channels={"u": 3.0 * WAVE})


@pytest.mark.parametrize("rest", [-1.0, 0.0, 0.4])
def test_the_memory_of_a_way_is_the_solution_of_its_equation(rest: float) -> None:
    """z' = (y' - |y'| z) / d, integrated between the corners of the way."""
    found = operators.hysteresis(WAVE, 0.3, rest)
    rates = np.diff(WAVE) / np.diff(T)

    def rate(t: float, z: np.ndarray) -> np.ndarray:
        along = rates[min(np.searchsorted(T, t, side="right") - 1, len(rates) - 1)]
        return (along - abs(along) * z) / 0.3

    truth = solve_ivp(rate, (0.0, T[-1]), [rest], t_eval=T, max_step=0.01, rtol=1e-9).y[0]
    np.testing.assert_allclose(found, truth, atol=3e-4)
    slow = operators.hysteresis(np.repeat(WAVE, 3), 0.3, rest)[::3]  # it does not depend on the time that a way takes
    np.testing.assert_allclose(found, slow, atol=1e-14)


def test_over_no_stroke_it_is_the_sign_of_the_last_movement() -> None:
    found = operators.hysteresis(WAVE, 0.0)
    moving = np.abs(np.diff(WAVE)) > 0.0
    np.testing.assert_array_equal(found[1:][moving], np.sign(np.diff(WAVE))[moving])
    assert found[T == 4.0] == 1.0  # at rest it stays


def test_over_a_long_stroke_it_is_another_scale_of_the_input() -> None:
    """Of an input that swings by 2 over a stroke of 2000: less by its half width over the stroke."""
    curved, straight = (
        cs.simulate(cart().with_effects([one]), pushed(), [0.0, 0.0]).outputs
        for one in (value("u", 200.0, stroke=2000.0), cs.EffectValue(kind="input_scale", target="u", value=-0.1))
    )
    plain = cs.simulate(cart(), pushed(), [0.0, 0.0]).outputs
    assert np.abs(curved - straight).max() < 0.02 * np.abs(plain - straight).max()


def test_of_twice_its_half_width_it_lags_as_a_backlash_without_its_corners() -> None:
    """Both are behind by their half width on long ways, and stand when the way turns."""
    z = operators.hysteresis(WAVE, 0.2)
    smooth = WAVE - 0.1 * z
    cornered = operators.backlash(WAVE, 0.1)
    assert np.abs(smooth - cornered).max() < 0.08
    turned = int(np.argmax(WAVE))
    early = (smooth[turned + 1] - smooth[turned]) / (WAVE[turned + 1] - WAVE[turned])
    late = (smooth[turned + 25] - smooth[turned + 24]) / (WAVE[turned + 25] - WAVE[turned + 24])
    assert abs(early) < 0.1 and late > 0.9
    assert np.abs(WAVE - smooth).max() < 0.1


def test_friction_over_no_travel_is_dry_friction() -> None:
    """Truth: the motion with a force of 0.3 against the speed, which reverses over 0.002 m/s."""
    smooth = cart().with_effects([value("v", 0.3, travel=0.002)])
    found = cs.simulate(smooth, pushed(), [0.0, 0.0, 0.0], substeps=100).outputs
    truth = cs.simulate(cart(creep=0.002), pushed(), [0.0, 0.0], substeps=100).outputs
    plain = cs.simulate(cart(), pushed(), [0.0, 0.0]).outputs
    assert np.abs(found - truth).max() < 0.1 * np.abs(plain - truth).max()


def test_friction_over_a_long_travel_is_a_spring() -> None:
    """0.3 over 1000 m: a spring of 0.0003 /s2 beside those of the model."""
    long = cs.simulate(cart().with_effects([value("v", 300.0, travel=1000.0)]), pushed(), [0.0, 0.0, 0.0])
    spring = cs.simulate(cart(), pushed(), [0.0, 0.0], {"k": 4.3})
    np.testing.assert_allclose(long.outputs, spring.outputs, atol=2e-3)


def rates(x: Any, v: Any, z: Any, u: Any, p: Any) -> list[Any]:
    """Of position, speed and bristles, by k, c, the size and the travel."""
    return [v, u - p[0] * x - p[1] * v - p[2] * z, (v - np.sign(v.real) * v * z) / p[3]]


def test_the_equations_of_friction_and_their_slopes_by_all_sizes() -> None:
    """Truth: the formula, and complex steps along it."""
    model = cart().with_effects([value("v", 0.3, travel=0.2)])
    assert model.states == ("x", "v", "v_bent")
    function = ca.Function("f", [model.x, model.u, model.p], [model.f, ca.jacobian(model.f, model.p)])
    p = model.nominal_vector()
    for x, v, z, u in np.random.default_rng(5).normal(size=(20, 4)):
        found, slopes = function([x, v, z], [u], p)
        np.testing.assert_allclose(found.full().ravel(), rates(x, v, z, u, p), rtol=1e-12)
        steps = [np.imag(rates(x, v, z, u, p + 1e-20j * row)) / 1e-20 for row in np.eye(4)]
        np.testing.assert_allclose(slopes.full(), np.transpose(steps), rtol=1e-9, atol=1e-12)


def by_hand(y: np.ndarray, size: Any, stroke: Any, rest: Any) -> np.ndarray:
    """What acts less its record, step by step."""
    z = rest
    found = [-size * rest]
    for step in np.diff(y):
        side = np.sign(step)
        z = side + (z - side) * np.exp(-abs(step) / stroke)
        found.append(-size * z)
    return np.array(found)


def test_slopes_of_what_acts_by_all_sizes() -> None:
    """Truth: complex steps along the formula, to 1e-6 of the largest."""
    sizes = {"value": 0.3, "stroke": 0.4, "rest": 0.2}
    entry = value("u", 0.3, stroke=0.4, rest=0.2)
    (one,) = cart().with_effects([entry]).effects
    history = History(of=InForce(effect=one.effect, name=one.name, value=entry), stations=())
    series, slopes = history.at(pushed(), one.parameters)
    np.testing.assert_allclose(series["d_u"], by_hand(3.0 * WAVE, *sizes.values()), atol=1e-12)
    for k, name in enumerate(("hysteresis(u)", "hysteresis(u).stroke", "hysteresis(u).rest")):
        moved = [size + 1e-20j * (k == i) for i, size in enumerate(sizes.values())]
        truth = np.imag(by_hand(3.0 * WAVE, *moved)) / 1e-20
        np.testing.assert_allclose(slopes[name]["d_u"], truth, atol=1e-6 * np.abs(truth).max())
        assert np.abs(truth).max() > 0.01


def test_a_surface_has_the_form_of_an_input_alone() -> None:
    with pytest.raises(InputError, match="of a model of your own equations"):
        cs.aircraft_model(do328().with_effects([value("delta_e", 0.01, travel=1.0)]))
    with pytest.raises(InputError, match="unknown input 'v'"):
        cart().with_effects([value("v", 0.1, stroke=1.0)])
