"""Effects with the names and values of their sizes, and what they make of a record: series at stations of a model."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import product
from typing import Any

import numpy as np

from casid.errors import InputError
from casid.model import operators, station
from casid.model.causes.instruments import group_channels
from casid.model.effect import Effect
from casid.model.effect_value import EffectValue
from casid.model.effects import effect_of
from casid.records.record import Record

TIME = "time of "  # of the state that a reading is of, less that of its sample [s]


@dataclass(frozen=True, kw_only=True)
class InForce:
    """An effect of a model, and the name of its parameter there."""

    effect: Effect
    name: str
    value: EffectValue | None = None  # None: typical sizes

    @property
    def is_history(self) -> bool:
        """Return True if a model has it as a history, and neither in its equations nor as a slow instrument."""
        effect = self.effect
        return effect.change is None and not is_slow_instrument(effect) and not effect.stochastic

    @property
    def masked(self) -> str:
        """Name of the input that is 1 in the records that have it; "" for all records."""
        return f"present {self.name}" if self.value is not None and self.value.records else ""

    @property
    def sizes(self) -> dict[str, float]:
        """Value and further sizes that the functions of the effect take, without onsets."""
        if self.value is None:
            return {**self.effect.further.typical, "value": 0.0}
        return sizes_of(self.value, self.effect)

    @property
    def parameters(self) -> dict[str, float]:
        """Name of each of its parameters in the model, with the value of the file or a typical one."""
        sizes = self.sizes
        found = {self.name: sizes.pop("value")} | {f"{self.name}.{key}": size for key, size in sizes.items()}
        return found | {f"{self.name}.onset[{record}]": at for record, at in self.onsets.items()}

    def acting(self, parameters: Mapping[str, Any], inputs: Mapping[str, Any]) -> dict[str, Any]:
        """Value and further sizes from the parameters of a model, the value none in records that do not have it."""
        value = parameters[self.name]
        sizes = {key: parameters[f"{self.name}.{key}"] for key in self.effect.beside}
        return {"value": value * inputs[self.masked] if self.masked else value, **sizes}

    @property
    def onsets(self) -> dict[str, float]:
        """Record -> time [s] at which it sets in there."""
        value = self.value
        if value is None or not self.effect.timed:
            return {}
        return {record: 0.5 * (low + high) for record, (low, high) in (value.onset_s or {}).items()}

    @property
    def units(self) -> dict[str, str]:
        """Unit of each of its parameters."""
        unit = {self.name: self.effect.unit}
        for name in self.parameters:
            if name != self.name:
                key = name.removeprefix(f"{self.name}.")
                unit[name] = "s" if key.startswith("onset[") else self.effect.units.get(key, "")
        return unit

    @property
    def prior_std(self) -> dict[str, float]:
        """1-sigma of its value, where the file states one."""
        return {self.name: self.value.std} if self.value is not None and self.value.std > 0.0 else {}

    def concerns(self, record: str) -> bool:
        """Return True if it acts in a record."""
        if self.value is None:
            return True
        if self.effect.timed:
            return record in self.onsets
        return not self.value.records or record in self.value.records


def sizes_of(value: EffectValue, effect: Effect) -> dict[str, float]:
    """Return the numbers that an effect's functions take. Raises InputError when the file leaves out one that it may
    not."""
    values = {"value": value.value, **effect.further.defaults, **value.parameters}
    for name in effect.further.typical:
        if name not in values:
            raise InputError(
                f"effect {effect.name}: its parameter '{name}' is missing; add parameters = {{ {name} = ... }}"
            )
    return values


def named(
    values: Iterable[EffectValue], where: str, make: Callable[[EffectValue], Effect] = effect_of
) -> list[InForce]:
    """Name the effects of a file or a list. Two of one kind and place are told apart by their records. Raises
    InputError where these overlap, and for sizes with which an effect cannot act."""
    found: list[InForce] = []
    values = tuple(values)
    effects = [make(value) for value in values]
    for value, effect in zip(values, effects, strict=True):
        twins = [other for other, its in zip(values, effects, strict=True) if its.name == effect.name]
        if len(twins) > 1:
            records = [name for twin in twins for name in twin.records]
            if len(set(records)) < len(records) or not all(twin.records for twin in twins):
                raise InputError(
                    f"{where}: effect {effect.name} stands twice; keep one of the two, or name their records"
                )
        name = effect.name if len(twins) == 1 else f"{effect.name}[{','.join(value.records)}]"
        _check_acts(value, effect, where)
        found.append(InForce(effect=effect, name=name, value=value))
    return found


def _check_acts(value: EffectValue, effect: Effect, where: str) -> None:
    sizes = sizes_of(value, effect)
    for key in effect.beside if effect.states else ():
        if not sizes[key] > 0.0:
            raise InputError(
                f"{where}: effect {effect.name} cannot act; its parameter '{key}' must be positive, got {sizes[key]}"
            )
    if effect.forms.instrument is not None and value.value < 0.0:
        raise InputError(
            f"{where}: effect {effect.name} cannot act; a lag needs a positive time constant, got {value.value}"
        )


def is_slow_instrument(effect: Effect) -> bool:
    """Return True for an instrument that follows with a state of its own."""
    return effect.change is None and effect.series is None and effect.forms.instrument is not None


@dataclass(frozen=True, kw_only=True)
class History:
    """Time histories that an effect makes of a record and of its sizes, at stations of a model."""

    of: InForce
    stations: tuple[str, ...]

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of its sizes in the model."""
        return tuple(self.of.parameters)

    @property
    def slopes(self) -> list[tuple[str, str]]:
        """Station and parameter of each derivative."""
        return list(product(self.stations, self.parameters))

    def at(self, record: Record, values: Mapping[str, float]) -> tuple[dict[str, np.ndarray], dict[str, dict]]:
        """Station -> (N,) series in a record at `values` of all parameters, and their derivatives, parameter -> station
        -> (N,); empty where it does not act."""
        one = self.of
        if not one.concerns(record.name):
            return {}, {}
        keys = {"value": one.name} | {key: f"{one.name}.{key}" for key in one.sizes if key != "value"}
        if record.name in one.onsets:
            keys["onset"] = f"{one.name}.onset[{record.name}]"
        known = known_of(record)
        make = partial(_series, one.effect, record.t, known)
        series, slopes = operators.with_slopes(make, {key: float(values[name]) for key, name in keys.items()})
        return series, {keys[key]: slope for key, slope in slopes.items()}


def _series(
    effect: Effect, t: np.ndarray, known: Mapping[str, np.ndarray], sizes: Mapping[str, Any]
) -> dict[str, np.ndarray]:
    """Station -> (N,) what an effect adds there."""
    if effect.series is not None:
        return effect.series(t, known, sizes)
    channels = group_channels(effect.target)
    if effect.forms.late is not None:
        late = effect.forms.late(t, sizes)
        return {TIME + channel: -late * np.ones(len(t)) for channel in channels}
    assert effect.output is not None
    perfect = dict(known) | {channel: np.zeros(len(t)) for channel in channels}
    return {station.reading(channel): series for channel, series in effect.output(t, perfect, sizes).items()}


def known_of(record: Record) -> dict[str, np.ndarray]:
    """Return the channels from which effects are made, the change of heading among them."""
    known = dict(record.channels)
    if all(name in record for name in operators.TURNING):
        known["turned"] = operators.turned(record.t, *(known[name] for name in operators.TURNING))
    return known


def history_of(one: InForce, probe: Record, outputs: Sequence[str]) -> History:
    """The history of an effect, whose stations are those of a `probe` record with all channels; readings only of the
    `outputs` of the model."""
    sizes = {**one.sizes, "onset": float(probe.t[0])}
    found = _series(one.effect, probe.t, known_of(probe), sizes)
    return History(of=one, stations=tuple(name for name in found if _is_there(name, outputs)))


def _is_there(name: str, outputs: Sequence[str]) -> bool:
    channel = name.removeprefix(TIME).removeprefix(station.reading(""))
    return channel == name or channel in outputs


def slope_input(name: str, parameter: str) -> str:
    """Name of the input that holds the derivative of a station by a parameter."""
    return f"{name} by {parameter}"
