"""Diagnosis of an aircraft file: what the simulation gets wrong, why, and how much better the extended model is."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from casid.arguments import require
from casid.diagnosis.causes import causes_of, trace_of_search
from casid.diagnosis.criteria import Criteria
from casid.diagnosis.data.check import channels_of, check
from casid.diagnosis.engine.baseline import baseline_of
from casid.diagnosis.engine.comparison import tempered
from casid.diagnosis.engine.held_out import keep, split
from casid.diagnosis.engine.probability import believed
from casid.diagnosis.engine.search import State, search
from casid.diagnosis.evidence.evidence import weigh
from casid.diagnosis.evidence.missing_input import missing_inputs
from casid.diagnosis.extension import extended_aircraft
from casid.diagnosis.flight.noise import with_noise_level
from casid.diagnosis.flight.statistics import view_of
from casid.diagnosis.given.as_given import AsGiven, attached_effects, fly_as_given, fly_recorded
from casid.diagnosis.given.budget import budget_of
from casid.diagnosis.given.flight_values import flight_values
from casid.diagnosis.given.reach import reach_of
from casid.diagnosis.result import Diagnosis
from casid.diagnosis.sentences import remarks
from casid.diagnosis.unexplained import beside_slow_noise, what_is_left
from casid.diagnosis.verdict import concluded, named_in_errors
from casid.model.aircraft import Aircraft, given_aircraft
from casid.model.linearised import linearised
from casid.native.singular import singular_is
from casid.native.threads import single_threaded
from casid.records.given import given_records
from casid.records.record import Record


@single_threaded()
@singular_is("diagnose", "the model cannot follow these records: check units and signs of channels and of the file")
def diagnose(
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
        reach = reach_of(aircraft, mended, criteria, axes)
        known = attached_effects(reach.flight)
        flight = with_noise_level(reach.flight, known)
        stages.begin("simulation as given")
        given = fly_as_given(flight, reach.held, known)
        if any(one.handled != "reported" for one in checked.findings):
            given = replace(given, recorded=fly_recorded(flight, reach.ready(recorded), known))
        state = search(baseline_of(flight, known, stages.begin), stages.begin)
        found = _judged(aircraft, state, given, reach.held, stages)
        return concluded(found, reach, checked.findings, checked.doubts)


def _judged(aircraft: Aircraft, state: State, given: AsGiven, held: Sequence[Record], stages: Stages) -> Diagnosis:
    """The diagnosis of the final state of a search, tested on the held-out records."""
    begun, criteria = state.baseline, state.criteria
    state = replace(state, rounds=tempered(state.rounds, state.evidence))
    stages.begin("held-out records")
    kept = keep(held, state)
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
        flight=flight_values(kept.evidence),
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
