"""The effects of an aircraft file in force: the model that has them, and the records made ready for it.

How an effect acts depends on where it enters: a symbolic one is a parameter of the model, fixed at the value of the
file unless it is freed. One before the aerodynamics (a lagged surface, a gust) is a known time history. A lag of an
instrument is a further state of the model; a delay or a ringing of an instrument is taken out of the record, exactly
but for the interpolation between samples. Turbulence is no deterministic effect: it is process noise.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import casadi as ca
import numpy as np

from casid.errors import InputError
from casid.model import operators
from casid.model.aircraft import Aircraft, EffectValue
from casid.model.causes import group_channels
from casid.model.dynamics import aircraft_model, flight_inputs
from casid.model.effect import Effect
from casid.model.effects import effect_of
from casid.model.measured_force import force_inputs, pulled_alike
from casid.model.path import INTEGRALS, aerodynamic_parameters
from casid.model.rotors import with_values
from casid.model.system import Model
from casid.records.record import Record
from casid.signals import SURFACES, is_control, scale_of


@dataclass(frozen=True, eq=False, kw_only=True)
class Applied:
    """An aircraft model with the effects of its file, and records that feed it."""

    aircraft: Aircraft
    axes: str
    # inputs include the known time histories; parameters the symbolic effects and lags, under `Effect.name`
    model: Model
    # with inputs completed, known histories added, delays and ringing of instruments taken out
    records: tuple[Record, ...]
    turbulence: float  # r.m.s. velocity [m/s] of an effect `turbulence` in the file, 0: none
    _timed: tuple[EffectValue, ...]
    _undone: tuple[EffectValue, ...]

    @property
    def unseen_by_equations(self) -> tuple[str, ...]:
        """Effects of the file that the equation-error form of the model does not have."""
        effects = [effect_of(e) for e in self.aircraft.effects if e.value != 0.0]
        lags = [e.name for e in effects if e.forms.instrument is not None and e.name in self.model.parameters]
        return (*(e.name for e in effects if e.change is not None and not e.in_equations), *lags)

    def transfer(self, name: str, omega: np.ndarray) -> np.ndarray:
        """(frequencies,) what effects of all records that are no part of the model make of an input or of a reading,
        at frequencies omega [rad/s]: lags and delays, where these are linear (`not_linear`)."""
        s = 1j * np.asarray(omega, dtype=float)
        total = np.ones(len(s), dtype=complex)
        for value in self._throughout:
            effect = effect_of(value)
            if effect.forms.transfer is not None and name in group_channels(effect.target):
                factor = effect.forms.transfer(s, values_of(value, effect))
                total = total + factor - 1.0 if value in self._timed else total * factor
        return total

    @property
    def not_linear(self) -> tuple[str, ...]:
        """Effects of all records that `transfer` leaves out: they have no transfer function."""
        return tuple(e.name for e in map(effect_of, self._throughout) if e.forms.transfer is None)

    @property
    def _throughout(self) -> list[EffectValue]:
        """Effects that are no part of the model, of all records."""
        both = (*self._timed, *self._undone)
        return [value for value in both if all(_concerns(value, record.name) for record in self.records)]

    def readings(self, record: Record, outputs: np.ndarray) -> np.ndarray:
        """(N, outputs) what the instruments of this aircraft read when the model's outputs are `outputs`."""
        names = self.model.outputs
        read = dict(record.channels) | {name: outputs[:, i] for i, name in enumerate(names)}
        for value in self._undone:
            if _concerns(value, record.name):
                effect = effect_of(value)
                assert effect.output is not None
                read |= effect.output(record.t, read, values_of(value, effect))
        return np.stack([read[name] for name in names], axis=1)


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


def default_free(applied: Applied) -> list[str]:
    """The derivatives and terms of the file in the equations of the states that move."""
    model = applied.model
    rates = ca.Function("rates", [model.x, model.u, model.p, model.w], [ca.vertcat(model.f, model.h)])
    used = set(rates.sparsity_jac(2, 0).get_col())
    names = {name for _, name, _ in aerodynamic_parameters(applied.aircraft)}
    names |= {name for one in applied.aircraft.tables if one.free for name in one.knots}
    return [name for i, name in enumerate(model.parameters) if name in names and i in used]


def apply_effects(
    aircraft: Aircraft,
    records: Sequence[Record],
    axes: str | None = None,
    outputs: Iterable[str] | None = None,
    like: Model | None = None,
) -> Applied:
    """Model and records of an aircraft file, its effects in force. `axes` as `axes_of`; `outputs`, by default every
    modelled channel that some record has, heading and altitude only when an effect is about them. Raises InputError
    when a record cannot feed the model, nothing modelled is measured, or two symbolic effects have one kind and target.
    """
    axes = axes or axes_of(records)
    chosen = tuple(outputs) if outputs is not None else _measured(_modelled(aircraft, axes), records)
    dt = min(record.dt for record in records)
    symbolic, timed, lags, undone = _sorted(aircraft, dt)
    masks = {_mask(effect_of(value)): value for value in (*symbolic, *lags) if value.records}
    effects = [_only_where_present(effect_of(v)) if v.records else effect_of(v) for v in symbolic]
    bare_records = [flight_inputs(aircraft, _without_instrument_effects(r, undone), axes) for r in records]
    histories = [_histories(timed, record) for record in bare_records]
    stations = sorted({station for history in histories for station in history})
    bare_records = pulled_alike(bare_records)
    pull = force_inputs(records)
    if like is None:
        model = aircraft_model(aircraft, axes=axes, outputs=chosen, effects=effects, known=(*stations, *masks, *pull))
        model = with_instruments(model, [(effect_of(v), v.value) for v in lags])
    else:
        sizes = {effect_of(v).name: v.value for v in (*symbolic, *lags)}
        model = replace(like, nominal={**like.nominal, **sizes})
    ready = []
    for record, history in zip(bare_records, histories, strict=True):
        added = {station: history.get(station, np.zeros(len(record))) for station in stations}
        added |= {name: np.full(len(record), float(_concerns(value, record.name))) for name, value in masks.items()}
        ready.append(record.with_channels(**added))
    turbulence = [v.value for v in aircraft.effects if effect_of(v).stochastic]
    return Applied(
        aircraft=aircraft,
        axes=axes,
        model=model,
        records=tuple(ready),
        turbulence=max(turbulence, default=0.0),
        _timed=tuple(timed),
        _undone=tuple(undone),
    )


def _modelled(aircraft: Aircraft, axes: str) -> tuple[str, ...]:
    """The channels of the model, heading and altitude only when an effect is about them."""
    asked = {channel for value in aircraft.effects for channel in effect_of(value).reads}
    outputs = aircraft_model(aircraft, axes=axes, effects=()).outputs
    return (*outputs, *(name for name in INTEGRALS if name in asked))


def with_instruments(model: Model, lags: Sequence[tuple[Effect, float]]) -> Model:
    """The model with slow instruments (`Effect.instrument`): one state per channel, what its instrument reads; the
    value is a parameter under the effect's name, `sensor_lag(alpha)`. A model that has an input which says where the
    effect is present reads without it elsewhere."""
    slow = {c: effect for effect, _ in lags for c in group_channels(effect.target) if c in model.outputs}
    if not slow:
        return model
    names = [e.name for e, _ in lags]
    T = ca.SX.sym("T", len(lags))
    reading = ca.SX.sym("reading", len(slow))
    rates = []
    h = ca.SX(model.h)
    for i, (channel, effect) in enumerate(slow.items()):
        row = model.outputs.index(channel)
        assert effect.forms.instrument is not None
        rates.append(effect.forms.instrument(h[row], reading[i], {"value": T[names.index(effect.name)]}))
        mask = _mask(effect)
        present = model.u[model.inputs.index(mask)] if mask in model.inputs else 1.0
        h[row] = present * reading[i] + (1.0 - present) * h[row]

    return replace(
        model,
        states=(*model.states, *(f"{c}_read" for c in slow)),
        parameters=(*model.parameters, *names),
        x=ca.vertcat(model.x, reading),
        p=ca.vertcat(model.p, T),
        f=ca.vertcat(model.f, *rates),
        h=h,
        guess=partial(_with_readings, model.guess, tuple(slow)),
        nominal={**model.nominal, **{e.name: value for e, value in lags}},
        state_scale={**model.state_scale, **{f"{c}_read": scale_of(c) for c in slow}},
        units={**model.units, **{e.name: e.unit for e, _ in lags}},
    )


def _with_readings(guess: Callable[[Record], np.ndarray], channels: Sequence[str], record: Record) -> np.ndarray:
    """A guess, and behind it what the slow instruments read."""
    columns = []
    for channel in channels:
        values = record[channel] if channel in record else np.zeros(len(record))
        good = np.isfinite(values)
        columns.append(np.interp(record.t, record.t[good], values[good]) if good.any() else np.zeros(len(record)))
    return np.column_stack([guess(record), *columns])


def with_estimates(aircraft: Aircraft, values: Mapping[str, float], std: Mapping[str, float]) -> Aircraft:
    """The aircraft file with derivatives, terms and effects put to estimates by name, and their standard deviations;
    other names are left alone."""
    derivatives = {name: values[name] for name in aircraft.derivatives if name in values}
    terms = {c: {t: values.get(f"{c}_{t}", value) for t, value in table.items()} for c, table in aircraft.terms.items()}
    effects = []
    for effect in aircraft.effects:
        known = effect_of(effect)
        if known.name in values:
            effect = replace(effect, value=values[known.name], std=std[known.name])
        parameters = {key: values.get(f"{known.name}.{key}", value) for key, value in effect.parameters.items()}
        told = known.in_words({"value": effect.value, **parameters})
        effects.append(replace(effect, value=told.pop("value"), parameters=told))
    tables = tuple(one.with_knots(values) for one in aircraft.tables)
    named = [name for _, name, _ in aerodynamic_parameters(aircraft)] + list(aircraft.knots)
    known_std = {name: std[name] for name in named if math.isfinite(std.get(name, math.nan))}
    changed = aircraft.with_derivatives(derivatives).with_terms(terms)
    if aircraft.rotors is not None:
        changed = replace(changed, rotors=with_values(aircraft.rotors, values, std))
    return replace(changed, tables=tables, std={**aircraft.std, **known_std}, effects=tuple(effects))


def _measured(outputs: Sequence[str], records: Sequence[Record]) -> tuple[str, ...]:
    found = tuple(o for o in outputs if any(o in r and np.isfinite(r[o]).any() for r in records))
    if not found:
        raise InputError(f"record '{records[0].name}': nothing to compare with; expected some of {', '.join(outputs)}")
    return found


def _sorted(aircraft: Aircraft, dt: float) -> tuple[list[EffectValue], ...]:
    """Effects of the file that are: symbolic; time histories; lags with a state; undone in the record."""
    symbolic = []
    timed = []
    lags = []
    undone = []
    names = set()
    for value in aircraft.effects:
        effect = effect_of(value)
        if effect.change is not None:
            if effect.name in names:
                raise InputError(f"aircraft '{aircraft.name}': effect {effect.name} stands twice; keep one of the two")
            names.add(effect.name)
            for key in effect.beside if effect.states else ():
                if not value.parameters.get(key, effect.further.grid[0][key]) > 0.0:
                    raise InputError(
                        f"aircraft '{aircraft.name}': effect {effect.name} cannot act; its parameter '{key}' must be "
                        f"positive, got {value.parameters[key]}"
                    )
            symbolic.append(value)
        elif effect.series is not None:
            timed.append(value)
        elif effect.forms.instrument is not None and value.value != 0.0:
            if value.value < 0.0:
                raise InputError(
                    f"aircraft '{aircraft.name}': effect {effect.name} cannot act; a lag needs a positive time "
                    f"constant, got {value.value}"
                )
            # a time constant below the sampling interval would need a finer step
            (lags if value.value >= dt else undone).append(value)
        elif effect.output is not None:
            undone.append(value)
    return symbolic, timed, lags, undone


def _concerns(value: EffectValue, record: str) -> bool:
    return not value.records or record in value.records


def _histories(timed: Sequence[EffectValue], record: Record) -> dict[str, np.ndarray]:
    """Station -> (N,) what all time-history effects together put there."""
    total: dict[str, np.ndarray] = {}
    for value in timed:
        for station, series in _series(value, record).items():
            total[station] = total.get(station, 0.0) + series
    return total


def _series(value: EffectValue, record: Record) -> dict[str, np.ndarray]:
    """Station -> (N,) what a time-history effect puts there in a record; empty where it is absent."""
    effect = effect_of(value)
    onsets = value.onset_s or {}
    if effect.series is None or not _concerns(value, record.name) or (effect.timed and record.name not in onsets):
        return {}
    values = values_of(value, effect)
    if effect.timed:
        values["onset"] = 0.5 * sum(onsets[record.name])
    known = dict(record.channels)
    if all(name in record for name in operators.TURNING):
        known["turned"] = operators.turned(record.t, *(known[name] for name in operators.TURNING))
    return effect.series(record.t, known, values)


def values_of(value: EffectValue, effect: Effect) -> dict[str, float]:
    """The numbers that an effect's functions take. Raises InputError when the file leaves out one that it may not."""
    values = {"value": value.value, **effect.further.defaults, **value.parameters}
    for name in effect.further.grid[0] if effect.further.grid else ():
        if name not in values:
            raise InputError(
                f"effect {effect.name}: its parameter '{name}' is missing; add parameters = {{ {name} = ... }}"
            )
    return values


def _mask(effect: Effect) -> str:
    return f"present {effect.name}"


def _only_where_present(effect: Effect) -> Effect:
    """The effect scaled by an input that is 1 in records that have it and 0 in the others."""
    change = effect.change
    mask = _mask(effect)
    assert change is not None
    return replace(
        effect, change=lambda path, values: change(path, {**values, "value": values["value"] * path.inputs[mask]})
    )


def _without_instrument_effects(record: Record, undone: Sequence[EffectValue]) -> Record:
    """The record as instruments without these delays and oscillations would have given it, latest effect first."""
    for value in reversed(undone):
        effect = effect_of(value)
        if not _concerns(value, record.name):
            continue
        values = values_of(value, effect)
        read = record.channels
        if effect.forms.undo is not None:
            record = record.with_channels(**effect.forms.undo(record.t, read, values))
        elif effect.output is not None:
            twice = effect.output(record.t, read, values)
            record = record.with_channels(**{c: 2.0 * read[c] - series for c, series in twice.items()})
    return record
