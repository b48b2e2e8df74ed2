"""The generic dynamic system that every estimator works on: states, inputs, parameters, outputs; f, h.

Continuous in time, f is the derivative of the state; discrete in time, f is the state one period later.

An aircraft is one of them; so is a two-state short period of three lines. All expressions are CasADi SX.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import partial
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from casid.above import ask_above
from casid.arguments import given, listed, names, number, numbers_by_name, one_line, require, table_of
from casid.errors import InputError, check_known
from casid.model.algebraic import algebraic_states
from casid.model.expressions import Symbols, Vectors, check_symbols, column, evaluated, expressions
from casid.records.record import Record, filled
from casid.signals import scale_of

if TYPE_CHECKING:
    from casid.model.effect_value import EffectValue
    from casid.model.in_force import History, InForce

_JITTER = 0.01  # of the period of a model in discrete time, that time stamps may be off


@dataclass(frozen=True, eq=False, kw_only=True)
class EquationForm:
    """Equation-error form of a model: `target` computed from measured signals alone, `prediction` from measured
    signals and parameters (paper eq. 6-8). Both are expressions in `m`, the measured `channels`, and the model's p."""

    names: tuple[str, ...]
    channels: tuple[str, ...]
    m: ca.SX
    target: ca.SX
    prediction: ca.SX


# vector or expression -> the names of its rows
_ROWS = {"x": "states", "u": "inputs", "p": "parameters", "w": "disturbances", "f": "states", "h": "outputs"}


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Model:
    """Dynamic system dx/dt = f(x, u, p, w),  y = h(x, u, p, w), of SX column vectors in the order of the names.

    In discrete time x[k+1] = f(x[k], u[k], p, w[k]),  y[k] = h(x[k], u[k], p, w[k]).

    Attributes
    ----------
    name
        For messages and tables.
    states, inputs, parameters, outputs
        Names of the elements of x, u, p and y.
    x, u, p, w
        Column vectors of symbols.
    f, h
        Derivative of the state (in discrete time: the next state) and output, expressions of these symbols.
    disturbances
        Unknown inputs w (null 0): where process noise, gusts or a missing effect may enter.
    nominal
        Start value of every parameter.
    state_scale
        Typical size of every state, for conditioning.
    guess
        (record) -> (N, states) first guess of the state trajectory from measurements.
    prior_std
        A-priori 1-sigma of parameters that have one (absent: none).
    equation
        Equation-error form, or None when the model has none.
    units
        Unit of each parameter, for tables.
    initial
        State -> its value at a record's first sample, an expression of p; what is not here is free, or known to the
        problem.
    period
        Time from one sample to the next [s] of a model in discrete time; None in continuous time.
    events
        Event -> (states,) state after it, an expression of the state before it, of u and p; records say when.
    effects
        What it differs by from the model as it was defined, see `with_effects`.
    histories
        What of these is made of the records, as inputs.
    prepare
        Makes a record that lacks inputs complete, where they follow from its other channels; None: it must have them.
    extend
        Makes the model with further effects, where these change more than equations, inputs and readings.

    Examples
    --------
    `define_model` makes one, and so does `aircraft_model`. After the example of `define_model`:

    >>> lag.f.shape, lag.nominal["T"]
    ((1, 1), 0.5)
    """

    name: str
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    parameters: tuple[str, ...]
    outputs: tuple[str, ...]
    disturbances: tuple[str, ...] = ()
    x: ca.SX
    u: ca.SX
    p: ca.SX
    w: ca.SX
    f: ca.SX
    h: ca.SX
    nominal: Mapping[str, float]
    state_scale: Mapping[str, float]
    guess: Callable[[Record], np.ndarray]
    prior_std: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    equation: EquationForm | None = None
    units: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    initial: Mapping[str, ca.SX] = field(default_factory=lambda: MappingProxyType({}))
    period: float | None = None
    events: Mapping[str, ca.SX] = field(default_factory=lambda: MappingProxyType({}))
    effects: tuple[InForce, ...] = ()
    histories: tuple[History, ...] = ()
    prepare: Callable[[Record], Record] | None = None
    extend: Callable[[Sequence[EffectValue]], Model] | None = None

    def __post_init__(self) -> None:
        where = f"model '{one_line(self.name, 'Model: name')}'"
        for letter, what in _ROWS.items():
            own = names(getattr(self, what), f"{where}: {what}")
            rows = require(getattr(self, letter), ca.SX, f"{where}: {letter}", "a column of expressions").shape[0]
            if rows != len(own):
                raise InputError(f"{where}: {len(own)} {what} but an expression of {rows} rows")
            if len(set(own)) != len(own):
                raise InputError(f"{where}: {what} are not unique: {own}")
            object.__setattr__(self, what, own)
        for what in ("nominal", "state_scale", "prior_std"):
            numbers_by_name(getattr(self, what), f"{where}: {what}")
        for what, kind, like in (("units", str, "'1/s'"), ("initial", ca.SX, "p[0]"), ("events", ca.SX, "x + 1")):
            for name, one in table_of(getattr(self, what), f"{where}: {what}", f"{{'x': {like}}}").items():
                require(one, kind, f"{where}: {what} of '{name}'", f"one like {like}")
        if not callable(self.guess):
            raise InputError(f"{where}: guess is {given(self.guess)}; expected a function of a record")
        if self.equation is not None:
            require(self.equation, EquationForm, f"{where}: equation", "None, or take a model from define_model")
        if self.period is not None:
            object.__setattr__(self, "period", number(self.period, f"{where}: period", positive=True))
        if self.events and self.period is not None:
            raise InputError(
                f"{where}: events are of models in continuous time; in discrete time make a jump part of the dynamics, "
                "with an input that says when"
            )
        for of, table in ((self.parameters, self.nominal), (self.states, self.state_scale)):
            if missing := sorted(set(of) - set(table)):
                raise InputError(f"{where}: no {'nominal value' if of is self.parameters else 'scale'} for {missing}")

    def __repr__(self) -> str:
        discrete = "" if self.period is None else f"discrete, every {self.period:g} s; "
        return (
            f"<Model '{self.name}': {discrete}states {listed(self.states)}; inputs {listed(self.inputs)}; "
            f"parameters {listed(self.parameters)}; outputs {listed(self.outputs)}>"
        )

    def __getstate__(self) -> dict[str, Any]:
        """Symbols cannot be pickled, functions can: the equations become functions of the vectors."""
        state = {f.name: getattr(self, f.name) for f in fields(self)}
        vectors = [state.pop(letter) for letter in "xupw"]
        state["prior_std"], state["units"] = dict(self.prior_std), dict(self.units)
        state["equations"] = ca.Function("equations", vectors, [state.pop("f"), state.pop("h")])
        if any(one.class_name() == "CallbackInternal" for one in state["equations"].find_functions()):
            raise InputError(
                f"model '{self.name}' calls a function outside CasADi, which cannot be kept or sent to another process"
            )
        begin = state.pop("initial")
        state["begin"] = (tuple(begin), ca.Function("initial", [self.p], [ca.vertcat(*begin.values())]))
        jumps = state.pop("events")
        state["jumps"] = (tuple(jumps), ca.Function("jumps", vectors[:3], [ca.vertcat(*jumps.values())]))
        if self.equation is not None:
            inside = [self.equation.m, self.p]
            form = ca.Function("form", inside, [self.equation.target, self.equation.prediction])
            state["equation"] = (self.equation.names, self.equation.channels, form)
        return state

    def __setstate__(self, state: dict[str, Any]) -> None:
        equations: ca.Function = state.pop("equations")
        vectors = [ca.SX.sym(letter, equations.size1_in(i)) for i, letter in enumerate("xupw")]
        f, h = equations(*vectors)
        state |= dict(zip("xupw", vectors, strict=True)) | {"f": f, "h": h}
        begin, function = state.pop("begin", ((), None))
        state["initial"] = dict(zip(begin, ca.vertsplit(function(state["p"])), strict=True)) if begin else {}
        jumps, function = state.pop("jumps", ((), None))
        after = ca.vertsplit(function(*vectors[:3]), len(state["states"])) if jumps else []
        state["events"] = dict(zip(jumps, after, strict=True))
        if state["equation"] is not None:
            names, channels, form = state["equation"]
            m = ca.SX.sym("m", len(channels))
            target, prediction = form(m, state["p"])
            state["equation"] = EquationForm(names=names, channels=channels, m=m, target=target, prediction=prediction)
        self.__dict__.update({"period": None} | state)

    def nominal_vector(self, values: Mapping[str, float] | None = None) -> np.ndarray:
        """(parameters,) nominal values, with `values` put over them by name."""
        values = values or {}
        check_known("parameter", values, self.parameters, f"model '{self.name}'")
        chosen = {name: number(value, f"model '{self.name}': value of '{name}'") for name, value in values.items()}
        return np.array([chosen.get(name, self.nominal[name]) for name in self.parameters], dtype=float)

    def with_effects(self, effects: Iterable[EffectValue]) -> Model:
        """Put effects in force: their sizes are parameters, fixed at the values given unless they are free.

        Parameters
        ----------
        effects
            Kind, target and size of each; of an aircraft any kind, of any other model those at its inputs
            (`actuator_lag`, `input_delay`, `dead_zone` ...), outputs (`sensor_bias`, `sensor_delay` ...), equations
            (`missing_term`) and parameters (`parameter_change`).

        Returns
        -------
        Model
            With one parameter for each size: `actuator_lag(u)`, `structural_mode(q).frequency_hz`, of one that sets in
            `effectiveness_change(u).onset[m1]`.

        Raises
        ------
        InputError
            For a place that the model does not have, and two of one kind and place.

        Examples
        --------
        After the example of `define_model`:

        >>> slow = lag.with_effects([cs.EffectValue(kind="actuator_lag", target="u", value=0.1)])
        >>> slow.parameters
        ('T', 'actuator_lag(u)')
        """
        return ask_above("Model.with_effects", self, effects)

    def without_histories(self) -> Model:
        """The model that takes records as they are: what effects make of them is an input like any other."""
        if not self.histories:
            return self
        found = vars(self).setdefault("_plain", replace(self, histories=(), prepare=None))
        return found

    def ready(self, record: Record, values: Mapping[str, float] | None = None) -> Record:
        """Make a record ready: inputs that follow from its other channels, and what effects make of it.

        Parameters
        ----------
        record
            With the channels of a flight or an experiment.
        values
            Parameters by name, at which histories are made; by default nominal ones.
        """
        return ask_above("Model.ready", self, record, values)

    @property
    def vectors(self) -> Vectors:
        """Letter -> vector of symbols and the names of its rows: states x, inputs u, parameters p, disturbances w."""
        return {letter: (getattr(self, letter), getattr(self, _ROWS[letter])) for letter in "xupw"}

    def scale_vector(self) -> np.ndarray:
        """(states,) typical size of each state."""
        return np.array([self.state_scale[name] for name in self.states], dtype=float)


def variables(model: Model) -> dict[str, ca.SX]:
    """States and inputs by name."""
    return dict(zip((*model.states, *model.inputs), ca.vertsplit(ca.vertcat(model.x, model.u)), strict=True))


def bare_name(model: Model, name: str) -> str:
    """Name in the model of a parameter that may have a record behind it: "bias_q" of "bias_q[m1]"."""
    return name if name in model.parameters or "[" not in name else name.rpartition("[")[0]


def check_continuous(model: Model, what: str) -> None:
    """Raise InputError for a model in discrete time, which `what` does not take."""
    if model.period is not None:
        raise InputError(f"{what}: model '{model.name}' is in discrete time; expected one in continuous time")


def check_period(model: Model, record: Record) -> None:
    """Raise InputError for a record whose samples are not one period of a model in discrete time apart."""
    if model.period is None or len(record) < 2:
        return
    apart = np.diff(record.t)
    k = int(np.argmax(np.abs(apart - model.period)))
    if not abs(apart[k] - model.period) <= _JITTER * model.period:
        raise InputError(
            f"record '{record.name}': {apart[k]:g} s from t = {record.t[k]:g} s to the next sample; model "
            f"'{model.name}' is in discrete time and takes one sample every {model.period:g} s: resample the record, "
            "and give a sample that is missing as NaN"
        )


def define_regression(
    name: str,
    *,
    inputs: Sequence[str],
    parameters: Mapping[str, float],
    outputs: Sequence[str],
    output: Callable[[Any], Mapping[str, Any]],
    prior_std: Mapping[str, float] | None = None,
) -> Model:
    """A static model y = h(u, p): a `Model` without states, whose outputs depend on the inputs of the same sample.

    Parameters
    ----------
    name
        For messages and tables.
    inputs
        Channels that h takes; "t" is the record's time [s].
    parameters
        Nominal value of every parameter.
    outputs
        Channels that h gives.
    output
        Takes a namespace of symbols and returns {output: expression}, as in `define_model`.
    prior_std
        A-priori 1-sigma of the parameters that have one.

    Returns
    -------
    Model
        Nothing is simulated: every transcription and every cost gives the same fit, and a sample where an input or an
        output is missing is left out.

    Raises
    ------
    InputError
        For an output that is not declared or has no expression, or a name that is used twice.

    Examples
    --------
    >>> import numpy as np, casid as cs
    >>> polar = cs.define_regression(
    ...     "polar", inputs=["CL"], parameters={"CD_0": 0.02, "k": 0.05}, outputs=["CD"],
    ...     output=lambda s: {"CD": s.CD_0 + s.k * s.CL**2},
    ... )
    >>> CL = np.linspace(0.2, 1.0, 60)
    >>> record = cs.Record(name="polar", t=np.arange(60.0), channels={"CL": CL, "CD": 0.03 + 0.04 * CL**2})
    >>> fit = cs.solve(cs.Problem(model=polar, records=[record], free=["CD_0", "k"], noise={"CD": 0.001}))
    >>> round(fit.values["CD_0"], 4), round(fit.values["k"], 4)
    (0.03, 0.04)
    """
    return define_model(
        name,
        states=(),
        inputs=inputs,
        parameters=parameters,
        outputs=outputs,
        dynamics=lambda s: {},
        output=output,
        prior_std=prior_std,
    )


def measured_states(states: Sequence[str]) -> Callable[[Record], np.ndarray]:
    """A `Model.guess` for models whose states are channels: the measured channel, zero where it is not measured."""
    return partial(_measured, tuple(states))


def unguessed_states(model: Model, records: Iterable[Record]) -> list[str]:
    """States that begin at zero for want of anything better: no channel of a record, in a model without a guess."""
    if not isinstance(model.guess, partial) or model.guess.func is not _measured:
        return []
    return [s for s in model.states if any(s not in r or not np.isfinite(r[s]).any() for r in records)]


def _measured(states: Sequence[str], record: Record) -> np.ndarray:
    columns = [filled(record, name)[:, None] for name in states]
    return np.concatenate([np.zeros((len(record), 0)), *columns], axis=1)


def substituted(model: Model, symbols: ca.SX, expressions: ca.SX, **changes: Any) -> Model:
    """The model with expressions in the place of symbols in its equations, readings and events, and further changes."""
    f, h, *after = ca.substitute([model.f, model.h, *model.events.values()], [symbols], [expressions])
    return replace(model, f=f, h=h, events=dict(zip(model.events, after, strict=True)), **changes)


def runge_kutta(f: ca.Function, x: ca.SX, inputs: Sequence[ca.SX], step: ca.SX, *rest: ca.SX) -> ca.SX:
    """State after a step [s] of dx/dt = f(x, u, *rest), by the inputs at its begin, in its middle and at its end."""
    first, middle, last = inputs
    k1 = f(x, first, *rest)
    k2 = f(x + step / 2 * k1, middle, *rest)
    k3 = f(x + step / 2 * k2, middle, *rest)
    k4 = f(x + step * k3, last, *rest)
    return x + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


def define_model(
    name: str,
    *,
    states: Sequence[str],
    inputs: Sequence[str],
    parameters: Mapping[str, float],
    outputs: Sequence[str],
    dynamics: Callable[[Any], Mapping[str, Any]],
    output: Callable[[Any], Mapping[str, Any]],
    disturbances: Sequence[str] = (),
    state_scale: Mapping[str, float] | None = None,
    guess: Callable[[Record], np.ndarray] | None = None,
    prior_std: Mapping[str, float] | None = None,
    equation: Callable[[Any], EquationForm] | None = None,
    initial: Callable[[Any], Mapping[str, Any]] | None = None,
    period: float | None = None,
    events: Callable[[Any], Mapping[str, Mapping[str, Any]]] | None = None,
    algebraic: Mapping[str, float] | None = None,
    balance: Callable[[Any], Mapping[str, Any]] | None = None,
) -> Model:
    """A Model from two functions that take a namespace of symbols and return expressions by name.

    `s.q`, `s.Cm_alpha`, ... are the symbols of the namespace `s`, and functions of numpy or casadi take them. States,
    inputs and outputs are in the units of the records; casid expects SI and radians.

    Parameters
    ----------
    name
        For messages and tables.
    states
        Names of the states x; a state that the records measure has the name of its channel.
    inputs
        Channels of the records that drive the model; an input named "t" is the record's time [s].
    parameters
        Nominal value of every parameter.
    outputs
        Channels of the records that the model predicts.
    dynamics
        Takes the namespace and returns {state: its time derivative}, for every state. With `period` it returns
        {state: its value one sample later}.
    output
        Takes the namespace and returns {output: expression}, for every output.
    disturbances
        Names of unknown inputs, like "w_q". They are symbols too, and zero in the nominal model.
    state_scale
        State -> its typical size, for conditioning; default: by the state's name.
    guess
        Takes a record and returns (N, states), a first guess of the states; default: the channels of their names.
    prior_std
        A-priori 1-sigma of the parameters that have one.
    equation
        Takes the namespace and returns the equation-error form; default: the state equations with measured states.
    initial
        Takes the namespace of the parameters and returns {state: its value at the first sample}, which the estimation
        holds exactly. Such a parameter may be estimated, fixed, or have a value per record.
    period
        Makes it a model in discrete time, x[k+1] = f(x[k], u[k], p): the time from one sample to the next [s], which
        the records must have. Process noise of such a model is given by its standard deviation at each sample.
    events
        Takes the namespace and returns {event: {state: its value after the event}}, of the values before it, inputs
        and parameters; other states stay. `Record(events=...)` has the times. Steps of integration end there.
    algebraic
        Algebraic state -> a value of its usual size, from which Newton's method finds it. `dynamics`, `output` and
        `balance` have its symbol.
    balance
        Takes the namespace and returns {algebraic state: an expression that is zero}, 0 = g(x, z, u, p) of index 1:
        together they determine the algebraic states.

    Returns
    -------
    Model
        Of symbolic expressions, for `simulate`, `Problem`, `linear_model` and `diagnose`.

    Raises
    ------
    InputError
        For a name that does not exist or is used twice, and for an expression that is missing or is none.

    Examples
    --------
    >>> import numpy as np, casid as cs
    >>> lag = cs.define_model(
    ...     "lag", states=["x"], inputs=["u"], parameters={"T": 0.5}, outputs=["y"],
    ...     dynamics=lambda s: {"x": (s.u - s.x) / s.T}, output=lambda s: {"y": s.x},
    ... )
    >>> lag.states, lag.inputs, lag.parameters, lag.outputs
    (('x',), ('u',), ('T',), ('y',))

    The same in discrete time, for records with a sample every 0.1 s and the input held between them:

    >>> sampled = cs.define_model(
    ...     "sampled lag", states=["x"], inputs=["u"], parameters={"a": 0.8}, outputs=["y"], period=0.1,
    ...     dynamics=lambda s: {"x": s.a * s.x + (1.0 - s.a) * s.u}, output=lambda s: {"y": s.x},
    ... )
    >>> ones = cs.Record(name="ones", t=0.1 * np.arange(4), channels={"u": np.ones(4)})
    >>> cs.simulate(sampled, ones, [0.0]).output("y").round(3).tolist()
    [0.0, 0.2, 0.36, 0.488]
    """
    where = f"model '{name}'"
    groups = {
        "x": names(states, f"{where}: states"),
        "u": names(inputs, f"{where}: inputs"),
        "p": tuple(numbers_by_name(parameters, f"{where}: parameters")),
        "w": names(disturbances, f"{where}: disturbances"),
        "z": tuple(roots := numbers_by_name(algebraic or {}, f"{where}: algebraic")),
    }
    states = groups["x"]
    outputs = names(outputs, f"{where}: outputs")
    vectors, space = _namespace(groups, where)
    f = expressions(dynamics, space, states, "dynamics", where)
    h = expressions(output, space, outputs, "output", where)
    check_symbols(ca.vertcat(f, h), vectors, where)
    f, h = ca.substitute([f, h], [vectors["z"][0]], [_solved(balance, space, vectors, roots, where)])
    space = Symbols(where, {n: s for n, s in vars(space).items() if n not in (*roots, "_where")})
    return Model(
        name=name,
        states=states,
        inputs=groups["u"],
        parameters=groups["p"],
        outputs=outputs,
        disturbances=groups["w"],
        x=vectors["x"][0],
        u=vectors["u"][0],
        p=vectors["p"][0],
        w=vectors["w"][0],
        f=f,
        h=h,
        nominal=numbers_by_name(parameters, f"{where}: parameters"),
        state_scale={s: scale_of(s) for s in states} | _sizes(state_scale, states, "state", f"{where}: state_scale"),
        guess=measured_states(states) if guess is None else _checked_guess(guess, states, where),
        prior_std=_sizes(prior_std, groups["p"], "parameter", f"{where}: prior_std"),
        equation=equation(space) if equation else None,
        initial=_initial(initial, groups, vectors, where) if initial is not None else MappingProxyType({}),
        period=period,
        events=_events(events, vectors, where) if events is not None else MappingProxyType({}),
    )


def _initial(
    function: Callable[[Any], Mapping[str, Any]], groups: Mapping[str, Sequence[str]], vectors: Vectors, where: str
) -> Mapping[str, ca.SX]:
    """The initial states that a user's function gives, checked."""
    what = f"{where}: initial"
    known = Symbols(f"{what}: parameters", {n: vectors["p"][0][i] for i, n in enumerate(groups["p"])})
    found = evaluated(function, known, what, "parameters")
    chosen = [name for name in groups["x"] if isinstance(found, Mapping) and name in found] or groups["x"]
    rows = ca.vertsplit(column(found, chosen, "initial", where))
    return MappingProxyType(dict(zip(chosen, rows, strict=True)))


def _namespace(groups: Mapping[str, Sequence[str]], where: str) -> tuple[Vectors, Symbols]:
    """Letter -> vector of symbols with their names, and all of them by name."""
    vectors = {key: (ca.SX.sym(key, len(group)), group) for key, group in groups.items()}
    symbols = {n: vector[i] for vector, group in vectors.values() for i, n in enumerate(group)}
    if len(symbols) != sum(len(group) for group in groups.values()):
        raise InputError(f"{where}: one name is used twice among states, inputs, parameters, disturbances, algebraic")
    return vectors, Symbols(where, symbols)


def _solved(
    balance: Callable[[Any], Mapping[str, Any]] | None,
    space: Symbols,
    every: Vectors,
    start: Mapping[str, float],
    where: str,
) -> ca.SX:
    """The algebraic states as expressions of all other symbols, by the balance that a user's function gives."""
    if bool(start) != (balance is not None):
        raise InputError(f"{where}: algebraic and balance belong together; give both, or neither")
    if balance is None:
        return ca.SX(0, 1)
    g = expressions(balance, space, tuple(start), "balance", where)
    check_symbols(g, every, where)
    known = [vector for letter, (vector, _) in every.items() if letter != "z"]
    return algebraic_states(every["z"][0], g, start, known, where)


def _events(
    function: Callable[[Any], Mapping[str, Mapping[str, Any]]], vectors: Vectors, where: str
) -> Mapping[str, ca.SX]:
    """States after the events that a user's function gives, checked."""
    what = f"{where}: events"
    known = {n: vectors[letter][0][i] for letter in "xup" for i, n in enumerate(vectors[letter][1])}
    space = Symbols(f"{what}: symbols", known)
    states = vectors["x"][1]
    found = evaluated(function, space, what)
    if not isinstance(found, Mapping) or not all(isinstance(sets, Mapping) for sets in found.values()):
        raise InputError(f"{what} returned {given(found)}; expected a table {{'dose': {{'x': ...}}}}")
    after = {}
    for event, sets in found.items():
        whole = {name: known[name] for name in states} | dict(sets)
        after[str(event)] = column(whole, states, f"event '{event}'", where)
    if after:
        check_symbols(ca.vertcat(*after.values()), vectors, where)
    return MappingProxyType(after)


def _sizes(given_sizes: Mapping[str, float] | None, valid: Sequence[str], what: str, where: str) -> dict[str, float]:
    """Positive numbers by name."""
    table = numbers_by_name(given_sizes or {}, where)
    for name, value in table.items():
        check_known(what, (name,), valid, where)
        number(value, f"{where}: '{name}'", positive=True)
    return table


def _checked_guess(
    guess: Callable[[Record], np.ndarray], states: Sequence[str], where: str
) -> Callable[[Record], np.ndarray]:
    if not callable(guess):
        raise InputError(f"{where}: guess is {given(guess)}; expected a function of a record, (N, {len(states)})")
    return partial(_guessed, guess, tuple(states), where)


def _guessed(guess: Callable[[Record], np.ndarray], states: Sequence[str], where: str, record: Record) -> np.ndarray:
    """Return the checked result of a user's guess."""
    try:
        found = np.asarray(guess(record), dtype=float)
    except (TypeError, ValueError) as error:
        raise InputError(f"{where}: guess failed on record '{record.name}': {str(error).splitlines()[0]}") from error
    expected = (len(record), len(states))
    if found.shape != expected:
        raise InputError(
            f"{where}: guess has the shape {found.shape}; expected {expected}, samples by {', '.join(states)}"
        )
    if not np.isfinite(found).all():
        name = states[int(np.argmin(np.isfinite(found).all(axis=0)))]
        raise InputError(f"{where}: guess of '{name}' is no number in record '{record.name}'; fill the gaps")
    return found
