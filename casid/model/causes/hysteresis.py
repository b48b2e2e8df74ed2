"""Hysteresis: what acts depends on the way that an input, or the motion under friction, came."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np
import scipy

from casid.model import operators, station
from casid.model.causes.controls import never_sought
from casid.model.effect import (
    Effect,
    Equations,
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
from casid.signals import SURFACES, unit_of

_STROKES = np.radians([0.5, 2.0, 8.0])


@of_kind("hysteresis")
def bristles(state: str) -> Effect:
    """Dry friction of a speed that builds up over a travel, by Dahl: bristles bend before they slip. Over a travel of 0
    it is `dry_friction`, over a long one a spring."""
    bent = f"{state}_bent"

    def change(model: Equations, values: Symbols) -> None:
        speed = model.term(state)
        model.adds(state, -values["value"] * model.term(bent))
        model.adds(bent, (speed - ca.fabs(speed) * model.term(bent)) / values["travel"])

    def series(t: np.ndarray, known: Series, values: Values) -> dict[str, np.ndarray]:
        way = scipy.integrate.cumulative_trapezoid(known[state], t, initial=0.0)
        return {station.equation(state): -values["value"] * operators.hysteresis(way, values["travel"])}

    return Effect(
        variant="speed",
        enters=station.equation(state),
        further=Further(grid=grid(travel=(1.0,)), unsigned=("travel",)),
        states={bent: ""},
        traits=Traits(includes=("dry_friction", "missing_term")),
        change=change,
        series=series,
    )


@cause(
    place="command",
    of_systems=True,
    targets=SURFACES,
    candidates=never_sought,
    variants={"travel": bristles},
    unit="{channel}",
    quantity="half its width, after long movements; `stroke`, over which it turns, and `rest`, where a record begins, "
    "from -1 to 1, stand in the parameters; with `travel` in place of these it is of the friction of a speed",
    sentence="There is a hysteresis of plus and minus {size} in the {label}.",
)
def hysteresis(surface: str) -> Effect:
    def series(t: np.ndarray, known: Series, values: Values) -> dict[str, np.ndarray]:
        z = operators.hysteresis(known[surface], values["stroke"], values.get("rest", 0.0))
        return {station.control(surface): -values["value"] * z}

    further = Further(
        grid=grid(stroke=_STROKES, rest=(0.0,)), defaults={"rest": 0.0}, unsigned=("stroke",), folded=("rest",)
    )
    return Effect(
        further=further,
        units={"stroke": unit_of(surface), "rest": "1"},
        size=Size(meaningful=math.radians(0.1), limit=math.radians(8.0)),
        traits=Traits(includes=("backlash", "actuator_lag", "input_delay", "input_scale")),
        series=series,
    )
