"""Report on the causes that a search found in a system: sizes, sentences, minor causes, and the verdict."""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Mapping, Sequence

import numpy as np
from scipy.special import expit

from casid.diagnosis.cause import Cause
from casid.diagnosis.causes import minor_trials, still_matters
from casid.diagnosis.criteria import Criteria
from casid.diagnosis.decision import Gate, all_passed
from casid.diagnosis.engine.held_out import Kept
from casid.diagnosis.engine.probability import Believed, Scale
from casid.diagnosis.engine.search import State
from casid.diagnosis.engine.size import meaningful_share
from casid.diagnosis.engine.trial import Trial
from casid.diagnosis.evidence.evidence import Evidence, deviation, sure
from casid.diagnosis.evidence.missing_input import MissingInput
from casid.diagnosis.evidence.screening import equivalence
from casid.diagnosis.flight.evaluation import FlightFit
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.systems.library import SENTENCES, level, told_limit, unit_of
from casid.diagnosis.systems.plant import Plant
from casid.diagnosis.systems.result import ParameterValue, SystemCause, Unexplained, name_of
from casid.model.station import reading

_EITHER = re.compile(r"\[([^|\]]*)\|([^\]]*)\]")  # words for a positive value, and for a negative one


def causes_of(plant: Plant, state: State, kept: Kept) -> tuple[list[Cause], list[Cause]]:
    """(causes, minor) of a search, strongest first.

    A cause is minor if the held-out records do not support it, or if it is not significant or not large enough beside
    the others.
    """
    evidence = kept.evidence
    there = {one.name: one for one in evidence.fit.attached}
    causes, minor = [], []
    for round_ in state.named:
        leader = round_.leader
        name = leader.candidate.name
        gates = tuple(kept.gates[name] for _ in "1" if name in kept.gates)
        if name in there:
            gates = (*gates, *sure(evidence, name, _records(evidence, there[name])), *still_matters(evidence.fit, name))
        one = there.get(name, leader.candidate.attached)
        passed = name in there and all_passed(gates)
        group, alike = (causes, round_.equivalents) if passed else (minor, ())
        if name in there or name in kept.gates:  # what another cause has superseded is not there
            group.append(_cause(plant, evidence, leader, one, alike, kept.gains.get(name), gates))
    return sorted(causes, key=lambda one: -one.statistic), minor


def small_cause(plant: Plant, state: State, seen: Sequence[Cause]) -> list[Cause]:
    """The clearest of the causes that the last round fitted beside those `seen` and found too small to matter."""
    small = [trial for trial in minor_trials(state, seen) if trial.share < 1.0][:1]
    return [_cause(plant, state.evidence, trial, trial.candidate.attached, (), None, ()) for trial in small]


def _records(evidence: Evidence, one: Attached) -> list[int]:
    return [r for r, name in enumerate(evidence.fit.batch.names) if one.concerns(name)]


def _cause(
    plant: Plant,
    evidence: Evidence,
    trial: Trial,
    one: Attached,
    equivalents: Sequence[Trial],
    held: float | None,
    gates: tuple[Gate, ...],
) -> Cause:
    fitted = {slot.name for slot in evidence.fit.slots}
    std = deviation(evidence, one.name, _records(evidence, one)) if one.name in fitted else trial.std
    value, std = _told(plant, one, std)
    unit = unit_of(one.effect, plant.base, plant.ports)
    effect = one.effect
    return Cause(
        kind=effect.kind,
        target=effect.target,
        term=effect.term,
        value=value,
        std=std,
        unit=unit,
        records=one.records,
        onset_s={record: (onset, onset) for record, onset in one.onsets.items()} or None,
        statistic=trial.gain.raw,
        dof=len(one.values),
        held_out_gain=held,
        indistinguishable_from=tuple(_named(other) for other in equivalents),
        sentence=_sentence(one, value, std, unit),
        parameters={},
        meaningful=trial.meaningful,
        share=meaningful_share(evidence.fit, one),
        gates=gates,
    )


def _named(trial: Trial) -> Mapping[str, object]:
    return {"kind": trial.effect.kind, "target": trial.effect.target, "term": trial.effect.term}


def _told(plant: Plant, one: Attached, std: float) -> tuple[float, float]:
    """Value and 1-sigma for the report: of a limit, or of the level at which a reading is stuck."""
    effect, value = one.effect, one.effect.in_words(one.values)["value"]
    if effect.timed:
        concerned = [record for record in plant.records if one.concerns(record.name) and effect.target in record]
        read = [record[effect.target][record.t > one.onsets[record.name]] for record in concerned]
        seen = np.concatenate([values[np.isfinite(values)] for values in read])
        return level(seen), plant.sigma[effect.target] / math.sqrt(max(len(seen), 1))
    if effect.kind in ("limit_above", "limit_below"):
        value = told_limit(effect, value, [record[effect.target] for record in plant.records])
    return value, std


def _sentence(one: Attached, value: float, std: float, unit: str) -> str:
    words = _EITHER.sub(lambda either: either[1 if value >= 0.0 else 2], SENTENCES[one.effect.kind])
    shown = value if words == SENTENCES[one.effect.kind] else abs(value)
    where = f" in {', '.join(one.records)}" if one.records else ""
    if one.onsets:
        where = " in " + ", ".join(f"{name} from {onset:.3g} s" for name, onset in one.onsets.items())
    size = f"{shown:.4g} +- {std:.2g}" + (f" {unit}" if unit else "")
    return words.format(target=one.effect.target, term=one.effect.term, size=size, where=where)


def system_cause(cause: Cause, criteria: Criteria | None = None) -> SystemCause:
    """A cause for the result; with `criteria`, its probability follows from its statistic alone."""
    others = tuple(
        (name_of(one["kind"], one["target"], one["term"]), float(one.get("probability", 0.0)))
        for one in cause.indistinguishable_from
    )
    log_odds, probability = cause.log_odds, cause.probability
    if criteria is not None:
        log_odds = Scale(criteria=criteria).against_nothing(cause.statistic, criteria.naming.gain)
        probability = criteria.priors.tempered(float(expit(log_odds)))
    return SystemCause(
        kind=cause.kind,
        target=cause.target,
        term=cause.term,
        value=cause.value,
        std=cause.std,
        unit=cause.unit,
        records=cause.records,
        onset_s={record: first for record, (first, _) in cause.onset_s.items()} if cause.onset_s else None,
        probability=float(probability or 0.0),
        alone=float(cause.alone if cause.alone is not None else probability or 0.0),
        log_odds=float(log_odds or 0.0),
        held_out_gain=cause.held_out_gain,
        indistinguishable_from=others,
        sentence=cause.sentence,
        share=cause.share,
    )


def unexplained_at(plant: Plant, missing: Sequence[MissingInput], belief: Believed) -> tuple[Unexplained, ...]:
    """The port at which something enters that no cause explains: the one with the largest statistic of a latent input.
    Among ports with nearly equal statistics it is an input, because its effect enters an equation too.
    """
    if not missing:
        return ()
    near = equivalence(missing[0].gain, plant.criteria)
    alike = [one for one in missing if missing[0].gain - one.gain < near]
    ports = {port.disturbance if port.kind != "output" else reading(port.name): port for port in plant.ports}
    best = next((one for one in alike if ports[one.station].kind == "input"), missing[0])
    return (Unexplained(port=ports[best.station], probability=belief.entered[best.station]),)


def values_of(plant: Plant, refitted: FlightFit, extended: FlightFit) -> tuple[ParameterValue, ...]:
    """The parameters that were fitted: nominal, and in the model without and with causes."""
    base = plant.base
    return tuple(
        ParameterValue(
            name=name,
            unit=base.units.get(name, ""),
            nominal=base.nominal[name],
            prior_std=base.prior_std.get(name, math.inf),
            refitted=refitted[name],
            refitted_std=refitted.std(name),
            extended=extended[name],
            extended_std=extended.std(name),
        )
        for name in plant.freed
    )


def headline(
    verdict: str,
    causes: Sequence[SystemCause],
    minor: Sequence[SystemCause],
    unexplained: Sequence[Unexplained],
    values: Sequence[ParameterValue],
) -> str:
    """The sentence of a verdict."""
    if verdict == "partly explained":
        return f"{causes[0].sentence} Besides, something unexplained is left."
    if verdict == "explained":
        return " ".join(one.sentence for one in causes)
    if verdict == "unexplained":
        return unexplained[0].sentence
    if verdict == "values wrong":
        wrong = ", ".join(one.name for one in values if one.contradicted)
        return f"The structure holds; the records contradict the value of {wrong}."
    small = " The other effects are too small to matter." if minor else ""
    return f"The model explains the records to within their noise.{small}"


def contributions(
    values: Sequence[ParameterValue], named: Sequence[SystemCause], unexplained: Sequence[Unexplained]
) -> dict[str, list[str]]:
    """Step of the account -> what contributes to it, the largest first."""
    moved = [one for one in values if one.contradicted and one.nominal]
    moved.sort(key=lambda one: -abs(one.extended - one.nominal) / max(one.extended_std, sys.float_info.min))
    return {
        "values": [f"{one.name} {100.0 * (one.extended / one.nominal - 1.0):+.0f} %" for one in moved],
        "structure": [f"{one.target}: {one.kind.replace('_', ' ')}" for one in named],
        "unexplained": [one.port.words for one in unexplained],
    }
