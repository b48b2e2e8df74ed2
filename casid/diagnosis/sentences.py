"""The sentences of a diagnosis. This file decides nothing; it only puts results into words.

The sentence of a kind of cause is in its definition in `casid/model/causes/`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from casid.data_check.reading import Finding
from casid.diagnosis import claims
from casid.diagnosis.cause import Cause
from casid.diagnosis.claims import times
from casid.diagnosis.evidence.missing_input import MissingInput
from casid.diagnosis.facts import Facts
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.flight.noise import Following
from casid.diagnosis.given.as_given import AsGiven
from casid.diagnosis.given.budget import AccountStep, Budget
from casid.diagnosis.given.contradicted import Contradiction
from casid.diagnosis.given.factors import Factor
from casid.diagnosis.given.scope import NotJudged
from casid.diagnosis.result import Diagnosis
from casid.errors import InputError
from casid.model.numbers import digits
from casid.model.plausible import Doubt
from casid.model.rotors import Rotors, hover_thrusts
from casid.model.vocabulary import sentence_of, title_of
from casid.signals import label_of

NOT_CONFIRMED = "Not confirmed on held-out data."
NOT_NEEDED = "No longer sure, or not needed, beside the other causes."
_ADEQUATE = "No cause of a size that matters shows in these records."
_NO_BETTER = "No cause of the catalogue shows, and re-estimated values do not make it smaller."
_BY_VALUES = "No cause of a size that matters shows; re-estimated values account for the difference."
_SMALL = " Effects that are expected, or too small to matter, are listed as minor."
_NOTHING_ELSE = "Other findings are reliable only after this has been corrected."


Times = Mapping[str, tuple[float, float]]  # record -> interval [s]


def cause_sentence(one: Attached, value: float, std: float, records: int, times: tuple[Times, Times]) -> str:
    """The sentence of a fitted cause with its size; `records` is the number of fitted records, `times` are the
    intervals of its onsets and of its ends."""
    effect = one.effect
    text = sentence_of(effect, value, std)
    begins, ends = times
    if both := ends.keys() & begins.keys():
        told = (f"{r} from t = {_between(begins[r])} until t = {_between(ends[r])}" for r in sorted(both))
        return f"{text[:-1]}: {', '.join(told)}."
    if effect.timed:
        return text[:-1] + ": " + ", ".join(f"{r} from t = {t:.1f} s" for r, t in one.onsets.items()) + "."
    if one.records and len(one.records) < records:
        others = " (or the other way in the others: free parameters show differences between records only)"
        return text[:-1] + f", in {', '.join(one.records)} only{others if effect.traits.relative else ''}."
    return text


def _between(interval: tuple[float, float]) -> str:
    return f"{interval[0]:.1f} to {interval[1]:.1f} s"


def noted(cause: Cause, remark: str) -> Cause:
    """The cause with a remark after its sentence."""
    return replace(cause, sentence=f"{cause.sentence} {remark}")


def thrust_curve(rotors: Rotors, weight: float) -> str:
    """The sentence of the mean thrust of rotors by their input, and of the input in hover."""
    hover = []
    shares = hover_thrusts(rotors, weight)
    factors = np.mean([one.effectiveness * np.array(one.thrust) for one in rotors.each], axis=0)
    for one in rotors.each:
        with suppress(InputError):  # no input hovers, by a curve that turns before
            hover.append(one.input_for(shares[one.name]))
    parts = [f"{factor:.3g}" + ("", " u", f" u^{k}")[min(k, 2)] for k, factor in enumerate(factors) if factor]
    text = " + ".join(parts).replace("+ -", "- ")
    at = f", and hover needs u = {np.mean(hover):.3g}" if hover else ""
    return f"By these records the thrust of a rotor is {text} [N] for an input u{at}."


def expected_of(cause: Cause, whom: str) -> Cause:
    """The cause as a term that is expected of, for example, "any aircraft"."""
    return replace(cause, sentence=f"Expected of {whom}, and added: {cause.sentence}")


def missing_beside(missing: MissingInput, fitted: Sequence[str]) -> str:
    """The sentence of a latent input beside named causes; `fitted` are the names of the fitted records."""
    return f"Something more is missing: it enters at {_where(missing, fitted)}."


def unexplained(missing: MissingInput, share: float, fitted: Sequence[str], no_cause: str) -> str:
    """The sentence of a latent input that no cause explains; `share` is its part of the variation at its port, and
    `no_cause` names the causes of which none explains it."""
    if missing.place.kind == "wind":
        size = f", {missing.rms:.2g} m/s"
    else:
        size = f", {100 * share:.0f} % of it" if share <= 1.0 else f", {share:.2g} times its variation"
    where = _where(missing, fitted, size)
    return f"The simulation misses something that {no_cause}; it enters at {where}."


def no_air(one: Following) -> str:
    """The sentence of an output whose innovations in moving air follow an input."""
    return (
        f"Something is missing that was taken for moving air: {label_of(one.output)} follows earlier changes of the "
        f"{label_of(one.input)}, which no air does (likelihood-ratio statistic {digits(one.statistic)})."
    )


def remarks(minor: Sequence[Cause], faint: tuple[str, float] | None) -> str:
    """Return what is added to a verdict that names nothing: that minor causes exist, and the sentence and the
    probability of the cause nearest to a name."""
    said = _SMALL if minor else ""
    if faint is None:
        return said
    text, probability = faint
    stated = text[0].lower() + text[1:-1]
    return f"{said} Not clear enough to be named, but worth a look: {stated} ({100.0 * probability:.0f} % probable)."


def data_at_fault(findings: Sequence[Finding], most: int) -> str:
    """The sentence of faults of the data that cannot be corrected; at most `most` are listed."""
    return f"{several(findings, most)} {_NOTHING_ELSE}"


def file_impossible(numbers: Sequence[Contradiction], most: int) -> str:
    """The sentence of impossible numbers of the file; at most `most` are listed."""
    stated = [f"Aircraft file: {one.sentence}" for one in numbers]
    return f"{_first(stated, most)} {_NOTHING_ELSE}"


def flown(facts: Facts) -> str:
    """The sentence of the simulation as given on the held-out records."""
    where = ", ".join(facts.budget.records)
    reason = claims.not_flown(facts)
    if reason:
        return f"The simulation as given does not reproduce {where}, which no fit has seen: {reason}."
    error = times(facts.budget.together.as_given)
    return f"The simulation as given reproduces {where}, which no fit has seen, with {error} the noise."


def so_far(given: AsGiven, data: Sequence[Finding], most: int) -> str:
    """The sentence of what is known before any fit: the data, and the simulation as given on the held-out records."""
    found = several(data, most) or "no fault of the data was found"
    view = given.held
    ratios = {name: one.rms / one.noise for name, one in view.channels.items()}
    error = math.sqrt(math.fsum(one**2 for one in ratios.values()) / max(len(ratios), 1))
    worst = sorted(ratios, key=lambda name: -ratios[name])[:2]
    told = ", ".join(f"{name} {times(ratios[name])}" for name in worst)
    return f"so far: {found}; as given, {', '.join(view.records)} is off by {times(error)} the noise ({told})"


def accounted(facts: Facts, account: Sequence[AccountStep]) -> str:
    """The sentence of what accounts for the error, in shares that add up to 100 %, and of what made it worse."""
    if not claims.not_flown(facts):
        return ""
    shares = dict(zip((one.step for one in account), claims.percents(account), strict=True))
    parts = [
        f"{_STEPS[one.step]}{_listed(one.what, facts.listed)} {shares[one.step]} %"
        for one in account
        if shares[one.step]
    ]
    worse = [
        f" {_STEPS[one.step].capitalize()} makes it worse: {times(one.before)} the noise before, "
        f"{times(one.grown_to)} after."
        for one in account
        if one.grown_to is not None and one.grown_to > facts.criteria.slightly * one.before
    ]
    left = f"{times(facts.budget.together.structure)} the noise is left"
    told = f"Of that error: {', '.join(parts)}; {left}." if parts else f"With the best model {left}."
    return told + "".join(worse)


_STEPS = MappingProxyType(
    {
        "data": "correction of data",
        "values": "re-estimation of values",
        "structure": "added structure",
        "unexplained": "unexplained",
        "noise": "noise",
    }
)


def _listed(what: Sequence[str], most: int) -> str:
    """Items in brackets, the first few of them."""
    return f" ({', '.join(what[:most])}{', ...' if len(what) > most else ''})" if what else ""


def headline(facts: Facts, found: Diagnosis) -> str:
    """The sentences of the verdict: faults first, then causes, what is missing, and values."""
    most = facts.listed
    wrong = contradicted(facts)
    if facts.at_fault:
        return data_at_fault(facts.at_fault, most)
    if facts.impossible:
        return file_impossible(facts.impossible, most)
    if failed := failure(facts):
        return failed
    if facts.causes:
        said = " ".join([*(one.statement for one in facts.causes), *facts.unexplained[:1]])
        return f"{said} Besides, {wrong}" if wrong else said
    if facts.unexplained:
        return f"{facts.unexplained[0]} Besides, {wrong}" if wrong else facts.unexplained[0]
    if claims.adequate(facts) and not wrong:
        return f"{_ADEQUATE}{found.remark}{_would_have_shown(found.detectable_by_channel)}"
    left = claims.left_over(facts)
    by_values = _NO_BETTER if claims.no_better(facts) else _BY_VALUES
    opening = f"No cause of the catalogue accounts for all of it: {left}." if left else by_values
    return f"{opening}{f' {wrong[0].upper()}{wrong[1:]}' if wrong else ''}{found.remark}"


def whole(facts: Facts, account: Sequence[AccountStep], found: Diagnosis) -> str:
    """The account of a diagnosis: the simulation as given, what accounts for its error, and what is open."""
    parts = [
        flown(facts),
        accounted(facts, account),
        several(facts.corrected, facts.listed),
        headline(facts, found),
        moved(facts),
        _hidden_by_air(found) if facts.turbulent and not claims.adequate(facts) else "",
        differing(facts),
        cost(facts) if facts.causes else "",
        f"The {facts.source} as given is kept: {claims.grown(facts)}." if claims.grown(facts) else "",
        losses(facts.budget, facts.criteria.slightly),
        left_open(facts.not_judged, facts.listed),
    ]
    return " ".join(part for part in parts if part)


def contradicted(facts: Facts) -> str:
    """The clause of common factors and single numbers that are inconsistent with the records; empty if none may be
    stated.
    """
    factors = claims.told_factors(facts)
    numbers = () if claims.no_values(facts) else facts.contradicted
    if not (factors or numbers):
        return ""
    counted = ((len(factors), "group{} of derivatives"), (len(numbers), "number{}"))
    said = " and ".join(f"{'a' if n == 1 else n} {what.format('' if n == 1 else 's')}" for n, what in counted if n)
    verb = "is" if len(factors) + len(numbers) == 1 else "are"
    opening = f"{said} of the {facts.source} {verb} inconsistent with {facts.witness}."
    return f"{opening} {several([*factors, *numbers], facts.listed)}"


def moved(facts: Facts) -> str:
    """The sentences of values that left their stated uncertainty and are not reported as inconsistent with the
    records."""
    because = claims.no_values(facts)
    told = {d for one in claims.told_factors(facts) for d in one.derivatives}
    told |= set() if because else {one.parameter for one in facts.contradicted}
    others = [one for one in facts.moved if one.parameter not in told]
    pairs = " ".join(one.sentence for one in facts.combinations[: facts.listed])
    if not others:
        return pairs
    opening = (
        f"Values that the fit needed while {because}: " if because else "Values that left their stated uncertainty: "
    )
    listed = [one.change + ("" if one.identifiable else " (not identifiable)") for one in others[: facts.listed]]
    more = len(others) - len(listed)
    return f"{opening}{', '.join(listed)}{f', and {more} more' if more > 0 else ''}.{f' {pairs}' if pairs else ''}"


def values(facts: Facts, identified: int) -> str:
    """The sentence on the values of the file or model; `identified` is the number that the records determine."""
    if because := claims.no_values(facts):
        return f"No value is what the records say: {because}."
    against = len(facts.contradicted) + len(facts.factors)
    numbers = f"{identified} numbers of the {facts.source} that these records identify"
    if against:
        return f"{against} of {numbers} {'is' if against == 1 else 'are'} inconsistent with {facts.witness}."
    if any(one.identifiable for one in facts.moved):
        return f"None of {numbers} is inconsistent with {facts.witness} beyond three standard deviations."
    return f"All {numbers} stay within their stated uncertainty."


def differing(facts: Facts) -> str:
    """The sentence of records in which much more is left than in the others."""
    by = claims.records_that_differ(facts)
    apart = ", ".join(f"{name} ({times(value)} the error of the right model)" for name, value in by.items())
    air = [name for name in facts.turbulent if len(facts.turbulent) < len(facts.budget.by_record)]
    turbulent = f"{', '.join(air)} {'was' if len(air) == 1 else 'were'} flown in turbulence." if air else ""
    left = f"Most is left in {apart}." if apart else ""
    return " ".join(part for part in (left, turbulent) if part)


def several(all_of_them: Sequence[Finding | Contradiction | Doubt | Factor], most: int) -> str:
    """The sentences of the first `most` items, and the number of the others."""
    return _first([one.sentence for one in all_of_them], most)


def losses(budget: Budget, worse: float) -> str:
    """The sentence of channels in which the best model is worse than the file as given on held-out records, worst
    first.
    """
    lost = {
        name: steps.structure / steps.as_given
        for name, steps in budget.channels.items()
        if steps.structure > worse * steps.as_given and steps.structure > worse
    }
    if not lost:
        return ""
    stated = ", ".join(f"{name} ({100.0 * (lost[name] - 1.0):+.0f} %)" for name in sorted(lost, key=lambda o: -lost[o]))
    return f"Open-loop simulation of {', '.join(budget.records)}, which no fit has seen, gets worse in {stated}."


def cost(facts: Facts) -> str:
    """The sentence for causes with which the error on held-out records is much larger than with values re-estimated
    alone; otherwise empty.
    """
    steps = facts.budget.together
    if steps.structure <= facts.criteria.clearly * max(steps.values, steps.floor):
        return ""
    return (
        f"Something else is missing: with the causes added, the error of a simulation of "
        f"{', '.join(facts.budget.records)} grows from {times(steps.values)} to {times(steps.structure)} the noise."
    )


def failure(facts: Facts) -> str:
    """The sentence for a best model that is much worse on held-out records than the simulation as given; otherwise
    empty.
    """
    steps = facts.budget.together
    if steps.structure <= facts.criteria.tenfold * max(steps.as_given, steps.floor):
        return ""
    ratio = steps.structure / steps.as_given
    worse = f"{ratio:.2g}" if math.isfinite(ratio) else "infinitely many"
    return (
        f"The extended model fails on {', '.join(facts.budget.records)}: its error there is {worse} times that of the "
        "simulation as given. No cause is named, and no re-estimated value should be used."
    )


def left_open(not_judged: Sequence[NotJudged], most: int) -> str:
    """The sentence of what was not judged, and why."""
    if not not_judged:
        return ""
    stated = "; ".join(f"{one.what} ({one.because})" for one in not_judged[:most])
    more = len(not_judged) - most
    return f"Not judged: {stated}{f'; and {more} more' if more > 0 else ''}."


def _would_have_shown(detectable: Mapping[str, Mapping[str, float]]) -> str:
    """The sentence of the smallest detectable instrument faults: for each kind, the channel with the largest one."""
    told = []
    for kind, unit, name in (("delay", "s", "delay"), ("lag", "s", "lag"), ("scale", "1", "scale error")):
        seen = {channel: by[kind] for channel, by in detectable.items() if math.isfinite(by.get(kind, math.inf))}
        if seen:
            channel = max(seen, key=lambda one: seen[one])
            size = f"{100.0 * seen[channel]:.2g} %" if unit == "1" else f"{seen[channel]:.2g} {unit}"
            told.append(f"a {name} of {channel} under {size}")
    return f" What would not show here: {', '.join(told)}." if told else ""


def _hidden_by_air(found: Diagnosis) -> str:
    """The sentence of the smallest sudden changes that turbulence would have left visible, the largest of them."""
    steps = [e for e in found.bare.flight.effects if e.timed and e.unit == "1" and not e.event.lasts]
    sizes = [(found.detectable.get(effect.name, math.inf), effect) for effect in steps]
    seen = [(size, title_of(effect)) for size, effect in sizes if size <= effect.size.limit]
    size, title = max(seen, default=(0.0, ""))
    return f"The turbulence would hide: {title} under {100.0 * size:.2g} %." if seen else ""


def _first(stated: Sequence[str], most: int) -> str:
    more = len(stated) - most
    return " ".join([*stated[:most], *([f"And {more} more."] if more > 0 else [])])


def _where(missing: MissingInput, fitted: Sequence[str], size: str = "") -> str:
    oscillation = f"an oscillation of {missing.frequency:.2g} Hz, " if missing.frequency else ""
    unseen = "" if missing.concerns(fitted) else f", in {', '.join(missing.history)}, which no fit has seen"
    return f"{missing.words}{size} ({oscillation}likelihood-ratio statistic {digits(missing.gain)}){unseen}"
