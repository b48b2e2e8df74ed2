"""Causes in the equations of any model: what a state lacks, and parameters that differ."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import casadi as ca

from casid.model import station
from casid.model.causes.controls import never_sought
from casid.model.effect import Effect, Equations, Further, Symbols, Traits, cause, grid, of_kind

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
