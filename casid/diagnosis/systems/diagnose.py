"""Diagnose a simulation of any dynamic system: causes, the ports where they enter, and the improvement."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import fields, replace

from casid.arguments import require
from casid.diagnosis.causes import still_missing, trace_of_search
from casid.diagnosis.criteria import Criteria
from casid.diagnosis.engine.baseline import Baseline
from casid.diagnosis.engine.comparison import tempered
from casid.diagnosis.engine.held_out import keep, split
from casid.diagnosis.engine.probability import believed
from casid.diagnosis.engine.search import State, search
from casid.diagnosis.evidence.missing_input import missing_inputs
from casid.diagnosis.given.budget import Budget, BudgetSteps, account_of, account_sentence, failure_sentence
from casid.diagnosis.systems.extended import Extended, Flown, as_given, flown
from casid.diagnosis.systems.library import Library
from casid.diagnosis.systems.plant import Plant, first_fit, plant_of
from casid.diagnosis.systems.result import (
    SystemDiagnosis,
    causes_of,
    contributions,
    headline,
    small_cause,
    system_cause,
    unexplained_at,
    values_of,
)
from casid.diagnosis.verdict import Facts, verdict_of
from casid.errors import InputError
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
        Every number that decides, see `Criteria`. Times in seconds are those of an aircraft's records and become longer
        or shorter with the records of a system; `systems` is for these alone.
    ports
        Where reality may differ; by default at every state derivative, input and output whose name is not in `exact`.
    exact
        Names of states whose equations are beyond doubt, and of inputs and outputs that are.
    library
        The causes that are considered; by default all that any system may have.

    Raises
    ------
    InputError
        For names that do not exist, records that cannot feed the model, and arguments that are not ports, a library
        or criteria.
    EstimationError
        When the model cannot be fitted at all.
    """
    begin = time.perf_counter()
    check_continuous(model, "diagnose")
    criteria = require(criteria or Criteria(), Criteria, "diagnose: criteria", "cs.Criteria(...)")
    library = require(library or Library(), Library, "diagnose: library", "cs.Library(...)")
    if model.events:
        raise InputError(f"diagnose: model '{model.name}' has events, which are not taken here; give one without")
    report("reading the records")
    own = (*model.inputs, *model.outputs)
    records = given_records(records, "diagnose", own)
    hold_out = given_records(hold_out, "diagnose: hold_out", own)
    fit_on, held = split(records, hold_out, criteria.held_out)
    ports = ports_of(model, exact) if ports is None else tuple(ports)
    check_ports(model, ports)
    plant = plant_of(model, fit_on, ports, library, criteria)
    report("refit of the model")
    state = search(Baseline.alone(first_fit(plant)), report)
    state = replace(state, rounds=tempered(state.rounds, state.evidence))
    return _judged(model, plant, state, held, (begin, report))


def _judged(
    model: Model, plant: Plant, state: State, held: Sequence[Record], since: tuple[float, Callable[[str], None]]
) -> SystemDiagnosis:
    """The result of a search, judged on the held-out records. The search began at `since`; `report` gets the stages."""
    (begin, report), criteria = since, plant.criteria
    report("held-out records")
    kept = keep(held, state)
    given, refitted, extension = as_given(plant, held), flown(kept.held_calm), flown(kept.held_fit)
    report("verdict")
    causes, minor = causes_of(plant, state, kept)
    left = state.missing if kept.evidence is state.evidence else tuple(missing_inputs(kept.evidence))
    unexplained = still_missing(kept.evidence, left, causes, 0.0)
    if not unexplained:  # what is missing distorts small things
        minor += small_cause(plant, state, (*causes, *minor))
    belief = believed(causes, unexplained, state, left)
    told = tuple(map(system_cause, belief.causes))
    small = tuple(system_cause(one, criteria) for one in minor)
    entered, values = unexplained_at(plant, unexplained, belief), values_of(plant, state.baseline.calm, kept.fit)
    budget = _budget(given, refitted, extension)
    failure = failure_sentence(budget, criteria.given)
    facts = Facts(
        fails=bool(failure),
        causes=bool(told),
        unexplained=bool(entered),
        contradicted=any(one.contradicted for one in values),
    )
    verdict = verdict_of(facts)
    sentence = failure or headline(verdict, told, small, entered, values)
    if facts.fails:
        told, small = (), (*told, *small)
    account = account_of(budget, contributions(values, told, entered))
    base = replace(plant.base, nominal={**plant.base.nominal, **{one.name: one.extended for one in values}})
    return SystemDiagnosis(
        verdict=verdict,
        sentence=f"{account_sentence(budget, account, criteria.verdict.stated)} {sentence}",
        model=model,
        extended=Extended(base=base, attached=kept.fit.attached, terms=plant.terms_of),
        values={**base.nominal, **{one.name: one.values["value"] for one in kept.fit.attached}},
        causes=told,
        minor=small,
        unexplained=entered,
        explanations={frozenset(names): p for names, p in belief.explanations},
        parameters=values,
        as_given=given,
        refitted=refitted,
        extension=extension,
        budget=budget,
        noise=plant.sigma,
        held_out=tuple(held),
        seconds=time.perf_counter() - begin,
        trace=trace_of_search(state, belief.causes, minor),
        account=account,
    )


def _budget(given: Flown, refitted: Flown, extended: Flown) -> Budget:
    """r.m.s. over noise on the held-out records; the data of a system are not corrected."""
    channels = {
        name: BudgetSteps(as_given=rms, data_mended=rms, values=refitted.rms[name], structure=extended.rms[name])
        for name, rms in given.rms.items()
    }
    together = {
        one.name: math.sqrt(math.fsum(getattr(steps, one.name) ** 2 for steps in channels.values()) / len(channels))
        for one in fields(BudgetSteps)
    }
    return Budget(records=given.records, channels=channels, together=BudgetSteps(**together))
