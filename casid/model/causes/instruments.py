"""Causes in the instruments: errors of their readings, and of their positions."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from types import MappingProxyType
from typing import Any

import numpy as np

from casid.errors import InputError
from casid.model import operators, station
from casid.model.airframe import Airframe
from casid.model.causes.controls import never_sought, of_value
from casid.model.effect import (
    Effect,
    Event,
    Forms,
    Further,
    Readable,
    Series,
    Size,
    Symbols,
    Traits,
    Values,
    cause,
    grid,
    of_kind,
)
from casid.model.path import GROUND, SignalPath
from casid.signals import SURFACES, unit_of

_AIR_DATA = ("V", "alpha", "beta")
RATES = ("p", "q", "r")
_ATTITUDE = ("phi", "theta", "psi")
_ACCELERATIONS = ("ax", "ay", "az")
_ANGULAR_ACCELERATIONS: tuple[str, ...] = ("pdot", "qdot", "rdot")
SENSOR_CHANNELS = (*_AIR_DATA, *RATES, *_ATTITUDE, *_ACCELERATIONS, *_ANGULAR_ACCELERATIONS, "altitude")
_PLACE = ("north", "east", "altitude")
_OVER_GROUND = (*_PLACE[:2], *GROUND)
# group -> vectors in its frame; an altitude is positive up
TRIADS = {"inertial": (RATES, _ACCELERATIONS, _ANGULAR_ACCELERATIONS), "ground": (GROUND, _PLACE)}
# Channels that share one cause: one instrument, or one recorder. `q` includes qdot.
SENSOR_GROUPS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "inertial": (*RATES, *_ACCELERATIONS, *_ANGULAR_ACCELERATIONS),
        "attitude": _ATTITUDE,
        "air_data": _AIR_DATA,
        "surfaces": SURFACES,
        "external": (*_PLACE, *GROUND, *_ATTITUDE),  # of a motion capture: one clock, one frame
        "ground": (*_PLACE, *GROUND),  # of satellites, beside an attitude of another source
    }
)
_GROUPS_OF_OUTPUTS = tuple(name for name in SENSOR_GROUPS if name != "surfaces")
_RATE_OF: dict[str, str] = dict(zip(_ANGULAR_ACCELERATIONS, RATES, strict=True))
_RATE_WITH_DERIVATIVE = {rate: (rate, derivative) for derivative, rate in _RATE_OF.items()}
_LIGHT = 0.03  # damping ratio of a structure
# unit of a channel -> bias that matters, what the better instruments of flight test keep to anyway, and the largest;
# nor does what is smaller than the noise of a reading matter
_BIAS = {
    "m/s": (1.0, 15.0),
    "rad": (math.radians(0.25), math.radians(10.0)),
    "rad/s": (math.radians(0.1), math.radians(3.0)),
    "m/s2": (0.05, 3.0),
    "rad/s2": (math.radians(0.2), math.radians(10.0)),
    "m": (5.0, 500.0),
}


def group_channels(target: str) -> tuple[str, ...]:
    """Channels that share one instrument fault: a channel, a rate with its derivative, or a group of them."""
    return SENSOR_GROUPS.get(target) or _RATE_WITH_DERIVATIVE.get(target, (target,))


def shown_in(target: str) -> tuple[str, ...]:
    """The channels of a target of which one must be measured: of those over ground no attitude or altitude alone."""
    channels = SENSOR_GROUPS.get(target, (target,))
    return _OVER_GROUND if {*_OVER_GROUND} < {*channels} else channels


def of_group(target: str, operate: Callable[[np.ndarray, np.ndarray, Values], np.ndarray]) -> Callable[..., Any]:
    """What `operate` makes of time, readings and values, for each channel of a target that is there."""

    def of_channels(t: np.ndarray, readings: Series, values: Values) -> dict[str, np.ndarray]:
        return {c: operate(t, readings[c], values) for c in group_channels(target) if c in readings}

    return of_channels


_reading = partial(cause, place="reading", of_systems=True)


@_reading(
    targets=SENSOR_CHANNELS,
    unit="{channel}",
    quantity="measured minus true",
    sentence="The measured {label} is off by {size}.",
)
def sensor_bias(channel: str) -> Effect:
    def change(model: Readable, values: Symbols) -> None:
        off = values["value"]
        model.reads(channel, lambda y: y + off, lambda read: read - off)

    least, limit = _BIAS.get(unit_of(channel), (0.0, np.inf))

    def matters(aircraft: Airframe) -> float:
        return max(least, aircraft.noise.get(channel, 0.0))

    return Effect(
        reads=(channel,),
        kinematic=True,
        traits=Traits(by_record=True, constant=True),
        station="sensors",
        change=change,
        size=Size(meaningful=matters, limit=limit),
    )


@_reading(
    targets=(*SENSOR_CHANNELS, "inertial"),
    unit="1",
    quantity="relative error of the scale; 0.1: 10 % too large",
    sentence="The measured {label} has a scale error of {percent}.",
)
def sensor_scale(target: str) -> Effect:
    def change(model: Readable, values: Symbols) -> None:
        scale = 1.0 + values["value"]
        for name in group_channels(target):
            model.reads(name, lambda y: y * scale, lambda read: read / scale)

    # calibrations in flight are good to about one percent
    return Effect(
        reads=SENSOR_GROUPS.get(target, (target,)),
        traits=Traits(covered_by=_RATE_OF.get(target), by_record=True),
        kinematic=True,
        station="sensors",
        change=change,
        size=Size(meaningful=0.015, limit=0.6),
    )


def _slow_reading(target: str, output: Callable[..., Any], forms: Forms, unsigned: tuple[str, ...] = ()) -> Effect:
    """A reading that is late by the value, as `output` has it."""
    return Effect(
        reads=shown_in(target),
        traits=Traits(covered_by=_RATE_OF.get(target), by_record=True, late=True),
        kinematic=True,
        linear=False,
        further=Further(grid=grid(value=(0.02, 0.05, 0.1, 0.2, 0.4)), unsigned=unsigned),
        output=output,
        forms=replace(forms, undo=of_group(target, of_value(operators.earlier))),
        size=Size(meaningful=0.01, limit=1.0),
    )


@_reading(
    targets=(*SENSOR_CHANNELS, *SENSOR_GROUPS),
    unit="s",
    quantity="delay",
    sentence="The measured {label} {comes} {size} [late|early].",
)
def sensor_delay(target: str) -> Effect:
    if target == "surfaces":
        return _late_inputs(target)
    forms = Forms(late=lambda t, values: values["value"], transfer=of_value(operators.delay_transfer))
    return _slow_reading(target, of_group(target, of_value(operators.delay)), forms)


def of_input(effect: Effect) -> Effect:
    """The fault of an instrument that reads an input: what acts is what is true of its record.

    Raises InputError for one that a record of the input does not undo.
    """
    if effect.change is not None or effect.stochastic:
        return effect
    if effect.kind == "sensor_delay":
        return _late_inputs(effect.target)
    raise InputError(
        f"effect {effect.name}: '{effect.target}' is an input, of whose record a bias, a scale and a delay can be "
        "taken back; write actuator_lag for what follows it slowly"
    )


@of_kind("sensor_delay")
def _late_inputs(target: str) -> Effect:
    """An input, or all surfaces by the same, are recorded late: what acts is ahead of its record."""
    names = SENSOR_GROUPS.get(target, (target,))

    def series(t: np.ndarray, known: Series, values: Values) -> dict[str, np.ndarray]:
        return {station.control(s): operators.delay(t, known[s], -values["value"]) - known[s] for s in names}

    def ahead(s: np.ndarray, values: Values) -> np.ndarray:
        return operators.delay_transfer(s, -values["value"])

    return Effect(
        linear=False,
        further=Further(grid=grid(value=(0.02, -0.02, 0.05, -0.05, 0.1, -0.1, 0.2, -0.2))),
        series=series,
        forms=Forms(transfer=ahead),
        size=Size(meaningful=0.01, limit=0.5),
        traits=Traits(by_record=True),
    )


@_reading(
    targets=(*SENSOR_CHANNELS, *_GROUPS_OF_OUTPUTS),
    unit="s",
    quantity="time constant",
    sentence="The measured {label} lags with a time constant of {size}.",
)
def sensor_lag(target: str) -> Effect:
    def instrument(true: Any, read: Any, values: Symbols) -> Any:
        return (true - read) / values["value"]

    def output(t: np.ndarray, readings: Series, values: Values) -> dict[str, np.ndarray]:
        behind = of_group(target, of_value(operators.lag))(t, readings, values)
        return {
            c: _follow_the_first_readings(t, series, readings.get(station.as_read(c)), values["value"])
            for c, series in behind.items()
        }

    # shorter than a sampling interval a lag cannot be separated from a delay, and `undo` treats it as one
    forms = Forms(instrument=instrument, transfer=of_value(operators.lag_transfer))
    return _slow_reading(target, output, forms, unsigned=("value",))


def _follow_the_first_readings(
    t: np.ndarray, behind: np.ndarray, read: np.ndarray | None, time_constant: operators.Size
) -> np.ndarray:
    """A lagged reading whose initial value is near the first readings, where these are known."""
    T = operators.magnitude(time_constant)
    if read is None or np.real(T) < 1e-9:
        return behind
    fades = np.exp(-(t - t[0]) / T)
    left = read - behind
    there = np.isfinite(read)
    start = (fades[there] @ left[there]) / operators.larger(fades[there] @ fades[there], 1e-300)
    return behind + start * fades


@_reading(
    targets=SENSOR_CHANNELS,
    candidates=never_sought,
    unit="{channel}",
    quantity="part of its motion that the reading loses from the onset on, 1: it stays where it is",
    sentence="The reading of {label} is stuck at {size}.",
)
def sensor_stuck(channel: str) -> Effect:
    def series(t: np.ndarray, known: Series, values: Values) -> dict[str, np.ndarray]:
        from_there = values["value"] * operators.step(t, values["onset"])
        read = known.get(station.as_read(channel), known.get(channel, np.zeros(len(t))))
        stays = level(read[t > np.real(values["onset"])])
        return {station.stuck(channel): from_there, station.reading(channel): from_there * stays}

    return Effect(reads=(channel,), event=Event(), series=series, size=Size(lowest=0.5, limit=1.5))


def level(read: np.ndarray) -> float:
    """Mean of readings, of which some may be missing; 0 where all are."""
    seen = read[np.isfinite(read)]
    return float(seen.mean()) if len(seen) else 0.0


@_reading(
    targets=(*SENSOR_CHANNELS, *_OVER_GROUND, *SURFACES, "thrust"),
    of_systems=False,
    of_rotors=True,
    candidates=never_sought,
    unit="{channel}",
    quantity="step, of which all that is recorded are multiples: simulated, and told by the check of samples",
    sentence="The {label} is recorded in steps of {size}.",
)
def sensor_resolution(channel: str) -> Effect:
    forms = Forms(written=of_value(operators.rounded))
    return Effect(reads=(channel,), kinematic=True, further=Further(unsigned=("value",)), forms=forms)


_SHAKEN_BY = {
    "delta_e": ("alpha", "q", "ax", "az", "qdot"),
    "delta_a": ("p", "pdot"),
    "delta_r": ("beta", "r", "ay", "rdot"),
}
_DRIVEN_BY = {channel: surface for surface, shaken in _SHAKEN_BY.items() for channel in shaken}


@cause(
    targets=_DRIVEN_BY,
    unit="{channel}/rad",
    quantity="gain from the surface that excites it; frequency and damping stand in the parameters",
    sentence="The {label} carries a lightly damped oscillation, excited with a gain of {size}.",
)
def structural_mode(channel: str) -> Effect:
    drive = _DRIVEN_BY[channel]

    def output(t: np.ndarray, readings: Series, values: Values) -> dict[str, np.ndarray]:
        ringing = operators.mode(t, readings[drive], values["frequency_hz"], values["damping"])
        shaken = zip(_RATE_WITH_DERIVATIVE.get(channel, (channel,)), ringing, strict=False)
        return {c: readings[c] + values["value"] * series for c, series in shaken if c in readings}

    # so near to one another that a fit climbs from one of them to the highest of neighbouring maxima
    frequencies = np.round(np.geomspace(1.5, 8.0, 19), 2).tolist()
    return Effect(
        reads=(channel,),
        traits=Traits(covered_by=_RATE_OF.get(channel)),
        further=Further(grid=grid(frequency_hz=frequencies, damping=(_LIGHT,)), defaults={"damping": _LIGHT}),
        output=output,
        size=Size(amplitude=0.05, limits={"damping": 0.1}),
        # above that it is half gone after one cycle, and looks like a lag of the reading
    )


@cause(
    targets=("alpha", "beta"),
    unit="m",
    quantity="true minus assumed position of the vane, forward positive",
    sentence="The vane of the {label} stands {size} further [forward|aft] than it is corrected for.",
)
def vane_position(channel: str) -> Effect:
    def change(path: SignalPath, values: Symbols) -> None:
        path.sensor_position[f"{channel}_vane"][0] += values["value"]

    size = Size(within="span", meaningful=0.3, limit=30.0)
    return Effect(reads=(channel,), kinematic=True, station="wind", change=change, size=size)


@cause(
    targets=("x", "y", "z"),
    unit="m",
    title="{words} along {target}",
    quantity="true minus assumed position, body axes",
    sentence="The accelerometer stands {size} along body {target} from where the aircraft file has it.",
)
def accelerometer_position(axis: str) -> Effect:
    def change(path: SignalPath, values: Symbols) -> None:
        path.sensor_position["accelerometer"]["xyz".index(axis)] += values["value"]

    return Effect(
        size=Size(within="span", meaningful=0.1, limit=20.0),
        reads=_ACCELERATIONS,
        kinematic=True,
        # the lift or side force of a tail turns the aircraft as well: that much of it reads so
        traits=Traits(grounded=axis == "x"),
        station="wind",
        change=change,
    )
