"""What to fly next: the manoeuvres that would separate what stayed ambiguous, and tell what these records do not."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from typing import Any

import numpy as np

from casid.design import Experiment, InputDesign, standard_3211
from casid.design.level_flight import SURFACES, Limits, experiment_of, level_rivals, plane_of
from casid.design.separation import NextFlight, Rivals, separating_manoeuvre, separation
from casid.diagnosis.cause import Cause
from casid.diagnosis.result import Diagnosis
from casid.errors import CasidError
from casid.model.aircraft import Aircraft
from casid.model.effect_value import EffectValue
from casid.model.effects import effect_of
from casid.records.record import Record
from casid.records.thinning import thinned
from casid.report.claims import numbered
from casid.report.design_figures import designed_histories, separated
from casid.report.style import Picture, channel_scale
from casid.report.templating import ReportTable, Row
from casid.report.words import (
    digits,
    effect_name,
    expectation_in_words,
    manoeuvre_in_words,
    odds_in_words,
    place,
    tells_apart,
)
from casid.signals import label_of

_RATE_HZ = 25.0
_LONGEST = 10.0  # s
_LIMITED = ("alpha", "beta", "az", "ay")
_TRIED, _ASKED = 2, 6  # questions that a flight is sought for until one is found, and all: a search takes seconds
_DEFLECTION = np.radians(3.0)  # rad, of a surface that the records did not move


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
    """What to fly next, `proposals`, and in words the questions for which no flight was sought or found, `beyond`."""

    proposals: tuple[Proposal, ...]
    beyond: tuple[str, ...]


def next_flights(diagnosis: Diagnosis) -> NextFlights:
    """A proposal for the first question that a manoeuvre can answer, within the limits of what the records flew."""
    flown = [thinned(record, _RATE_HZ) for record in diagnosis.refitted.fit.flight.records]
    aircraft, limits = _at_trim(diagnosis.extended_aircraft, flown), _limits(flown)
    noise = diagnosis.noise
    found: list[Proposal] = []
    beyond: list[str] = []
    for asked, (said, first, second) in enumerate(islice(_questions(diagnosis), _ASKED)):
        if found or asked >= _TRIED:
            beyond.append(f"{said} `{_command(first, second)}` looks for a flight that does.")
            continue
        try:
            rivals, experiment = level_rivals(aircraft, first, second, limits, noise)
            best, before = separating_manoeuvre(rivals, experiment), separation(rivals, flown).log_odds
        except CasidError as fault:
            beyond.append(f"{said} No manoeuvre is proposed: {fault}.")
            continue
        if tells_apart(best.separation.log_odds):
            found.append(_separating(len(found) + 1, said, (rivals, best), before, limits))
        else:
            beyond.append(f"{said} No movement of one surface from level flight within these limits separates them.")
    found += _for_untold(diagnosis, aircraft, limits, len(found))
    return NextFlights(proposals=tuple(found), beyond=tuple(beyond))


def _at_trim(aircraft: Aircraft, flown: Sequence[Record]) -> Aircraft:
    """With the trim that its file has, else that of the records."""
    if "V" in aircraft.trim and {"altitude", "rho"} & set(aircraft.trim):
        return aircraft
    own = {name: _median(flown, name) for name in ("V", "rho") if any(name in r for r in flown)}
    return replace(aircraft, trim={**aircraft.trim, **own})


def _median(flown: Sequence[Record], name: str) -> float:
    return float(np.nanmedian(np.concatenate([r[name] for r in flown if name in r])))


def _limits(flown: Sequence[Record]) -> Limits:
    """No further from the middle than the records went."""

    def reach(name: str) -> float:
        series = np.concatenate([r[name] for r in flown if name in r])
        return float(np.nanmax(np.abs(series - np.nanmedian(series))))

    def moved(names: Sequence[str]) -> dict[str, float]:
        there = [name for name in names if any(name in r for r in flown)]
        return {name: reach(name) for name in there if reach(name) > 0.0}

    return Limits(
        surfaces=moved(SURFACES["full"]),
        channels=moved(_LIMITED),
        duration=min(_LONGEST, *(record.duration for record in flown)),
    )


def _questions(diagnosis: Diagnosis) -> Iterator[tuple[str, EffectValue, EffectValue]]:
    """What is open in words, and the two effects between which a flight would decide."""
    for cause in diagnosis.causes:
        for other in cause.indistinguishable_from:
            second = _other(diagnosis, other)
            if second is not None:
                first = _value(cause)
                names = [effect_name(effect_of(one)) for one in (first, second)]
                yield f"These records cannot tell {names[0]} from {names[1]}.", first, second
    for missing in diagnosis.unexplained:
        near = [
            one.attached
            for one in (diagnosis.rounds[-1].candidates if diagnosis.rounds else ())
            if one.attached.effect.enters == missing.station and not one.attached.effect.stochastic
        ]
        if len(near) > 1:
            first, second = (_attached_value(one) for one in near[:2])
            names = [effect_name(effect_of(one)) for one in (first, second)]
            yield (
                f"What enters at {place(missing.station)} is no cause of the catalogue as it stands. The two nearest "
                f"to it are {names[0]} and {names[1]}.",
                first,
                second,
            )


def _value(cause: Cause) -> EffectValue:
    return EffectValue(
        kind=cause.kind, target=cause.target, term=cause.term, value=cause.value, parameters=dict(cause.parameters)
    )


def _attached_value(one: Any) -> EffectValue:
    """Of a cause that was fitted or scored."""
    effect, values = one.effect, one.effect.in_words(one.values)
    further = {key: value for key, value in values.items() if key != "value"}
    return EffectValue(
        kind=effect.kind, target=effect.target, term=effect.term, value=values["value"], parameters=further
    )


def _other(diagnosis: Diagnosis, other: Mapping[str, Any]) -> EffectValue | None:
    """What a cause cannot be told from, with the size that was fitted or predicted; None where there is none."""
    key = other["kind"], other["target"], other["term"]
    trials = [trial.candidate.attached for round_ in diagnosis.rounds for trial in round_.trials]
    fitted = next((one for one in trials if one.effect.key == key), None)
    if fitted is not None:
        return _attached_value(fitted)
    if "value" not in other:
        return None
    return EffectValue(kind=other["kind"], target=other["target"] or "", term=other["term"], value=other["value"])


def _separating(number: int, said: str, of: tuple[Rivals, NextFlight], before: float, limits: Limits) -> Proposal:
    rivals, best = of
    return Proposal(
        open=said,
        fly=manoeuvre_in_words(best),
        within=_in_words(limits, [best.manoeuvre.surface, *(n for n in limits.channels if n in rivals.noise)]),
        tells=(
            f"It {odds_in_words(best.separation.log_odds)}: the log likelihood ratio to be expected is "
            f"{expectation_in_words(best.separation)} from flight to flight, and of all fitted records together, by "
            f"the same measure, {digits(before, 2)}. This counts noise alone and assumes no prior knowledge of the "
            "derivatives. The model discrepancy, for which a verdict allows, reduces both."
        ),
        command=_command(rivals.first, rivals.second),
        picture=separated(best, rivals, number),
        record=best.flown,
    )


def _command(first: EffectValue, second: EffectValue) -> str:
    """The command that designs a flight between two effects."""
    asked = " ".join(f"'{effect_of(one).name}={one.value:.4g}'" for one in (first, second))
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


@dataclass(frozen=True, kw_only=True)
class Untold:
    """A number of the file that these records do not tell: its 1-sigma as the file states it, NaN where it does not.
    Standard deviation by the noise of these records alone, infinite without any information; and corrected."""

    name: str
    given: float
    stated: float
    by_noise: float
    corrected: float

    def unmoved(self, least: float) -> bool:
        """Whether it was not excited: by noise alone, less than `least` of what is known would come from the
        records."""
        return not self.stated**2 / (self.stated**2 + self.by_noise**2) > least


def _untold(diagnosis: Diagnosis) -> Iterator[Untold]:
    relative = diagnosis.aircraft.relative_uncertainty or np.nan
    for one in diagnosis.parameters:
        if one.flight.determined:
            continue
        stated = relative * abs(one.a_priori)
        own = 1.0 / one.extended_std**2 - (1.0 / stated**2 if stated > 0.0 else 0.0)  # without the file's own word
        by_noise = own**-0.5 if own > 0.0 else np.inf
        yield Untold(name=one.name, given=one.a_priori, stated=stated, by_noise=by_noise, corrected=one.flight.std)
    flight = diagnosis.extended.fit.flight
    for name, value in flight.aircraft.derivatives.items():
        if any(name.endswith(f"_{surface}") for surface in flight.resting):
            yield Untold(name=name, given=value, stated=relative * abs(value), by_noise=np.inf, corrected=np.inf)


def limited(diagnosis: Diagnosis) -> ReportTable:
    """Numbers that the motion would tell, were noise the only thing that is unknown: flying more of it is no help."""
    least = diagnosis.criteria.given.from_records
    rows = tuple(
        Row(cells=(one.name, digits(one.given), _std(one.stated), _std(one.by_noise), _std(one.corrected)))
        for one in _untold(diagnosis)
        if not one.unmoved(least)
    )
    return ReportTable(
        head=("number", "aircraft file", "its stated 1σ", "1σ by noise alone", "corrected 1σ"),
        rows=rows,
        caption="Excited, but not identifiable: the model discrepancy, or differences between stretches of record, "
        "make them uncertain. More of the same motion would not help.",
        numeric=True,
    )


def _std(value: float) -> str:
    return digits(value, 2) if np.isfinite(value) else "not stated" if np.isnan(value) else "any"


def _for_untold(diagnosis: Diagnosis, aircraft: Aircraft, limits: Limits, count: int) -> Iterator[Proposal]:
    """A 3-2-1-1 for the derivatives that these records did not excite, plane by plane."""
    noise, least = diagnosis.noise, diagnosis.criteria.given.from_records
    unmoved = {one.name: one for one in _untold(diagnosis) if one.unmoved(least)}
    resting = dict.fromkeys(diagnosis.extended.fit.flight.resting, _DEFLECTION)
    limits = replace(limits, surfaces={**resting, **limits.surfaces})
    for plane in ("longitudinal", "lateral"):
        wanted = [name for name in unmoved if plane_of(name.partition("_")[0]) == plane]
        if not wanted:
            continue
        try:
            experiment = experiment_of(aircraft, plane, limits, noise=noise)
            best = standard_3211(experiment)
        except CasidError:
            continue  # nothing of this plane may move, or there is no trim
        better = [unmoved[n] for n in wanted if n in best.std and best.std[n] < unmoved[n].by_noise]
        if better:
            count += 1
            yield _exciting(count, better, best, (plane, experiment, limits))


def _exciting(number: int, wanted: Sequence[Untold], best: InputDesign, of: tuple[str, Experiment, Limits]) -> Proposal:
    plane, experiment, limits = of
    names = ", ".join(one.name for one in wanted)
    shown = [*experiment.surfaces, *experiment.limits]
    rows = tuple(
        Row(cells=(one.name, digits(one.given), _std(one.stated), _std(one.by_noise), _std(best.std[one.name])))
        for one in wanted
    )
    return Proposal(
        open=f"The motion in these records says less of {names} than the file does.",
        fly=f"{' and '.join(label_of(s) for s in experiment.surfaces)}: 3-2-1-1, as large as the limits allow",
        within=_in_words(limits, shown),
        tells="It alone would tell them with the 1σ in the last column, all other derivatives being free.",
        command=f"casid design --aircraft extended.toml --axes {plane} --free {' '.join(experiment.free)}",
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
