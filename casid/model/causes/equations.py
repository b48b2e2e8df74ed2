"""Causes in the equations of any model: a term that is missing, a parameter that differs in some records."""

from __future__ import annotations

from casid.model import station
from casid.model.causes.controls import never_sought
from casid.model.effect import Effect, Equations, Symbols, Traits, cause


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
