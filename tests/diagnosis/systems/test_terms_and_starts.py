"""Terms of any degree, and resonances. Truth: laws of motion simulated here, and invariance to the zero of an input."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from casid.diagnosis.criteria import Criteria
from casid.diagnosis.diagnose_ported import diagnose_system
from casid.diagnosis.flight.ported import first_fit, ported
from casid.model.library import Library
from casid.model.port import ports_of
from casid.model.system import Model, define_model
from casid.records.record import Record
from problems.random_systems.contract import diagnosed
from problems.random_systems.world import draw


def swing(w: float, damping: float, gain: float) -> Model:
    """An oscillator with a force."""
    return define_model(
        "swing",
        states=("x", "v"),
        inputs=("u",),
        parameters={"w2": w**2, "d": damping, "b": gain},
        outputs=("x",),
        dynamics=lambda s: {"x": s.v, "v": s.b * s.u - s.w2 * s.x - s.d * s.v},
        output=lambda s: {"x": s.x},
    )


def swung(seed: int, w: float, damping: float, samples: int, per_cycle: int, cube: float = 0.0) -> Record:
    """The oscillator with a spring that may stiffen, on a force that changes at the samples, with 1 % noise."""
    rng, dt, inside = np.random.default_rng(seed), 2.0 * np.pi / w / per_cycle, 40
    force = np.convolve(rng.standard_normal(samples), np.ones(3) / 3.0, "same")
    x, v, read = 0.0, 0.0, []
    for k in range(samples):
        read.append(x)
        for i in range(inside):
            now = force[k] + (force[min(k + 1, samples - 1)] - force[k]) * i / inside
            v += dt / inside * (now - w**2 * x - cube * x**3 - damping * v)
            x += dt / inside * v
    y = np.array(read)
    noisy = y + 0.01 * y.std() * rng.standard_normal(samples)
    return Record(name=f"m{seed}", t=dt * np.arange(samples), channels={"u": force, "x": noisy})


@pytest.mark.parametrize("w, gain", [(1.1, 0.5), (0.3, 0.3), (2.0, 1.5)])
def test_a_resonance_is_fitted_from_afar_with_nine_samples_per_cycle(w: float, gain: float) -> None:
    """Forty cycles with 3 % of damping: frequencies of 0.3 and 2 times the truth are many cycles away at the end.
    One Runge-Kutta step for a ninth of a cycle is 0.2 % slow."""
    record, model = swung(1, 1.0, 0.06, 360, 9), swing(w, 0.02, gain)
    fitted = first_fit(ported(model, [record], ports_of(model), Library(), Criteria())[0])
    assert fitted["w2"] == pytest.approx(1.0, abs=5.0 * fitted.std("w2") + 0.005)
    assert fitted["b"] == pytest.approx(1.0, abs=5.0 * fitted.std("b") + 0.01)
    assert np.sum(fitted.white**2) < 1.3 * fitted.readings


def test_a_term_of_a_higher_degree_is_proposed_where_something_is_still_missing() -> None:
    """A stiffening spring: x^3 is beyond the degree of the library. Without it, no such term is tried at all."""
    records = [swung(k, 1.0, 0.1, 300, 20, cube=0.05) for k in (1, 2, 3)]
    found = diagnose_system(swing(1.0, 0.1, 1.0), records, exact=("x",))
    assert found.causes[0].key == ("missing_term", "v", "x^3")
    assert found.causes[0].value == pytest.approx(-0.05, rel=0.05)
    plain = diagnose_system(swing(1.0, 0.1, 1.0), [swung(k, 1.0, 0.1, 300, 20) for k in (1, 2, 3)], exact=("x",))
    assert not plain.causes
    assert not any("^3" in decision.cause for round_ in plain.rounds for decision in round_.decisions(1))


def rotor(zero: float, slope: float) -> Model:
    """A climb on a thrust that is taken for linear in the speed of the rotor, which is read from another zero."""
    return define_model(
        "climb",
        states=("w",),
        inputs=("n",),
        parameters={"slope": slope, "drag": 0.3},
        outputs=("w",),
        dynamics=lambda s: {"w": s.slope * (s.n - zero - 5.0) - 9.81 - s.drag * s.w},
        output=lambda s: {"w": s.w},
    )


def climbed(seed: int, zero: float) -> Record:
    """Thrust of the square of the speed, whose tangent at 10 is that of the model."""
    rng, dt = np.random.default_rng(seed), 0.02
    t = dt * np.arange(1000)
    n = 10.0 + 0.8 * np.convolve(np.repeat(rng.choice([-1.0, 0.0, 1.0], 20), 50), np.ones(15) / 15.0, "same")
    w, read = 0.0, []
    for now in n:
        read.append(w)
        for _ in range(10):
            w += dt / 10 * (0.0981 * now**2 - 9.81 - 0.3 * w)
    noisy = np.array(read) + 0.01 * rng.standard_normal(1000)
    return Record(name=f"m{seed}", t=t, channels={"n": n + zero, "w": noisy}, hold="held")


@pytest.mark.parametrize("zero", [0.0, -10.0])
def test_a_power_of_an_input_is_found_from_any_zero_of_it(zero: float) -> None:
    """A square far from its zero is nearly a line, which derivatives reproduce; it is not taken for a limit."""
    model = rotor(zero, 1.962)
    found: Any = diagnose_system(model, [climbed(1, zero), climbed(2, zero)], [climbed(3, zero)])
    assert [one.key for one in found.causes] == [("missing_term", "w", "n^2")]
    assert found.causes[0].value == pytest.approx(0.0981, abs=4.0 * found.causes[0].std)


@pytest.mark.parametrize("seed", [3, 23, 35])
def test_no_power_is_named_for_what_it_only_imitates(seed: int) -> None:
    """Friction and a dead zone, drawn: a polynomial follows them, and leaves a part that matters at its port."""
    world = draw(seed)
    assert world.truth in ("friction", "dead zone")
    assert not [one for one in diagnosed(world).causes if one.effect.traits.last_resort]


def test_a_cause_is_not_refused_for_another_that_was_wrong() -> None:
    """A dead zone, drawn, beside which play was tried first: the set of both is refused, and the dead zone alone is
    accepted."""
    world = draw(26)
    assert [one.kind for one in diagnosed(world).causes] == [world.truth.replace(" ", "_")]


def test_a_term_that_a_parameter_multiplies_is_the_value_of_that_parameter() -> None:
    """The file has a third of the true gain, ten times its stated uncertainty away: a wrong value, and no term in u."""
    world = draw(86)
    assert world.truth == "values" and not diagnosed(world).causes
    model = swing(1.0, 0.1, 1.0)
    subject, _ = ported(model, [swung(1, 1.0, 0.1, 100, 20)], ports_of(model), Library(), Criteria())
    terms = {one.term for one in subject.effects if one.key[:2] == ("missing_term", "v")}
    assert not terms & {"x", "v", "u"} and {"1", "x^2", "x*u", "u^2"} <= terms


@pytest.mark.parametrize(
    ("seed", "name"), [(87, "missing_term(x:x*|x|)"), (97, "missing_term(v:x*|x|)"), (15, "dry_friction(v)")]
)
def test_a_kink_at_zero_is_found(seed: int, name: str) -> None:
    """Truth: a drawn world with a spring by the square, or with dry friction that is steeper than a sample shows."""
    assert [cause.name for cause in diagnosed(draw(seed)).causes] == [name]
