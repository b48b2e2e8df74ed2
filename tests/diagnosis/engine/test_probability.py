"""Probabilities of what the rules tell. Their truth is what defines them: 19 to 1 at the distance of equivalents, and
the odds of the costs where a name is worth its risk."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from diagnosis_flights import at_least, at_most, trial_of
from hypothesis import given
from hypothesis import strategies as st

from casid.diagnosis import claims
from casid.diagnosis import comparisons as ask
from casid.diagnosis.cause import Cause
from casid.diagnosis.criteria import Criteria
from casid.diagnosis.engine.probability import other_explanations, probabilities
from casid.diagnosis.engine.trial import Round, Trial
from casid.diagnosis.evidence.screening import equivalence
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.given.budget import BudgetSteps
from casid.model.causes.air import gust, turbulence
from casid.model.causes.controls import actuator_lag, input_delay
from casid.model.causes.instruments import accelerometer_position, sensor_bias, sensor_scale

CRITERIA = Criteria()
DOUBT, AT_CRITERION = CRITERIA.priors.doubt, CRITERIA.priors.named
LAG = Attached(effect=actuator_lag("delta_e"), values={"value": 0.1})
DELAY = Attached(effect=input_delay("delta_e"), values={"value": 0.1})
BIAS = Attached(effect=sensor_bias("q"), values={"value": 0.004})
ALONG = (1.0, 0.0, 0.0)  # a fingerprint


def naming_of(*rounds: Round) -> Any:
    return SimpleNamespace(criteria=CRITERIA, rounds=rounds, named=[r for r in rounds if r.named])


def round_of(*trials: Trial, named: bool = True) -> Round:
    return Round(candidates=(), trials=trials, equivalents=(), named=named)


def lacking(one: Attached, gain: float, threshold: float) -> Trial:
    """A trial with its gate on the statistic."""
    return replace(trial_of(one, gain), enough=at_least("gain", gain, threshold))


def cause_of(one: Attached, statistic: float = 0.0, alike: tuple[Attached, ...] = ()) -> Cause:
    others = tuple(dict(zip(("kind", "target", "term"), other.effect.key, strict=True)) for other in alike)
    return Cause(
        effect=one.effect,
        value=1.0,
        std=0.1,
        records=(),
        statistic=statistic,
        indistinguishable_from=others,
        sentence="",
        meaningful=True,
        share=1.0,
    )


@pytest.mark.parametrize("gain", [500.0, 50_000.0])
def test_a_rival_at_the_distance_of_equivalents_has_one_in_twenty(gain: float) -> None:
    """Whatever the gain: what makes two causes equivalent grows with it."""
    rival = trial_of(DELAY, gain - equivalence(gain, CRITERIA), fingerprint=ALONG)
    found = probabilities(
        [cause_of(LAG, alike=(DELAY,))], [], naming_of(round_of(trial_of(LAG, gain, fingerprint=ALONG), rival)), []
    )
    (lag,) = found.causes
    assert lag.probability == pytest.approx(1.0 - DOUBT)
    assert lag.alone == pytest.approx(0.95 * (1.0 - DOUBT))
    assert lag.indistinguishable_from[0]["probability"] == pytest.approx(0.05 * (1.0 - DOUBT))
    assert lag.log_odds == pytest.approx(np.log(19.0))
    assert [names for names, _ in found.explanations] == [(LAG.name,), (DELAY.name,)]


def test_equals_share_and_what_has_nothing_in_common_takes_nothing() -> None:
    """Two that explain the same to the last digit have half each. A third that explains as much of something else is no
    rival of theirs, and may be there besides."""
    trials = [trial_of(one, 300.0, fingerprint=ALONG) for one in (LAG, DELAY)]
    apart = trial_of(BIAS, 300.0, fingerprint=(0.0, 1.0, 0.0))
    found = probabilities([cause_of(LAG)], [], naming_of(round_of(*trials, apart)), [])
    assert found.causes[0].probability == pytest.approx(0.5 * (1.0 - DOUBT))
    assert BIAS.name not in found.there


def test_at_its_criterion_a_name_is_worth_its_risk() -> None:
    """There its odds are those of the costs of a wrong name and of a missed one; and so are those of a cause that falls
    just short of it, of the air, and of something unknown."""
    required = CRITERIA.significance.search
    named = probabilities([cause_of(LAG)], [], naming_of(round_of(trial_of(LAG, required))), [])
    assert named.causes[0].probability == pytest.approx(AT_CRITERION * (1.0 - DOUBT))
    faint = probabilities([], [], naming_of(round_of(trial_of(LAG, required), named=False)), [])
    assert faint.there == {LAG.name: pytest.approx(AT_CRITERION * (1.0 - DOUBT))}
    assert faint.nothing == pytest.approx((1.0 - AT_CRITERION) * (1.0 - DOUBT))
    air = Attached(effect=turbulence(""), values={"value": 1.0})
    moving = probabilities([cause_of(air, CRITERIA.missing)], [], naming_of(), [])
    assert moving.causes[0].probability == pytest.approx(AT_CRITERION * (1.0 - DOUBT))
    unknown: Any = SimpleNamespace(station="dCm", gain=CRITERIA.missing)
    assert probabilities([], [unknown], naming_of(), [unknown]).entered == {
        "dCm": pytest.approx(AT_CRITERION * (1.0 - DOUBT))
    }


def test_explanations_are_wholes_and_their_probabilities_multiply() -> None:
    """Two places with two possible causes each: the four wholes hold all the probability but the doubt."""
    second = (Attached(effect=gust("z"), values={"value": 3.0}), BIAS)
    rounds = [
        round_of(*(trial_of(one, gain, fingerprint=ALONG) for one, gain in zip(pair, (400.0, 396.0), strict=True)))
        for pair in ((LAG, DELAY), second)
    ]
    found = probabilities([cause_of(LAG), cause_of(second[0])], [], naming_of(*rounds), [])
    assert len(found.explanations) == 4
    assert sum(p for _, p in found.explanations) == pytest.approx(1.0 - DOUBT)
    lag, air = (one.probability for one in found.causes)
    assert lag is not None and air is not None
    assert found.explanations[0] == ((LAG.name, second[0].name), pytest.approx(lag * air / (1.0 - DOUBT)))


@pytest.mark.parametrize("side", [0.0, 1.0])  # of its fingerprint: it acts as the lag does, or not at all so
def test_a_cause_named_later_stands_in_its_own_place_alone(side: float) -> None:
    """A bias, tried beside the lag and named in the next round, whichever of the two is listed first: it is as sure as
    without that trial, takes nothing from the lag, and is in no explanation twice."""
    lag, bias = trial_of(LAG, 400.0, fingerprint=ALONG), trial_of(BIAS, 398.0, fingerprint=(1.0 - side, side, 0.0))
    for causes in ((LAG, BIAS), (BIAS, LAG)):
        found = probabilities([cause_of(one) for one in causes], [], naming_of(round_of(lag, bias), round_of(bias)), [])
        assert found.there == pytest.approx({LAG.name: 1.0 - DOUBT, BIAS.name: 1.0 - DOUBT})
        assert found.explanations[0] == ((LAG.name, BIAS.name), pytest.approx(1.0 - DOUBT))
        assert all(len(set(names)) == len(names) for names, _ in found.explanations)


def test_an_alternative_of_two_causes_is_there_if_it_is_either() -> None:
    """Truth: it is absent if it is neither of the two, with half the probability each; and it is one cause."""
    two = (BIAS, Attached(effect=gust("z"), values={"value": 3.0}))
    rounds = [round_of(*(trial_of(one, 400.0, fingerprint=ALONG) for one in (first, LAG))) for first in two]
    found = probabilities([cause_of(one) for one in two], [], naming_of(*rounds), [])
    assert found.there[LAG.name] == pytest.approx(0.75 * (1.0 - DOUBT))
    assert dict(found.explanations)[(LAG.name,)] == pytest.approx(0.25 * (1.0 - DOUBT))
    assert sum(p for _, p in found.explanations) == pytest.approx(1.0 - DOUBT)


FAILED = (at_most("part still missing", 0.5, 0.25),)


@pytest.mark.parametrize("gates", [{"accepted_by": FAILED}, {"refused_by": (ask.NONE_REFUSED.of(1.0, 0.0),)}])
def test_what_was_refused_in_a_set_is_not_there(gates: dict[str, Any]) -> None:
    """A round whose leader gained much and was doubted for what it left missing, and one that passed its own gates
    beside such a cause: neither the leader nor what it was preferred to is there, in that round or in a later one."""
    trials = [trial_of(one, 400.0) for one in (LAG, BIAS)]
    refused, later = replace(round_of(*trials, named=False), **gates), lacking(LAG, 400.0, 420.0)
    assert probabilities([], [], naming_of(refused, round_of(later, named=False)), []).there == {}


def test_a_named_cause_that_a_later_gate_refused_is_not_there() -> None:
    """It was named in one round and tried in another, and is not among the reported causes: held-out records, or
    another cause, spoke against it."""
    rounds = round_of(trial_of(LAG, 400.0)), round_of(lacking(LAG, 400.0, 420.0), named=False)
    assert probabilities([], [], naming_of(*rounds), []).there == {}


@pytest.mark.parametrize("threshold", [40.0, 354.0, 50_000.0])
def test_a_statistic_is_weighed_against_the_threshold_of_its_own_gate(threshold: float) -> None:
    """Beside turbulence or a large earlier cause a name asks more: at that threshold the odds are those of the costs,
    whether the cause is just named or just not; at less than half of it, nothing is likely. (A fault of the
    accelerometer with 200 of 354 was told at 0.9, beside named causes at 0.98.)"""
    just = lacking(LAG, threshold, threshold)
    (named,) = probabilities([cause_of(LAG)], [], naming_of(round_of(just)), []).causes
    there = probabilities([], [], naming_of(round_of(just, named=False)), []).there
    assert named.probability == there[LAG.name] == pytest.approx(AT_CRITERION * (1.0 - DOUBT))
    little = probabilities([], [], naming_of(round_of(lacking(LAG, 0.45 * threshold, threshold), named=False)), [])
    assert little.faint is None and little.explanations[0][0] == ()


KINDS = tuple(
    Attached(effect=effect, values={"value": 0.1})
    for effect in (
        actuator_lag("delta_e"),
        input_delay("delta_e"),
        sensor_bias("q"),
        sensor_scale("beta"),
        accelerometer_position("x"),
        gust("z"),
        sensor_scale("V"),
        actuator_lag("delta_a"),
        input_delay("delta_a"),
    )
)
STATISTICS = st.floats(41.0, 50_000.0)


@given(
    st.permutations(range(len(KINDS))),
    st.lists(st.tuples(STATISTICS, st.floats(0.9, 1.0), st.booleans()), min_size=0, max_size=2),
    st.lists(STATISTICS, max_size=2),
    st.floats(0.0, 1.0),
    st.booleans(),
)
def test_explanations_hold_nothing_that_was_refused_and_agree_with_the_causes(
    order: Sequence[int],
    places: Sequence[tuple[float, float, bool]],
    refused: Sequence[float],
    reached: float,
    too_much: bool,
) -> None:
    """Drawn searches: named causes, each with a rival near it, sets that were refused, and a last round that named
    nothing, whose trials reached a part of what their gates asked, among them the causes that were refused.

    No explanation holds a cause that a gate refused, nor one that was only tried as sure as a name must be. In how many
    a cause is, is what is said of it: its probability summed over the explanations, up to what is not listed, also
    where something is left that nothing accounts for."""
    left = (KINDS[i] for i in order)
    rounds, causes, out = list[Round](), list[Cause](), list[Attached]()
    for gain, near, shared in places:
        first, rival = next(left), next(left)
        rounds.append(round_of(*(trial_of(o, g, fingerprint=ALONG) for o, g in ((first, gain), (rival, near * gain)))))
        causes.append(cause_of(first, alike=(rival,) if shared else ()))
    for gain in refused:
        out.append(next(left))
        rounds.append(replace(round_of(trial_of(out[-1], gain), named=False), accepted_by=FAILED))
    last = [*out, *left]
    rounds.append(round_of(*(lacking(one, reached * 400.0, 400.0) for one in last), named=False))
    found = probabilities(causes, [], naming_of(*rounds), [])

    def said(p: float) -> float:
        return claims.probability(p, TOO_MUCH) if too_much else p

    listed = [(names, said(p)) for names, p in found.explanations]
    unlisted = said(1.0 - DOUBT) - sum(p for _, p in listed)
    assert not {one.name for one in out} & ({name for names, _ in listed for name in names} | found.there.keys())
    for name, there in found.there.items():
        among = sum(p for names, p in listed if name in names)
        assert -1e-9 < said(there) - among < unlisted + 1e-3  # places leave out what is below `least`
        if name in {one.name for one in last}:
            assert there <= AT_CRITERION * (1.0 - DOUBT) + 1e-9
    for cause in found.causes:
        assert cause.alone == pytest.approx(found.there[cause.name])


TOO_MUCH: Any = SimpleNamespace(  # ten times the error of the right model is left
    unexplained=(),
    criteria=CRITERIA.parts,
    budget=SimpleNamespace(together=BudgetSteps(as_given=20.0, data_mended=20.0, values=10.0, structure=10.0)),
)


def test_what_was_refuted_is_no_rival() -> None:
    first = trial_of(LAG, 300.0, fingerprint=ALONG)
    refuted = replace(
        trial_of(DELAY, 300.0, fingerprint=ALONG), given_up=at_least("found by kinematics at half its size", 0.0, 0.3)
    )
    found = probabilities([cause_of(LAG)], [], naming_of(round_of(first, refuted)), [])
    assert found.causes[0].probability == pytest.approx(1.0 - DOUBT)


def test_nothing_faint_leaves_the_model_adequate() -> None:
    """A cause far below its criterion, and an unknown input far below its own."""
    little: Any = SimpleNamespace(station="dCL", gain=20.0)
    found = probabilities([], [], naming_of(round_of(trial_of(LAG, 1.0), named=False)), [little])
    assert found.nothing == pytest.approx(1.0 - DOUBT, abs=1e-3)
    assert found.explanations[0][0] == ()


def test_values_have_those_of_other_causes_that_are_not_refused() -> None:
    """Of a set: its change against that by the named cause, unless one in twenty is more than it has. Of a cause that
    is not in the model: its change, if it could be named. A cause with too little statistic has no part."""

    def trial(one: Attached, moved: float, value: float = 2.0) -> Trial:
        enough = at_least("gain", value, 1.0, "significance.search")
        return replace(trial_of(one, 300.0, fingerprint=ALONG), moved={"Cm_q": moved}, enough=enough)

    first, rival, apart = trial(LAG, 1.0), trial(DELAY, 1.5), trial(BIAS, -0.7)
    named = replace(round_of(first, rival), equivalents=(first, rival))
    refused = round_of(apart, trial(gust_of(), 9.0, value=0.5), named=False)
    state, final = naming_of(named, refused), SimpleNamespace(attached=(LAG,))

    def changes(there: dict[str, float]) -> list[float]:
        return [one["Cm_q"] for one in other_explanations(state, final, there)]  # pyright: ignore

    assert changes({LAG.name: 0.5, DELAY.name: 0.5}) == [0.0, 0.5, -0.7]
    assert changes({LAG.name: 0.96, DELAY.name: 0.04}) == [0.0, -0.7]
    final.attached = ()  # held-out records did not support the cause
    assert changes({LAG.name: 0.96}) == [1.0, 1.5, -0.7]


def gust_of() -> Attached:
    return Attached(effect=gust("z"), values={"value": 1.0, "length": 1.0}, onsets={"m1": 4.0})
