"""Diagnose a model with ports, of an aircraft with rotors or of any other system."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from casid.arguments import require
from casid.data_check.check import check, check_readings
from casid.data_check.rotors import until_one_stands
from casid.diagnosis import sentences
from casid.diagnosis.cause import Cause
from casid.diagnosis.criteria import Criteria
from casid.diagnosis.diagnosed import DiagnosedAircraft, DiagnosedSystem
from casid.diagnosis.engine.baseline import Baseline
from casid.diagnosis.engine.held_out import Kept
from casid.diagnosis.engine.search import search
from casid.diagnosis.flight.evaluation import FlightFit
from casid.diagnosis.flight.hypothesis import OFFSET
from casid.diagnosis.flight.ported import first_fit, ported
from casid.diagnosis.flight.rotorcraft import (
    before_vertical,
    in_its_colour,
    known_effects,
    rotorcraft,
    too_small_for_rotors,
    with_thrust_curve,
)
from casid.diagnosis.flight.rotorcraft import first_fit as rotorcraft_fit
from casid.diagnosis.given.as_given import fly_system_as_given
from casid.diagnosis.given.contradicted import contradicted_parameters
from casid.diagnosis.given.scope import split
from casid.diagnosis.last_tests import judged
from casid.diagnosis.result import Diagnosis
from casid.diagnosis.time_limit import Stages, TimeLimit
from casid.diagnosis.verdict import concluded
from casid.errors import InputError
from casid.model.aircraft import Aircraft
from casid.model.library import Library
from casid.model.port import ModelPort as Port
from casid.model.port import check_ports, ports_of
from casid.model.system import Model, check_continuous
from casid.model.with_effects import with_effects
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
    limit: TimeLimit | None = None,
) -> Diagnosis:
    """The diagnosis of a system; arguments and errors are those of `diagnose`.

    All parameters are fitted, with the prior of `model.prior_std`; one whose prior is 0 stays nominal. Noise of the
    readings is judged from the band above the motion. One Runge-Kutta step of fourth order goes from sample to sample.
    Criteria in seconds are of an aircraft's records, and become longer or shorter with the records of a system.
    """
    check_continuous(model, "diagnose")
    criteria = require(criteria or Criteria(), Criteria, "diagnose: criteria", "cs.Criteria(...)")
    library = require(library or Library(), Library, "diagnose: library", "cs.Library(...)")
    if model.events:
        raise InputError(f"diagnose: model '{model.name}' has events, which are not taken here; give one without")
    stages = Stages(report)
    limit = limit or TimeLimit()
    stages.begin("reading the records")
    own = (*model.inputs, *model.outputs)
    records = given_records(records, "diagnose", own)
    hold_out = given_records(hold_out, "diagnose: hold_out", own)
    findings, whole = check_readings([*records, *hold_out], model.outputs)
    fit_on, held = split(whole[: len(records)], whole[len(records) :], criteria.parts)
    _check_measured(model, held)
    ports = ports_of(model, exact) if ports is None else tuple(ports)
    check_ports(model, ports)
    subject, of = ported(model, fit_on, ports, library, criteria)
    subject = replace(subject, limit=limit)
    stages.begin("refit of the model")
    refitted = first_fit(subject)
    stages.begin("simulation as given")
    given = fly_system_as_given(subject, held, lambda names: (), refitted.derivatives)
    report(sentences.so_far(given, findings, criteria.numerics.naming.trials))

    def diagnosed(kept: Kept, *_: object) -> DiagnosedSystem:
        base = replace(of.base, nominal={**of.base.nominal, **{name: kept.fit[name] for name in subject.freed}})
        found = [one.entry for one in kept.fit.attached]
        return DiagnosedSystem(model=model, extended=with_effects(base, found, of.terms))

    found = judged(search(Baseline.alone(refitted), stages.begin), given, held, diagnosed, stages)
    return concluded(found, contradicted_parameters(of.base, found.flight, criteria), data=findings)


ExtendedBy = Callable[[Aircraft, FlightFit, Sequence[Cause], Sequence[Cause]], Aircraft]


def diagnose_rotorcraft(
    aircraft: Aircraft,
    records: Sequence[Record],
    hold_out: Sequence[Record],
    report: Callable[[str], None],
    criteria: Criteria,
    extended: ExtendedBy,
    *,
    limit: TimeLimit,
    as_recorded: bool | Sequence[str] = False,
) -> Diagnosis:
    """Diagnose an aircraft with rotors; `extended` makes its file of a fit, the named and the minor causes.

    Raises InputError for records that lack an input of a rotor, and for channels that no record has.
    """
    stages = Stages(report)
    stages.begin("faults of the data")
    checked = check((*records, *hold_out), aircraft, undo=as_recorded, criteria=criteria.data)
    given_to_fit = len(records)
    stages.begin("reading the records")
    rotors = aircraft.required_rotors
    whole = [until_one_stands(one, rotors) for one in checked.records]
    records, hold_out = (whole[:given_to_fit], whole[given_to_fit:])
    step = 1.0 / criteria.rotors.rate
    steep = [left for record in (*records, *hold_out) for left in before_vertical(record, step)[1]]
    records, hold_out = ([before_vertical(one, step)[0] for one in both] for both in (records, hold_out))
    fit_on, held = split(records, hold_out, criteria.parts)
    flight, base = rotorcraft(aircraft, fit_on, criteria)
    flight = replace(flight, limit=limit)
    _check_measured(base, held)
    stages.begin("refit of the model")
    flight, refitted = in_its_colour(flight, rotorcraft_fit(flight))
    stages.begin("simulation as given")
    given = fly_system_as_given(flight, held, partial(known_effects, flight), refitted.derivatives)
    report(sentences.so_far(given, checked.findings, criteria.numerics.naming.trials))

    def diagnosed(kept: Kept, causes: Sequence[Cause], minor: Sequence[Cause], _: object) -> DiagnosedAircraft:
        return DiagnosedAircraft(file=aircraft, extended=extended(aircraft, kept.fit, causes, minor))

    found = judged(search(Baseline.alone(refitted), stages.begin), given, held, diagnosed, stages)
    found = with_thrust_curve(found)
    usual = () if aircraft.relative_uncertainty else aircraft.derivatives  # of the wing, where the file states nothing
    stated = {name: std for name, std in base.prior_std.items() if name not in usual}
    against = contradicted_parameters(replace(base, prior_std=stated), found.flight, criteria)
    least = criteria.significance.sigmas
    clear = [one for one in against if abs(one.flight - one.given) > least * stated.get(one.parameter, 0.0)]
    told = [one for one in clear if not one.parameter.startswith(OFFSET)]
    not_judged = [*steep, *too_small_for_rotors(aircraft, found.detectable, criteria)]
    return concluded(found, told, not_judged=not_judged, data=checked.findings)


def _check_measured(model: Model, held: Sequence[Record]) -> None:
    """Raises InputError if no held-out record measures any output."""
    if not any(name in record and np.isfinite(record[name]).any() for record in held for name in model.outputs):
        raise InputError(
            f"diagnose: held-out {', '.join(record.name for record in held)}: got none of the outputs "
            f"{', '.join(model.outputs)}, expected at least one; add the columns, or hold out another record"
        )
