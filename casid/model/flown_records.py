"""The model of an aircraft that given records can feed, with the effects of its file, and the records made ready."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from casid.errors import InputError
from casid.model.aircraft import Aircraft, EffectValue
from casid.model.causes.instruments import group_channels
from casid.model.dynamics import aircraft_model
from casid.model.in_force import InForce, named
from casid.model.measured_force import force_inputs, pulled_alike
from casid.model.path import aerodynamic_parameters
from casid.model.rotors import with_values
from casid.model.system import Model
from casid.model.with_effects import unmade
from casid.records.record import Record
from casid.signals import SURFACES, is_control


@dataclass(frozen=True, eq=False, kw_only=True)
class FlownRecords:
    """A model, and the records that feed it."""

    aircraft: Aircraft
    axes: str
    model: Model
    records: tuple[Record, ...]  # with all inputs of the model

    @property
    def _beside(self) -> list[InForce]:
        """Effects of all records that are no part of the model's equations: what they make of a record is an input."""
        names = [record.name for record in self.records]
        return [one for one in self.model.effects if one.is_history and all(map(one.concerns, names))]

    def transfer(self, name: str, omega: np.ndarray) -> np.ndarray:
        """(frequencies,) what effects of all records beside the equations make of an input or of a reading, at
        frequencies omega [rad/s]: lags and delays, where these are linear (`not_linear`)."""
        s = 1j * np.asarray(omega, dtype=float)
        total = np.ones(len(s), dtype=complex)
        for one in self._beside:
            effect = one.effect
            if effect.forms.transfer is not None and name in group_channels(effect.target):
                factor = effect.forms.transfer(s, one.sizes)
                total = total + factor - 1.0 if effect.series is not None else total * factor
        return total

    @property
    def not_linear(self) -> tuple[str, ...]:
        """Effects of all records that `transfer` leaves out: they have no transfer function."""
        return tuple(one.name for one in self._beside if one.effect.forms.transfer is None)


def flown_records(
    aircraft: Aircraft, records: Sequence[Record], axes: str | None = None, outputs: Iterable[str] | None = None
) -> FlownRecords:
    """Make model and records of an aircraft file ready. `axes` as `axes_of`; `outputs`, by default every modelled
    channel that some record has. Raises InputError when a record cannot feed the model."""
    axes = axes or axes_of(records)
    alike = pulled_alike(records)
    known = force_inputs(records)
    chosen = tuple(outputs) if outputs is not None else None
    if chosen is None:
        chosen = _measured(aircraft_model(aircraft, axes=axes, equations=False).outputs, records)
    model = aircraft_model(aircraft, axes=axes, outputs=chosen, known=known)
    ready = tuple(model.ready(unmade(record)) for record in alike)
    return FlownRecords(aircraft=aircraft, axes=axes, model=model, records=ready)


def _measured(outputs: Sequence[str], records: Sequence[Record]) -> tuple[str, ...]:
    found = tuple(o for o in outputs if any(o in r and np.isfinite(r[o]).any() for r in records))
    if not found:
        raise InputError(f"record '{records[0].name}': nothing to compare with; expected some of {', '.join(outputs)}")
    return found


def axes_of(records: Sequence[Record]) -> str:
    """The largest model that the surfaces of all records can feed: "full", "longitudinal" or "lateral"; InputError for
    none."""
    has = {s for s in SURFACES if all(s in record for record in records)}
    if has == set(SURFACES):
        return "full"
    if "delta_e" in has:
        return "longitudinal"
    if {"delta_a", "delta_r"} <= has:
        return "lateral"
    missing = ", ".join(s for s in SURFACES if s not in has)
    rotors = [n for n in records[0].channels if is_control(n) and n.removesuffix("_command") not in SURFACES]
    if rotors and not any(f"{s}_command" in records[0] for s in SURFACES):
        raise InputError(
            f"record '{records[0].name}': has rotors, {', '.join(rotors)}, and no surfaces, as of a multirotor; "
            "expected a wing here; casid check and casid diagnose take multirotors, with an aircraft file of [rotors]"
        )
    raise InputError(
        f"record '{records[0].name}': surfaces {missing} are missing; expected delta_e (longitudinal motion), "
        "delta_a and delta_r (lateral), or all three; casid check RECORD --write-map map.toml lists what its file has"
    )


def default_free(flown: FlownRecords) -> list[str]:
    """The derivatives and terms of the file that stand in an equation of the states that move."""
    model = flown.model
    rates = ca.Function("rates", [model.x, model.u, model.p, model.w], [ca.vertcat(model.f, model.h)])
    used = set(rates.sparsity_jac(2, 0).get_col())
    names = {name for _, name, _ in aerodynamic_parameters(flown.aircraft)}
    names |= {name for one in flown.aircraft.tables if one.free for name in one.knots}
    return [name for i, name in enumerate(model.parameters) if name in names and i in used]


def with_estimates(aircraft: Aircraft, values: Mapping[str, float], std: Mapping[str, float]) -> Aircraft:
    """The aircraft file with derivatives, terms and effects put to estimates by name, and their standard deviations;
    other names are left alone."""
    derivatives = {name: values[name] for name in aircraft.derivatives if name in values}
    terms = {c: {t: values.get(f"{c}_{t}", value) for t, value in table.items()} for c, table in aircraft.terms.items()}
    effects = [_estimated(one, values, std) for one in named(aircraft.effects, f"aircraft '{aircraft.name}'")]
    tables = tuple(one.with_knots(values) for one in aircraft.tables)
    numbers = [name for _, name, _ in aerodynamic_parameters(aircraft)] + list(aircraft.knots)
    known_std = {name: std[name] for name in numbers if math.isfinite(std.get(name, math.nan))}
    changed = aircraft.with_derivatives(derivatives).with_terms(terms)
    if aircraft.rotors is not None:
        changed = replace(changed, rotors=with_values(aircraft.rotors, values, std))
    return replace(changed, tables=tables, std={**aircraft.std, **known_std}, effects=tuple(effects))


def _estimated(one: InForce, values: Mapping[str, float], std: Mapping[str, float]) -> EffectValue:
    """An effect of a file with the estimates of its sizes."""
    assert one.value is not None
    found = one.value
    sizes = {"value": values.get(one.name, found.value)}
    sizes |= {key: values.get(f"{one.name}.{key}", size) for key, size in found.parameters.items()}
    told = one.effect.in_words(sizes)
    onsets = dict(found.onset_s or {})
    for record, at in one.onsets.items():
        moved = values.get(f"{one.name}.onset[{record}]", at) - at
        onsets[record] = (onsets[record][0] + moved, onsets[record][1] + moved)
    return replace(
        found,
        value=told.pop("value"),
        std=std.get(one.name, found.std),
        parameters=told,
        onset_s=onsets or None,
    )
