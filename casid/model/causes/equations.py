"""Causes in the equations of any model: what a state lacks, hysteresis there or of an input, parameters that differ."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import casadi as ca
import numpy as np
import scipy

from casid.model import operators, station
from casid.model.causes.controls import PLAY_SIZE, command, never_sought
from casid.model.effect import Effect, Equations, Further, Series, Symbols, Traits, Values, cause, grid, of_kind
from casid.signals import unit_of

_STROKES = np.radians([0.5, 2.0, 8.0])
_CREEP = 1e-2  # usual speed about which friction reverses
_equation = partial(cause, place="equation", candidates=never_sought)
_parameter = partial(cause, place="value", candidates=never_sought)


def _adding(state: str, expression: Callable[[Equations, Symbols], Any], **more: Any) -> Effect:
    """What adds an expression of the model and of its values to the equation of a state."""

    def change(model: Equations, values: Symbols) -> None:
        model.adds(state, expression(model, values))

    return Effect(enters=station.equation(state), change=change, **more)


@_equation(
    of_systems=True,
    needs_term=True,
    unit="",
    quantity="factor of the term in the equation of a state",
    title="{target}: {term}",
    sentence="The equation of {target} lacks a term {size} {term}.",
)
def missing_term(state: str, term: str) -> Effect:
    return _adding(state, lambda model, values: values["value"] * model.term(term), regressor=term)


@_equation(
    unit="",
    quantity="factor of the state that its equation loses",
    sentence="{target} is damped by {size} of itself more than in the model.",
)
def damping(state: str) -> Effect:
    return _adding(state, lambda model, values: -values["value"] * model.term(state))


@_equation(
    needs_term=True,
    unit="",
    quantity="factor of another state that the equation loses",
    title="{target}: damping by {term}",
    sentence="{target} is damped by {size} of {term}, which the model does not have.",
)
def cross_damping(state: str, other: str) -> Effect:
    return _adding(state, lambda model, values: -values["value"] * model.term(other))


@of_kind("dry_friction")
def sticking(state: str) -> Effect:
    """Dry friction that is larger at rest and falls with speed, by Stribeck."""

    def friction(model: Equations, values: Symbols) -> Any:
        speed = model.term(state)
        falls = ca.exp(-((speed / values["falls_over"]) ** 2))
        size = values["value"] + values["at_rest"] * falls
        return -size * ca.tanh(speed / values["creep"])

    sizes = grid(creep=(_CREEP,), at_rest=(0.0,), falls_over=(1.0,))
    return _adding(state, friction, variant="stribeck", further=Further(grid=sizes))


@_equation(
    of_systems=True,
    variants={"at_rest": sticking},
    unit="",
    quantity="what the equation of a speed loses, with the sign of the speed; `creep`, the speed about which that "
    "reverses, stands in the parameters, and `at_rest`, by how much it is more at rest, falling over a speed "
    "`falls_over`",
    sentence="{target} has dry friction of {size} that the model does not have.",
)
def dry_friction(state: str) -> Effect:
    def friction(model: Equations, values: Symbols) -> Any:
        return -values["value"] * ca.tanh(model.term(state) / values["creep"])

    return _adding(state, friction, further=Further(grid=grid(creep=(_CREEP,))))


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


@command(
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
        size=PLAY_SIZE,
        traits=Traits(includes=("backlash", "actuator_lag", "input_delay", "input_scale")),
        series=series,
    )


@_equation(
    unit="1/s",
    quantity="rate at which the state is drawn to a level, which stands in the parameters",
    sentence="{target} is drawn to a level at a rate of {size}, which the model does not have.",
)
def relaxation(state: str) -> Effect:
    def drawn(model: Equations, values: Symbols) -> Any:
        return values["value"] * (values["level"] - model.term(state))

    return _adding(state, drawn, further=Further(grid=grid(level=(0.0,))))


@_equation(
    unit="1",
    quantity="true over assumed inertia of the state, less one: of all that moves it",
    sentence="The inertia in the equation of {target} differs by {percent}.",
)
def inertia_scale(state: str) -> Effect:
    def change(model: Equations, values: Symbols) -> None:
        model.scales(state, 1.0 / (1.0 + values["value"]))

    return Effect(enters=station.equation(state), change=change)


@_parameter(
    of_systems=True,
    unit="",
    quantity="difference of the parameter from its value in the other records",
    title="{target}: another value",
    sentence="The parameter {target} is other by {size}.",
)
def parameter_change(parameter: str) -> Effect:
    def change(model: Equations, values: Symbols) -> None:
        model.shifts(parameter, values["value"])

    return Effect(traits=Traits(by_record=True, relative=True), change=change)


@_parameter(
    needs_term=True,
    unit="",
    quantity="difference of the parameter, in the equation of the state that is its term, from its value in the others",
    title="{target}: another value in the equation of {term}",
    sentence="The parameter {target} is other by {size} in the equation of {term}: it stands for two.",
)
def parameter_split(parameter: str, state: str) -> Effect:
    def change(model: Equations, values: Symbols) -> None:
        model.shifts(parameter, values["value"], state)

    return Effect(traits=Traits(relative=True), change=change)


@_parameter(
    joined=True,
    unit="1",
    quantity="relative change of all its parameters by one factor",
    title="{target}: a common factor",
    sentence="The parameters {label} differ by {percent}, all by one factor.",
)
def common_factor(parameters: str) -> Effect:
    def change(model: Equations, values: Symbols) -> None:
        for name in parameters.split("+"):
            model.scales(name, 1.0 + values["value"])

    return Effect(traits=Traits(relative=True), change=change)
