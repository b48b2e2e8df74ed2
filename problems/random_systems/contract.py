"""What holds for every result of a diagnosis, whatever the system: the points of `casid/diagnosis/claims.py`.

The points are computed here again, from the numbers of the result and from the truth, and not by the functions that
make the statements.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

import casid as cs
from casid.diagnosis.cause import NOT_TRIED, REFUSED
from casid.diagnosis.comparisons import all_passed
from casid.diagnosis.result import Diagnosis
from casid.errors import InputError
from casid.records.record import Record
from problems.random_systems.world import World, as_given

# Multiple of the noise, up to which the true error of a simulation that is called adequate may go: 1.5 of the
# criterion, and as much again for a noise that is estimated from a few hundred readings.
_ADEQUATE = 2.25
_ROUNDING = 1e-9


def diagnosed(world: World) -> Diagnosis:
    """The diagnosis of a world."""
    return cs.diagnose(world.model, list(world.records), [world.held], exact=world.exact)


def broken(world: World, found: Diagnosis) -> list[str]:
    """The points of the contract that a result breaks, in words."""
    return [*_adequate(world, found), *general(found)]


def general(found: Diagnosis) -> list[str]:
    """The points that a result breaks and that need no truth."""
    points = (_moved, _values, _shares, _probabilities, _words, _small, _decisions)
    return [said for point in points for said in point(found)]


def refuses_copies(world: World) -> list[str]:
    """A fitted record as a held-out one, also cut or under another name, is refused in words."""
    first = world.records[0]
    half = first.t[0] + 0.7 * first.duration
    copies = [
        Record(name="another name", t=first.t, channels=dict(first.channels)),
        first.between(-np.inf, half, name="a part"),
    ]
    found = []
    for copy in copies:
        try:
            cs.diagnose(world.model, list(world.records), [copy], exact=world.exact)
        except InputError as error:
            if first.name not in str(error) or copy.name not in str(error):
                found.append(f"the refusal of a copy names no record: {error}")
        else:
            found.append(f"a copy of a fitted record was held out: {copy.name}")
    return found


def _decisions(found: Diagnosis) -> Iterator[str]:
    """Every cause that was refused, or not tried, has a gate that failed; one that is named has none."""
    for cause in found.causes:
        if not all_passed(cause.gates):
            yield f"{cause.name} is named, and a gate failed"
    for one in found.trace.decisions:
        if one.outcome in (REFUSED, NOT_TRIED) and not one.failed:
            yield f"{one.cause} is {one.outcome} in round {one.round}, and passes every gate"


def _adequate(world: World, found: Diagnosis) -> Iterator[str]:
    """A simulation that is called adequate flies the truth, which was never seen, nearly within the noise."""
    if found.verdict != "adequate":
        return
    simulated = as_given(world)
    for name, sigma in world.noise.items():
        error = float(np.sqrt(np.mean((world.clean[name] - simulated[name]) ** 2 + sigma**2))) / sigma
        if error > _ADEQUATE:
            yield f"adequate, and {name} of the held-out record is off by {error:.3g} times the noise"


def _moved(found: Diagnosis) -> Iterator[str]:
    """Every value of the extended model that left its stated uncertainty is told on the first screen."""
    told = {one.parameter: one.change for one in found.moved}
    screen = str(found)
    for one in found.parameters:
        stated = found.refitted.fit.prior_weight[[s.name for s in found.refitted.fit.slots].index(one.name)]
        left = stated > 0.0 and one.name in found.diagnosed.values
        if left and abs(one.extended - one.a_priori) > (1.0 + 1e-6) * stated**-0.5:
            if one.name not in told:
                yield f"{one.name} left its stated uncertainty and is not told"
            elif told[one.name] not in screen:
                yield f"{one.name} is not on the first screen"


def _values(found: Diagnosis) -> Iterator[str]:
    """No value is what the records say while structure is missing or the held-out error has grown."""
    steps = found.budget.together
    missing = bool(found.unexplained) or steps.structure > 1.1 * max(steps.data_mended, steps.noise, steps.expected)
    factors = [one for one in found.factors if not one.cause]  # the size of a cause is structure
    if missing and (found.contradicted or factors or "records say" in found.sentence):
        yield "values are told as what the records say while structure is missing"


def _shares(found: Diagnosis) -> Iterator[str]:
    """Shares are from 0 to 1 and add up to 1; no sentence has a per cent outside."""
    shares = [one.share for one in found.account]
    if math.isfinite(found.budget.together.as_given):
        if not all(-_ROUNDING <= share <= 1.0 + _ROUNDING for share in shares):
            yield f"a share outside 0 to 1: {shares}"
        if abs(math.fsum(shares) - 1.0) > 1e-6:
            yield f"shares add up to {math.fsum(shares)}"
    if any(word in found.opening for word in ("nan", "inf ")):
        yield f"a number that is none: {found.opening}"


def _probabilities(found: Diagnosis) -> Iterator[str]:
    """With more than twice the error of the right model left, or an input unexplained, none is above 0.9. A cause with
    its set is as probable as a name must be; the alternatives that are left out of the set have one in twenty."""
    steps = found.budget.together
    much = bool(found.unexplained) or steps.structure > 2.0 * max(steps.noise, steps.expected)
    stated = [p for one in found.causes for p in (one.probability, one.alone) if p is not None]
    stated += [p for _, p in found.explanations] + list(found.believed.values())
    if much and any(p > 0.9 + _ROUNDING for p in stated):
        yield f"a probability of {max(stated):.3g} beside {steps.structure:.3g} times the noise"
    by = found.criteria
    least = by.priors.tempered(by.priors.named) * (by.parts.doubtful if much else 1.0)
    for one in found.causes:
        if one.probability is not None and one.probability < by.priors.holds * least:
            yield f"{one.name} is named with a probability of {one.probability:.3g}"
    if much and found.nothing is not None:
        yield "a probability that nothing is wrong beside a large error"


def _words(found: Diagnosis) -> Iterator[str]:
    """The headline names the worst channel; nothing is explained that leaves more than twice the noise."""
    channels, steps = found.budget.channels, found.budget.together
    worst = max(channels, key=lambda name: channels[name].as_given)
    if "does not reproduce" in found.opening and found.budget.labels.get(worst, worst) not in found.opening:
        yield f"the worst channel {worst} is not named: {found.opening}"
    if found.verdict == "explained" and steps.structure > 2.0 * max(steps.noise, steps.expected):
        yield f"explained, and {steps.structure:.3g} times the noise is left"


def _small(found: Diagnosis) -> Iterator[str]:
    """A minor cause that is no part of the extended model changes a reading by more than its noise."""
    fit = found.extended.fit
    within = {one.effect.key for one in fit.attached}
    doubted = found.verdict == "data at fault" or "fails on" in found.headline
    for one in found.minor:
        if one.key not in within and one.on_readings < 1.0 and not doubted:
            yield f"minor and not visible: {one.name}"
