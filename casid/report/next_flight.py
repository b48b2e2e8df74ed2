"""Describe what to fly next, in words and pictures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from casid.design.level_flight import Limits
from casid.design.next_flight import Exciting, Question, Separating
from casid.diagnosis.document import Document
from casid.records.record import Record
from casid.report.design_figures import designed_histories, separated
from casid.report.figure import Picture
from casid.report.sections import ReportTable
from casid.report.statements import numbered
from casid.report.words import (
    channel_scale,
    digits,
    effect_name,
    expectation_in_words,
    manoeuvre_in_words,
    odds_in_words,
    place,
)
from casid.signals import label_of


@dataclass(frozen=True, eq=False, kw_only=True)
class Proposal:
    """A flight that answers a question: what is `open`, what is to be flown within which limits, what it would tell,
    the command that makes it, and its picture, record and table."""

    open: str
    fly: str
    within: str
    tells: str
    command: str
    picture: Picture
    record: Record
    table: ReportTable | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class NextFlights:
    """Manoeuvres to fly next, `proposals`, and in words the questions for which no flight was sought or found,
    `beyond`."""

    proposals: tuple[Proposal, ...]
    beyond: tuple[str, ...]


def next_flights(document: Document) -> NextFlights:
    """A proposal for the first question that a manoeuvre can answer, within the limits of what the records flew."""
    found = document.next_flights
    proposals = [
        _separating(number, one) if isinstance(one, Separating) else _exciting(number, one)
        for number, one in enumerate(found.flights, 1)
    ]
    return NextFlights(proposals=tuple(proposals), beyond=tuple(_beyond(one) for one in found.beyond))


def _beyond(one: Question) -> str:
    if not one.sought:
        return f"{_in_question(one)} `{_command(one)}` looks for a flight that does."
    if one.fault:
        return f"{_in_question(one)} No manoeuvre is proposed: {one.fault}."
    return f"{_in_question(one)} No movement of one surface from level flight within these limits separates them."


def _in_question(one: Question) -> str:
    first, second = map(effect_name, one.effects)
    if not one.port:
        return f"These records cannot tell {first} from {second}."
    return (
        f"What enters at {place(one.port)} is no cause of the catalogue as it stands. The two nearest to it are "
        f"{first} and {second}."
    )


def _separating(number: int, one: Separating) -> Proposal:
    rivals = one.rivals
    best = one.best
    limits = one.limits
    return Proposal(
        open=_in_question(one.question),
        fly=manoeuvre_in_words(best),
        within=_in_words(limits, [best.manoeuvre.surface, *(n for n in limits.channels if n in rivals.noise)]),
        tells=f"It {odds_in_words(best.separation)}: the log likelihood ratio to be expected is "
        f"{expectation_in_words(best.separation)} from flight to flight, and of all fitted records together, by "
        f"the same measure, {digits(one.before, 2)}. This counts noise alone and assumes no prior knowledge of the "
        "derivatives. The model discrepancy, for which a verdict allows, reduces both.",
        command=_command(one.question),
        picture=separated(best, rivals, number),
        record=best.flown,
    )


def _command(one: Question) -> str:
    values = zip(one.effects, (one.first, one.second), strict=True)
    asked = " ".join(f"'{effect.name}={value.value:.4g}'" for effect, value in values)
    return f"casid design --aircraft extended.toml --separate {asked}"


def _in_words(limits: Limits, names: Sequence[str]) -> str:
    """Limits in units that a person reads."""
    both = {**limits.surfaces, **limits.channels}
    told = [
        f"{label_of(name)} ±{digits(channel_scale(name)[0] * both[name], 2)} {channel_scale(name)[1]}"
        for name in names
        if name in both
    ]
    return (
        f"{', '.join(told)} from trim, no further than these records went where they moved it, in {limits.duration:g} s"
    )


def limited(document: Document) -> ReportTable:
    """Numbers that the motion would determine if noise were the only unknown: flying more of it is no help."""
    rows = [
        (one.name, digits(one.given), _std(one.stated), _std(one.by_noise), _std(one.corrected))
        for one in document.limited
    ]
    return ReportTable(
        head=("number", "aircraft file", "its stated 1σ", "1σ by noise alone", "corrected 1σ"),
        rows=rows,
        caption="Excited, but not identifiable: the model discrepancy, or differences between stretches of record, "
        "make them uncertain. More of the same motion would not help.",
        numeric=True,
    )


def _std(value: float) -> str:
    return digits(value, 2) if np.isfinite(value) else "not stated" if np.isnan(value) else "any"


def _exciting(number: int, of: Exciting) -> Proposal:
    wanted = of.wanted
    best = of.best
    experiment = of.experiment
    names = ", ".join(one.name for one in wanted)
    shown = [*experiment.surfaces, *experiment.limits]
    rows = [
        (one.name, digits(one.given), _std(one.stated), _std(one.by_noise), _std(best.std[one.name])) for one in wanted
    ]
    return Proposal(
        open=f"The motion in these records says less of {names} than the file does.",
        fly=f"{' and '.join(label_of(s) for s in experiment.surfaces)}: 3-2-1-1, as large as the limits allow",
        within=_in_words(of.limits, shown),
        tells="It alone would tell them with the 1σ in the last column, all other derivatives being free.",
        command=f"casid design --aircraft extended.toml --axes {of.plane} --free {' '.join(experiment.free)}",
        picture=replace(
            designed_histories("next", {"3-2-1-1": best.record}, shown),
            name=numbered("next_flight", number),
            title=f"Next flight: {names}",
            caption="The standard 3-2-1-1 with the best unit, as large as the limits allow.",
        ),
        record=best.record,
        table=ReportTable(
            head=("derivative", "aircraft file", "its stated 1σ", "1σ of these records", "1σ of the manoeuvre"),
            rows=rows,
            caption="What the manoeuvre would tell, by noise alone",
            numeric=True,
        ),
    )
