"""The sentences of a diagnosis. This file decides nothing; it only puts results into words."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

from casid.data_check.reading import Finding
from casid.diagnosis.cause import Cause
from casid.diagnosis.evidence.missing_input import MissingInput
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.given.budget import Budget
from casid.diagnosis.given.contradicted import Contradiction, Factor
from casid.diagnosis.given.scope import NotJudged
from casid.diagnosis.result import OfAircraft, OfSystem
from casid.model.plausible import Doubt
from casid.model.vocabulary import sentence_of

NOT_CONFIRMED = "Not confirmed on held-out data."
NOT_NEEDED = "No longer sure, or not needed, beside the other causes."
SLOW_NOISE = "Slow noise and offsets of instruments do as much."
_ADEQUATE = "The model is adequate: no cause of a size that matters shows in these records."
_SMALL = " Effects that are expected, or too small to matter, are listed as minor."
_NOTHING_ELSE = "Other findings are reliable only after this has been corrected."


def cause_sentence(one: Attached, value: float, std: float, records: int) -> str:
    """The sentence of a fitted cause with its size; `records` is the number of fitted records."""
    effect = one.effect
    text = sentence_of(effect, value, std)
    if effect.timed:
        return text[:-1] + ": " + ", ".join(f"{r} from t = {t:.1f} s" for r, t in one.onsets.items()) + "."
    if one.records and len(one.records) < records:
        others = " (or the other way in the others: free parameters show differences between records only)"
        return text[:-1] + f", in {', '.join(one.records)} only{others if effect.relative else ''}."
    return text


def noted(cause: Cause, remark: str) -> Cause:
    """The cause with a remark after its sentence."""
    return replace(cause, sentence=f"{cause.sentence} {remark}")


def expected_of(cause: Cause, whom: str) -> Cause:
    """The cause as a term that is expected of, for example, "any aircraft"."""
    return replace(cause, sentence=f"Expected of {whom}, and added: {cause.sentence}")


def explained(causes: Sequence[Cause], missing: MissingInput | None, fitted: Sequence[str]) -> str:
    """The sentence of the named causes, and of the port where something more is missing.

    `fitted` are the names of the fitted records.
    """
    stated = " ".join(c.statement for c in causes)
    return stated if missing is None else f"{stated} Something more is missing: it enters at {_where(missing, fitted)}."


def unexplained(missing: MissingInput, share: float, fitted: Sequence[str]) -> str:
    """The sentence of a latent input that no cause explains; `share` is its part of the variation at its port."""
    if missing.place.kind == "wind":
        size = f", {missing.rms:.2g} m/s"
    else:
        size = f", {100 * share:.0f} % of it" if share <= 1.0 else f", {share:.2g} times its variation"
    where = _where(missing, fitted, size)
    return f"The simulation misses something that no cause in the catalogue explains; it enters at {where}."


def adequate(remark: str, detectable: Mapping[str, Mapping[str, float]], refined: str) -> str:
    """The sentence of an adequate model, with the smallest instrument faults that would have been found."""
    return f"{_ADEQUATE}{remark}{_would_have_shown(detectable)}{refined}"


def remarks(minor: Sequence[Cause], faint: tuple[str, float] | None) -> str:
    """What is added to a verdict that names nothing: that minor causes exist, and the sentence and the probability of
    the cause nearest to a name."""
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


def contradicted(
    factors: Sequence[Factor], numbers: Sequence[Contradiction], most: int, part: OfAircraft | OfSystem
) -> str:
    """The clause of common factors and single numbers that are inconsistent with the records."""
    counted = ((len(factors), "group{} of derivatives"), (len(numbers), "number{}"))
    said = " and ".join(f"{'a' if n == 1 else n} {what.format('' if n == 1 else 's')}" for n, what in counted if n)
    verb = "is" if len(factors) + len(numbers) == 1 else "are"
    opening = f"{said} of the {part.source} {verb} inconsistent with {part.witness}."
    return f"{opening} {several([*factors, *numbers], most)}"


def several(all_of_them: Sequence[Finding | Contradiction | Doubt | Factor], most: int) -> str:
    """The sentences of the first `most` items, and the number of the others."""
    return _first([one.sentence for one in all_of_them], most)


def refined(budget: Budget, least: float) -> str:
    """The sentence of the improvement by values within their stated uncertainty.

    It is empty unless the error becomes `least` times smaller.
    """
    steps = budget.together
    if not steps.data_mended > least * steps.structure:
        return ""
    return (
        f" Its values, re-estimated within their stated uncertainty, change the error on "
        f"{', '.join(budget.records)} from {steps.data_mended:.2g} to {steps.structure:.2g} times the noise."
    )


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


def cost(budget: Budget, least: float) -> str:
    """The sentence for causes with which the error on held-out records is more than `least` times that with values
    re-estimated alone; otherwise empty.
    """
    steps = budget.together
    if steps.structure <= least * max(steps.values, steps.noise):
        return ""
    return (
        f"Something else is missing: with the causes added, the error of a simulation of {', '.join(budget.records)} "
        f"grows from {steps.values:.2g} to {steps.structure:.2g} times the noise."
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


def _first(stated: Sequence[str], most: int) -> str:
    more = len(stated) - most
    return " ".join([*stated[:most], *([f"And {more} more."] if more > 0 else [])])


def _where(missing: MissingInput, fitted: Sequence[str], size: str = "") -> str:
    oscillation = f"an oscillation of {missing.frequency:.2g} Hz, " if missing.frequency else ""
    unseen = "" if missing.concerns(fitted) else f", in {', '.join(missing.history)}, which no fit has seen"
    return f"{missing.words}{size} ({oscillation}likelihood-ratio statistic {missing.gain:.0f}){unseen}"
