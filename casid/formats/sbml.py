"""Models of SBML, the Systems Biology Markup Language, as expressions: species, reactions, rules, events.

Level 2 and 3, core. Needs python-libsbml. What has no meaning here is refused by name: delays, algebraic rules, events
whose time depends on the state or that do anything but add to it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import casadi as ca

from casid.errors import InputError, unknown


@dataclass(frozen=True, eq=False, kw_only=True)
class Switch:
    """A condition on time, true while `margin` >= 0: an expression of t and of parameters."""

    name: str
    margin: ca.SX


@dataclass(eq=False)
class Scope:
    """What names mean while formulas are translated: `known` symbols, `rules` that define others, the switches found so
    far, and where we are, for messages."""

    where: str
    known: Mapping[str, ca.SX]
    rules: Mapping[str, Any] = field(default_factory=dict)
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
    initial: Mapping[str, Any]  # state -> formula of its initial value, or a number
    rules: Mapping[str, Any]
    # event -> (trigger, state -> formula of its value after the event)
    doses: Mapping[str, tuple[Any, Mapping[str, Any]]]
    _rates: Callable[[Scope], Mapping[str, ca.SX]]

    def rates(self, scope: Scope) -> Mapping[str, ca.SX]:
        """State -> its time derivative."""
        return self._rates(scope)


def library(what: str) -> Any:
    """libsbml. Raises InputError where it is not installed."""
    try:
        import libsbml
    except ImportError:
        raise InputError(f"{what}: SBML needs python-libsbml; install it with: pip install 'casid[petab]'") from None
    return libsbml


def read_sbml(path: Path) -> SbmlModel:
    """The model of an SBML file. Raises InputError for a file that is none, and for what is not taken."""
    libsbml = library(str(path))
    if not path.is_file():
        raise InputError(f"{path}: cannot be read: no such file")
    document = libsbml.readSBMLFromFile(str(path))
    for option in ("expandFunctionDefinitions", "promoteLocalParameters"):
        properties = libsbml.ConversionProperties()
        properties.addOption(option, True)
        document.convert(properties)
    if document.getNumErrors(libsbml.LIBSBML_SEV_ERROR) or document.getModel() is None:
        fault = document.getErrorLog().getErrorWithSeverity(0, libsbml.LIBSBML_SEV_ERROR)
        raise InputError(f"{path}: not a readable SBML file: {fault.getShortMessage() if fault else 'no model'}")
    model = document.getModel()
    _check_factors(model, path)
    rules = {}
    rated = {}
    for rule in model.getListOfRules():
        if rule.isAlgebraic():
            raise InputError(f"{path}: an algebraic rule; only assignment and rate rules are taken")
        (rules if rule.isAssignment() else rated)[rule.getVariable()] = rule.getMath().deepCopy()
    initial = {a.getSymbol(): a.getMath().deepCopy() for a in model.getListOfInitialAssignments()}
    constants, begin, divided = _values(model, rules)
    moved = _moved_by_reactions(model)
    states = [n for n in begin if n in rated or n in moved]
    reactions = {r.getId(): r.getKineticLaw().getMath().deepCopy() for r in model.getListOfReactions()}

    def rates(scope: Scope) -> dict[str, ca.SX]:
        velocity = {name: translated(law, scope) for name, law in reactions.items()}
        found = {name: translated(law, scope) for name, law in rated.items()}
        for state, parts in moved.items():
            total = sum((count * velocity[reaction] for reaction, count in parts), ca.SX(0))
            found[state] = total / scope.lookup(divided[state]) if state in divided else total
        return found

    held = {name: value for name, value in begin.items() if name not in states}
    return SbmlModel(
        name=model.getId() or path.stem,
        states=tuple(states),
        constants={n: v for n, v in (constants | held).items() if n not in states},
        initial={n: initial.get(n, begin[n]) for n in states},
        rules=rules | {n: m for n, m in initial.items() if n not in states},
        doses=_doses(model, path, states),
        _rates=rates,
    )


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


def _doses(model: Any, path: Path, states: list[str]) -> dict[str, tuple[Any, dict[str, Any]]]:
    """The events, each as a trigger and what it sets; whether they are doses at known times is seen when numbers are
    there."""
    found = {}
    for i, event in enumerate(model.getListOfEvents()):
        name = event.getId() or f"event {i + 1}"
        if event.isSetDelay() or event.isSetPriority():
            raise InputError(f"{path}: event '{name}' has a delay or a priority; only events at known times are taken")
        sets = {a.getVariable(): a.getMath().deepCopy() for a in event.getListOfEventAssignments()}
        for target in sets:
            if target not in states:
                raise InputError(f"{path}: event '{name}' sets '{target}', which no reaction or rate rule moves")
        found[name] = (event.getTrigger().getMath().deepCopy(), sets)
    return found


def parsed(formula: str, where: str) -> Any:
    """The tree of a formula as text, with log as the natural logarithm. Raises InputError for what is none."""
    libsbml = library(where)
    settings = libsbml.L3ParserSettings()
    settings.setParseLog(libsbml.L3P_PARSE_LOG_AS_LN)
    tree = libsbml.parseL3FormulaWithSettings(str(formula).replace("**", "^"), settings)
    if tree is None:
        raise InputError(f"{where}: {formula!r:.60} is no formula")
    return tree


_ONE = {
    "exp": ca.exp,
    "ln": ca.log,
    "abs": ca.fabs,
    "floor": ca.floor,
    "ceiling": ca.ceil,
    **{name: getattr(ca, name) for name in ("sin", "cos", "tan", "sinh", "cosh", "tanh")},
    **{f"arc{name}": getattr(ca, f"a{name}") for name in ("sin", "cos", "tan", "sinh", "cosh", "tanh")},
}


def translated(tree: Any, scope: Scope) -> ca.SX:
    """The expression of a formula; a number is one already. Raises InputError for what is not taken."""
    if isinstance(tree, int | float):
        return ca.SX(tree)
    libsbml = library(scope.where)
    kind = tree.getType()
    if tree.isNumber():
        return ca.SX(tree.getValue())
    if kind == libsbml.AST_NAME_TIME:
        return scope.lookup("t")
    if kind in (libsbml.AST_CONSTANT_PI, libsbml.AST_CONSTANT_E):
        return ca.SX(ca.pi if kind == libsbml.AST_CONSTANT_PI else float(ca.exp(1)))
    if kind in (libsbml.AST_CONSTANT_TRUE, libsbml.AST_CONSTANT_FALSE):
        return ca.SX(1.0 if kind == libsbml.AST_CONSTANT_TRUE else 0.0)
    if kind == libsbml.AST_NAME:
        return scope.lookup(tree.getName())
    if tree.isRelational():
        return _relation(libsbml, tree, scope)
    parts = [translated(tree.getChild(i), scope) for i in range(tree.getNumChildren())]
    return _operation(libsbml, tree, parts, scope.where)


def _operation(libsbml: Any, tree: Any, parts: list[ca.SX], where: str) -> ca.SX:
    kind = tree.getType()
    name = tree.getName() or ""
    if kind == libsbml.AST_PLUS:
        return sum(parts, ca.SX(0))
    if kind == libsbml.AST_TIMES:
        product = ca.SX(1)
        for part in parts:
            product = product * part
        return product
    if kind == libsbml.AST_MINUS:
        return -parts[0] if len(parts) == 1 else parts[0] - parts[1]
    if kind == libsbml.AST_DIVIDE:
        return parts[0] / parts[1]
    if kind in (libsbml.AST_POWER, libsbml.AST_FUNCTION_POWER):
        return parts[0] ** parts[1]
    if kind == libsbml.AST_FUNCTION_ROOT:
        return ca.sqrt(parts[-1]) if len(parts) == 1 else parts[1] ** (1.0 / parts[0])
    if kind == libsbml.AST_FUNCTION_LOG:
        return ca.log(parts[-1]) / ca.log(parts[0] if len(parts) == 2 else ca.SX(10.0))
    if kind == libsbml.AST_FUNCTION_PIECEWISE:
        value = parts[-1] if len(parts) % 2 else ca.SX(0)
        for k in range(len(parts) // 2 - 1, -1, -1):
            value = ca.if_else(parts[2 * k + 1], parts[2 * k], value)
        return value
    if tree.isLogical():
        return _logical(libsbml, kind, parts)
    if name in ("min", "max"):
        found = parts[0]
        for part in parts[1:]:
            found = ca.fmin(found, part) if name == "min" else ca.fmax(found, part)
        return found
    if name in _ONE and len(parts) == 1:
        return _ONE[name](parts[0])
    raise InputError(f"{where}: the function '{name or kind}' is not taken")


def _logical(libsbml: Any, kind: int, parts: list[ca.SX]) -> ca.SX:
    if kind == libsbml.AST_LOGICAL_NOT:
        return ca.logic_not(parts[0])
    found = parts[0]
    for part in parts[1:]:
        if kind == libsbml.AST_LOGICAL_AND:
            found = ca.logic_and(found, part)
        elif kind == libsbml.AST_LOGICAL_OR:
            found = ca.logic_or(found, part)
        else:
            found = found + part - 2.0 * found * part
    return found


def _relation(libsbml: Any, tree: Any, scope: Scope) -> ca.SX:
    """A comparison; of time with what is known, a switch, which records have as an input."""
    kind = tree.getType()
    name = f"switch {libsbml.formulaToL3String(tree)}"
    if name in scope.inputs:
        return scope.inputs[name]
    left, right = (translated(tree.getChild(i), scope) for i in range(2))
    if kind in (libsbml.AST_RELATIONAL_EQ, libsbml.AST_RELATIONAL_NEQ):
        same = left == right
        return same if kind == libsbml.AST_RELATIONAL_EQ else ca.logic_not(same)
    greater = kind in (libsbml.AST_RELATIONAL_GT, libsbml.AST_RELATIONAL_GEQ)
    margin = left - right if greater else right - left
    if "t" in scope.known and ca.depends_on(margin, scope.known["t"]):
        scope.switches.setdefault(name, Switch(name=name, margin=margin))
    strict = kind in (libsbml.AST_RELATIONAL_GT, libsbml.AST_RELATIONAL_LT)
    return margin > 0 if strict else margin >= 0
