"""The moves of the search: a cause is dropped, or swapped for a rival. Truth: flights in which causes are hidden."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace

import numpy as np
import pytest
from diagnosis_flights import flights, trial_of

from casid.diagnosis.comparisons import all_passed
from casid.diagnosis.criteria import Criteria
from casid.diagnosis.diagnose import diagnose
from casid.diagnosis.engine.acceptance import may_come_near
from casid.diagnosis.engine.baseline import baseline_from
from casid.diagnosis.engine.candidates import checked, try_cause
from casid.diagnosis.engine.search import State, added, swapped, with_gates_of_set, without_improbable
from casid.diagnosis.engine.trial import Round
from casid.diagnosis.evidence.evidence import weigh
from casid.diagnosis.evidence.screening import equivalence
from casid.diagnosis.flight.fit import fit
from casid.diagnosis.flight.flight import prepare
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.flight.subject import Subject
from casid.diagnosis.kinematics.check import KinematicFindings
from casid.diagnosis.kinematics.turbulence import still_air
from casid.model.causes.aerodynamics import aero_term, unsteady_aero
from casid.model.causes.controls import actuator_lag, effectiveness_change, input_delay
from casid.model.causes.instruments import sensor_bias, sensor_scale
from casid.model.causes.loading import thrust_line
from problems.do328 import do328

LATE = Attached(effect=input_delay("delta_e"), values={"value": 0.05})
LAGGED = Attached(effect=actuator_lag("delta_e"), values={"value": 0.05})
BIAS = Attached(effect=sensor_bias("q"), values={"value": 0.004})


def state_of(flight: Subject, attached: list[Attached], rounds: tuple[Round, ...]) -> State:
    """A search that has found these causes, in calm air."""
    calm = fit(flight, (), flight.noise(), extent="settled")
    still = KinematicFindings(evidence=None, ranked=[], turbulence=still_air(flight), nuisance=[])
    evidence = weigh(fit(flight, attached, flight.noise(), calm, extent="settled"))
    return State(
        baseline=baseline_from(calm, still),
        evidence=evidence,
        kinematic=None,
        observed=(),
        missing=(),
        rounds=rounds,
        intervals={},
    )


@pytest.mark.parametrize("lag", [0.0, 0.25])
def test_a_cause_is_dropped_that_another_explains_and_stays_when_both_are_there(lag: float) -> None:
    """Truth: a delay alone, beside which a lag was named; and both."""
    both = [
        Attached(effect=actuator_lag("delta_e"), values={"value": lag}),
        Attached(effect=input_delay("delta_e"), values={"value": 0.15}),
    ]
    flight = prepare(do328(), flights(both if lag else both[1:], seed=3, count=3))
    guessed = [one.with_values({"value": 0.1}) for one in both]
    rounds = tuple(Round(candidates=(), trials=(trial_of(one, 1e4),), equivalents=(), named=True) for one in guessed)
    kept = without_improbable(state_of(flight, guessed, rounds)).fit.attached
    assert [one.effect.kind for one in kept] == (["actuator_lag"] if lag else []) + ["input_delay"]


def test_a_fingerprint_has_the_order_of_the_readings() -> None:
    """A reading that a record does not have contributes nothing at its place; residuals are compared in that order."""
    first, second = flights([LAGGED], 3)[:2]
    flight = prepare(do328(), [first, second.with_channels(alpha=np.full(len(second), np.nan))])
    base = weigh(fit(flight, (), flight.noise(), extent="settled"))
    trial, joint, _ = try_cause(base, trial_of(LAGGED).candidate, None, np.inf)
    seen = joint.fit.seen
    response = trial.fingerprint.reshape(seen.shape)
    assert not seen.all() and not response[~seen].any() and np.mean(response[seen] != 0.0) > 0.9


def test_a_cause_is_not_fitted_twice_beside_the_same_model() -> None:
    """The next best takes the place of a cause that is refused: as it was fitted in its round."""
    flight = prepare(do328(), flights([LAGGED], 3))
    base = weigh(fit(flight, (), flight.noise(), extent="settled"))
    trial, joint, _ = try_cause(base, trial_of(LAGGED).candidate, None, np.inf)
    again, same, _ = try_cause(base, trial.candidate, None, np.inf)
    assert again is trial and same.fit.motion is joint.fit.motion and same.deviance == joint.deviance


SCALE, LIKE_IT, UNLIKE = (
    Attached(effect=effect, values={"value": value})
    for effect, value in ((sensor_scale("p"), 0.1), (sensor_scale("phi"), -0.1), (sensor_bias("p"), 0.01))
)


@pytest.mark.parametrize(
    ("size", "named", "rival", "near"),
    [
        (0.1, SCALE, UNLIKE, False),
        (0.1, UNLIKE, SCALE, True),
        (0.1, SCALE, LIKE_IT, False),
        (0.01, SCALE, LIKE_IT, True),
    ],
)
def test_what_comes_near_a_named_cause_is_predicted(size: float, named: Attached, rival: Attached, near: bool) -> None:
    """Truth: the statistics of both, fitted in one another's place, where a scale of `size` is hidden."""
    flight = prepare(do328(), flights([SCALE.with_values({"value": size})], 3))
    base = weigh(fit(flight, (), flight.noise(), extent="settled"))
    best, other = (try_cause(base, trial_of(one).candidate, None, np.inf)[0] for one in (named, rival))
    beside = weigh(fit(flight, [best.candidate.attached], flight.noise(), base.fit, extent="settled"))
    assert may_come_near(beside, best, other) == near
    assert near or best.gain.total - other.gain.total > equivalence(best.gain.raw, Criteria())


@pytest.mark.parametrize(("left", "passes"), [(2e4, True), (7e4, False)])
def test_no_cause_of_a_set_is_named_with_a_gate_that_failed(left: float, passes: bool) -> None:
    """A term and a loss that are judged together: the loss explains all at its port, the term leaves `left` of 1e5."""
    term = Attached(effect=unsteady_aero("Cn"), values={"value": -5.0})
    loss = Attached(effect=effectiveness_change("delta_a"), values={"value": -0.3}, onsets={"m1": 7.2})

    def state(missing: dict[str, float], named: Sequence[Attached]) -> State:
        inputs = tuple(SimpleNamespace(station=station, gain=gain) for station, gain in missing.items())
        flight = SimpleNamespace(imitated_names=frozenset())
        found = SimpleNamespace(slots=(), attached=tuple(named), flight=flight)
        rounds = tuple(
            Round(candidates=(), trials=(trial_of(one, gain),), equivalents=(), named=True)
            for one, gain in zip(named, (6e4, 2e5), strict=False)
        )
        return State(  # the arrays behind it are not asked for
            baseline=None,  # pyright: ignore
            evidence=SimpleNamespace(fit=found, criteria=Criteria()),  # pyright: ignore
            kinematic=None,
            observed=(),
            missing=inputs,  # pyright: ignore
            rounds=rounds,
            intervals={},
        )

    before = state({"dCn": 1e5, "dCl": 1e5, "control_delta_a": 1e5, "reading_r": 0.0}, ())
    after = state({"dCn": left, "dCl": 0.0, "control_delta_a": 0.0, "reading_r": 0.0}, (term, loss))
    judged = with_gates_of_set(before, after)
    assert all(all_passed(one.accepted_by) for one in judged.rounds) == passes
    assert all_passed(judged.rounds[-1].accepted_by)


def test_a_round_fits_each_event_once_and_no_cause_that_cannot_reach_the_best() -> None:
    """Truth: an elevator that loses 30 % at 9 s. The statistics that are predicted of it dwarf those of the others."""
    loss = Attached(effect=effectiveness_change("delta_e"), values={"value": -0.3}, onsets={"m1": 9.0})
    flight = prepare(do328(), flights([loss], 3))
    (round_,) = added(state_of(flight, [], ()), flight.effects).rounds
    leader = round_.leader.candidate.attached
    assert leader.effect.key == loss.effect.key and leader.values["value"] == pytest.approx(-0.3, abs=0.05)
    fitted = [trial.candidate.attached for trial in round_.trials if trial.given_up is None]
    places = [(one.name, one.values["value"] > 0.0, tuple(sorted(one.onsets))) for one in fitted if one.effect.timed]
    assert len(places) == len(set(places))
    best = round_.leader.gain
    for one in (trial for trial in round_.trials if trial.given_up is not None):
        assert one.given_up is not None and not one.given_up.passed
        assert one.candidate.statistic < max(best.raw, best.exact, 40.0)


@pytest.mark.parametrize("named", [LAGGED, LATE])
def test_a_cause_is_compared_again_beside_those_named_since(named: Attached) -> None:
    """Truth: a delay and a bias. Whichever of delay and lag was named before the bias, the delay stays."""
    flight = prepare(do328(), flights([LATE.with_values({"value": 0.06}), BIAS], 3))
    base = weigh(fit(flight, (), flight.noise(), extent="settled"))
    other = LATE if named is LAGGED else LAGGED
    fitted = [try_cause(base, trial_of(one).candidate, None, np.inf)[:2] for one in (named, other, BIAS)]
    tried = [checked(trial, joint.fit, base, None) for trial, joint in fitted]
    rounds = tuple(
        Round(candidates=(), trials=tuple(some), equivalents=(), named=True) for some in (tried[:2], tried[2:])
    )
    after = swapped(state_of(flight, [named, BIAS], rounds))
    assert {one.name for one in after.fit.attached} == {LATE.name, BIAS.name}
    assert after.fit[LATE.name] == pytest.approx(0.06, rel=0.05)
    assert [round_.leader.effect.key for round_ in after.rounds] == [LATE.effect.key, BIAS.effect.key]


@pytest.mark.parametrize(
    ("hidden", "alike"),
    [
        (Attached(effect=aero_term("Cm", "delta_e*Tc"), values={"value": -10.0}), False),
        (Attached(effect=aero_term("Cm", "delta_e*Tc"), values={"value": -3.0}), True),
        (Attached(effect=thrust_line(), values={"value": 1.5}), False),
    ],
)
@pytest.mark.slow
def test_a_tail_in_the_slipstream_is_told_from_another_thrust_line(hidden: Attached, alike: bool) -> None:
    """Truth: with the elevator at 3.5 deg in trim, an effectiveness that grows with thrust pitches the aircraft as a
    thrust line does that lies elsewhere. It is expected of propeller aircraft and no fault; the thrust line is one; and
    what is too little to tell them apart is a set."""
    found = diagnose(do328(), flights([hidden], 4, count=4 if alike else 3, rate_hz=50.0))
    no_fault = hidden.effect.traits.expected and not alike
    (named,) = (cause for cause in (found.minor if no_fault else found.causes) if cause.kind == hidden.effect.kind)
    assert (found.verdict == "explained") != no_fault
    assert named.sentence.startswith("Expected of a propeller aircraft") == no_fault
    assert named.value == pytest.approx(hidden.values["value"], rel=0.1)
    equal = ["aero_term"] if hidden.effect.traits.equal is not None else []  # Cm:Tc, by algebra
    assert [one["kind"] for one in named.indistinguishable_from] == (["thrust_line"] if alike else equal)
    assert {"thrust_line", "aero_term"} <= {trial.effect.kind for trial in found.rounds[0].trials}
