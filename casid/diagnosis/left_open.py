"""List what a diagnosis leaves open, as questions that a flight may answer."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from casid.design.next_flight import Question, Untold
from casid.diagnosis.cause import Cause
from casid.diagnosis.engine.trial import Round
from casid.diagnosis.evidence.missing_input import MissingInput
from casid.diagnosis.facts import Parameter
from casid.diagnosis.flight.flight import resting
from casid.diagnosis.flight.subject import Subject
from casid.model.aircraft import Aircraft
from casid.model.effect_value import EffectValue
from casid.model.vocabulary import KINDS


def questions(
    causes: Sequence[Cause], unexplained: Sequence[MissingInput], rounds: Sequence[Round]
) -> Iterator[Question]:
    """The two effects between which a flight would decide, for each cause with an equal and each latent input."""
    for cause in causes:
        for other in cause.indistinguishable_from:
            second = _other(rounds, other)
            if second is not None:
                yield Question(first=_everywhere(cause.entry), second=second)
    for missing in unexplained:
        near = [
            one.attached
            for one in (rounds[-1].candidates if rounds else ())
            if one.attached.effect.enters == missing.station and not one.attached.effect.stochastic
        ]
        if len(near) > 1:
            first, second = (_everywhere(one.entry) for one in near[:2])
            yield Question(first=first, second=second, port=missing.station)


def _everywhere(entry: EffectValue) -> EffectValue:
    """The effect in all records, and from their beginning."""
    return replace(entry, std=0.0, records=(), onset_s=None, sentence="")


def _other(rounds: Sequence[Round], other: Mapping[str, Any]) -> EffectValue | None:
    """Return the rival that a cause cannot be separated from, with the size that was fitted or predicted; None where
    there is none."""
    key = other["kind"], other["target"], other["term"]
    trials = [trial.candidate.attached for round_ in rounds for trial in round_.trials]
    fitted = next((one for one in trials if one.effect.key == key), None)
    if fitted is not None:
        return _everywhere(fitted.entry)
    if "value" not in other or other["kind"] not in KINDS:  # a fault of the data is not flown
        return None
    return EffectValue(kind=other["kind"], target=other["target"] or "", term=other["term"], value=other["value"])


def untold(parameters: Iterable[Parameter], aircraft: Aircraft, flight: Subject) -> Iterator[Untold]:
    """Numbers of the aircraft file that the records of a flight do not determine, with those of surfaces that
    rested."""
    relative = aircraft.relative_uncertainty or np.nan
    for one in parameters:
        if one.flight.determined:
            continue
        stated = relative * abs(one.a_priori)
        own = 1.0 / one.cramer_rao[1] ** 2 - (1.0 / stated**2 if stated > 0.0 else 0.0)  # without the file's own word
        by_noise = own**-0.5 if own > 0.0 else np.inf
        yield Untold(name=one.name, given=one.a_priori, stated=stated, by_noise=by_noise, corrected=one.flight.std)
    for name, value in flight.aircraft.derivatives.items():
        if any(name.endswith(f"_{surface}") for surface in resting(flight.records)):
            yield Untold(name=name, given=value, stated=relative * abs(value), by_noise=np.inf, corrected=np.inf)
