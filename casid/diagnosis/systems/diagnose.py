"""Diagnose a simulation of any dynamic system: what does it get wrong, where does it enter, what is it worth?"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np

from casid.arguments import an
from casid.diagnosis.criteria import Criteria
from casid.diagnosis.decision import IN_A_SET, MINOR, NAMED, REFUSED, Decision, Gate, Trace, at_least
from casid.diagnosis.engine.held_out import split
from casid.diagnosis.given.account import account_of, account_sentence, failure_sentence
from casid.diagnosis.given.budget import Budget, BudgetSteps
from casid.diagnosis.systems.criteria import SystemCriteria
from casid.diagnosis.systems.extended import Extended
from casid.diagnosis.systems.fit import Flown, Question, change_of_outputs, fly, motions, noise_of
from casid.diagnosis.systems.library import Library, causes_for
from casid.diagnosis.systems.naming import Searching, SystemNaming, share_of
from casid.diagnosis.systems.result import ParameterValue, SystemCause, SystemDiagnosis, Unexplained
from casid.errors import EstimationError, InputError
from casid.model.port import ModelPort as Port
from casid.model.port import check_ports, ports_of
from casid.model.system import Model, check_continuous
from casid.native.threads import single_threaded
from casid.records.given import given_records
from casid.records.record import Record


@single_threaded()
def diagnose_system(
    model: Model,
    records: Sequence[Record],
    hold_out: Sequence[Record] = (),
    report: Callable[[str], None] = lambda stage: None,
    criteria: Criteria | None = None,
    *,
    ports: Sequence[Port] | None = None,
    exact: Sequence[str] = (),
    library: Library | None = None,
) -> SystemDiagnosis:
    """Diagnose a model on records.

    All parameters are fitted, with the prior of `model.prior_std`; one whose prior is 0 stays nominal. Noise of the
    readings is judged from the band above the motion.

    Parameters
    ----------
    model
        The simulation; one Runge-Kutta step of fourth order goes from sample to sample.
    records
        Records to be fitted.
    hold_out
        Records that are never fitted; when none is given one record, or the last third of a single one, is held back.
    report
        Is called with the name of every stage.
    criteria
        Every number that decides, see `Criteria`; `systems`, `priors`, `size` and `held_out` matter here.
    ports
        Where reality may differ; by default at every state derivative, input and output whose name is not in `exact`.
    exact
        Names of states whose equations are beyond doubt, and of inputs and outputs that are.
    library
        The causes that are considered; by default all that any system may have.

    Raises
    ------
    InputError
        For names that do not exist, records that cannot feed the model, and what is no port, library or criteria.
    EstimationError
        When the model cannot be fitted at all.
    """
    begin = time.perf_counter()
    criteria = an(criteria or Criteria(), Criteria, "diagnose: criteria", "cs.Criteria(...)")
    library = an(library or Library(), Library, "diagnose: library", "cs.Library(...)")
    check_continuous(model, "diagnose")
    if model.events:
        raise InputError(f"diagnose: model '{model.name}' has events, which are not taken here; give one without")
    report("reading the records")
    own = (*model.inputs, *model.outputs)
    records = given_records(records, "diagnose", own)
    hold_out = given_records(hold_out, "diagnose: hold_out", own)
    fit_on, held = split(records, hold_out, criteria.held_out)
    ports = ports_of(model, exact) if ports is None else tuple(ports)
    check_ports(model, ports)
    question, base = _question(model, fit_on, criteria)
    causes = causes_for(library, base.base, ports, question)
    naming = Searching(question=question, ports=ports, causes=causes, library=library).naming(base, {}, report)
    if naming is None:
        raise EstimationError(f"model '{model.name}' cannot be fitted to these records from its nominal values")
    report("held-out records")
    first = naming.wholes[0]
    given = fly(base, model.nominal, held, question)
    refitted = fly(base, first.found.values, held, question)
    naming, extended, gains, lost = _that_recurs(naming, question, held)
    named, minor, gates = _named(naming, question, gains, ports)
    told = _told(naming, _budget(given, refitted, extended), (named, minor), ports, question)
    return SystemDiagnosis(
        **told,
        model=model,
        extended=naming.best.found.extended,
        values=naming.best.found.values,
        explanations=_explanations(naming),
        as_given=given,
        refitted=refitted,
        extension=extended,
        noise=question.noise,
        held_out=tuple(held),
        seconds=time.perf_counter() - begin,
        trace=_trace(
            naming, gates, lost, {c.name: NAMED for c in told["causes"]} | {c.name: MINOR for c in told["minor"]}
        ),
    )


def _told(
    naming: SystemNaming,
    budget: Budget,
    judged: tuple[tuple[SystemCause, ...], tuple[SystemCause, ...]],
    ports: Sequence[Port],
    question: Question,
) -> dict[str, Any]:
    """Verdict, sentence and what they rest on, as fields of `SystemDiagnosis`."""
    (named, minor), criteria = judged, question.criteria
    unexplained = _unexplained(naming, ports, criteria.systems)
    values = _values(naming.wholes[0].found.extended.base, naming, question)
    verdict, sentence = _verdict(named, minor, unexplained, values)
    if fails := failure_sentence(budget, criteria.given):
        named, minor, verdict, sentence = (), (*named, *minor), "unexplained", fails
    account = account_of(budget, _contributions(values, named, unexplained))
    return {
        "verdict": verdict,
        "sentence": f"{account_sentence(budget, account, criteria.verdict.stated)} {sentence}",
        "causes": named,
        "minor": minor,
        "unexplained": unexplained,
        "parameters": values,
        "budget": budget,
        "account": account,
    }


def _question(model: Model, records: Sequence[Record], criteria: Criteria) -> tuple[Question, Extended]:
    """What is asked of which model: priors of 0 become fixed values, and a state is as large as it is measured."""
    exact = [name for name, std in model.prior_std.items() if std == 0.0]
    free = tuple(name for name in model.parameters if name not in exact)
    if not free:
        raise InputError(f"model '{model.name}' has no free parameter; give at least one a prior above 0, or none")
    guess = np.concatenate([model.guess(record) for record in records])
    seen = dict(zip(model.states, np.sqrt(np.mean(guess**2, axis=0)).tolist(), strict=True))
    base = replace(
        model,
        prior_std={name: std for name, std in model.prior_std.items() if std > 0.0},
        state_scale={name: seen[name] or scale for name, scale in model.state_scale.items()},
    )
    noise = noise_of(base, records, criteria.systems)
    series = {o: np.concatenate([r[o] for r in records if o in r]) for o in model.outputs}
    sizes = {o: max(float(np.nanstd(values)), noise[o]) for o, values in series.items()}
    shortest = criteria.systems.shortest_lag * min(record.dt for record in records)
    return (
        Question(records=tuple(records), noise=noise, free=free, criteria=criteria),
        Extended(base=base, sizes=sizes, shortest=shortest, paths=motions(base, records, noise, criteria.systems)),
    )


def _that_recurs(
    naming: SystemNaming, question: Question, held: Sequence[Record]
) -> tuple[SystemNaming, Flown, dict[str, float | None], dict[str, Gate]]:
    """The naming without causes that help only where they were fitted, its best model on the held-out records, what
    each of its causes gains there, and by name the gates of those that lost. The gain is log likelihood per reading
    against the best without it, None for what is in some records only, of which others say nothing."""
    lost: dict[str, Gate] = {}
    while True:
        extended, gains = fly(naming.best.found.extended, naming.best.found.values, held, question), {}
        for one in naming.best.attached:
            without = naming.without(one.name)
            gains[one.name] = None
            if without is not None and one.flag is None:
                other = fly(without.found.extended, without.found.values, held, question)
                gains[one.name] = extended.log_likelihood - other.log_likelihood
        worst = min(gains, key=lambda name: math.inf if gains[name] is None else float(gains[name] or 0.0), default="")
        gain = gains.get(worst)
        if gain is None or (gate := _recurs(gain)).passed:
            return naming, extended, gains, lost
        lost[worst] = gate
        naming = SystemNaming(
            wholes=tuple(one for one in naming.wholes if worst not in one.names), criteria=naming.criteria
        )


def _recurs(gain: float) -> Gate:
    """What a cause must pass on the held-out records."""
    return at_least("gain on held-out records", gain, sys.float_info.min)


def _trace(
    naming: SystemNaming, gates: Mapping[str, tuple[Gate, ...]], lost: Mapping[str, Gate], told: Mapping[str, str]
) -> Trace:
    """The decisions on every cause that was fitted: `gates` of those in the best model, those that were `lost` on the
    held-out records, and the outcome of those that are `told`."""
    best, found = naming.best.names, []
    members = {name: one for one in best if one in told for name, _ in naming.rivals(one)}
    for name in dict.fromkeys(name for whole in naming.wholes for name in sorted(whole.names)):
        odds = at_least("log odds against the best model without it", naming.log_odds(name), 0.0)
        found.append(
            Decision(
                cause=name,
                round=1,
                outcome=told.get(name, IN_A_SET if name in members else REFUSED),
                gates=(odds, *gates.get(name, ())),
                against=tuple(other for other, _ in naming.rivals(name)) if name in best else tuple(sorted(best)),
            )
        )
    refused = [Decision(cause=name, round=1, outcome=REFUSED, gates=(gate,)) for name, gate in lost.items()]
    return Trace(decisions=(*found, *refused))


def _named(
    naming: SystemNaming, question: Question, gains: Mapping[str, float | None], ports: Sequence[Port]
) -> tuple[tuple[SystemCause, ...], tuple[SystemCause, ...], dict[str, tuple[Gate, ...]]]:
    """Causes of the best whole that are worth their names, those that matter and those that do not; and by name, what
    each cause of it had to pass."""
    causes, minor, gates = [], [], {}
    best = naming.best
    accumulates = {port.disturbance for port in ports if port.kind == "state derivative" and port.matters is None}
    for one in best.attached:
        rivals = naming.rivals(one.name)
        together = naming.probability([one.name, *(name for name, _ in rivals)])
        sure = at_least("probability of its set", together, best.evidence.priors.named, "priors.named")
        gain = gains[one.name]
        gates[one.name] = (*(() if gain is None else (_recurs(gain),)), sure)
        if not sure.passed:
            continue
        value, std = best.found.values[one.name], best.std(one.name)
        share, share_std = share_of(best, one, question)
        if share + share_std < 1.0 and one.cause.port in accumulates:
            share = max(share, change_of_outputs(best.found, one.name) / question.criteria.size.share)
        matters = at_least("size with its deviation, of what matters", share + share_std, 1.0, "size.share")
        gates[one.name] = (*gates[one.name], matters)
        size = f"{value:.4g} +- {std:.2g}" + (f" {one.cause.unit}" if one.cause.unit else "")
        found_cause = SystemCause(
            kind=one.cause.kind,
            target=one.cause.target,
            term=one.cause.term,
            value=value,
            std=std,
            unit=one.cause.unit,
            records=one.records,
            onset_s=dict(one.onset_s) or None,
            probability=together,
            alone=naming.probability([one.name]),
            log_odds=naming.log_odds(one.name),
            held_out_gain=gains[one.name],
            indistinguishable_from=rivals,
            sentence=one.stated(value, size),
            share=share,
        )
        (causes if matters.passed else minor).append(found_cause)
    return (
        tuple(sorted(causes, key=lambda c: -c.log_odds)),
        tuple(sorted(minor, key=lambda c: -c.log_odds)),
        gates,
    )


def _unexplained(naming: SystemNaming, ports: Sequence[Port], criteria: SystemCriteria) -> tuple[Unexplained, ...]:
    """Ports at which something enters; where none alone is likely but one of them is, the likeliest."""
    unknown, by_name = naming.unknown(), {port.disturbance: port for port in ports}
    found = [Unexplained(port=by_name[name], probability=p) for name, p in unknown.items() if p > criteria.unexplained]
    if not found and sum(unknown.values()) > criteria.unexplained:
        name, p = max(unknown.items(), key=lambda item: item[1])
        found = [Unexplained(port=by_name[name], probability=p)]
    return tuple(found)


def _values(model: Model, naming: SystemNaming, question: Question) -> tuple[ParameterValue, ...]:
    first, best = naming.wholes[0].found, naming.best.found
    return tuple(
        ParameterValue(
            name=name,
            unit=model.units.get(name, ""),
            nominal=model.nominal[name],
            prior_std=model.prior_std.get(name, math.inf),
            refitted=first.values[name],
            refitted_std=first.fit.parameters[name].std,
            extended=best.values[name],
            extended_std=best.fit.parameters[name].std,
        )
        for name in question.free
    )


def _verdict(
    causes: Sequence[SystemCause],
    minor: Sequence[SystemCause],
    unexplained: Sequence[Unexplained],
    values: Sequence[ParameterValue],
) -> tuple[str, str]:
    wrong = [one.name for one in values if one.contradicted]
    if causes and unexplained:
        return "partly explained", f"{causes[0].sentence} Besides, something unexplained is left."
    if causes:
        return "explained", " ".join(one.sentence for one in causes)
    if unexplained:
        return "unexplained", unexplained[0].sentence
    if wrong:
        return "values wrong", f"The structure holds; the records contradict the value of {', '.join(wrong)}."
    small = " What is there besides is too small to matter." if minor else ""
    return "adequate", f"The model explains the records to within their noise.{small}"


def _contributions(
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


def _explanations(naming: SystemNaming) -> dict[frozenset[str], float]:
    found: dict[frozenset[str], float] = {}
    for weight, whole in zip(naming.weights, naming.wholes, strict=True):
        found[whole.names] = found.get(whole.names, 0.0) + float(weight)
    return dict(sorted(found.items(), key=lambda item: -item[1]))


def _budget(given: Flown, refitted: Flown, extended: Flown) -> Budget:
    """r.m.s. over noise on the held-out records; no step mends the data of a system that casid does not know."""
    channels = {
        name: BudgetSteps(as_given=rms, data_mended=rms, values=refitted.rms[name], structure=extended.rms[name])
        for name, rms in given.rms.items()
    }
    together = {
        one.name: math.sqrt(math.fsum(getattr(steps, one.name) ** 2 for steps in channels.values()) / len(channels))
        for one in fields(BudgetSteps)
    }
    return Budget(records=given.records, channels=channels, together=BudgetSteps(**together))
