"""The extended aircraft file: estimated values and named causes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from casid.diagnosis.cause import Cause
from casid.diagnosis.flight.evaluation import FlightFit
from casid.model.aircraft import Aircraft, EffectValue
from casid.model.applied import with_estimates
from casid.model.causes import turbulence as turbulence_effect
from casid.model.effects import effect_of


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
    effects, tables = [], None
    for cause, named in (*((c, True) for c in causes), *((c, False) for c in minor)):
        key = cause.kind, cause.target, cause.term
        if key not in missing:
            continue
        missing.remove(key)
        take_up = effect_of(cause).into_tables
        held = take_up(tables or aircraft.tables, cause.value) if take_up else None
        if held is not None:
            tables = held
        elif not named and cause.term and cause.target in aircraft.coefficients:
            terms.setdefault(cause.target, {})[cause.term] = cause.value
        else:
            effects.append(_as_effect(cause, fit.batch.names))
    if tables is not None:
        aircraft = replace(aircraft, tables=tables)
    std = {slot.name: fit.std(slot.name) for slot in fit.slots}
    estimated = with_estimates(aircraft, {name: fit[name] for name in std}, std)
    return (
        replace(estimated, effects=tuple(_as_fitted(e, fit) for e in estimated.effects))
        .with_terms(terms)
        .with_effects(effects)
    )


def _as_effect(cause: Cause, fitted: Sequence[str]) -> EffectValue:
    """The cause as an effect of an aircraft file."""
    return EffectValue(
        kind=cause.kind,
        target=cause.target,
        term=cause.term,
        value=cause.value,
        std=cause.std,
        records=cause.records if set(cause.records) != set(fitted) else (),
        onset_s=dict(cause.onset_s) if cause.onset_s else None,
        parameters=dict(cause.parameters),
        sentence=cause.sentence,
    )


def _as_fitted(effect: EffectValue, fit: FlightFit) -> EffectValue:
    """An effect of the file with its fitted onsets; the width of their intervals is unchanged."""
    onsets = next((a.onsets for a in fit.attached if a.effect.key == (effect.kind, effect.target, effect.term)), {})
    moved = dict(effect.onset_s or {})
    for record, onset in onsets.items():
        low, high = moved[record]
        moved[record] = (onset - 0.5 * (high - low), onset + 0.5 * (high - low))
    return replace(effect, onset_s=moved or None)
