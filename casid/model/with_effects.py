"""Effects in force in a model: their sizes are parameters of it, wherever on the way from command to reading they act.

Inside the equations an effect is an expression. What it makes of a record, a lagged command or a gust, is a history: an
input of the model, to first order about the values of its sizes (`History`). With these at the values that it was made
for the history and its derivatives are exact; `solve` makes it again where they moved. A slow instrument is a state.
A late one reads the motion of an earlier time: its readings stand beside the samples nearest to that time, and the
rest, a part of a sample, is a step of the motion (`ready`). Records are not changed: what a file says is wrong in the
data is a part of the prediction.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import casadi as ca
import numpy as np

from casid.errors import InputError, check_known, unknown
from casid.model import station
from casid.model.causes.instruments import group_channels, of_input
from casid.model.effect import KINDS, Effect
from casid.model.effect_value import EffectValue
from casid.model.effects import effect_of
from casid.model.in_force import (
    TIME,
    History,
    InForce,
    history_of,
    is_slow_instrument,
    named,
    slope_input,
)
from casid.model.port import entering
from casid.model.rotors import ALL
from casid.model.system import EquationForm, Model, runge_kutta, substituted, variables
from casid.records.record import Record, filled
from casid.signals import SURFACES, is_control, scale_of

_RECORDED = "recorded "  # a channel of which readings stand beside other samples than their own
_MADE_AT = "made at "  # the size at which histories were made
_RATE = "rate of "  # of an input [1/s]


def history_inputs(model: Model) -> tuple[str, ...]:
    """Names of the inputs of a model that `ready` makes of its histories."""
    names = [s for one in model.histories for s in one.stations]
    names += [slope_input(*pair) for one in model.histories for pair in one.slopes]
    return tuple(dict.fromkeys(names))


# ---- the model


def times_of_readings(model: Model) -> tuple[str, ...]:
    """Names of the inputs by which readings are of another time than that of their sample."""
    return tuple(name for name in model.inputs if name.startswith(TIME))


def with_stations(model: Model, names: Sequence[str]) -> Model:
    """The model with further inputs, each of which adds to an input, an equation or a reading, by its name."""
    names = [name for name in names if name not in model.inputs]
    if not names:
        return model
    added = ca.SX.sym("station", len(names))
    u, w, f, h = entering(model, names, added)
    changed = replace(model, f=f, h=h)
    before = ca.vertcat(model.u, model.w)
    return substituted(changed, before, ca.vertcat(u, w), inputs=(*model.inputs, *names), u=ca.vertcat(model.u, added))


def with_histories(model: Model, histories: Sequence[History]) -> Model:
    """The model with sizes of histories as parameters; the stations of these are inputs of it already."""
    if not histories:
        return model
    pairs = [pair for one in histories for pair in one.slopes]
    names = tuple(dict.fromkeys(p for one in histories for p in one.parameters))
    p = ca.SX.sym("size", len(names))
    slopes = ca.SX.sym("slope", len(pairs))
    u = ca.SX(model.u)
    for k, (at, parameter) in enumerate(pairs):
        u[model.inputs.index(at)] += slopes[k] * p[names.index(parameter)]
    form = model.equation
    sizes = dict(zip(names, ca.vertsplit(p), strict=True))
    return substituted(
        model,
        model.u,
        u,
        inputs=(*model.inputs, *(slope_input(*pair) for pair in pairs)),
        parameters=(*model.parameters, *names),
        u=ca.vertcat(model.u, slopes),
        p=ca.vertcat(model.p, p),
        **_with_sizes(model, [one.of for one in histories]),
        equation=None if form is None else _in_equations(form, pairs, sizes),
        histories=(*model.histories, *histories),
    )


def _with_sizes(model: Model, found: Iterable[InForce]) -> dict[str, Any]:
    """What a model states of its parameters, with those of effects."""
    nominal = dict(model.nominal)
    units = dict(model.units)
    prior_std = dict(model.prior_std)
    for one in found:
        nominal |= one.parameters
        units |= one.units
        prior_std |= one.prior_std
    return {"nominal": nominal, "units": units, "prior_std": prior_std}


def _in_equations(form: EquationForm, pairs: Sequence[tuple[str, str]], sizes: Mapping[str, Any]) -> EquationForm:
    """The equation-error form with histories at its channels."""
    acting = [pair for pair in pairs if pair[0] in form.channels]
    if not acting:
        return form
    slopes = ca.SX.sym("slope", len(acting))
    m = ca.SX(form.m)
    for k, (at, parameter) in enumerate(acting):
        m[form.channels.index(at)] += slopes[k] * sizes[parameter]
    target, prediction = ca.substitute([form.target, form.prediction], [form.m], [m])
    channels = (*form.channels, *(slope_input(*pair) for pair in acting))
    return replace(form, channels=channels, m=ca.vertcat(form.m, slopes), target=target, prediction=prediction)


def with_instruments(model: Model, lags: Sequence[InForce]) -> Model:
    """The model with slow instruments (`Effect.instrument`): one state per channel, what its instrument reads; the
    value is a parameter under the effect's name, `sensor_lag(alpha)`. A model that has an input which says where the
    effect is present reads without it elsewhere."""
    slow = {c: one for one in lags for c in group_channels(one.effect.target) if c in model.outputs}
    if not slow:
        return model
    names = [one.name for one in lags]
    T = ca.SX.sym("T", len(lags))
    reading = ca.SX.sym("reading", len(slow))
    rates = []
    h = ca.SX(model.h)
    for i, (channel, one) in enumerate(slow.items()):
        row = model.outputs.index(channel)
        assert one.effect.forms.instrument is not None
        rates.append(one.effect.forms.instrument(h[row], reading[i], {"value": T[names.index(one.name)]}))
        present = model.u[model.inputs.index(one.masked)] if one.masked in model.inputs else 1.0
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
        **_with_sizes(model, lags),
        state_scale={**model.state_scale, **{f"{c}_read": scale_of(c) for c in slow}},
        events={name: ca.vertcat(after, reading) for name, after in model.events.items()},
    )


def with_states(model: Model, found: Iterable[InForce]) -> Model:
    """The model with the states of effects, which rest: what these change makes their rates."""
    names = tuple(name for one in found for name in one.effect.states)
    if not names:
        return model
    added = ca.SX.sym("state", len(names))
    return replace(
        model,
        states=(*model.states, *names),
        x=ca.vertcat(model.x, added),
        f=ca.vertcat(model.f, ca.SX.zeros(len(names))),
        guess=partial(_with_halves, model.guess, len(names)),
        state_scale={**model.state_scale, **dict.fromkeys(names, 1.0)},
        events={name: ca.vertcat(after, added) for name, after in model.events.items()},
    )


def _with_halves(guess: Callable[[Record], np.ndarray], count: int, record: Record) -> np.ndarray:
    """A guess, and behind it states of effects at half of their size, by which they are uncertain."""
    return np.column_stack([guess(record), np.full((len(record), count), 0.5)])


def _with_readings(guess: Callable[[Record], np.ndarray], channels: Sequence[str], record: Record) -> np.ndarray:
    """A guess, and behind it what the slow instruments read."""
    return np.column_stack([guess(record), *(filled(record, channel) for channel in channels)])


def with_late_readings(model: Model, channels: Sequence[str]) -> Model:
    """The model with readings of another time than that of their sample, by inputs `time of CHANNEL` [s]: one step of
    Runge and Kutta leads from the state of the sample to that of the reading. Raises InputError in discrete time."""
    late = [c for c in dict.fromkeys(channels) if c in model.outputs]
    if not late:
        return model
    if model.period is not None:
        raise InputError(
            f"model '{model.name}' is in discrete time, and has no motion between samples; write the delay of a "
            "reading as states, one per sample"
        )
    rates = ca.SX.sym("rate", len(model.inputs))
    off = ca.SX.sym("time", len(late))
    f = ca.Function("f", [model.x, model.u, model.p, model.w], [model.f])
    h = ca.Function("h", [model.x, model.u, model.p, model.w], [model.h])
    read = ca.SX(model.h)
    for k, channel in enumerate(late):
        s = off[k]
        end = model.u + s * rates
        inputs = (model.u, model.u + 0.5 * s * rates, end)
        there = runge_kutta(f, model.x, inputs, s, model.p, model.w)
        row = model.outputs.index(channel)
        read[row] = h(there, end, model.p, model.w)[row]
    return replace(
        model,
        inputs=(*model.inputs, *(_RATE + name for name in model.inputs), *(TIME + c for c in late)),
        u=ca.vertcat(model.u, rates, off),
        h=read,
    )


# ---- records


def ready(model: Model, record: Record, values: Mapping[str, float] | None = None) -> Record:
    """Make a record ready for a model: inputs that follow from other channels, and the histories of its effects at
    `values` of the parameters, by default nominal.

    A record that was made ready at the same values stays as it is, also where it was cut since.
    """
    if model.prepare is not None and any(name not in record for name in model.inputs):
        record = model.prepare(record)
    own = {name for one in model.histories for name in one.parameters}
    sizes = {**model.nominal, **{name: value for name, value in (values or {}).items() if name in own}}
    masks = _present(model, record.name)
    inputs = history_inputs(model)
    made_at = {_MADE_AT + name: sizes[name] for name in own}
    if _is_made(record, made_at) and all(name in record for name in (*inputs, *masks)):
        return record
    whole = _own(record)
    added = {name: np.zeros(len(whole)) for name in inputs}
    for one in model.histories:
        series, slopes = one.at(whole, sizes)
        for name in one.stations:
            added[name] = added[name] + series.get(name, 0.0)
            for parameter, slope in slopes.items():
                if name in slope:
                    added[slope_input(name, parameter)] = slope[name]
                    added[name] = added[name] - sizes[parameter] * slope[name]
    added |= _beside(whole, _lateness(model, whole, sizes), added)
    added |= {name: np.full(len(whole), float(value)) for name, value in (masks | made_at).items()}
    made = whole.with_channels(**added)
    rates = {n: _slope(made, n.removeprefix(_RATE)) for n in model.inputs if n.startswith(_RATE)}
    return _held_alike(made.with_channels(**rates), model)


def _is_made(record: Record, at: Mapping[str, float]) -> bool:
    """Return True for a record that was made ready at these sizes."""
    return all(name in record and float(record[name][0]) == value for name, value in at.items())


def unmade(record: Record) -> Record:
    """The record as one that is to be made ready anew, for its channels may have changed since."""
    return record.without(*(name for name in record.channels if name.startswith(_MADE_AT)))


def _present(model: Model, record: str) -> dict[str, bool]:
    """Input that says where an effect is present -> whether it is, in a record."""
    return {one.masked: one.concerns(record) for one in model.effects if one.masked in model.inputs}


def _own(record: Record) -> Record:
    """The record with readings beside their own samples."""
    moved = {n.removeprefix(_RECORDED): v for n, v in record.channels.items() if n.startswith(_RECORDED)}
    return record.with_channels(**moved) if moved else record


def _lateness(model: Model, record: Record, sizes: Mapping[str, float]) -> dict[str, np.ndarray]:
    """Channel -> (N,) by how much [s] its readings are late, at the given sizes."""
    found = {c: np.zeros(len(record)) for c in model.outputs if TIME + c in model.inputs}
    for one in model.histories if found else ():
        series, _ = one.at(record, sizes)
        for channel in found:
            found[channel] = found[channel] - series.get(TIME + channel, 0.0)
    return found


def _beside(record: Record, late: Mapping[str, np.ndarray], added: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Readings beside the samples nearest to the times that they are of, and how far these are apart."""
    found: dict[str, np.ndarray] = {}
    t = record.t
    for channel, by in late.items():
        at, of = nearest_samples(t, by)
        readings = np.full(len(t), np.nan)
        if channel in record:
            readings[at] = record[channel][of]
            found[_RECORDED + channel] = record[channel]
            found[channel] = readings
        apart = np.zeros(len(t))
        apart[at] = t[of] - t[at]
        names = [n for n in added if n == TIME + channel or n.startswith(f"{TIME}{channel} by ")]
        for name in names:  # of the reading, not of the sample beside which it stands
            moved = np.zeros(len(t))
            moved[at] = added[name][of]
            found[name] = moved + (apart if name == TIME + channel else 0.0)
    return found


def nearest_samples(t: np.ndarray, late: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Samples beside which readings stand that are late by so much [s] (N,), and those at which these were read."""
    wanted = t - late
    there = np.flatnonzero((wanted >= t[0] - 1e-9) & (wanted <= t[-1] + 1e-9))
    after = np.clip(np.searchsorted(t, wanted[there]), 1, len(t) - 1)
    nearer = wanted[there] - t[after - 1] < t[after] - wanted[there]
    at = np.where(nearer, after - 1, after)
    at, first = np.unique(at, return_index=True)
    return at, there[first]


def _slope(record: Record, name: str) -> np.ndarray:
    """Rates of an input between samples [1/s]: none of one that is held."""
    if record.hold_of(name) == "held" or len(record) < 2:
        return np.zeros(len(record))
    return np.gradient(record[name], record.t)


def _held_alike(record: Record, model: Model) -> Record:
    """The record whose histories at an input run between samples as that does."""
    if isinstance(record.hold, str):
        return record
    held = {name: "held" for name in history_inputs(model) if _acts_on_a_held_one(record, name)}
    return replace(record, hold={**record.hold, **held}) if held else record


def _acts_on_a_held_one(record: Record, name: str) -> bool:
    target = name.split(" by ")[0].removeprefix(station.control(""))
    return target in record and record.hold_of(target) == "held"


def at_own_times(
    model: Model, record: Record, outputs: np.ndarray, values: Mapping[str, float] | None = None
) -> np.ndarray:
    """(N, outputs) of a record made ready, each reading at the time at which it was read, the first one held before."""
    sizes = {**model.nominal, **{n: v for n, v in (values or {}).items() if n in model.nominal}}
    found = outputs.copy()
    for channel, late in _lateness(model, _own(record), sizes).items():
        at, of = nearest_samples(record.t, late)
        i = model.outputs.index(channel)
        found[:, i] = np.interp(np.arange(len(record)), of, outputs[at, i])
    return found


def as_written(model: Model, record: Record, outputs: np.ndarray) -> tuple[Record, np.ndarray]:
    """A record, and (N, outputs) at its samples, as recorders write them that a model has."""
    found = outputs.copy()
    for one in model.effects:
        write = one.effect.forms.written
        if write is None or not one.concerns(record.name):
            continue
        every = [name for name in model.inputs if is_control(name) and name not in SURFACES]
        for name in every if one.effect.target == ALL else (one.effect.target,):
            if name in model.outputs:
                i = model.outputs.index(name)
                found[:, i] = write(found[:, i], one.sizes)
            elif name in record:
                record = record.with_channels(**{name: write(record[name], one.sizes)})
    return record, found


# ---- any model


class Draft:
    """A model under change by effects; expressions that are added are in the symbols of the model as given."""

    def __init__(self, model: Model, terms: Mapping[str, ca.SX] | None = None) -> None:
        self.model = model
        self.terms = terms or {}
        self.f = ca.SX(model.f)
        self.h = ca.SX(model.h)
        self.p = ca.SX(model.p)
        self.u = ca.SX(model.u)

    def adds(self, state: str, expression: Any) -> None:
        """Add an expression to the equation of a state."""
        self.f[self.model.states.index(state)] += expression

    def shifts(self, parameter: str, by: Any, equation: str = "") -> None:
        """Let a parameter differ from its value by an expression, in the `equation` of a state or in all.

        Raises InputError for a state that the model does not have."""
        i = self.model.parameters.index(parameter)
        if not equation:
            self.p[i] += by
            return
        check_known("state", (equation,), self.model.states, f"model '{self.model.name}': {parameter} in an equation")
        row = self.model.states.index(equation)
        self.f[row] = ca.substitute(self.f[row], self.model.p[i], self.model.p[i] + by)

    def scales(self, name: str, by: Any) -> None:
        """Multiply the equation of a state, or a parameter."""
        if name in self.model.states:
            self.f[self.model.states.index(name)] *= by
        else:
            self.p[self.model.parameters.index(name)] *= by

    def reads(self, channel: str, read: Callable[[Any], Any], true: Callable[[Any], Any]) -> None:
        """Let an instrument `read` something else than what is; of an input, what acts is what is `true` of its
        record."""
        if channel in self.model.outputs:
            i = self.model.outputs.index(channel)
            self.h[i] = read(self.h[i])
        elif channel in self.model.inputs:  # else of an instrument of an aircraft that this system does not have
            i = self.model.inputs.index(channel)
            self.u[i] = true(self.u[i])

    def term(self, name: str) -> Any:
        """Expression of a term: one of those given, or a monomial of states and inputs."""
        if name in self.terms:
            return self.terms[name]
        return monomial(self.model, name)

    def made(self, found: Sequence[InForce], symbols: Mapping[str, ca.SX]) -> Model:
        """The changed model with the parameters of effects."""
        model = replace(self.model, f=self.f, h=self.h)
        return substituted(
            model,
            ca.vertcat(model.p, model.u),
            ca.vertcat(self.p, self.u),
            parameters=(*model.parameters, *symbols),
            p=ca.vertcat(model.p, *symbols.values()),
            **_with_sizes(model, found),
            equation=None,
        )


def monomial(model: Model, name: str) -> ca.SX:
    """Expression of a monomial in states and inputs, and their sizes, `u*x^2`, `x*|x|`, "1" for the constant. Raises
    InputError for a name that the model does not have."""
    symbols = variables(model)
    found = ca.SX(1.0)
    for factor in name.split("*") if name != "1" else ():
        variable, _, power = factor.strip().partition("^")
        kinked = variable.startswith("|") and variable.endswith("|")
        variable = variable.strip("|") if kinked else variable
        if variable not in symbols:
            raise unknown("state or input", variable, tuple(symbols), f"model '{model.name}': term '{name}'")
        one = ca.fabs(symbols[variable]) if kinked else symbols[variable]
        found = found * one ** (int(power) if power else 1)
    return found


# place of a kind -> what its targets are, and the names of a model that are such
_PLACES = {
    "command": ("input", ("inputs",)),
    "reading": ("output or input", ("outputs", "inputs")),
    "equation": ("state", ("states",)),
    "value": ("parameter", ("parameters",)),
}


def effect_at(model: Model, value: EffectValue) -> Effect:
    """The effect of an entry, at a port of a model. Raises InputError for a place that the model does not have."""
    effect = effect_of(value)
    kind = KINDS[value.kind]
    where = f"model '{model.name}': effect {effect.name}"
    if kind.place not in _PLACES:
        raise InputError(f"{where} is of the equations of an aircraft; expected a model of cs.aircraft_model(...)")
    what, groups = _PLACES["equation" if effect.states else kind.place]
    valid = [name for group in groups for name in getattr(model, group)]
    check_known(what, kind.parts(effect.target), valid, where)
    return of_input(effect) if kind.place == "reading" and effect.target not in model.outputs else effect


def with_effects(model: Model, values: Iterable[EffectValue], terms: Mapping[str, ca.SX] | None = None) -> Model:
    """The model with effects in force, see `Model.with_effects`; `terms` are expressions of missing terms by name,
    where they are no monomials."""
    values = tuple(values)
    if model.extend is not None:
        return model.extend(values)
    found = named(values, f"model '{model.name}'", partial(effect_at, model))
    masks = tuple(dict.fromkeys(one.masked for one in found if one.masked and is_masked(one.effect)))
    draft = Draft(with_stations(with_states(model, found), masks), terms)
    inputs = dict(zip(draft.model.inputs, ca.vertsplit(draft.model.u), strict=True))
    symbols: dict[str, ca.SX] = {}
    for one in found:
        if one.effect.change is None:
            continue
        symbols |= {name: ca.SX.sym("size") for name in one.parameters}
        one.effect.change(draft, one.acting(symbols, inputs))
    made = draft.made([one for one in found if one.effect.change is not None], symbols) if symbols else draft.model
    channels = dict.fromkeys((*model.inputs, *model.states, *model.outputs), np.zeros(8))
    return completed(made, found, Record(name="probe", t=0.01 * np.arange(8), channels=channels))


def is_masked(effect: Effect) -> bool:
    """Return True if the model, and not a history, says in which records an effect is."""
    return effect.change is not None or is_slow_instrument(effect)


def completed(model: Model, found: Sequence[InForce], probe: Record) -> Model:
    """The model whose equations have effects, with their histories, and with slow and late instruments. `probe` is a
    record with all channels."""
    lags = [one for one in found if is_slow_instrument(one.effect)]
    histories = [history_of(one, probe, model.outputs) for one in found if one.is_history]
    stations = dict.fromkeys(s for one in histories for s in one.stations)
    late = [s.removeprefix(TIME) for s in stations if s.startswith(TIME)]
    model = with_stations(model, [s for s in stations if not s.startswith(TIME)])
    model = with_instruments(model, lags)
    model = with_late_readings(model, late)
    return replace(with_histories(model, histories), effects=(*model.effects, *found))


def stations_of(found: Sequence[InForce], probe: Record, outputs: Sequence[str]) -> tuple[str, ...]:
    """Stations at which histories of effects act, without times of readings."""
    histories = [history_of(one, probe, outputs) for one in found if one.is_history]
    return tuple(dict.fromkeys(s for one in histories for s in one.stations if not s.startswith(TIME)))


def unseen_by_equations(model: Model) -> tuple[str, ...]:
    """Names of the effects of a model that equations on measured signals do not have: those of instruments, and those
    with a state of their own."""
    return tuple(one.name for one in model.effects if not _in_equations_of(one.effect))


def _in_equations_of(effect: Effect) -> bool:
    if effect.change is not None:
        return effect.in_equations
    return effect.series is not None or effect.stochastic
