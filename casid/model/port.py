"""Ports: the places of a dynamic system where reality may differ from its simulation.

Whatever is missing in a model enters somewhere: a state equation, an input, a reading. A port says where; its history
is a disturbance of the model that `with_ports` makes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import casadi as ca

from casid.arguments import names as names_of
from casid.arguments import number, one_line, one_of, require
from casid.errors import InputError, check_known, unknown
from casid.model.station import Station, StationKind, stuck
from casid.model.system import Model

Place = Literal["state derivative", "input", "output"]
# kind of a port -> kind of its station, the names of a model among which it is, and how a report calls it
_PLACES: dict[Place, tuple[StationKind, str, str]] = {
    "state derivative": ("equation", "states", "the equation of "),
    "input": ("control", "inputs", "the input "),
    "output": ("reading", "outputs", "the reading of "),
}


@dataclass(frozen=True, kw_only=True)
class ModelPort:
    """A place of a model where something unknown may enter.

    Attributes
    ----------
    kind
        What it adds to: "state derivative", "input" or "output".
    name
        Of the state, input or output.
    unit
        Of what it adds; "" if unknown.
    matters
        The r.m.s. size that matters, in `unit`; None: 5 % of the variation there.
    words
        How a report calls it; by default from kind and name.

    Raises
    ------
    InputError
        For an unknown kind, and a size that is not positive.

    Examples
    --------
    >>> import casid as cs
    >>> port = cs.ModelPort(kind="input", name="u", unit="V", matters=0.1)
    >>> port.words
    'the input u'
    """

    kind: Place
    name: str
    unit: str = ""
    matters: float | None = None
    words: str = ""

    def __post_init__(self) -> None:
        where = f"port '{one_line(self.name, 'ModelPort: name')}'"
        one_of(self.kind, tuple(_PLACES), f"{where}: kind")
        for what in ("unit", "words"):
            one_line(getattr(self, what), f"{where}: {what}")
        if self.matters is not None:
            number(self.matters, f"{where}: matters", positive=True)
        if not self.words:
            object.__setattr__(self, "words", _PLACES[self.kind][2] + self.name)

    @property
    def station(self) -> str:
        """Key of its station, the name of its disturbance in a model `with_ports`."""
        return Station(_PLACES[self.kind][0], self.name).key


def ports_of(model: Model, exact: Sequence[str] = ()) -> tuple[ModelPort, ...]:
    """A port at every state derivative, input and output whose name is not in `exact`."""
    check_known("name", names_of(exact, "exact"), (*model.states, *model.inputs, *model.outputs), "exact")
    equations = [ModelPort(kind="state derivative", name=name) for name in model.states if name not in exact]
    inputs = [ModelPort(kind="input", name=name) for name in model.inputs if name not in exact]
    # an exact equation does not vouch for the instrument that reads the state of the same name
    beyond_doubt = {name for name in exact if name not in model.states}
    outputs = [ModelPort(kind="output", name=name) for name in model.outputs if name not in beyond_doubt]
    return (*equations, *inputs, *outputs)


def check_ports(model: Model, ports: Sequence[ModelPort]) -> None:
    """Raises InputError for a port that the model does not have, or that is named twice."""
    for port in ports:
        require(port, ModelPort, f"ports of '{model.name}': one", "cs.ModelPort(kind=..., name=...)")
        valid = getattr(model, _PLACES[port.kind][1])
        check_known(port.kind, (port.name,), valid, f"ports of '{model.name}'")
    names = [port.station for port in ports]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise InputError(
            f"ports of '{model.name}': '{Station.at(twice[0]).name}' stands twice in one kind; name it once"
        )


def with_ports(model: Model, ports: Sequence[ModelPort]) -> Model:
    """The model with a disturbance, null 0, at every port, after those that it has; a port at which it has one keeps
    it."""
    names = tuple(port.station for port in ports if port.station not in model.disturbances)
    w = ca.SX.sym("ports", len(names))
    u, _, f, h = entering(model, names, w)
    f, h = ca.substitute([f, h], [model.u], [u])
    return replace(model, f=f, h=h, w=ca.vertcat(model.w, w), disturbances=(*model.disturbances, *names), equation=None)


def entering(model: Model, stations: Sequence[str], added: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
    """Inputs, disturbances, equations and readings of a model with what is added at stations, by their names. Raises
    InputError for a station that the model does not have."""
    u = ca.SX(model.u)
    w = ca.SX(model.w)
    f = ca.SX(model.f)
    h = ca.SX(model.h)
    beside = ca.SX.zeros(h.shape[0])  # what is added to a reading is added to one that is stuck
    places = {"control": (u, model.inputs), "equation": (f, model.states), "reading": (beside, model.outputs)}
    for k, name in enumerate(stations):
        if name in model.disturbances:
            w[model.disturbances.index(name)] += added[k]
            continue
        if name.startswith("present "):
            continue
        lost = name.removeprefix(stuck(""))
        if lost != name and lost in model.outputs:
            h[model.outputs.index(lost)] *= 1.0 - added[k]
            continue
        at = Station.at(name)
        rows, names = places.get(at.kind, (u, ()))
        if at.name not in names:
            raise unknown("station", name, (*model.inputs, *model.states, *model.outputs), f"model '{model.name}'")
        rows[names.index(at.name)] += added[k]
    return u, w, f, h + beside
