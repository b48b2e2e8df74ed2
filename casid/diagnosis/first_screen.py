"""The first screen of a diagnosis: verdict, causes, shares of the error, worst channel, and what to do next.

The page, the terminal and diagnosis.json show the same lines. Nothing is decided here.
"""

from __future__ import annotations

import math
import shlex
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

from casid.design.level_flight import plane_of
from casid.design.next_flight import Question, Untold
from casid.diagnosis.cause import Cause
from casid.diagnosis.claims import percents, times
from casid.diagnosis.document import Called, Document, NextStep
from casid.frames import Rows
from casid.model.aircraft import Aircraft
from casid.model.effect import Effect
from casid.model.numbers import digits
from casid.model.station import Station
from casid.model.vocabulary import LABELS, title_of
from casid.signals import SURFACES, label_of

_ORDER = ("data", "values", "structure", "unexplained", "noise")  # of the shares in their bar


@dataclass(frozen=True, kw_only=True)
class Share:
    """A part of the error as given: the step that removes it, in whole per cent, and what the step consists of."""

    step: str
    percent: int
    what: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class Found:
    """A sentence of what was found: a cause with its number from 1 and its probability, or else 0 and None."""

    sentence: str
    probability: float | None = None
    cause: int = 0


@dataclass(frozen=True, kw_only=True)
class FirstScreen:
    """The lines that a diagnosis opens with.

    `shares` are empty where the simulation as given flies the records or diverges. `values` are changes of values that
    left their stated uncertainty, beside those that the shares list.
    """

    verdict: str
    found: tuple[Found, ...]
    shares: tuple[Share, ...]
    values: tuple[str, ...]
    worst: str

    @classmethod
    def of(cls, document: Document) -> FirstScreen:
        """Return the first screen of a diagnosis."""
        flown = next((one.said for one in document.claims), False)
        shares = () if flown else tuple(_shares(document))
        return cls(
            verdict=_verdict(document),
            found=tuple(_found(document)),
            shares=shares,
            values=tuple(_values(document, shares)),
            worst=_worst(document),
        )


def _verdict(document: Document) -> str:
    """Return the verdict in one sentence."""
    where = f"On {', '.join(document.budget.records)}, which no fit has seen,"
    steps = document.budget.together
    left = f"{times(steps.structure)} the noise"
    as_given = f"is off by {times(steps.as_given)} the noise" if math.isfinite(steps.as_given) else "diverges"
    off = f"{where} the simulation as given {as_given}"
    if document.verdict == "data at fault":
        return "The data are at fault; nothing else can be judged before they are corrected."
    if any(one.impossible for one in document.contradicted):
        return f"The {document.source} has numbers that cannot be right; nothing else can be judged before that."
    if document.verdict == "adequate":
        return f"{where} the simulation as given stays within the noise ({times(steps.as_given)}): nothing is missing."
    if document.causes:
        count = len(document.causes)
        named = "the cause" if count == 1 else f"the {count} causes"
        rest = "" if document.verdict == "explained" else ", so that more is missing"
        if steps.structure > document.criteria.parts.clearly * max(steps.values, steps.floor):
            return f"{off}; re-estimated values alone leave {times(steps.values)}, with {named} below {left}{rest}."
        return f"{off}; with {named} below and re-estimated values, {left} is left{rest}."
    if document.verdict == "values wrong":
        return f"{off}; with re-estimated values alone, {left} is left: numbers of the {document.source} are wrong."
    return f"{off}; with re-estimated values, {left} is left, which {document.no_cause}."


def _found(document: Document) -> Iterator[Found]:
    """Return the named causes, and what else the verdict rests on."""
    rest = document.headline
    for number, one in enumerate(document.causes, 1):
        rest = rest.replace(one.statement, "", 1)
        yield Found(sentence=one.statement, probability=one.probability, cause=number)
    if rest.strip():
        yield Found(sentence=rest.strip())


def _shares(document: Document) -> Iterator[Share]:
    whole = percents(document.account)
    found = sorted(zip(document.account, whole, strict=True), key=lambda pair: _ORDER.index(pair[0].step))
    yield from (Share(step=one.step, percent=percent, what=one.what) for one, percent in found if percent)


def _values(document: Document, shares: Sequence[Share]) -> Iterator[str]:
    """Return the values that left their stated uncertainty and are in no share."""
    if document.verdict == "data at fault":
        return
    told = {what for one in shares if one.step == "values" for what in one.what}
    for one in document.moved:
        if one.change not in told:
            yield one.change + ("" if one.identifiable else " (not identifiable)")


def _worst(document: Document) -> str:
    """Return the channel that is worst as given, with its error before and after."""
    channels = document.budget.channels
    if not channels:
        return ""
    name = document.budget.worst()[0]
    steps = channels[name]
    label = document.budget.labels.get(name, name)
    given = f"{times(steps.as_given)} the noise" if math.isfinite(steps.as_given) else "diverges"
    called = label if label == name else f"{label} {name}"
    return f"{called}: {given} as given, {times(steps.structure)} with the {document.best}"


def text(document: Document) -> str:
    """Return the first screen as text: five lines and the table of the channels, then what is minor or not judged."""
    screen = FirstScreen.of(document)
    lines = [f"{document.verdict}: {screen.verdict}"]
    for one in screen.found:
        sure = "" if one.probability is None else f" ({_sure(one.probability)})"
        lines.append(f"{'cause' if one.cause else 'finding'}: {one.sentence}{sure}")
    if screen.shares:
        lines.append(f"shares of the error as given: {'; '.join(map(_part, screen.shares))}")
    if screen.values:
        lines.append(f"values that left their stated uncertainty: {', '.join(screen.values)}")
    lines += [f"worst: {screen.worst}"] if screen.worst else []
    lines += map(str, document.next)
    lines += ["", *_table(document), ""]
    lines += [f"data, {one.handled}: {one.sentence}" for one in document.data]
    lines += [f"values: {one.sentence}" for one in (*document.factors, *document.contradicted, *document.combinations)]
    lines += [f"minor: {one.sentence}" for one in document.minor]
    lines += [f"not judged: {one.what} ({one.because})" for one in document.not_judged]
    return "\n".join(lines).rstrip("\n")


def _part(one: Share) -> str:
    return f"{one.step} {one.percent} %" + (f" ({', '.join(one.what)})" if one.what else "")


def _sure(probability: float) -> str:
    """Return a probability in per cent, never 0 or 100 of what is neither."""
    if probability > 0.995:
        return "more than 99 % probable"
    return "less than 1 % probable" if probability < 0.005 else f"{100.0 * probability:.0f} % probable"


def _table(document: Document) -> list[str]:
    """Return the error of every channel after each step, worst as given first."""
    found = document.budget
    rows = {"all channels": found.together} | {name: found.channels[name] for name in found.worst()}
    steps = {"as given": "as_given", "data corrected": "data_mended", "values": "values", "causes": "structure"}
    cells = [(name, *(_ratio(getattr(one, step)) for step in steps.values())) for name, one in rows.items()]
    return Rows(heads={"error / noise": "", **dict.fromkeys(steps, "s")}, rows=cells).text().split("\n")


def _ratio(value: float) -> str:
    return digits(value, 2) if math.isfinite(value) else "diverges"


# -- what to do next ---------------------------------------------------------------------------------------------------


def next_steps(
    document: Document,
    causes: Sequence[Cause],
    questions: Sequence[Question],
    unmoved: Sequence[Untold],
    called: Called,
) -> tuple[NextStep, ...]:
    """Return what to do now, the most useful first.

    `questions` are those that a manoeuvre may answer, and `unmoved` the values that the records did not excite.
    """
    return tuple(_steps(document, causes, questions, unmoved, called))


def _steps(
    document: Document,
    causes: Sequence[Cause],
    questions: Sequence[Question],
    unmoved: Sequence[Untold],
    called: Called,
) -> Iterator[NextStep]:
    aircraft = document.aircraft
    again = f"{called.records} --aircraft {called.aircraft}"
    if document.verdict == "data at fault":
        what = ", ".join(dict.fromkeys(one.target for one in document.data)) or "the data"
        yield NextStep(
            text=f"Correct {what} in the records, or leave it out, and diagnose again. The check shows the faults:",
            command=f"casid check {again} --out {called.inside('check')}" if aircraft else "",
        )
        return
    if any(one.impossible for one in document.contradicted):
        names = ", ".join(one.parameter for one in document.contradicted if one.impossible)
        yield NextStep(text=f"Correct {names} in the {document.source} and diagnose again.")
        return
    extended = called.inside("extended.toml")
    kept = aircraft is not None and not causes and not document.moved and document.verdict == "adequate"
    if aircraft is not None and not kept:
        named = [] if not causes else ["the named cause" if len(causes) == 1 else "the named causes"]
        what = " and ".join([*named, "re-estimated values"])
        yield NextStep(
            text=f"Fly the extended file, extended.toml, which has {what}, beside the one as given:",
            command=f"casid simulate {again} {extended} --out {called.inside('simulate')}",
        )
    if document.coefficients:
        before = "" if kept else f" --diagnosis {called.folder}"
        yield NextStep(
            text="Prove the match by the tolerances of a standard" + (":" if kept else ", before and after:"),
            command=f"casid match {again}{before} --out {called.inside('match')}",
        )
    for one in dict.fromkeys(_measurement(cause.effect) for cause in causes):
        if one:
            yield NextStep(text=one)
    flyable = [one for one in questions if not any(effect.timed or effect.stochastic for effect in one.effects)]
    for question in flyable[:1] if document.coefficients else ():
        first, second = question.effects
        asked = " ".join(
            shlex.quote(f"{effect.name}={value.value:.4g}")
            for effect, value in ((first, question.first), (second, question.second))
        )
        yield NextStep(
            text=f"Fly a manoeuvre that tells {title_of(first)} from {title_of(second)}{_with_trim(aircraft)}:",
            command=f"casid design --aircraft {extended} --separate {asked} --out {called.inside('design')}",
        )
    for plane in ("longitudinal", "lateral") if document.coefficients else ():
        names = [one.name for one in unmoved if plane_of(one.name.partition("_")[0]) == plane]
        if names:
            yield NextStep(
                text=f"Excite {', '.join(names)}, of which these records say less than the file{_with_trim(aircraft)}:",
                command=f"casid design --aircraft {extended} --axes {plane} --free {' '.join(names)} "
                f"--out {called.inside(f'design-{plane}')}",
            )
    if document.unexplained or document.left:
        yield NextStep(
            text="Read which causes came nearest, and what refused them:", command=f"casid why {called.folder}"
        )


def _with_trim(aircraft: Aircraft | None) -> str:
    """Return what a design needs of a file that has no flight point; empty if it has one."""
    trim = {} if aircraft is None else aircraft.trim
    return (
        ""
        if "V" in trim and {"altitude", "rho"} & set(trim)
        else " (first give extended.toml V and altitude in [trim])"
    )


# what an engineer measures to confirm a cause, by the place where it acts
_MEASURED: Mapping[str, str] = MappingProxyType(
    {
        "control": "Record the position of the {label} beside its command: it shows this cause directly.",
        "input": "Record {label} where it acts, beside its command: it shows this cause directly.",
        "rotors": "Run {label} on a thrust stand: it shows this cause directly.",
        "instrument": "Calibrate the reading of {label} on the ground, or record a second instrument beside it.",
        "mass": "Weigh the aircraft as it was flown, and measure its centre of gravity.",
        "moments": "Weigh the aircraft as it was flown, and measure its centre of gravity and thrust line.",
        "wind": "Fly the manoeuvres again in calm air: a cause of the aircraft stays.",
        "coefficient": "Fly the manoeuvres again at other amplitudes: a missing term keeps its size.",
    }
)


def _measurement(effect: Effect) -> str:
    """Return the measurement that confirms or refutes a cause; empty where there is none."""
    place = Station.at(effect.enters).kind if effect.enters else ""
    if effect.unit_at_port is not None:  # of a system whose names are its own
        return _MEASURED["input"].format(label=effect.target) if place == "control" else ""
    if effect.target in SURFACES and place != "coefficient":
        place = "control"
    elif effect.station == "rotors":
        place = "rotors"
    elif effect.of_an_instrument and place != "wind":
        place = "instrument"
    elif effect.station in ("mass", "moments"):
        place = effect.station
    return _MEASURED.get(place, "").format(label=LABELS.get(effect.target, label_of(effect.target)))
