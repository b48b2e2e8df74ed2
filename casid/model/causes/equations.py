"""Causes in the equations of any model: what a state lacks, and parameters that differ."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca

from casid.model import station
from casid.model.causes.controls import never_sought
from casid.model.effect import Effect, Equations, Further, Symbols, Traits, cause


@cause(
    "missing_term",
    place="equation",
    of_systems=True,
    candidates=never_sought,
    needs_term=True,
    unit="",
    quantity="factor of the term in the equation of a state",
    title="{target}: {term}",
    sentence="The equation of {target} lacks a term {size} {term}.",
)
def missing_term(state: str, term: str) -> Effect:
    def change(model: Equations, values: Symbols) -> None:
        model.adds(state, values["value"] * model.term(term))

    return Effect(target=state, term=term, regressor=term, enters=station.equation(state), change=change)


def _of_a_state(state: str, change: Callable[[Equations, Symbols], None], **more: Any) -> Effect:
    """An effect in the equation of a state."""
    return Effect(target=state, enters=station.equation(state), change=change, **more)


@cause(
    "damping",
    place="equation",
    candidates=never_sought,
    unit="",
    quantity="factor of the state that its equation loses",
    sentence="{target} is damped by {size} of itself more than in the model.",
)
def damping(state: str) -> Effect:
    return _of_a_state(state, lambda model, values: model.adds(state, -values["value"] * model.term(state)))


@cause(
    "cross_damping",
    place="equation",
    candidates=never_sought,
    needs_term=True,
    unit="",
    quantity="factor of another state that the equation loses",
    title="{target}: damping by {term}",
    sentence="{target} is damped by {size} of {term}, which the model does not have.",
)
def cross_damping(state: str, other: str) -> Effect:
    def change(model: Equations, values: Symbols) -> None:
        model.adds(state, -values["value"] * model.term(other))

    return _of_a_state(state, change, term=other)


def sticking(state: str) -> Effect:
    """Dry friction that is larger at rest and falls with speed, by Stribeck."""

    def change(model: Equations, values: Symbols) -> None:
        speed = model.term(state)
        falls = ca.exp(-((speed / values["falls_over"]) ** 2))
        size = values["value"] + values["at_rest"] * falls
        model.adds(state, -size * ca.tanh(speed / values["creep"]))

    grid = ({"creep": 1e-2, "at_rest": 0.0, "falls_over": 1.0},)
    return _of_a_state(state, change, kind="dry_friction", variant="stribeck", further=Further(grid=grid))


@cause(
    "dry_friction",
    place="equation",
    of_systems=True,
    candidates=never_sought,
    variants={"at_rest": sticking},
    unit="",
    quantity="what the equation of a speed loses, with the sign of the speed; `creep`, the speed about which that "
    "reverses, stands in the parameters, and `at_rest`, by how much it is more at rest, falling over a speed "
    "`falls_over`",
    sentence="{target} has dry friction of {size} that the model does not have.",
)
def dry_friction(state: str) -> Effect:
    def change(model: Equations, values: Symbols) -> None:
        model.adds(state, -values["value"] * ca.tanh(model.term(state) / values["creep"]))

    return _of_a_state(state, change, further=Further(grid=({"creep": 1e-2},)))


@cause(
    "relaxation",
    place="equation",
    candidates=never_sought,
    unit="1/s",
    quantity="rate at which the state is drawn to a level, which stands in the parameters",
    sentence="{target} is drawn to a level at a rate of {size}, which the model does not have.",
)
def relaxation(state: str) -> Effect:
    def change(model: Equations, values: Symbols) -> None:
        model.adds(state, values["value"] * (values["level"] - model.term(state)))

    return _of_a_state(state, change, further=Further(grid=({"level": 0.0},)))


@cause(
    "inertia_scale",
    place="equation",
    candidates=never_sought,
    unit="1",
    quantity="true over assumed inertia of the state, less one: of all that moves it",
    sentence="The inertia in the equation of {target} differs by {percent}.",
)
def inertia_scale(state: str) -> Effect:
    return _of_a_state(state, lambda model, values: model.scales(state, 1.0 / (1.0 + values["value"])))


@cause(
    "parameter_change",
    place="value",
    of_systems=True,
    candidates=never_sought,
    unit="",
    quantity="difference of the parameter from its value in the other records",
    title="{target}: another value",
    sentence="The parameter {target} is other by {size}.",
)
def parameter_change(parameter: str) -> Effect:
    def change(model: Equations, values: Symbols) -> None:
        model.shifts(parameter, values["value"])

    return Effect(target=parameter, traits=Traits(by_record=True, relative=True), change=change)


@cause(
    "parameter_split",
    place="value",
    candidates=never_sought,
    needs_term=True,
    unit="",
    quantity="difference of the parameter, in the equation of the state that is its term, from its value in the others",
    title="{target}: another value in the equation of {term}",
    sentence="The parameter {target} is other by {size} in the equation of {term}: it stands for two.",
)
def parameter_split(parameter: str, state: str) -> Effect:
    def change(model: Equations, values: Symbols) -> None:
        model.shifts(parameter, values["value"], state)

    return Effect(target=parameter, term=state, traits=Traits(relative=True), change=change)


@cause(
    "common_factor",
    place="value",
    joined=True,
    candidates=never_sought,
    unit="1",
    quantity="relative change of all its parameters by one factor",
    title="{target}: a common factor",
    sentence="The parameters {label} differ by {percent}, all by one factor.",
)
def common_factor(parameters: str) -> Effect:
    def change(model: Equations, values: Symbols) -> None:
        for name in parameters.split("+"):
            model.scales(name, 1.0 + values["value"])

    return Effect(target=parameters, traits=Traits(relative=True), change=change)
