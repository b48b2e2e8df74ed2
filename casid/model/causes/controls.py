"""Causes between the recorded command and the surface that acts."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

import numpy as np

from casid.model import operators, station
from casid.model.airframe import Airframe
from casid.model.effect import (
    Effect,
    Event,
    Forms,
    Further,
    Series,
    Size,
    Symbols,
    Traits,
    Values,
    cause,
    grid,
    of_kind,
)
from casid.model.path import SignalPath
from casid.model.rotors import thrust_of
from casid.signals import SURFACES

_TO_THE_END = 1e3  # s
_LARGEST_GAIN = 5.0  # rad per rad/s or per rad
_PLAY = np.radians([0.05, 0.1, 0.2, 0.4, 0.8, 1.5, 3.0])
PLAY_SIZE = Size(meaningful=math.radians(0.1), limit=math.radians(8.0))
_DAMPED = 0.7  # damping ratio of an actuator
# what a dead zone lies about: the zero of the record, or its median
_ZERO = 0.0
_TRIM = 1.0


def never_sought(aircraft: Airframe) -> Iterable[Effect]:
    """None: a user states it, and it can be estimated; no diagnosis of an aircraft looks for it by itself."""
    return ()


def of_value(operate: Callable[..., Any], **usual: float) -> Callable[..., Any]:
    """A function of the value of an effect, and of further sizes that have `usual` values, as one of all its values."""

    def of_values(*arguments: Any) -> Any:
        *others, values = arguments
        return operate(*others, values["value"], *(values.get(name, size) for name, size in usual.items()))

    return of_values


def _added_to(surface: str, added: Callable[[np.ndarray, np.ndarray, Values], np.ndarray], **more: Any) -> Effect:
    """What is `added` to a surface, of time, its record and the values of the effect."""

    def series(t: np.ndarray, known: Series, values: Values) -> dict[str, np.ndarray]:
        return {station.control(surface): added(t, known[surface], values)}

    return Effect(series=series, **more)


def _following(
    surface: str, act: Callable[[np.ndarray, np.ndarray, Values], np.ndarray], further: Further, **more: Any
) -> Effect:
    """A surface that does what `act` makes of time, its record and the values of the effect."""

    def added(t: np.ndarray, recorded: np.ndarray, values: Values) -> np.ndarray:
        return act(t, recorded, values) - recorded

    return _added_to(surface, added, linear=False, further=further, **more)


def _sizes(*sizes: float) -> Further:
    return Further(grid=grid(value=sizes), unsigned=("value",))


command = partial(cause, place="command", of_systems=True, targets=SURFACES)


@command(
    unit="s",
    quantity="time constant",
    sentence="The {label} follows its command with a lag of {size} that the model does not have.",
)
def actuator_lag(surface: str) -> Effect:
    def noise(sigma: float, dt: float, values: Values) -> tuple[float, float]:
        T = max(abs(values["value"]), dt)
        return sigma * float(np.sqrt(np.tanh(dt / (2.0 * T)))), T

    forms = Forms(noise=noise, transfer=of_value(operators.lag_transfer))
    size = Size(meaningful=0.01, limit=1.0)
    return _following(surface, of_value(operators.lag), _sizes(0.03, 0.06, 0.12, 0.25, 0.5), size=size, forms=forms)


@command(
    unit="s",
    quantity="delay of the surface behind its record",
    sentence="The {label} follows its command {size} [late|early].",
)
def input_delay(surface: str) -> Effect:
    further = Further(grid=grid(value=(0.02, 0.05, 0.1, 0.2, 0.4)))
    forms = Forms(transfer=of_value(operators.delay_transfer))
    return _following(surface, of_value(operators.delay), further, size=Size(meaningful=0.01, limit=0.5), forms=forms)


@command(
    unit="{channel}/s",
    quantity="largest rate of the surface",
    sentence="The {label} cannot move faster than {size}.",
)
def rate_limit(surface: str) -> Effect:
    rates = _sizes(*np.radians([2.0, 3.5, 6.0, 10.0, 17.0, 30.0, 50.0, 85.0]))
    size = Size(meaningful=0.0, limit=math.radians(200.0))
    return _following(surface, of_value(operators.rate_limit), rates, size=size)


@command(
    candidates=never_sought,
    unit="s",
    quantity="time of one radian of its oscillation, the inverse of its natural frequency; its damping ratio stands in "
    "the parameters",
    sentence="The {label} follows its command as an oscillator, {size} per radian, that the model does not have.",
)
def second_order_actuator(surface: str) -> Effect:
    usual = {"damping": _DAMPED}
    sizes = grid(value=(0.02, 0.04, 0.08, 0.15), damping=(_DAMPED,))
    return _following(
        surface,
        of_value(operators.second_order, **usual),
        Further(grid=sizes, defaults=usual, unsigned=("value", "damping")),
        size=Size(meaningful=0.01, limit=0.5, limits={"damping": 2.0}),
        traits=Traits(includes=("input_delay", "actuator_lag")),
        forms=Forms(transfer=of_value(operators.second_order_transfer, **usual)),
    )


@command(
    terms=("above", "below"),
    candidates=never_sought,
    unit="{channel}",
    quantity="largest value that acts, or smallest, as its term says",
    title="{label}: limit {term}",
    sentence="The {label} does not act {term} {size}.",
)
def input_limit(surface: str, side: str) -> Effect:
    def act(t: np.ndarray, recorded: np.ndarray, values: Values) -> np.ndarray:
        within = recorded < np.real(values["value"]) if side == "above" else recorded > np.real(values["value"])
        return np.where(within, recorded, values["value"])

    return _following(surface, act, Further(grid=grid(value=(0.0,))))


@command(
    candidates=never_sought,
    unit="{channel}",
    quantity="what acts less its record: a trim of the actuator",
    sentence="The {label} acts {size} beside its record.",
)
def input_offset(surface: str) -> Effect:
    return _added_to(surface, lambda t, _, values: values["value"] * np.ones(len(t)), traits=Traits(by_record=True))


@command(
    targets=(*SURFACES, "thrust"),
    candidates=never_sought,
    unit="1",
    quantity="what acts over its record, less one",
    sentence="What acts of the {label} differs by {percent} from its record.",
)
def input_scale(surface: str) -> Effect:
    return _added_to(surface, lambda _, recorded, values: values["value"] * recorded, traits=Traits(by_record=True))


@command(
    of_systems=False,
    candidates=never_sought,
    unit="s",
    quantity="time for which a command is held until the next is taken, beginning at the first sample",
    sentence="The {label} takes a command every {size} only and holds it.",
)
def sample_hold(surface: str) -> Effect:
    size = Size(meaningful=0.02, limit=2.0)
    return _following(surface, of_value(operators.sample_hold), _sizes(0.05, 0.1, 0.2), size=size)


@command(
    unit="{channel}",
    quantity="half width without any answer; what it lies about stands in the parameters, 0 the zero of the record, 1 "
    "its median",
    sentence="The {label} does not answer to a command below {size}.",
)
def dead_zone(surface: str) -> Effect:
    def act(t: np.ndarray, recorded: np.ndarray, values: Values) -> np.ndarray:
        centre = values.get("about", _TRIM) * float(np.median(recorded))
        return operators.dead_zone(recorded, values["value"], centre)

    further = Further(
        grid=grid(value=_PLAY, about=(_TRIM, _ZERO)),
        defaults={"about": _TRIM},
        unsigned=("value",),
        usual={"about": (0.5 * (_ZERO + _TRIM), 0.5 * abs(_ZERO - _TRIM))},  # a movement may reach one end alone
    )
    return _following(surface, act, further, size=PLAY_SIZE)


@command(
    unit="{channel}",
    quantity="half the free play; where in it a record begins, from -1 to 1, stands in the parameters",
    sentence="The {label} has a free play of plus and minus {size}.",
)
def backlash(surface: str) -> Effect:
    def act(t: np.ndarray, recorded: np.ndarray, values: Values) -> np.ndarray:
        return operators.backlash(recorded, values["value"], values.get("rest", 0.0))

    sizes = grid(value=_PLAY, rest=(0.0,))
    further = Further(grid=sizes, defaults={"rest": 0.0}, unsigned=("value",), folded=("rest",))
    return _following(surface, act, further, size=PLAY_SIZE)


@cause(
    targets=(*SURFACES, "thrust"),
    of_rotors=True,
    unit="1",
    quantity="relative change from the onset on; -0.3: 30 % are lost",
    sentence="The effectiveness of the {label} changes by {percent} in mid-record.",
)
def effectiveness_change(surface: str) -> Effect:
    def series(t: np.ndarray, known: Series, values: Values) -> dict[str, np.ndarray]:
        lost = values["value"] * operators.step(t, values["onset"])
        acts = thrust_of(surface) if thrust_of(surface) in known else surface  # of a rotor the thrust changes
        return {station.control(acts): lost * known[acts]}

    def from_the_onset_on(s: np.ndarray, values: Values) -> np.ndarray:
        return np.full(len(s), 1.0 + values["value"], dtype=complex)

    return Effect(
        event=Event(recurring=True),
        further=Further(either_sign=True),
        series=series,
        forms=Forms(transfer=from_the_onset_on),
        traits=Traits(balance=True),
        size=Size(meaningful=0.03, limit=1.5),
    )


@cause(
    targets=SURFACES,
    unit="1",
    quantity="part of the command that is not followed, 1: none of it, from the onset on for a duration; the parameter "
    "`beside` is where the surface stands, less its record at the onset, which has noise",
    sentence="The {label} stays where it is and does not follow its command, {percent} of it.",
)
def stuck(surface: str) -> Effect:
    def added(t: np.ndarray, recorded: np.ndarray, values: Values) -> np.ndarray:
        onset = values["onset"]
        during = operators.step(t, onset) - operators.step(t, onset + values.get("duration", _TO_THE_END))
        held = operators.sampled(t, recorded, np.array([onset]))[0] + values.get("beside", 0.0)
        return values["value"] * during * (held - recorded)

    sizes = grid(duration=(2.0, 5.0, _TO_THE_END), beside=(0.0,))
    return _added_to(
        surface,
        added,
        event=Event(recurring=True, lasts="duration"),
        further=Further(grid=sizes, defaults={"duration": _TO_THE_END, "beside": 0.0}),
        size=Size(meaningful=0.5, limit=1.2, lowest=0.0),
    )


# what a damper or an autopilot feeds to each surface: a rate or a flow angle through a washout, an attitude as it is
LOOPS = {"delta_e": ("q", "alpha", "theta"), "delta_a": ("p", "phi"), "delta_r": ("r", "beta")}
_ATTITUDES = ("phi", "theta")
_RATES = ("p", "q", "r")


def _loops(aircraft: Airframe) -> Iterable[Effect]:
    """The usual loops. A rate without a washout is left out: derivatives in that rate reproduce it."""
    for surface, quantities in LOOPS.items():
        yield from (feedback(surface, name) if name in _ATTITUDES else washed_out(surface, name) for name in quantities)


_MOMENT_OF = {"delta_e": "Cm", "delta_a": "Cl", "delta_r": "Cn"}
_SMALL_GAIN = 0.05  # of an attitude, and where the file gives no size
_SMALL_PART = 0.1  # of the derivative that a loop adds to


def _gain_that_matters(surface: str, quantity: str) -> Callable[[Airframe], float]:
    """The gain that changes the derivative of the surface's moment in the quantity by a tenth."""

    def size(aircraft: Airframe) -> float:
        moment = _MOMENT_OF[surface]
        speed = aircraft.trim.get("V", 0.0)
        own, power = (aircraft.derivatives.get(f"{moment}_{name}", 0.0) for name in (quantity, surface))
        if quantity in _ATTITUDES or not (own and power and speed):
            return _SMALL_GAIN
        length = aircraft.rate_length_pitch if quantity == "q" else aircraft.rate_length_lateral
        return _SMALL_PART * abs(own / power) * (length / speed if quantity in _RATES else 1.0)

    return size


def _fed(path: SignalPath, quantity: str) -> Any:
    return path.air[quantity] if quantity in path.air else path.state[quantity]


def _loop(surface: str, quantity: str, act: Callable[[SignalPath, Symbols], Any], **more: Any) -> Effect:
    """A surface to which what `act` gives is added, behind the air data that it may depend on."""

    def change(path: SignalPath, values: Symbols) -> None:
        path.surface[surface] += act(path, values)
        path.regressor[surface] = path.surface[surface]

    return Effect(
        enters=station.control(surface),
        size=Size(meaningful=_gain_that_matters(surface, quantity), limit=_LARGEST_GAIN),
        station="air data",
        change=change,
        **more,
    )


@of_kind("feedback")
def washed_out(surface: str, quantity: str) -> Effect:
    """Feedback of the changes of a quantity: what it was before, over a time constant, is taken away."""
    behind = f"{quantity}_fed_to_{surface}"

    def act(path: SignalPath, values: Symbols) -> Any:
        changes = _fed(path, quantity) - path.state[behind]
        path.derivative[behind] = changes / values["time_constant"]
        return values["value"] * changes

    def series(t: np.ndarray, known: Series, values: Values) -> dict[str, np.ndarray]:
        name = f"rate_{quantity}" if quantity in _RATES else quantity
        fed = known[name] if name in known else np.zeros_like(t)  # the motion along one axis has none of the other
        passed = fed - operators.lag(t, fed, values["time_constant"])
        return {station.control(surface): values["value"] * passed}

    return _loop(
        surface,
        quantity,
        act,
        variant="washout",
        further=Further(grid=grid(time_constant=(1.0, 3.0)), unsigned=("time_constant",)),
        units={"time_constant": "s"},
        states={behind: quantity},
        series=series,
    )


@cause(
    targets=SURFACES,
    terms=("p", "q", "r", "alpha", "beta", "phi", "theta"),
    candidates=_loops,
    variants={"time_constant": washed_out},
    unit="{gain}",
    quantity="gain from the quantity to the surface; beside the command",
    title="{label}: feedback of {term}",
    sentence="The {label} also follows {term}, with a gain of {size}: a damper or autopilot that the model lacks.",
)
def feedback(surface: str, quantity: str) -> Effect:
    return _loop(surface, quantity, lambda path, values: values["value"] * _fed(path, quantity))
