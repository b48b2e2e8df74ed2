"""Design what to fly next: the manoeuvres that would separate what stayed ambiguous, and excite what rested."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from casid.design.experiment import Experiment
from casid.design.input_design import InputDesign, standard_3211
from casid.design.level_flight import SURFACES, Limits, experiment_of, level_rivals, plane_of
from casid.design.separation import NextFlight, NoManoeuvre, Rivals, separating_manoeuvre, separation
from casid.errors import CasidError
from casid.model.aircraft import Aircraft
from casid.model.effect import Effect
from casid.model.effect_value import EffectValue
from casid.model.effects import effect_of
from casid.records.record import Record
from casid.records.thinning import thinned

_RATE_HZ = 25.0
_LONGEST = 10.0  # s
_LIMITED = ("alpha", "beta", "az", "ay")
# questions that a flight is sought for until one is found, and all: a search takes seconds
_TRIED = 2
_ASKED = 6
_DEFLECTION = np.radians(3.0)  # rad, of a surface that the records did not move


@dataclass(frozen=True, eq=False, kw_only=True)
class Question:
    """Two effects between which a flight would decide: a named cause and one that these records cannot separate from
    it, or the two nearest to a latent input at a `port`; `fault` is the reason why no manoeuvre is proposed, if one was
    `sought`."""

    first: EffectValue
    second: EffectValue
    port: str = ""
    fault: str = ""
    sought: bool = True

    @property
    def effects(self) -> tuple[Effect, Effect]:
        return effect_of(self.first), effect_of(self.second)


@dataclass(frozen=True, eq=False, kw_only=True)
class Separating:
    """The manoeuvre that answers a question best, within its limits, and the expected log odds of the fitted records
    together by the same measure."""

    question: Question
    rivals: Rivals
    best: NextFlight
    before: float
    limits: Limits


@dataclass(frozen=True, eq=False, kw_only=True)
class Exciting:
    """A 3-2-1-1 in one plane for derivatives that the records did not excite."""

    wanted: tuple[Untold, ...]
    best: InputDesign
    plane: str
    experiment: Experiment
    limits: Limits


@dataclass(frozen=True, eq=False, kw_only=True)
class NextFlights:
    """Manoeuvres to fly next, and the questions that no manoeuvre of one surface answers."""

    flights: tuple[Separating | Exciting, ...] = ()
    beyond: tuple[Question, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Untold:
    """A number of the file that these records do not determine: its 1-sigma as the file states it, NaN where it does
    not. Standard deviation by the noise of these records alone, infinite without any information; and corrected."""

    name: str
    given: float
    stated: float
    by_noise: float
    corrected: float

    def unmoved(self, least: float) -> bool:
        """Return True if it was not excited: by noise alone, less than `least` of what is known would come from the
        records."""
        return not self.stated**2 / (self.stated**2 + self.by_noise**2) > least


@dataclass(frozen=True, eq=False, kw_only=True)
class Setting:
    """Who flies next, and what has been flown."""

    aircraft: Aircraft  # the aircraft that is to fly
    records: Sequence[Record]  # what was flown; a manoeuvre goes no further from trim
    resting: Sequence[str]  # surfaces that did not move in these records
    noise: Mapping[str, float]  # output -> 1-sigma of the noise of its samples


def next_flights(questions: Iterable[Question], unmoved: Sequence[Untold], setting: Setting) -> NextFlights:
    """Design a flight for the first question that a manoeuvre can answer, and for numbers that were not excited."""
    flown = [thinned(record, _RATE_HZ) for record in setting.records]
    setting = replace(setting, aircraft=_at_trim(setting.aircraft, flown))
    limits = _limits(flown)
    found: list[Separating | Exciting] = []
    beyond: list[Question] = []
    for count, question in enumerate(islice(questions, _ASKED)):
        if found or count >= _TRIED:
            beyond.append(replace(question, sought=False))
            continue
        try:
            rivals, experiment = level_rivals(setting.aircraft, question.first, question.second, limits, setting.noise)
            best = separating_manoeuvre(rivals, experiment)
            before = 0.0 if isinstance(best, NoManoeuvre) else separation(rivals, flown).log_odds
        except CasidError as fault:
            beyond.append(replace(question, fault=str(fault)))
            continue
        if isinstance(best, NoManoeuvre):
            beyond.append(replace(question, fault=best.reason))
        elif best.separation.tells_apart:
            found.append(Separating(question=question, rivals=rivals, best=best, before=before, limits=limits))
        else:
            beyond.append(question)
    return NextFlights(flights=(*found, *_for_untold(unmoved, setting, limits)), beyond=tuple(beyond))


def _at_trim(aircraft: Aircraft, flown: Sequence[Record]) -> Aircraft:
    """Return the aircraft with the trim that its file has, else that of the records."""
    if "V" in aircraft.trim and {"altitude", "rho"} & set(aircraft.trim):
        return aircraft
    there = [name for name in ("V", "rho") if any(name in r for r in flown)]
    own = {name: float(np.nanmedian(_series(flown, name))) for name in there}
    return replace(aircraft, trim={**aircraft.trim, **own})


def _series(flown: Sequence[Record], name: str) -> np.ndarray:
    return np.concatenate([r[name] for r in flown if name in r])


def _limits(flown: Sequence[Record]) -> Limits:
    """No further from the middle than the records went."""

    def reach(name: str) -> float:
        series = _series(flown, name)
        return float(np.nanmax(np.abs(series - np.nanmedian(series))))

    def moved(names: Sequence[str]) -> dict[str, float]:
        there = [name for name in names if any(name in r for r in flown)]
        return {name: reach(name) for name in there if reach(name) > 0.0}

    return Limits(
        surfaces=moved(SURFACES["full"]),
        channels=moved(_LIMITED),
        duration=min(_LONGEST, *(record.duration for record in flown)),
    )


def _for_untold(untold: Sequence[Untold], setting: Setting, limits: Limits) -> Iterator[Exciting]:
    """A 3-2-1-1 for the derivatives that these records did not excite, plane by plane."""
    unmoved = {one.name: one for one in untold}
    resting = dict.fromkeys(setting.resting, _DEFLECTION)
    limits = replace(limits, surfaces={**resting, **limits.surfaces})
    for plane in ("longitudinal", "lateral"):
        wanted = [name for name in unmoved if plane_of(name.partition("_")[0]) == plane]
        if not wanted:
            continue
        try:
            experiment = experiment_of(setting.aircraft, plane, limits, noise=setting.noise)
            best = standard_3211(experiment)
        except CasidError:
            continue  # nothing of this plane may move, or there is no trim
        better = tuple(unmoved[n] for n in wanted if n in best.std and best.std[n] < unmoved[n].by_noise)
        if better:
            yield Exciting(wanted=better, best=best, plane=plane, experiment=experiment, limits=limits)
