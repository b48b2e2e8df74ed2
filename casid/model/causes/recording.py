"""Causes in how instruments are mounted, fed and written down: misalignment, position errors, the record of thrust,
clocks of recorders."""

from __future__ import annotations

import math
from itertools import starmap
from typing import Any

import casadi as ca
import numpy as np

from casid.model import operators, station
from casid.model.causes.changes import turned
from casid.model.causes.instruments import SENSOR_GROUPS, TRIADS, group_channels, of_group, shown_in
from casid.model.effect import Effect, Forms, Further, Series, Size, Symbols, Traits, Values, cause, grid
from casid.model.path import SignalPath, velocity_over_ground
from casid.model.terms import parse_term

# static ports and upwash depend on the flow angles; each with the smallest slope that matters and the largest plausible
_POSITION_ERRORS: dict[tuple[str, str], tuple[float, float]] = {
    ("V", "alpha"): (10.0, 200.0),
    ("V", "beta^2"): (50.0, 1000.0),
    ("alpha", "beta"): (0.03, 0.6),
    ("beta", "alpha"): (0.03, 0.6),
}


def _turned_attitude(angles: Symbols, axis: str, cosine: Any, sine: Any) -> dict[str, Any]:
    """Euler angles over a turned frame, as continuous as they were."""
    own = {name: angles.get(name, 0.0) for name in ("phi", "theta", "psi")}
    columns = [velocity_over_ground(own | dict(zip("uvw", row, strict=True))) for row in np.eye(3).tolist()]
    x, y, z = (turned(list(column.values()), axis, cosine, sine) for column in columns)

    def beside(angle: Any, across: Any, along: Any) -> Any:
        c = ca.cos(angle)
        s = ca.sin(angle)
        return angle + ca.atan2(across * c - along * s, along * c + across * s)

    found = {"phi": beside(own["phi"], y[2], z[2]), "theta": -ca.asin(x[2]), "psi": beside(own["psi"], x[1], x[0])}
    return {name: angle for name, angle in found.items() if name in angles}


@cause(
    targets=("inertial", "external", "ground"),
    terms=("x", "y", "z"),
    unit="rad",
    quantity="angle by which its axes are turned about the one that is its term; those of an external frame are north, "
    "east and down",
    title="{label}: misalignment about {term}",
    sentence="The axes of the {label} are turned by {size} about {term}.",
)
def sensor_misalignment(target: str, axis: str) -> Effect:
    def change(path: SignalPath, values: Symbols) -> None:
        cosine = ca.cos(values["value"])
        sine = -ca.sin(values["value"])
        for names in TRIADS.get(target, TRIADS["ground"]):
            true = [path.output.get(name, 0.0) for name in names]
            signs = [-1.0 if name == "altitude" else 1.0 for name in names]
            read = turned([sign * x for sign, x in zip(signs, true, strict=True)], axis, cosine, sine)
            found = zip(names, signs, read, strict=True)
            path.output |= {name: sign * x for name, sign, x in found if name in path.output}
        if target == "external":
            path.output |= _turned_attitude(path.output, axis, cosine, sine)

    return Effect(
        reads=shown_in(target),
        kinematic=True,
        traits=Traits(by_record=True),
        station="sensors",
        change=change,
        size=Size(meaningful=math.radians(0.5), limit=math.radians(10.0)),
    )


@cause(
    targets=("V", "alpha", "beta"),
    needs_term=True,
    candidates=lambda aircraft: starmap(position_error, _POSITION_ERRORS),
    unit="{channel}*{term}",
    quantity="slope of the reading over the term, about the trim of the file",
    title="{label}: position error with {term}",
    sentence="The measured {label} has a position error: it depends on {term}, with a slope of {size}.",
)
def position_error(channel: str, term: str) -> Effect:
    dependence = parse_term(term)
    matters, limit = _POSITION_ERRORS.get((channel, dependence.name), (0.0, np.inf))

    def change(path: SignalPath, values: Symbols) -> None:
        at_trim = {name: path.aircraft.trim.get(name, 0.0) for name in dependence.variables}
        off = dependence.evaluate(path.regressor) - dependence.evaluate(at_trim)
        path.output[channel] += values["value"] * off

    return Effect(
        term=dependence.name,
        reads=(channel,),
        kinematic=True,
        station="sensors",
        change=change,
        size=Size(meaningful=matters, limit=limit),
    )


@cause(
    unit="1",
    quantity="relative error of the recorded thrust; true over recorded, less one",
    sentence="The thrust is {percent} [more|less] than its record says.",
)
def thrust_scale() -> Effect:
    def change(path: SignalPath, values: Symbols) -> None:
        path.surface["thrust"] *= 1.0 + values["value"]

    # drag that grows with thrust, as in a slipstream, acts along the flight path, which is nearly the thrust line
    traits = Traits(by_record=True, shows_as=(("aero_term", "CD", "Tc"), ("aero_term", "CX", "Tc")))
    return Effect(traits=traits, station="surface", change=change, size=Size(meaningful=0.05, limit=0.6))


def _drifted(t: np.ndarray, values: Values) -> np.ndarray:
    """Return the time [s] by which a clock that stamped `t` is late."""
    return (t - t[0]) * values["value"] / (1.0 + values["value"])


@cause(
    place="reading",
    targets=SENSOR_GROUPS,
    unit="s/s",
    quantity="seconds that the recorder's clock gains in a second",
    sentence="The clock that stamps the {label} runs {percent} [fast|slow], against the others.",
)
def clock_drift(target: str) -> Effect:
    def read(t: np.ndarray, true: np.ndarray, values: Values) -> np.ndarray:
        return operators.sampled(t, true, t - _drifted(t, values))

    def undo(t: np.ndarray, read: np.ndarray, values: Values) -> np.ndarray:
        return operators.earlier(t, read, (t - t[0]) * values["value"])

    def series(t: np.ndarray, known: Series, values: Values) -> dict[str, np.ndarray]:
        true = t + (t - t[0]) * values["value"]
        return {station.control(c): operators.sampled(t, known[c], true) - known[c] for c in group_channels(target)}

    of_inputs = target == "surfaces"
    return Effect(
        traits=Traits(includes=("sensor_delay", "sensor_lag", "input_delay", "actuator_lag"), by_record=True),
        reads=() if of_inputs else shown_in(target),
        kinematic=not of_inputs,
        linear=False,
        further=Further(grid=grid(value=(0.002, -0.002, 0.005, -0.005, 0.01, -0.01, 0.02, -0.02))),
        output=None if of_inputs else of_group(target, read),
        forms=Forms() if of_inputs else Forms(undo=of_group(target, undo), late=_drifted),
        series=series if of_inputs else None,
        size=Size(meaningful=0.001, limit=0.1),
    )
