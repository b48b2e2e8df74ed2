"""A functional mock-up unit (FMI 2.0, model exchange) as a `Model`: its binary gives rates and outputs as numbers.

The unit is called by `fmpy`. Its derivatives are differences, as of every `external_function`. CasADi's own import was
tried and is not used. Its Jacobians are zero for parameters, since no model description has dependencies on these, and
it sets parameters where a unit may refuse them.
"""

from __future__ import annotations

import atexit
import re
import shutil
from collections.abc import Callable, Mapping, Sequence
from ctypes import c_uint
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from threading import Lock
from typing import Any

import numpy as np
from numpy.ctypeslib import as_ctypes

from casid.arguments import a_path, names, number
from casid.errors import InputError, check_known
from casid.model.external import external_function
from casid.model.system import Model, define_model

_LATER = (1.0, 2.6180339)  # s after the start: rates that differ there depend on time
_ROUNDS = 100  # of discrete states until they settle
_VERSION = "2.0"


@dataclass(frozen=True, kw_only=True)
class _Variable:
    """One of the description: `name` as casid has it, `start` in the unit's own unit."""

    name: str
    reference: int
    start: float
    size: float


@dataclass(frozen=True, kw_only=True)
class _Described:
    """Variables of a model that a description has, in its order."""

    name: str
    states: tuple[_Variable, ...]
    inputs: tuple[_Variable, ...]
    parameters: tuple[_Variable, ...]
    outputs: tuple[_Variable, ...]


def fmu_model(
    path: str | Path, parameters: Sequence[str] = (), *, prior_std: Mapping[str, float] | None = None
) -> Model:
    """The model of a functional mock-up unit: FMI 2.0, model exchange, without events. Needs the extra `fmu`.

    Parameters
    ----------
    path
        The .fmu file. Its binary is run: give only one that you trust.
    parameters
        Names of its Real parameters that may be estimated; the others keep their start values.
    prior_std
        A-priori 1-sigma of the parameters that have one.

    Returns
    -------
    Model
        Continuous states, Real inputs and outputs under the unit's names and in its units; without outputs, its states.
        Letters that no name has become underscores, `motor.w[1]` is `motor_w_1`. Where rates depend on time, "t" is an
        input. Derivatives are differences, and Python is called for every sample: see `external_function`.

    Raises
    ------
    InputError
        Without the extra, for a file that cannot be run here, and for what is none of these.

    Examples
    --------
    >>> import casid as cs
    >>> model = cs.fmu_model("motor.fmu", parameters=["R"])  # doctest: +SKIP
    """
    where = f"fmu_model: {a_path(path, 'fmu_model')}"
    description, unit = _opened(path, where)
    own = _described(description, names(parameters, "fmu_model: parameters"), where)
    running = _Running(unit, own, where)
    timed = running.depends_on_time()
    taken = [*own.states, *own.inputs, *own.parameters]
    sizes = {v.name: v.size for v in taken}
    takes = ([v.name for v in taken] + ["t"]) if timed else [v.name for v in taken]
    return define_model(
        own.name,
        states=[v.name for v in own.states],
        inputs=[*(v.name for v in own.inputs), *(["t"] if timed else [])],
        parameters={v.name: v.start for v in own.parameters},
        outputs=[v.name for v in own.outputs],
        dynamics=external_function(running.rates, takes, [v.name for v in own.states], sizes),
        output=external_function(running.outputs, takes, [v.name for v in own.outputs], sizes),
        state_scale={v.name: v.size for v in own.states},
        prior_std=prior_std,
    )


def _opened(path: str | Path, where: str) -> tuple[Any, Any]:
    """Description and instance of a unit, unpacked until the process ends."""
    try:
        import fmpy
        from fmpy.fmi2 import FMU2Model
    except ImportError:
        raise InputError("an FMU needs the extra fmu; install it: pip install 'casid[fmu]'") from None
    if not Path(path).is_file():
        raise InputError(f"{where}: no such file")
    try:
        description = fmpy.read_model_description(str(path), validate=False)
        folder = str(fmpy.extract(str(path)))
    except Exception as error:  # whatever a file may be that is no FMU
        raise InputError(f"{where}: is no FMU: {_first_line(error)}") from None
    atexit.register(partial(shutil.rmtree, folder, ignore_errors=True))
    if description.fmiVersion != _VERSION or description.modelExchange is None:
        kinds = [k for k in ("modelExchange", "coSimulation", "scheduledExecution") if getattr(description, k, None)]
        raise InputError(
            f"{where}: FMI {description.fmiVersion}, {' and '.join(kinds)}; expected FMI {_VERSION} for model exchange"
        )
    if description.numberOfEventIndicators:
        raise InputError(
            f"{where}: has {description.numberOfEventIndicators} event indicators; rates that jump have no derivatives"
        )
    try:
        unit = FMU2Model(
            guid=description.guid,
            unzipDirectory=folder,
            modelIdentifier=description.modelExchange.modelIdentifier,
            instanceName="casid",
        )
        unit.instantiate()
    except Exception as error:  # a binary of another platform, a library that it needs
        raise InputError(f"{where}: its binary does not run here: {_first_line(error)}") from None
    return description, unit


def _first_line(error: Exception) -> str:
    """Return the first line of an error, or its kind where it has no text."""
    return (str(error).splitlines() or [type(error).__name__])[0]


def _described(description: Any, parameters: Sequence[str], where: str) -> _Described:
    variables = list(description.modelVariables)
    reals = [v for v in variables if v.type == "Real"]
    driven = [v for v in variables if v.causality == "input"]
    for v in driven:
        if v.type != "Real":
            raise InputError(f"{where}: input '{v.name}' is of type {v.type}; expected Real ones only")
    states = [unknown_rate.variable.derivative for unknown_rate in description.derivatives]
    outputs = [v for v in reals if v.causality == "output"] or states
    able = {v.name: v for v in reals if v.causality == "parameter" and v.start is not None}
    check_known("parameter", parameters, able, where)
    found = _Described(
        name=str(description.modelName),
        states=tuple(_variable(v, where) for v in states),
        inputs=tuple(_variable(v, where) for v in driven),
        parameters=tuple(_variable(able[name], where) for name in parameters),
        outputs=tuple(_variable(v, where) for v in outputs),
    )
    if not found.states:
        raise InputError(f"{where}: has no continuous states")
    return found


def _variable(variable: Any, where: str) -> _Variable:
    """Read a variable; an underscore replaces each letter that no name of casid has: `motor.w[1]` is `motor_w_1`."""
    start = 0.0 if variable.start is None else number(float(variable.start), f"{where}: start of '{variable.name}'")
    nominal = float(variable.nominal) if variable.nominal is not None else abs(start)
    name = re.sub(r"\W+", "_", variable.name).strip("_")
    return _Variable(name=name, reference=variable.valueReference, start=start, size=nominal or 1.0)


class _Running:
    """An instance that gives rates and outputs at points; its parameters are set anew when a point has others. Through
    arrays that stay where they are: millions of calls go through them."""

    def __init__(self, unit: Any, own: _Described, where: str) -> None:
        self.unit = unit
        self.own = own
        self.where = where
        self.at: tuple[float, ...] | None = None
        self.in_use = Lock()  # a unit has one state, and calls of several threads would mix
        self.x, self.xdot = np.zeros(len(own.states)), np.zeros(len(own.states))
        self.u, self.y = np.zeros(len(own.inputs)), np.zeros(len(own.outputs))
        self.of_u, self.of_y = _references(own.inputs), _references(own.outputs)

    def rates(self, v: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        own = self.own.states
        call = partial(self.unit.fmi2GetDerivatives, self.unit.component, as_ctypes(self.xdot), len(own))
        return self._by_point(v, own, self.xdot, call)

    def outputs(self, v: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        own = self.own.outputs
        call = partial(self.unit.fmi2GetReal, self.unit.component, self.of_y, len(own), as_ctypes(self.y))
        return self._by_point(v, own, self.y, call)

    def depends_on_time(self) -> bool:
        """Return True if rates or outputs at the start differ between two later times."""
        start = {v.name: np.full(2, v.start) for v in (*self.own.states, *self.own.inputs, *self.own.parameters)}
        later = start | {"t": np.array(_LATER)}
        return any(np.ptp(x) > 0.0 for found in (self.rates(later), self.outputs(later)) for x in found.values())

    def _by_point(
        self, v: Mapping[str, np.ndarray], gives: Sequence[_Variable], into: np.ndarray, call: Callable[[], Any]
    ) -> dict[str, np.ndarray]:
        own = self.own
        unit = self.unit
        m = len(self.own.inputs)
        count = len(v[own.states[0].name])
        states, inputs, parameters = (
            np.stack([v[one.name] for one in group], axis=1) if group else np.zeros((count, 0))
            for group in (own.states, own.inputs, own.parameters)
        )
        times = v.get("t", np.zeros(count)).tolist()
        found = np.zeros((count, len(gives)))
        component = unit.component
        x = as_ctypes(self.x)
        u = as_ctypes(self.u)
        with self.in_use:
            try:
                for k, wanted in enumerate(map(tuple, parameters.tolist())):
                    if wanted != self.at:
                        self._with_parameters(wanted)
                    unit.fmi2SetTime(component, times[k])
                    self.x[:] = states[k]
                    unit.fmi2SetContinuousStates(component, x, len(x))
                    if m:
                        self.u[:] = inputs[k]
                        unit.fmi2SetReal(component, self.of_u, m, u)
                    call()
                    found[k] = into
            except Exception as error:  # of fmpy: the unit refused a call
                self.at = None
                raise InputError(f"{self.where}: {_first_line(error)}") from None
        return dict(zip((one.name for one in gives), found.T, strict=True))

    def _with_parameters(self, values: tuple[float, ...]) -> None:
        """Initialise with these, where every unit takes them."""
        unit = self.unit
        if self.at is not None:
            unit.reset()
        self.at = values
        unit.setupExperiment(startTime=0.0)
        if values:
            unit.setReal([one.reference for one in self.own.parameters], list(values))
        unit.enterInitializationMode()
        unit.exitInitializationMode()
        for _ in range(_ROUNDS):
            again, _, _, _, timed, _ = unit.newDiscreteStates()
            if timed:
                raise InputError("has an event at a time; rates that jump have no derivatives")
            if not again:
                break
        unit.enterContinuousTimeMode()


def _references(variables: Sequence[_Variable]) -> Any:
    return (c_uint * len(variables))(*(one.reference for one in variables))
