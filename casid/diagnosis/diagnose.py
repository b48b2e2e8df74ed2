"""The main job: what does the simulation get wrong, which cause is it, and what does the extended model gain?"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from casid.arguments import an, one_of
from casid.diagnosis.cause import Cause
from casid.diagnosis.criteria import Criteria
from casid.diagnosis.data.check import check
from casid.diagnosis.evidence.evidence import Evidence, is_sure, weigh
from casid.diagnosis.evidence.missing_input import MissingInput, missing_inputs
from casid.diagnosis.explanations.by_score import Begun, by_score
from casid.diagnosis.flight.colour import in_colour, is_far, unread
from casid.diagnosis.flight.evaluation import FlightFit
from casid.diagnosis.flight.fit import fit, without
from casid.diagnosis.flight.flight import Flight
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.flight.input_timing import as_inputs_run
from casid.diagnosis.flight.noise_level import with_noise_level
from casid.diagnosis.flight.view import view_of
from casid.diagnosis.given.as_given import AsGiven, fly_as_given, fly_recorded
from casid.diagnosis.given.budget import budget_of
from casid.diagnosis.given.flight_values import flight_values
from casid.diagnosis.given.reach import reach_of
from casid.diagnosis.judging.conclusion import concluded, named_in_errors
from casid.diagnosis.judging.extension import extended_aircraft
from casid.diagnosis.judging.held_out import best_on_held, gains_by_kinematics, held_gains, judge_on, split, with_events
from casid.diagnosis.judging.verdict import (
    causes_of,
    minor_trials,
    smallest_detectable,
    still_missing,
    too_small,
    verdict_of,
)
from casid.diagnosis.kinematics import kinematics
from casid.diagnosis.kinematics.stage import KinematicFindings, judge_kinematics
from casid.diagnosis.naming.baseline import Baseline, baseline, named
from casid.diagnosis.naming.naming import Naming
from casid.diagnosis.naming.structure import demanded_offsets
from casid.diagnosis.result import Diagnosis
from casid.diagnosis.stages import Stages
from casid.model.aircraft import Aircraft
from casid.model.applied import values_of
from casid.model.effects import effect_of
from casid.model.given import given_aircraft
from casid.model.linearised import linearised
from casid.native.processors import side_by_side
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
    naming: Literal["rules", "score"] = "rules",
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
    naming
        How causes are named: by rules about gains, or by the score, in which explanations compete as wholes and have
        probabilities.
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
    one_of(naming, ("rules", "score"), "diagnose: naming")
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
        case = _Case(aircraft=aircraft, given=given, held=reach.held, known=known, by_score=naming == "score")
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
    by_score: bool


def _attempt(case: _Case, flight: Flight, stages: Stages) -> Diagnosis:
    """The diagnosis of a flight whose noise is believed as read, unless its baseline is far from the data."""
    stages.begin("refit of the file")
    calm = fit(flight, case.known, flight.noise(), iterations=20)
    if is_far(calm, flight.criteria.noise.far_from_data):
        flight = unread(flight)
        calm = fit(flight, case.known, flight.noise(), iterations=20)
    calm = as_inputs_run(in_colour(calm))
    flight, offsets = calm.flight, demanded_offsets(calm)
    stages.begin("kinematics")
    found = judge_kinematics(flight, case.known, offsets)
    stages.begin("refit of the file")
    begun = baseline(calm, found.turbulence, found.nuisance)
    stages.begin("naming")
    by = _by_score if case.by_score else _by_rules
    return by(case.aircraft, begun, found, case.given, case.held, stages)


def _unexplained(
    kept: _Kept,
    by_rules: Naming,
    left: Sequence[MissingInput],
    judged: tuple[tuple[Cause, ...], tuple[Cause, ...]],
    required: float,
) -> tuple[tuple[Cause, ...], list[MissingInput]]:
    """(minor, unexplained): what no cause explains, unless what is too small to matter does; `told`: causes, minor."""
    causes, minor = judged
    unexplained = still_missing(kept.evidence, left, causes, required)
    seen = (*causes, *minor)
    small = too_small(by_rules, seen, unexplained)
    nuisance = [trial.candidate.attached for trial in minor_trials(by_rules, seen)][:1]
    if small and (not unexplained or _nothing_left_with(kept, nuisance, by_rules, causes, required)):
        minor, unexplained = (*minor, *small), []
    if not unexplained:
        unexplained = _missing_on_held(kept, nuisance, causes, required)
    return minor, unexplained


def _by_score(
    aircraft: Aircraft,
    begun: Baseline,
    found: KinematicFindings,
    given: AsGiven,
    held: Sequence[Record],
    stages: Stages,
) -> Diagnosis:
    """Causes by the posterior over explanations."""
    start = Begun(
        calm=begun.calm,
        structure=begun.structure,
        structured=begun.structured,
        start=begun.start,
        turbulence=begun.turbulence,
        kinematic=tuple(found.ranked),
        given=given,
    )
    return by_score(aircraft, start, held, stages)


def _by_rules(
    aircraft: Aircraft,
    begun: Baseline,
    found: KinematicFindings,
    given: AsGiven,
    held: Sequence[Record],
    stages: Stages,
) -> Diagnosis:
    """Causes one after the other, by rules about what each gains."""
    criteria, known = begun.calm.criteria, begun.calm.attached
    begun, by_rules = named(begun, found, known, stages.begin)
    stages.begin("held-out records")
    kept = _kept(held, begun, by_rules)
    stages.begin("missing inputs")
    left = by_rules.missing if kept.evidence is by_rules.evidence else tuple(missing_inputs(kept.evidence))
    exact = missing_inputs(weigh(kept.fit, discrepancy=False))
    stages.begin("verdict")
    structure, required = (kept.structure, kept.structure_gain), begun.required
    causes, minor = causes_of(by_rules, kept.evidence, begun.turbulence, kept.gains, structure, required, left)
    minor, unexplained = _unexplained(kept, by_rules, left, (causes, minor), required)
    verdict, sentence = verdict_of(causes, minor, unexplained, by_rules, kept.fit)
    bare = begun.without_causes({(c.kind, c.target, c.term) for c in causes})
    first = exact if kept.fit is bare else missing_inputs(weigh(bare, discrepancy=False))
    candidates = by_rules.rounds[0].candidates
    refitted, extended, held_refitted, held_extended = [
        view_of(one) for one in (begun.calm, kept.fit, kept.held_calm, kept.held_fit)
    ]
    values = flight_values(kept.evidence)
    extended_file = extended_aircraft(begun.calm.flight.aircraft, kept.fit, causes, minor)
    stages.end()
    return Diagnosis(
        verdict=verdict,
        headline=sentence,
        sentence=sentence,
        aircraft=aircraft,
        extended_aircraft=extended_file,
        causes=causes,
        minor=minor,
        ranking=candidates[: criteria.numerics.naming.ranking],
        rounds=by_rules.rounds,
        as_given=given.fitted,
        refitted=refitted,
        extended=extended,
        held_out_as_given=given.held,
        held_out_refitted=held_refitted,
        held_out_extended=held_extended,
        budget=budget_of(given, held_refitted, held_extended),
        flight=values,
        bare=bare,
        missing_before=tuple(first),
        missing_after=tuple(exact),
        unexplained=tuple(unexplained),
        kinematic=tuple(found.ranked),
        turbulence=begun.turbulence,
        detectable=smallest_detectable(candidates, criteria.verdict),
        seconds=stages.seconds,
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class _Kept:
    """The model that is best on the held-out records.

    fit, evidence        of it, in the fitted records
    held_fit, held_calm  of it and of the baseline, in the others
    structure            the terms put in beforehand of which the records are sure, which together gained
    structure_gain       log likelihood per held-out sample; None where there is none
    gains                the same of turbulence and of every named round
    """

    evidence: Evidence
    held_fit: FlightFit
    held_calm: FlightFit
    structure: list[Attached]
    structure_gain: float | None
    gains: list[float | None]

    @property
    def fit(self) -> FlightFit:
        return self.evidence.fit

    def has_all(self, naming: Naming) -> bool:
        """Whether every cause that stands in the naming's last fit is in it."""
        named = {round_.leader.effect.key for round_ in naming.named}
        standing = {one.effect.key for one in naming.evidence.fit.attached}
        return named & standing <= {one.effect.key for one in self.fit.attached}

    def with_effects(self, nuisance: Sequence[Attached]) -> FlightFit:
        """The fit with further effects."""
        return fit(self.fit.flight, [*self.fit.attached, *nuisance], self.fit.noise, self.fit)


def _kept(held: Sequence[Record], begun: Baseline, naming: Naming) -> _Kept:
    named, turbulence = naming.named, begun.turbulence
    coloured, flight = turbulence.named, begun.calm.flight
    steps = [begun.structured, *([begun.start] if coloured else []), *(r.fitted for r in named)]
    on_fitted = [*([turbulence.gain] if coloured else []), *(r.leader.gain.total for r in named)]
    on_held = side_by_side(lambda step: judge_on(held, step), steps)
    held_calm = judge_on(held, begun.calm) if begun.structure else on_held[0]
    moving = kinematics.gusts(flight, turbulence.sigma, length=turbulence.length) if coloured else {}
    gains = gains_by_kinematics(flight, held, steps, held_gains(on_held), [r.leader for r in named], moving)
    final, held_final = best_on_held(held, steps, on_held, gains, on_fitted)
    evidence = naming.evidence if final is naming.evidence.fit else weigh(final)
    structure = [*begun.structure, *_put_in_later(begun, final)]
    unsure = {one.name for one in structure if not is_sure(evidence, one.name)}
    if unsure:  # records that do not tell a term from the others give it any size
        final = without(final, unsure)
        evidence, held_final = weigh(final), judge_on(held, final)
    return _Kept(
        evidence=evidence,
        held_fit=held_final,
        held_calm=held_calm,
        structure=[one for one in structure if one.name not in unsure],
        structure_gain=held_gains([held_calm, on_held[0]])[0],
        gains=gains if coloured else [None, *gains],
    )


def _put_in_later(begun: Baseline, final: FlightFit) -> list[Attached]:
    """Slight errors of instruments that the data asked for beside what was named."""
    before = {one.name for one in begun.structure}
    return [one for one in final.attached if one.nuisance and one.name not in before]


def _missing_on_held(
    kept: _Kept, nuisance: Sequence[Attached], causes: Sequence[Cause], required: float
) -> list[MissingInput]:
    """What the held-out records show that neither the model nor other derivatives explain, nor a `nuisance` cause, too
    small to matter in the fitted ones: an effect in them alone."""

    def missing(model: FlightFit, held: FlightFit) -> list[MissingInput]:
        held = with_events(held, model)
        evidence = weigh(fit(held.flight, held.attached, held.noise, held))
        return still_missing(
            evidence, missing_inputs(evidence), causes, required, kept.evidence.criteria.held_out.missing_share
        )

    found = missing(kept.fit, kept.held_fit)
    if found and nuisance:
        joint = kept.with_effects(nuisance)
        if not missing(joint, judge_on(kept.held_fit.flight.records, joint)):
            return []
    return found


def _nothing_left_with(
    kept: _Kept, nuisance: Sequence[Attached], naming: Naming, causes: Sequence[Cause], required: float
) -> bool:
    """Whether nothing is missing in the fitted records beside a `nuisance` cause, which was tried beside all others."""
    if not kept.has_all(naming):
        return False
    evidence = weigh(kept.with_effects(nuisance))
    return not still_missing(evidence, missing_inputs(evidence), causes, required)


def attached_effects(flight: Flight) -> list[Attached]:
    """The effects that the aircraft file already has in the records of the flight, to be fitted further."""
    found = []
    for value in flight.aircraft.effects:
        effect = effect_of(value)
        onsets = {r: 0.5 * (lo + hi) for r, (lo, hi) in (value.onset_s or {}).items() if r in flight.names}
        records = tuple(r for r in value.records if r in flight.names)
        elsewhere = not onsets if effect.timed else bool(value.records) and not records
        if not effect.stochastic and not elsewhere:
            values = effect.in_words(values_of(value, effect))  # a time constant below zero acts as its size does
            found.append(Attached(effect=effect, values=values, onsets=onsets, records=records))
    return found
