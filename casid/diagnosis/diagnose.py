"""The main job: what does the simulation get wrong, which cause is it, and what does the extended model gain?"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from casid.arguments import an
from casid.diagnosis.criteria import Criteria
from casid.diagnosis.data.check import check
from casid.diagnosis.flight.colour import in_colour, is_far, unread
from casid.diagnosis.flight.fit import fit
from casid.diagnosis.flight.flight import Flight
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.flight.input_timing import as_inputs_run
from casid.diagnosis.flight.noise_level import with_noise_level
from casid.diagnosis.flight.outliers import without_outliers
from casid.diagnosis.given.as_given import AsGiven, attached_effects, fly_as_given, fly_recorded
from casid.diagnosis.given.reach import reach_of
from casid.diagnosis.judging.by_rules import by_rules
from casid.diagnosis.judging.conclusion import concluded, named_in_errors
from casid.diagnosis.judging.held_out import split
from casid.diagnosis.kinematics.stage import comes_near, judge_kinematics
from casid.diagnosis.naming.baseline import baseline
from casid.diagnosis.naming.structure import demanded_offsets
from casid.diagnosis.result import Diagnosis
from casid.diagnosis.stages import Stages
from casid.model.aircraft import Aircraft, given_aircraft
from casid.model.linearised import linearised
from casid.native.memory import kept_memory
from casid.native.singular import singular_is
from casid.native.threads import single_threaded
from casid.records.given import given_records
from casid.records.record import Record


@single_threaded()
@kept_memory()
@singular_is("diagnose", "the model cannot follow these records: check units and signs of channels and of the file")
def diagnose(
    aircraft: Aircraft | str | Path,
    records: Sequence[Record],
    hold_out: Sequence[Record] = (),
    report: Callable[[str], None] = lambda stage: None,
    criteria: Criteria | None = None,
    *,
    as_recorded: bool = False,
    axes: str | None = None,
) -> Diagnosis:
    """Diagnose an aircraft file on flight records.

    Parameters
    ----------
    aircraft
        The simulation as an aircraft file has it; a name of a file is taken too.
    records
        Flight records to be fitted, or names of files.
    hold_out
        Records that are never fitted; when none is given one record, or the last third of a single one, is held back.
    report
        Is called with the name of every stage.
    criteria
        The numbers by which the diagnosis decides; by default those of `Criteria()`.
    as_recorded
        The data stay as they were recorded: faults are told, and neither corrected nor left out.
    axes
        "longitudinal", "lateral" or "full": what is judged; by default what the records can tell of.

    Raises
    ------
    InputError
        For what is neither, and for records that cannot feed the model.
    """
    aircraft = given_aircraft(aircraft, "diagnose")
    records, hold_out = given_records(records, "diagnose"), given_records(hold_out, "diagnose: hold_out")
    an(as_recorded, bool, "diagnose: as_recorded", "as_recorded=True or as_recorded=False")
    criteria = an(criteria or Criteria(), Criteria, "diagnose: criteria", "Criteria(...)")
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
        case = _Case(aircraft=aircraft, given=given, held=reach.held, known=known)
        found = _attempt(case, flight, stages)
        if is_far(found.extended.fit, criteria.noise.far_from_causes):
            found = _attempt(case, unread(flight), stages)
        return concluded(found, reach, checked.findings, checked.doubts)


@dataclass(frozen=True, eq=False, kw_only=True)
class _Case:
    """What every attempt begins with: the file, how it flies as given, the held-out records, its own effects."""

    aircraft: Aircraft
    given: AsGiven
    held: Sequence[Record]
    known: Sequence[Attached]


def _attempt(case: _Case, flight: Flight, stages: Stages) -> Diagnosis:
    """The diagnosis of a flight whose noise is believed as read, unless its baseline and kinematics are far from it."""
    stages.begin("refit of the file")
    calm = fit(flight, case.known, flight.noise(), iterations=20)
    if is_far(calm, flight.criteria.noise.far_from_data) and not comes_near(flight, case.known):
        flight = unread(flight)
        calm = fit(flight, case.known, flight.noise(), iterations=20)
    calm = as_inputs_run(in_colour(without_outliers(calm)))
    flight, offsets = calm.flight, demanded_offsets(calm)
    stages.begin("kinematics")
    found = judge_kinematics(flight, case.known, offsets, calm)
    stages.begin("refit of the file")
    begun = baseline(calm, found.turbulence, found.nuisance)
    stages.begin("naming")
    return by_rules(case.aircraft, begun, found, case.given, case.held, stages)
