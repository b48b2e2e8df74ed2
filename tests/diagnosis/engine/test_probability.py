"""Probabilities of what the rules tell. Their truth is what defines them: 19 to 1 at the distance of equivalents, and
the odds of the costs where a name is worth its risk."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from diagnosis_flights import trial_of

from casid.diagnosis.cause import Cause, at_least, at_most
from casid.diagnosis.criteria import Criteria
from casid.diagnosis.engine.probability import other_explanations, probabilities
from casid.diagnosis.engine.trial import Round, Trial
from casid.diagnosis.evidence.screening import equivalence
from casid.diagnosis.flight.hypothesis import Attached
from casid.model.causes import actuator_lag, gust, input_delay, sensor_bias, turbulence

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
    required = CRITERIA.naming.gain
    named = probabilities([cause_of(LAG)], [], naming_of(round_of(trial_of(LAG, required))), [])
    assert named.causes[0].probability == pytest.approx(AT_CRITERION * (1.0 - DOUBT))
    faint = probabilities([], [], naming_of(round_of(trial_of(LAG, required), named=False)), [])
    assert faint.there == {LAG.name: pytest.approx(AT_CRITERION * (1.0 - DOUBT))}
    assert faint.nothing == pytest.approx((1.0 - AT_CRITERION) * (1.0 - DOUBT))
    air = Attached(effect=turbulence(""), values={"value": 1.0})
    moving = probabilities([cause_of(air, CRITERIA.verdict.missing)], [], naming_of(), [])
    assert moving.causes[0].probability == pytest.approx(AT_CRITERION * (1.0 - DOUBT))
    unknown: Any = SimpleNamespace(station="dCm", gain=CRITERIA.verdict.missing)
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


def test_what_was_refused_is_not_there() -> None:
    """A round whose leader gained much and was doubted for what it left missing; one whose leader gained as much and
    was not named for another reason: that is no surer than a name must be."""
    gained = trial_of(LAG, 400.0)
    refused = replace(round_of(gained, named=False), accepted_by=(at_most("part still missing", 0.5, 0.25),))
    assert probabilities([], [], naming_of(refused), []).there == {}
    there = probabilities([], [], naming_of(round_of(gained, named=False)), []).there
    assert there == {LAG.name: pytest.approx(AT_CRITERION * (1.0 - DOUBT))}


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
    found = probabilities([], [], naming_of(round_of(trial_of(LAG, 5.0), named=False)), [little])
    assert found.nothing == pytest.approx(1.0 - DOUBT, abs=1e-3)
    assert found.explanations[0][0] == ()


def test_values_have_those_of_other_causes_that_are_not_refused() -> None:
    """Of a set: its change against that by the named cause, unless one in twenty is more than it has. Of a cause that
    is not in the model: its change, if it could be named. A cause with too little statistic has no part."""

    def trial(one: Attached, moved: float, value: float = 2.0) -> Trial:
        enough = at_least("gain", value, 1.0, "naming.gain")
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
