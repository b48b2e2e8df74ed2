"""Diagnosis of an aircraft file: what the simulation gets wrong, why, and how much better the extended model is."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, overload

from casid.arguments import number, require
from casid.data_check.check import DataFindings, channels_of, check
from casid.data_check.reading import Finding
from casid.diagnosis import sentences
from casid.diagnosis.cause import Cause
from casid.diagnosis.criteria import Criteria
from casid.diagnosis.diagnose_ported import diagnose_rotorcraft, diagnose_system
from casid.diagnosis.diagnosed import DiagnosedAircraft
from casid.diagnosis.engine.baseline import baseline_in_time
from casid.diagnosis.engine.held_out import Kept
from casid.diagnosis.engine.search import search
from casid.diagnosis.flight.evaluation import FlightFit
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.flight.noise import with_noise_level
from casid.diagnosis.flight.subject import Subject
from casid.diagnosis.given.as_given import AsGiven, attached_effects, error_over_noise, fly_as_given, fly_recorded
from casid.diagnosis.given.contradicted import FlightValue
from casid.diagnosis.given.scope import Scope, out_of_sight, scope_of, split
from casid.diagnosis.last_tests import judged
from casid.diagnosis.result import Diagnosis
from casid.diagnosis.time_limit import Stages, TimeLimit
from casid.diagnosis.verdict import concluded
from casid.errors import CasidError, InputError, unknown
from casid.model.aircraft import Aircraft, EffectValue, given_aircraft
from casid.model.causes.air import turbulence as turbulence_effect
from casid.model.flown_records import with_estimates
from casid.model.library import Library
from casid.model.linearised import linearised
from casid.model.plausible import Doubt
from casid.model.port import ModelPort as Port
from casid.model.system import Model
from casid.native.singular import singular_is
from casid.native.threads import single_threaded
from casid.records.given import given_records, require_flight
from casid.records.record import Record
from casid.signals import CHANNELS


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
    limit: TimeLimit,
) -> Diagnosis:
    """The diagnosis of an aircraft file; arguments and errors are those of `diagnose`."""
    aircraft = given_aircraft(aircraft, "diagnose")
    records = given_records(records, "diagnose")
    hold_out = given_records(hold_out, "diagnose: hold_out")
    require_flight((*records, *hold_out), "diagnose")
    channels_of(as_recorded, "diagnose: as_recorded")
    criteria = require(criteria or Criteria(), Criteria, "diagnose: criteria", "Criteria(...)")
    if aircraft.rotors is not None:
        judged_as = {"limit": limit, "as_recorded": as_recorded}
        return diagnose_rotorcraft(aircraft, records, hold_out, report, criteria, extended_aircraft, **judged_as)
    stages = Stages(report)
    stages.begin("faults of the data")
    as_line = linearised(aircraft, records)
    checked = check((*records, *hold_out), as_line, undo=as_recorded, criteria=criteria.data)
    flown = _flown_as_given(aircraft, checked, len(records), criteria, axes, limit, stages)
    made_worse = _made_worse(flown, checked)
    if made_worse:  # of the data: as they stand they are nearer to the simulation
        believed = (*channels_of(as_recorded, "diagnose: as_recorded"), *made_worse)
        checked = check((*records, *hold_out), as_line, undo=believed, criteria=criteria.data)
        flown = _flown_as_given(aircraft, checked, len(records), criteria, axes, limit, stages)
    with named_in_errors(checked.findings, checked.doubts, criteria.numerics.naming.trials):
        scope = flown.scope
        flight = flown.flight
        known = flown.known
        given = flown.given
        report(sentences.so_far(given, checked.findings, criteria.numerics.naming.trials))
        state = search(baseline_in_time(flight, known, stages.begin), stages.begin)

        def diagnosed(
            kept: Kept, causes: Sequence[Cause], minor: Sequence[Cause], flown: Mapping[str, FlightValue]
        ) -> DiagnosedAircraft:
            extended = extended_aircraft(state.baseline.flight.aircraft, kept.fit, causes, minor)
            std = {name: one.std for name, one in flown.items() if one.determined}
            return DiagnosedAircraft(file=aircraft, extended=with_estimates(extended, {}, std))

        found = judged(state, given, scope.held, diagnosed, stages)
        return concluded(
            found,
            scope.contradicted(aircraft, found.flight),
            scope.factors(aircraft, found.flight),
            (*scope.not_judged(found.flight), *out_of_sight(found.bare.flight, found.detectable)),
            checked.findings,
            scope.borne_out(checked.doubts, aircraft, found.flight),
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class _FlownAsGiven:
    """The file flown along the records, as they were checked."""

    scope: Scope
    flight: Subject
    known: list[Attached]
    given: AsGiven


def _flown_as_given(
    aircraft: Aircraft,
    checked: DataFindings,
    fitted: int,
    criteria: Criteria,
    axes: str | None,
    limit: TimeLimit,
    stages: Stages,
) -> _FlownAsGiven:
    """Fly the file along the records without faults of the data, and along them as they were recorded; the first
    `fitted` are those that were given to be fitted."""
    stages.begin("reading the records")
    mended, recorded = (
        split(both[:fitted], both[fitted:], criteria.parts) for both in (checked.records, checked.recorded)
    )
    with named_in_errors(checked.findings, checked.doubts, criteria.numerics.naming.trials):
        scope = scope_of(aircraft, mended, criteria, axes)
        known = attached_effects(scope.flight.aircraft, scope.flight.names)
        flight = replace(with_noise_level(scope.flight, known), limit=limit)
        stages.begin("simulation as given")
        given = fly_as_given(flight, scope.held, known)
        if any(one.handled != "reported" for one in checked.findings):
            given = replace(given, recorded=fly_recorded(flight, scope.ready(recorded), known))
    return _FlownAsGiven(scope=scope, flight=flight, known=known, given=given)


def _made_worse(flown: _FlownAsGiven, checked: DataFindings) -> tuple[str, ...]:
    """Channels that were changed although the simulation as given follows them better as they were recorded."""
    changed = {name for one in checked.findings if one.handled == "corrected" for name in one.target.split("+")}
    given = flown.given
    if not changed or given.recorded is None:
        return ()
    before, after = (error_over_noise(views) for views in (given.recorded, given.mended))
    return tuple(sorted(changed & set(CHANNELS))) if after > before else ()


@contextmanager
def named_in_errors(data: Sequence[Finding], doubts: Sequence[Doubt], most: int) -> Iterator[None]:
    """A block whose errors also name the likely reasons.

    These are faults of the `data` that could not be corrected, and impossible numbers of the file (`doubts`); at most
    `most` of each kind are listed.
    """
    try:
        yield
    except CasidError as error:
        at_fault = [one for one in data if one.handled == "reported"]
        stated = f"; {sentences.several(at_fault, most)}" if at_fault else ""
        stated += f"; of the aircraft file: {sentences.several(doubts, most)}" if doubts else ""
        if not stated:
            raise
        raise type(error)(f"{error}{stated}") from None


def extended_aircraft(aircraft: Aircraft, fit: FlightFit, causes: Sequence[Cause], minor: Sequence[Cause]) -> Aircraft:
    """The aircraft file with its estimated values and the causes of the fit.

    Named causes become effects or changes of tables. Minor causes that are part of the fit are included too; terms of
    the aerodynamics among them become ordinary terms.
    """
    known = {(e.kind, e.target, e.term) for e in aircraft.effects}
    missing = {one.effect.key for one in fit.attached}
    if fit.noise.coloured:
        missing.add(turbulence_effect("").key)
    missing -= known
    terms: dict[str, dict[str, float]] = {}
    known_std = dict(aircraft.std)  # of derivatives: the corrected ones are in the flight values, not in the fit
    effects = []
    tables = None
    for cause, named in (*((c, True) for c in causes), *((c, False) for c in minor)):
        if cause.key not in missing:
            continue
        missing.remove(cause.key)
        take_up = cause.effect.forms.into_tables
        held = take_up(tables or aircraft.tables, cause.value) if take_up else None
        if held is not None:
            tables = held
        elif not named and cause.term and cause.target in aircraft.coefficients:
            terms.setdefault(cause.target, {})[cause.term] = cause.value
            known_std[f"{cause.target}_{cause.term}"] = cause.std
        else:
            records = () if set(cause.records) == set(fit.batch.names) else cause.records
            effects.append(_as_fitted(replace(cause.entry, records=records), fit))
    if tables is not None:
        aircraft = replace(aircraft, tables=tables)
    std = {slot.name: fit.std(slot.name) for slot in fit.slots}
    estimated = with_estimates(aircraft.with_terms(terms), {name: fit[name] for name in std}, std)
    fitted = tuple(_as_fitted(e, fit) for e in estimated.effects)
    return replace(estimated, std=known_std, effects=fitted).with_effects(effects)


def _as_fitted(effect: EffectValue, fit: FlightFit) -> EffectValue:
    """An effect with its fitted onsets, in the middle of their intervals: that is when the file is flown with them."""
    onsets = next((a.onsets for a in fit.attached if a.effect.key == (effect.kind, effect.target, effect.term)), {})
    moved = dict(effect.onset_s or {})
    for record, onset in onsets.items():
        low, high = moved[record]
        moved[record] = (onset - 0.5 * (high - low), onset + 0.5 * (high - low))
    return replace(effect, onset_s=moved or None)


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
    seconds: float | None = None,
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
    seconds: float | None = None,
) -> Diagnosis: ...


def diagnose(
    simulation: Any,
    records: Any,
    hold_out: Any = (),
    report: Say = lambda stage: None,
    criteria: Criteria | None = None,
    *,
    as_recorded: bool | Sequence[str] = False,
    axes: str | None = None,
    seconds: float | None = None,
    ports: Sequence[Port] | None = None,
    exact: Sequence[str] = (),
    library: Library | None = None,
    **others: Any,
) -> Diagnosis:
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
    seconds
        Time [s] in which the verdict is asked for; by default the search ends by itself. What was not tried is listed
        in `not_judged`. Half of it belongs to what comes before the search. The file is re-estimated and flown on the
        held-out records in any case. Ctrl-C asks for the verdict so far.

    Returns
    -------
    Diagnosis
        The named causes with their sizes, and the improvement by each on records that were
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
    if seconds is not None:
        seconds = number(seconds, "diagnose: seconds", positive=True)
    for name in others:
        raise unknown("argument", name, _ARGUMENTS, "diagnose")
    if isinstance(simulation, Model):
        if axes is not None or as_recorded is not False:
            raise InputError("axes and as_recorded are for an aircraft; a Model takes ports, exact and library")
        chosen = {"ports": ports, "exact": exact, "library": library}
        with TimeLimit(seconds).answering(report) as limit:
            return diagnose_system(simulation, records, hold_out, report, criteria, **chosen, limit=limit)
    if ports is not None or exact or library is not None:
        raise InputError("ports, exact and library are for a Model; an aircraft has the ports of its mass properties")
    judged_as = {"as_recorded": as_recorded, "axes": axes}
    with TimeLimit(seconds).answering(report) as limit:
        return diagnose_aircraft(simulation, records, hold_out, report, criteria, **judged_as, limit=limit)


_ARGUMENTS = tuple(name for name in inspect.signature(diagnose).parameters if name != "others")
