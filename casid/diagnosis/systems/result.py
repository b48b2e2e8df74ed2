"""The result of the diagnosis of a dynamic system, in words and as the document of diagnosis.json."""

from __future__ import annotations

import json
import math
import re
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import expit

from casid.diagnosis.cause import Cause, Gate, Trace, all_passed
from casid.diagnosis.causes import minor_trials, still_matters
from casid.diagnosis.criteria import Criteria
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
from casid.diagnosis.given.budget import AccountStep, Budget
from casid.diagnosis.systems.extended import Extended, Flown
from casid.diagnosis.systems.library import SENTENCES, level, told_limit, unit_of
from casid.diagnosis.systems.plant import Plant
from casid.keeping import whole_file
from casid.model.port import ModelPort as Port
from casid.model.station import reading
from casid.model.system import Model
from casid.records.record import Record

SCHEMA = "casid.diagnosis/3"


def name_of(kind: str, target: str, term: str | None) -> str:
    """Name of a cause, as "actuator_lag(voltage)" or "missing_term(speed:speed^2)"."""
    return f"{kind}({target}:{term})" if term else f"{kind}({target})"


@dataclass(frozen=True, kw_only=True)
class SystemCause:
    """A named cause.

    Attributes
    ----------
    value, std
        Its size in `unit`, and the 1-sigma by Cramer-Rao.
    probability
        Of the cause or one of those that cannot be separated from it.
    alone
        Probability of the cause itself.
    log_odds
        Of the best fitted model with the cause against the best one without it.
    held_out_gain
        Log likelihood per reading on the held-out records that is lost when the cause is left out.
    onset_s
        Record -> time [s] of the onset; None: it always acts.
    share
        Its size in units of the smallest one that matters at its port or in an output, whichever is larger.

    Examples
    --------
    >>> import casid as cs
    >>> found = cs.diagnose(model, records, hold_out=unseen)  # doctest: +SKIP
    >>> [(cause.sentence, cause.probability) for cause in found.causes]  # doctest: +SKIP
    """

    kind: str
    target: str
    term: str | None
    value: float
    std: float
    unit: str
    records: tuple[str, ...]
    onset_s: Mapping[str, float] | None
    probability: float
    alone: float
    log_odds: float
    held_out_gain: float | None
    indistinguishable_from: tuple[tuple[str, float], ...]
    sentence: str
    share: float

    @property
    def name(self) -> str:
        """As "input_lag(voltage)"."""
        return name_of(self.kind, self.target, self.term)

    def to_dict(self) -> dict[str, Any]:
        """One entry of `causes` or `minor` of diagnosis.json.

        Returns
        -------
        dict
            Numbers, texts, lists and tables, as JSON holds them.
        """
        others = [{"name": name, "probability": p} for name, p in self.indistinguishable_from]
        return {
            "kind": self.kind,
            "target": self.target,
            "term": self.term,
            "value": self.value,
            "std": self.std,
            "unit": self.unit,
            "records": list(self.records),
            "onset_s": {r: [t, t] for r, t in self.onset_s.items()} if self.onset_s else None,
            "probability": self.probability,
            "log_odds": self.log_odds,
            "held_out_gain": self.held_out_gain,
            "indistinguishable_from": others,
            "sentence": self.sentence,
            "share": self.share,
        }


@dataclass(frozen=True, kw_only=True)
class Unexplained:
    """A latent input at a port: its probability, and its size in units of the size that matters."""

    port: Port
    probability: float

    @property
    def sentence(self) -> str:
        """In words."""
        return f"Something that no cause of the library explains enters at {self.port.words}."


@dataclass(frozen=True, kw_only=True)
class ParameterValue:
    """A parameter of the model: nominal, fitted and in the extended model, each fit with its 1-sigma."""

    name: str
    unit: str
    nominal: float
    prior_std: float
    refitted: float
    refitted_std: float
    extended: float
    extended_std: float

    @property
    def contradicted(self) -> bool:
        """Whether the records are inconsistent with the nominal value: the difference exceeds its stated uncertainty
        (10 % if none is stated), and three standard deviations of the fit."""
        margin = self.prior_std if math.isfinite(self.prior_std) else 0.1 * abs(self.nominal)
        return abs(self.extended - self.nominal) > max(margin, 3.0 * self.extended_std)

    def to_dict(self) -> dict[str, Any]:
        """One entry of `parameters`."""
        return {
            "unit": self.unit,
            "a_priori": self.nominal,
            "refitted": {"value": self.refitted, "std": self.refitted_std},
            "extended": {"value": self.extended, "std": self.extended_std},
        }

    def contradiction(self) -> dict[str, Any]:
        """One entry of `contradicted`."""
        return {
            "parameter": self.name,
            "unit": self.unit,
            "given": self.nominal,
            "flight": self.extended,
            "std": self.extended_std,
            "sentence": f"{self.name} is {self.nominal:.4g} in the model; the records say {self.extended:.4g} "
            f"+- {self.extended_std:.2g}.",
        }


@dataclass(frozen=True, eq=False, kw_only=True)
class SystemDiagnosis:
    """The verdict on a simulation of any dynamic system, and the evidence behind it.

    Attributes
    ----------
    verdict
        "adequate", "values wrong", "explained", "partly explained" or "unexplained".
    model
        As it was given.
    extended
        With the named causes and fitted values: `extended.model`, whose records are `extended.prepared(record)`, and
        `values` of its parameters.
    causes, minor
        Named, and real but too small to matter; strongest first.
    unexplained
        Ports at which something enters that no cause explains.
    explanations
        Sets of causes that were fitted -> probability.
    as_given, refitted, extension
        Open-loop simulations of the held-out records: r.m.s. over noise of each output.
    budget
        The same as a table of steps.
    noise
        Output -> 1-sigma of the noise.
    held_out
        The records of these simulations, which no fit has seen.
    seconds
        Wall time.
    account
        Shares of the error on the held-out records that values and structure take away, the largest first.
    trace
        The decisions on every cause that was fitted, see `why` and `why_not`.

    Examples
    --------
    >>> import casid as cs
    >>> found = cs.diagnose(model, records, hold_out=unseen)  # doctest: +SKIP
    >>> found.verdict, found.extended.values  # doctest: +SKIP
    """

    verdict: str
    sentence: str
    model: Model
    extended: Extended
    values: Mapping[str, float]
    causes: tuple[SystemCause, ...]
    minor: tuple[SystemCause, ...]
    unexplained: tuple[Unexplained, ...]
    explanations: Mapping[frozenset[str], float]
    parameters: tuple[ParameterValue, ...]
    as_given: Flown
    refitted: Flown
    extension: Flown
    budget: Budget
    noise: Mapping[str, float]
    held_out: tuple[Record, ...]
    seconds: float
    trace: Trace = Trace()
    account: tuple[AccountStep, ...] = ()

    def why(self, cause: str) -> Trace:
        """The decisions on a cause that was fitted, as of `Diagnosis.why`.

        Parameters
        ----------
        cause
            Name of the cause.

        Returns
        -------
        Trace
            The gates of the cause.
        """
        return self.trace.of(cause)

    def why_not(self, cause: str) -> Trace:
        """The decisions that kept a cause from being named, as of `Diagnosis.why_not`.

        Parameters
        ----------
        cause
            Name of the cause.

        Returns
        -------
        Trace
            The gates that the cause did not pass.
        """
        return self.trace.against(cause)

    @property
    def contradicted(self) -> tuple[ParameterValue, ...]:
        """Values of the model that are inconsistent with the records."""
        return tuple(one for one in self.parameters if one.contradicted)

    def __str__(self) -> str:
        lines = [f"verdict: {self.verdict}", self.sentence]
        lines += [f"  - {one.sentence} (probability {one.probability:.2f})" for one in self.causes]
        lines += [f"  - minor: {one.sentence}" for one in self.minor]
        lines += [f"  - {one.sentence} (probability {one.probability:.2f})" for one in self.unexplained]
        lines += [f"  - {one.contradiction()['sentence']}" for one in self.contradicted]
        steps = self.budget.together
        lines.append(
            f"held-out {', '.join(self.budget.records)}: residual over noise {steps.as_given:.3g} as given, "
            f"{steps.values:.3g} refitted, {steps.structure:.3g} extended"
        )
        return "\n".join(lines)

    def to_dict(self) -> dict[str, Any]:
        """The document of diagnosis.json, as far as it speaks of any system.

        Returns
        -------
        dict
            Numbers, texts, lists and tables, as JSON holds them.
        """
        before, after = self.as_given, self.extension
        ratio = {name: after.rms[name] / rms for name, rms in before.rms.items() if rms > 0.0}
        return {
            "schema": SCHEMA,
            "system": self.model.name,
            "verdict": self.verdict,
            "sentence": self.sentence,
            "not_judged": [],
            "data": [],
            "account": [one.to_dict() for one in self.account],
            "contradicted": [one.contradiction() for one in self.contradicted],
            "causes": [one.to_dict() for one in self.causes],
            "minor": [one.to_dict() for one in self.minor],
            "unexplained": [
                {"port": one.port.name, "kind": one.port.kind, "probability": one.probability, "sentence": one.sentence}
                for one in self.unexplained
            ],
            "decisions": [one.to_dict() for one in self.trace.decisions],
            "explanations": [{"causes": sorted(names), "probability": p} for names, p in self.explanations.items()],
            "budget": self.budget.to_dict(),
            "as_given": _channels(self.as_given, self.noise),
            "refitted": _channels(self.refitted, self.noise),
            "extended": _channels(self.extension, self.noise),
            "gain": {
                "held_out": {
                    "records": list(before.records),
                    "rms_ratio": dict(sorted(ratio.items(), key=lambda item: -item[1])),
                    "log_likelihood_per_sample": after.log_likelihood - before.log_likelihood,
                }
            },
            "parameters": {one.name: one.to_dict() for one in self.parameters},
            "seconds": {"all": self.seconds},
        }

    def write(self, path: str | Path) -> None:
        """Write diagnosis.json whole or not at all; a number that is not finite becomes null.

        Parameters
        ----------
        path
            Name of the file.
        """
        with whole_file(path) as temporary:
            temporary.write_text(json.dumps(_plain(self.to_dict()), indent=1, allow_nan=False), encoding="utf-8")


def _channels(flown: Flown, noise: Mapping[str, float]) -> dict[str, Any]:
    channels = {name: {"rms": rms * noise[name], "noise": noise[name]} for name, rms in flown.rms.items()}
    return {"channels": channels, "log_likelihood": flown.log_likelihood * flown.readings}


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(v) for v in value]
    if isinstance(value, (bool, str, int)) or value is None:
        return value
    return float(value) if math.isfinite(value) else None


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
