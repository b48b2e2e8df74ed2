"""Diagnosis of an aircraft file: what the simulation gets wrong, why, and how much better the extended model is."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, overload

from casid.arguments import require
from casid.data_check.check import channels_of, check
from casid.diagnosis.causes import causes_of, trace_of_search
from casid.diagnosis.criteria import Criteria
from casid.diagnosis.engine.baseline import baseline_of
from casid.diagnosis.engine.comparison import tempered
from casid.diagnosis.engine.held_out import keep, split
from casid.diagnosis.engine.probability import believed
from casid.diagnosis.engine.search import State, search
from casid.diagnosis.evidence.evidence import weigh
from casid.diagnosis.evidence.missing_input import missing_inputs
from casid.diagnosis.flight.noise import view_of, with_noise_level
from casid.diagnosis.given.budget import AsGiven, attached_effects, budget_of, fly_as_given, fly_recorded
from casid.diagnosis.given.contradicted import flight_values
from casid.diagnosis.given.scope import scope_of
from casid.diagnosis.result import Diagnosis, extended_aircraft
from casid.diagnosis.sentences import remarks
from casid.diagnosis.systems.diagnose import diagnose_system
from casid.diagnosis.systems.library import Library
from casid.diagnosis.systems.result import SystemDiagnosis
from casid.diagnosis.verdict import beside_slow_noise, concluded, named_in_errors, what_is_left
from casid.errors import InputError
from casid.model.aircraft import Aircraft, given_aircraft
from casid.model.linearised import linearised
from casid.model.port import ModelPort as Port
from casid.model.system import Model
from casid.native.singular import singular_is
from casid.native.threads import single_threaded
from casid.records.given import given_records
from casid.records.record import Record


@single_threaded()
@singular_is("diagnose", "the model cannot follow these records: check units and signs of channels and of the file")
def diagnose_aircraft(
    aircraft: Aircraft | str | Path,
    records: Sequence[Record],
    hold_out: Sequence[Record] = (),
    report: Callable[[str], None] = lambda stage: None,
    criteria: Criteria | None = None,
    *,
    as_recorded: bool | Sequence[str] = False,
    axes: str | None = None,
) -> Diagnosis:
    """Diagnose an aircraft file with flight records.

    Parameters
    ----------
    aircraft
        The aircraft model, or the name of its file.
    records
        Flight records to be fitted, or names of files.
    hold_out
        Records that are never fitted. If none is given, the last record is held out, or the last third of a single one.
    report
        Function that is called with the name of every stage.
    criteria
        Thresholds of the diagnosis; by default `Criteria()`.
    as_recorded
        True: faults of the data are reported, and the data are neither corrected nor left out. Names of channels: these
        are trusted as recorded.
    axes
        Scope: "longitudinal", "lateral" or "full"; by default the largest that the records support.

    Raises
    ------
    InputError
        If an argument has the wrong type, or the records lack channels that the model needs.
    """
    aircraft = given_aircraft(aircraft, "diagnose")
    records, hold_out = given_records(records, "diagnose"), given_records(hold_out, "diagnose: hold_out")
    channels_of(as_recorded, "diagnose: as_recorded")
    criteria = require(criteria or Criteria(), Criteria, "diagnose: criteria", "Criteria(...)")
    stages = Stages(report)
    stages.begin("faults of the data")
    as_line = linearised(aircraft, records)
    checked = check((*records, *hold_out), as_line, undo=as_recorded, criteria=criteria.data)
    stages.begin("reading the records")
    mended, recorded = (
        split(both[: len(records)], both[len(records) :], criteria.held_out)
        for both in (checked.records, checked.recorded)
    )
    with named_in_errors(checked.findings, checked.doubts, criteria.verdict.stated):
        scope = scope_of(aircraft, mended, criteria, axes)
        known = attached_effects(scope.flight)
        flight = with_noise_level(scope.flight, known)
        stages.begin("simulation as given")
        given = fly_as_given(flight, scope.held, known)
        if any(one.handled != "reported" for one in checked.findings):
            given = replace(given, recorded=fly_recorded(flight, scope.ready(recorded), known))
        state = search(baseline_of(flight, known, stages.begin), stages.begin)
        found = _judged(aircraft, state, given, scope.held, stages)
        return concluded(found, scope, checked.findings, checked.doubts)


def _judged(aircraft: Aircraft, state: State, given: AsGiven, held: Sequence[Record], stages: Stages) -> Diagnosis:
    """The diagnosis of the final state of a search, tested on the held-out records."""
    begun, criteria = state.baseline, state.criteria
    state = replace(state, rounds=tempered(state.rounds, state.evidence))
    stages.begin("held-out records")
    kept = keep(held, state)
    if kept.evidence is not state.evidence:
        state.evidence.forget()
    stages.begin("missing inputs")
    left = state.missing if kept.evidence is state.evidence else tuple(missing_inputs(kept.evidence))
    exact = missing_inputs(weigh(kept.fit, discrepancy=False))
    stages.begin("verdict")
    causes, minor = beside_slow_noise(kept, state, *causes_of(state, kept, left))
    minor, unexplained = what_is_left(kept, state, left, (causes, minor))
    belief = believed(causes, unexplained, state, left)
    causes = belief.causes
    bare = begun.without_causes({(c.kind, c.target, c.term) for c in causes})
    first = exact if kept.fit is bare else missing_inputs(weigh(bare, discrepancy=False))
    flight = flight_values(kept.evidence)
    kept.evidence.forget()
    refitted, extended, held_refitted, held_extended = map(
        view_of, (begun.calm, kept.fit, kept.held_calm, kept.held_fit)
    )
    extended_file = extended_aircraft(begun.flight.aircraft, kept.fit, causes, minor)
    stages.end()
    return Diagnosis(
        remark=remarks(minor, belief.faint, len(begun.calm.batch.names)),
        aircraft=aircraft,
        extended_aircraft=extended_file,
        causes=causes,
        minor=minor,
        ranking=state.rounds[0].candidates[: criteria.numerics.naming.ranking],
        rounds=state.rounds,
        as_given=given.fitted,
        refitted=refitted,
        extended=extended,
        held_out_as_given=given.held,
        held_out_refitted=held_refitted,
        held_out_extended=held_extended,
        budget=budget_of(given, held_refitted, held_extended),
        flight=flight,
        bare=bare,
        missing_before=tuple(first),
        missing_after=tuple(exact),
        unexplained=tuple(unexplained),
        kinematic=tuple(begun.kinematics.ranked),
        turbulence=begun.turbulence,
        detectable=state.rounds[0].detectable,
        seconds=stages.seconds,
        explanations=belief.explanations,
        believed=belief.there,
        entered=belief.entered,
        nothing=belief.nothing,
        trace=trace_of_search(state, causes, minor),
    )


class Stages:
    """Wall time of each stage; `report` is called when a stage begins."""

    def __init__(self, report: Callable[[str], None]) -> None:
        self._report = report
        self._name, self._since = "", time.perf_counter()
        self.seconds: dict[str, float] = {}

    def begin(self, name: str) -> None:
        self.end()
        self._name, self._since = name, time.perf_counter()
        self._report(name)

    def end(self) -> None:
        if self._name:
            self.seconds[self._name] = self.seconds.get(self._name, 0.0) + time.perf_counter() - self._since
        self._name = ""


Say = Callable[[str], None]


@overload
def diagnose(
    simulation: Aircraft | str | Path,
    records: Sequence[Record],
    hold_out: Sequence[Record] = (),
    report: Say = ...,
    criteria: Criteria | None = None,
    *,
    as_recorded: bool | Sequence[str] = False,
    axes: str | None = None,
) -> Diagnosis: ...


@overload
def diagnose(
    simulation: Model,
    records: Sequence[Record],
    hold_out: Sequence[Record] = (),
    report: Say = ...,
    criteria: Criteria | None = None,
    *,
    ports: Sequence[Port] | None = None,
    exact: Sequence[str] = (),
    library: Library | None = None,
) -> SystemDiagnosis: ...


def diagnose(simulation: Any, *arguments: Any, **options: Any) -> Diagnosis | SystemDiagnosis:
    """Diagnose what a simulation gets wrong, with measured records.

    Parameters
    ----------
    simulation
        An `Aircraft` or the name of its file, or the `Model` of any dynamic system (`define_model`).
    records
        Records to be fitted, in SI units and radians, or names of files.
    hold_out
        Records that are never fitted. If none is given, the last record is held out, or the last third of a single one.
    report
        Function that is called with the name of every stage.
    criteria
        Thresholds of the diagnosis; by default `Criteria()`.
    as_recorded
        For an aircraft. True: faults of the data are reported, and the data are neither corrected nor left out. A list
        of channels: these are trusted as recorded.
    axes
        For an aircraft: the scope, "longitudinal", "lateral" or "full"; by default the largest that the records
        support.
    ports
        For a model: where reality may differ; by default every state derivative, input and output not in `exact`.
    exact
        For a model: names of states with exact equations, and of exact inputs and outputs.
    library
        For a model: the causes that are considered; by default all that any system may have.

    Returns
    -------
    Diagnosis or SystemDiagnosis
        For an aircraft or a model: the named causes with their sizes, and the improvement by each on records that were
        not fitted. Print it for the account; `save` stores it and `write_report` makes a page of it.

    Raises
    ------
    InputError
        For records that lack inputs of the simulation, and for ports of an aircraft, whose ports are fixed.
    EstimationError
        If the model cannot be fitted at all.

    Examples
    --------
    >>> import casid as cs
    >>> found = cs.diagnose("aircraft.toml", cs.read_records("flight/m*.csv"))  # doctest: +SKIP
    >>> print(found)  # doctest: +SKIP
    >>> cs.write_report(found, "report")  # doctest: +SKIP
    """
    if isinstance(simulation, Model):
        if {"axes", "as_recorded"} & set(options):
            raise InputError("axes and as_recorded are for an aircraft; a Model takes ports, exact and library")
        return diagnose_system(simulation, *arguments, **options)
    if {"ports", "exact", "library"} & set(options):
        raise InputError("ports, exact and library are for a Model; an aircraft has the ports of its mass properties")
    return diagnose_aircraft(simulation, *arguments, **options)
