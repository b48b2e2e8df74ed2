"""Models of SBML, the Systems Biology Markup Language, as expressions: species, reactions, rules, events.

Level 2 and 3, core. Needs python-libsbml, which ends the process at some files: it reads in a process of its own, and
hands over trees of plain values. What has no meaning here is refused by name: delays, algebraic rules, events
whose time depends on the state or that do anything but add to it.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import casadi as ca

from casid.errors import InputError, unknown
from casid.formats.operators import ONE, REDUCED, Operators
from casid.records.limits import MOST_BYTES_OF_A_MODEL, MOST_DEPTH, apart, read_bytes


@dataclass(frozen=True, eq=False, kw_only=True)
class Formula:
    """A formula as a tree."""

    operation: str  # "number", "name", "time", or what is done with the parts: "plus", "gt", "exp"
    value: float = 0.0  # of a number
    text: str = ""  # of a name; of a comparison as it is written
    parts: tuple[Formula, ...] = ()


@dataclass(frozen=True, eq=False, kw_only=True)
class Switch:
    """A condition on time, true while `margin` >= 0: an expression of t and of parameters."""

    name: str
    margin: ca.SX


@dataclass(eq=False)
class Scope:
    """Meaning of names while formulas are translated: `known` symbols, `rules` that define others, the switches
    found so far, and where we are, for messages."""

    where: str
    known: Mapping[str, ca.SX]
    rules: Mapping[str, Formula | float] = field(default_factory=dict)
    switches: dict[str, Switch] = field(default_factory=dict)
    inputs: Mapping[str, ca.SX] = field(default_factory=dict)

    def lookup(self, name: str) -> ca.SX:
        """The meaning of a name. Raises InputError for one that has none."""
        if name in self.known:
            return self.known[name]
        if name in self.rules:
            return translated(self.rules[name], self)
        raise unknown("name", name, (*self.known, *self.rules), self.where)


@dataclass(frozen=True, eq=False, kw_only=True)
class SbmlModel:
    """An SBML model before numbers are put in."""

    name: str
    states: tuple[str, ...]  # names of what changes by reactions and rate rules
    # name -> value of everything that does not change: parameters, compartments, species that are held
    constants: Mapping[str, float]
    initial: Mapping[str, Formula | float]  # state -> formula of its initial value, or a number
    rules: Mapping[str, Formula | float]
    # event -> (trigger, state -> formula of its value after the event)
    doses: Mapping[str, tuple[Formula, Mapping[str, Formula]]]
    rated: Mapping[str, Formula]  # state -> its time derivative
    reactions: Mapping[str, Formula]  # reaction -> its velocity
    moved: Mapping[str, Sequence[tuple[str, float]]]  # state -> reactions that change it, and by how much each
    divided: Mapping[str, str]  # state -> compartment by whose size its reactions are divided

    def rates(self, scope: Scope) -> Mapping[str, ca.SX]:
        """State -> its time derivative."""
        velocity = {name: translated(law, scope) for name, law in self.reactions.items()}
        found = {name: translated(law, scope) for name, law in self.rated.items()}
        for state, parts in self.moved.items():
            total = sum((count * velocity[reaction] for reaction, count in parts), ca.SX(0))
            found[state] = total / scope.lookup(self.divided[state]) if state in self.divided else total
        return found


def library(what: str) -> Any:
    """libsbml. Raises InputError where it is not installed."""
    try:
        import libsbml
    except ImportError:
        raise InputError(f"{what}: SBML needs python-libsbml; install it with: pip install 'casid[petab]'") from None
    return libsbml


def read_sbml(path: Path) -> SbmlModel:
    """The model of an SBML file. Raises InputError for a file that is none, and for what is not taken."""
    library(str(path))
    read_bytes(path, MOST_BYTES_OF_A_MODEL)  # says what is no readable file
    return apart(_read, path, remedy="save it as SBML level 3")


def _read(path: Path) -> SbmlModel:
    libsbml = library(str(path))
    document = libsbml.readSBMLFromFile(str(path))
    for option in ("", "expandFunctionDefinitions", "promoteLocalParameters"):
        if option:  # a conversion forgets the errors of before
            properties = libsbml.ConversionProperties()
            properties.addOption(option, True)
            document.convert(properties)
        if document.getNumErrors(libsbml.LIBSBML_SEV_ERROR) or document.getModel() is None:
            fault = document.getErrorLog().getErrorWithSeverity(0, libsbml.LIBSBML_SEV_ERROR)
            said = f"line {fault.getLine()}: {fault.getShortMessage()}" if fault else "no model"
            raise InputError(f"{path}: not a readable SBML file: {said}")
    model = document.getModel()
    where = str(path)
    _check_factors(model, path)
    rules = {}
    rated = {}
    for rule in model.getListOfRules():
        if rule.isAlgebraic():
            raise InputError(f"{path}: an algebraic rule; only assignment and rate rules are taken")
        (rules if rule.isAssignment() else rated)[rule.getVariable()] = _tree(rule.getMath(), where)
    initial = {a.getSymbol(): _tree(a.getMath(), where) for a in model.getListOfInitialAssignments()}
    constants, begin, divided = _values(model, rules)
    moved = _moved_by_reactions(model)
    states = [n for n in begin if n in rated or n in moved]
    held = {name: value for name, value in begin.items() if name not in states}
    return SbmlModel(
        name=model.getId() or path.stem,
        states=tuple(states),
        constants={n: v for n, v in (constants | held).items() if n not in states},
        initial={n: initial.get(n, begin[n]) for n in states},
        rules=rules | {n: m for n, m in initial.items() if n not in states},
        doses=_doses(model, path, states),
        rated=rated,
        reactions={r.getId(): _velocity(r, where) for r in model.getListOfReactions()},
        moved=moved,
        divided=divided,
    )


def _velocity(reaction: Any, where: str) -> Formula:
    law = reaction.getKineticLaw()
    return _tree(law.getMath() if law else None, f"{where}: reaction '{reaction.getId()}'")


def _values(model: Any, rules: Mapping[str, Any]) -> tuple[dict[str, float], dict[str, float], dict[str, str]]:
    """Value of every constant; initial value of all that may change; and species -> the compartment whose size divides
    what reactions make of it."""
    sizes = {c.getId(): c.getSize() if c.isSetSize() else 1.0 for c in model.getListOfCompartments()}
    constants = {n: v for n, v in sizes.items() if n not in rules}
    begin: dict[str, float] = {}
    divided: dict[str, str] = {}
    for p in model.getListOfParameters():
        if p.getId() not in rules:
            (constants if p.getConstant() else begin)[p.getId()] = p.getValue() if p.isSetValue() else 0.0
    for s in model.getListOfSpecies():
        name = s.getId()
        size = sizes[s.getCompartment()]
        if name in rules:
            continue
        amount = s.getHasOnlySubstanceUnits()
        value = s.getInitialConcentration() if s.isSetInitialConcentration() else 0.0
        value = value * size if amount else value
        if s.isSetInitialAmount():
            value = s.getInitialAmount() if amount else s.getInitialAmount() / size
        (constants if s.getConstant() else begin)[name] = value
        if not amount:
            divided[name] = s.getCompartment()
    return constants, begin, divided


def _check_factors(model: Any, path: Path) -> None:
    """Raise InputError for what multiplies the effect of reactions and is not taken."""
    for one in (model, *model.getListOfSpecies()):
        if one.isSetConversionFactor():
            raise InputError(
                f"{path}: '{one.getId()}' has a conversionFactor, which is not taken; put it into the laws"
            )
    for reaction in model.getListOfReactions():
        if reaction.isSetFast() and reaction.getFast():
            raise InputError(f"{path}: reaction '{reaction.getId()}' is fast, at equilibrium; only rates are taken")
        for side in (*reaction.getListOfReactants(), *reaction.getListOfProducts()):
            if side.isSetStoichiometryMath():
                raise InputError(
                    f"{path}: reaction '{reaction.getId()}' has a stoichiometryMath; only numbers are taken"
                )


def _moved_by_reactions(model: Any) -> dict[str, list[tuple[str, float]]]:
    """Species -> reactions that change it, and by how much each."""
    fixed = {s.getId() for s in model.getListOfSpecies() if s.getBoundaryCondition() or s.getConstant()}
    moved: dict[str, list[tuple[str, float]]] = {}
    for reaction in model.getListOfReactions():
        for sign, sides in ((-1.0, reaction.getListOfReactants()), (1.0, reaction.getListOfProducts())):
            for side in sides:
                if side.getSpecies() not in fixed:
                    count = side.getStoichiometry() if side.isSetStoichiometry() else 1.0
                    moved.setdefault(side.getSpecies(), []).append((reaction.getId(), sign * count))
    return moved


def _doses(model: Any, path: Path, states: list[str]) -> dict[str, tuple[Formula, dict[str, Formula]]]:
    """The events, each as a trigger and what it sets; whether they are doses at known times is seen when numbers are
    there."""
    found = {}
    for i, event in enumerate(model.getListOfEvents()):
        name = event.getId() or f"event {i + 1}"
        if event.isSetDelay() or event.isSetPriority():
            raise InputError(f"{path}: event '{name}' has a delay or a priority; only events at known times are taken")
        sets = {a.getVariable(): _tree(a.getMath(), str(path)) for a in event.getListOfEventAssignments()}
        for target in sets:
            if target not in states:
                raise InputError(f"{path}: event '{name}' sets '{target}', which no reaction or rate rule moves")
        found[name] = (_tree(event.getTrigger().getMath(), str(path)), sets)
    return found


def parsed(formula: str, where: str) -> Formula:
    """Return the tree of a formula as text, with log as the natural logarithm. Raises InputError for what is none."""
    libsbml = library(where)
    settings = libsbml.L3ParserSettings()
    settings.setParseLog(libsbml.L3P_PARSE_LOG_AS_LN)
    tree = libsbml.parseL3FormulaWithSettings(str(formula).replace("**", "^"), settings)
    if tree is None:
        raise InputError(f"{where}: {formula!r:.60} is no formula")
    return _tree(tree, where)


# types of libsbml, after AST_ and what precedes their names -> operation; any other one has a name of its own
_FAMILIES = {
    "": ("NAME", "PLUS", "TIMES", "MINUS", "DIVIDE", "POWER"),
    "CONSTANT_": ("PI", "E", "TRUE", "FALSE"),
    "FUNCTION_": ("POWER", "ROOT", "LOG", "PIECEWISE"),
    "LOGICAL_": ("NOT", "AND", "OR", "XOR"),
    "RELATIONAL_": ("EQ", "NEQ", "GT", "GEQ", "LT", "LEQ"),
}
_TYPES = {f"{family}{name}": name.lower() for family, names in _FAMILIES.items() for name in names}
_TYPES |= {"NAME_TIME": "time"}


def _tree(node: Any, where: str, depth: int = 0) -> Formula:
    """Return a formula of libsbml. Raises InputError for none, and for one that is too deep."""
    if node is None:
        raise InputError(f"{where}: a formula is missing")
    if depth > MOST_DEPTH:
        raise InputError(f"{where}: a formula is more than {MOST_DEPTH} operations deep; define parts of it by rules")
    libsbml = library(where)
    if node.isNumber():
        return Formula(operation="number", value=float(node.getValue()))
    kind = node.getType()
    known = (operation for name, operation in _TYPES.items() if getattr(libsbml, f"AST_{name}", None) == kind)
    operation = next(known, node.getName() or str(kind))
    text = libsbml.formulaToL3String(node) if node.isRelational() else node.getName() or ""
    parts = tuple(_tree(node.getChild(i), where, depth + 1) for i in range(node.getNumChildren()))
    return Formula(operation=operation, text=text, parts=parts)


_CONSTANTS = {"pi": ca.pi, "e": math.e, "true": 1.0, "false": 0.0}
_RELATIONS = ("eq", "neq", "gt", "geq", "lt", "leq")
_FEWEST = {"plus": 0, "times": 0, "divide": 2, "power": 2}  # arguments
_OPERATORS = Operators(
    one=ONE
    | {name: getattr(ca, name) for name in ("sinh", "cosh", "tanh")}
    | {f"arc{name}": getattr(ca, f"a{name}") for name in ("sin", "cos", "tan", "sinh", "cosh", "tanh")}
    | {"minus": operator.neg, "root": ca.sqrt, "log": lambda x: ca.log(x) / ca.log(10.0), "ceiling": ca.ceil},
    two={
        "minus": operator.sub,
        "divide": operator.truediv,
        "power": operator.pow,
        "root": lambda degree, x: x ** (1.0 / degree),
        "log": lambda base, x: ca.log(x) / ca.log(base),
    },
    reduced=REDUCED | {"plus": operator.add, "times": operator.mul, "xor": lambda a, b: a + b - 2.0 * a * b},
)
_NOTHING = {"plus": 0.0, "times": 1.0}  # of no arguments


def translated(tree: Formula | float, scope: Scope) -> ca.SX:
    """Return the expression of a formula; a number is one already. Raises InputError for what is not taken."""
    if not isinstance(tree, Formula):
        return ca.SX(tree)
    if tree.operation == "number":
        return ca.SX(tree.value)
    if tree.operation in _CONSTANTS:
        return ca.SX(_CONSTANTS[tree.operation])
    if tree.operation in ("time", "name"):
        return scope.lookup("t" if tree.operation == "time" else tree.text)
    if tree.operation in _RELATIONS:
        return _relation(tree, scope)
    return _operation(tree.operation, [translated(part, scope) for part in tree.parts], scope.where)


def _operation(name: str, parts: list[ca.SX], where: str) -> ca.SX:
    if len(parts) < _FEWEST.get(name, 1):
        raise InputError(f"{where}: '{name}' of {len(parts)} arguments; expected {_FEWEST.get(name, 1)} or more")
    if not parts:
        return ca.SX(_NOTHING[name])
    if name == "piecewise":
        value = parts[-1] if len(parts) % 2 else ca.SX(0)
        for k in range(len(parts) // 2 - 1, -1, -1):
            value = ca.if_else(parts[2 * k + 1], parts[2 * k], value)
        return value
    value = _OPERATORS(name, parts)
    if value is None:
        raise InputError(f"{where}: the function '{name}' is not taken")
    return value


def _relation(tree: Formula, scope: Scope) -> ca.SX:
    """Return a comparison; of time with what is known, a switch, which records have as an input."""
    name = f"switch {tree.text}"
    if name in scope.inputs:
        return scope.inputs[name]
    if len(tree.parts) != 2:
        raise InputError(f"{scope.where}: '{tree.text:.60}' compares {len(tree.parts)} things; expected two")
    left, right = (translated(part, scope) for part in tree.parts)
    if tree.operation in ("eq", "neq"):
        same = left == right
        return same if tree.operation == "eq" else ca.logic_not(same)
    margin = left - right if tree.operation in ("gt", "geq") else right - left
    if "t" in scope.known and ca.depends_on(margin, scope.known["t"]):
        scope.switches.setdefault(name, Switch(name=name, margin=margin))
    return margin > 0 if tree.operation in ("gt", "lt") else margin >= 0
