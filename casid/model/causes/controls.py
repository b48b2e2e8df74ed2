"""Causes between the recorded command and the surface that acts."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable

import numpy as np

from casid.model import operators, station
from casid.model.effect import Effect, Series, Values, cause
from casid.model.rotors import thrust_of
from casid.signals import SURFACES

_PLAY = np.radians([0.05, 0.1, 0.2, 0.4, 0.8, 1.5, 3.0])


def _surface_operator(
    kind: str,
    surface: str,
    sizes: Iterable[float],
    operate: Callable,
    meaningful: float,
    limit: float,
    *,
    unsigned: tuple[str, ...] = ("value",),
    noise: Callable[[float, float, Values], tuple[float, float]] | None = None,
    transfer: Callable[[np.ndarray, float], np.ndarray] | None = None,
) -> Effect:
    def series(t: np.ndarray, known: Series, values: Values) -> dict[str, np.ndarray]:
        recorded = known[surface]
        return {station.control(surface): operate(t, recorded, values["value"]) - recorded}

    def response(s: np.ndarray, values: Values) -> np.ndarray:
        assert transfer is not None
        return transfer(s, values["value"])

    return Effect(
        kind=kind,
        target=surface,
        linear=False,
        grid=tuple({"value": v} for v in sizes),
        series=series,
        unsigned=unsigned,
        meaningful=meaningful,
        limit=limit,
        noise=noise,
        transfer=response if transfer else None,
    )


@cause(
    "actuator_lag",
    targets=SURFACES,
    unit="s",
    quantity="time constant",
    sentence="The {label} follows its command with a lag of {size} that the model does not have.",
)
def actuator_lag(surface: str) -> Effect:
    def noise(sigma: float, dt: float, values: Values) -> tuple[float, float]:
        T = max(abs(values["value"]), dt)
        return sigma * float(np.sqrt(np.tanh(dt / (2.0 * T)))), T

    sizes = (0.03, 0.06, 0.12, 0.25, 0.5)
    late = operators.lag_transfer
    return _surface_operator("actuator_lag", surface, sizes, operators.lag, 0.01, 1.0, noise=noise, transfer=late)


@cause(
    "input_delay",
    targets=SURFACES,
    unit="s",
    quantity="delay of the surface behind its record",
    sentence="The {label} follows its command {size} [late|early].",
)
def input_delay(surface: str) -> Effect:
    sizes, late = (0.02, 0.05, 0.1, 0.2, 0.4), operators.delay_transfer
    return _surface_operator("input_delay", surface, sizes, operators.delay, 0.01, 0.5, unsigned=(), transfer=late)


@cause(
    "rate_limit",
    targets=SURFACES,
    unit="rad/s",
    quantity="largest rate of the surface",
    sentence="The {label} cannot move faster than {size}.",
)
def rate_limit(surface: str) -> Effect:
    sizes = np.radians([2.0, 3.5, 6.0, 10.0, 17.0, 30.0, 50.0, 85.0])
    return _surface_operator("rate_limit", surface, sizes, operators.rate_limit, 0.0, math.radians(200.0))


@cause(
    "dead_zone",
    targets=SURFACES,
    unit="rad",
    quantity="half width around zero without any answer",
    sentence="The {label} does not answer to a command below {size}.",
)
def dead_zone(surface: str) -> Effect:
    def operate(t: np.ndarray, y: np.ndarray, width: float) -> np.ndarray:
        return operators.dead_zone(y, width, float(np.median(y)))

    return _surface_operator("dead_zone", surface, _PLAY, operate, math.radians(0.1), math.radians(8.0))


@cause(
    "backlash",
    targets=SURFACES,
    unit="rad",
    quantity="half the free play; where in it a record begins, from -1 to 1, stands in the parameters",
    sentence="The {label} has a free play of plus and minus {size}.",
)
def backlash(surface: str) -> Effect:
    def series(t: np.ndarray, known: Series, values: Values) -> dict[str, np.ndarray]:
        recorded = known[surface]
        return {
            station.control(surface): operators.backlash(recorded, values["value"], values.get("rest", 0.0)) - recorded
        }

    return Effect(
        kind="backlash",
        target=surface,
        linear=False,
        grid=tuple({"value": v, "rest": 0.0} for v in _PLAY),
        defaults={"rest": 0.0},
        series=series,
        unsigned=("value",),
        folded=("rest",),
        meaningful=math.radians(0.1),
        limit=math.radians(8.0),
    )


@cause(
    "effectiveness_change",
    targets=(*SURFACES, "thrust"),
    of_rotors=True,
    unit="1",
    quantity="relative change from the onset on; -0.3: 30 % are lost",
    sentence="The effectiveness of the {label} changes by {percent} in mid-record.",
)
def effectiveness_change(surface: str) -> Effect:
    def series(t: np.ndarray, known: Series, values: Values) -> dict[str, np.ndarray]:
        lost = values["value"] * operators.step(t, values["onset"])
        if thrust_of(surface) in known:  # a rotor, of which the thrust changes
            thrust = thrust_of(surface)
            return {station.control(thrust): lost * known[thrust]}
        return {station.control(surface): lost * known[surface]}

    def from_the_onset_on(s: np.ndarray, values: Values) -> np.ndarray:
        return np.full(len(s), 1.0 + values["value"], dtype=complex)

    return Effect(
        kind="effectiveness_change",
        target=surface,
        timed=True,
        recurring=True,
        either_sign=True,
        series=series,
        transfer=from_the_onset_on,
        meaningful=0.03,
        limit=1.5,
    )
