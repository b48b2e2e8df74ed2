"""Define the task of an input design: the model, what may move how far, what is measured, and which parameters
count."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from casid.arguments import names, number, numbers_by_name, require, table_of
from casid.errors import InputError, check_known
from casid.estimation.problem import chosen_parameters
from casid.model.simulate import simulate
from casid.model.system import Model
from casid.records.record import Record


@dataclass(frozen=True, eq=False, kw_only=True)
class Experiment:
    """Task of an input design: the model, its limits, the measurements and the parameters to estimate.

    Attributes
    ----------
    surfaces
        Input -> largest deflection from its value at rest (SI); all other inputs rest.
    rest
        Values of the inputs at rest.
    start
        (states,) state at rest.
    noise
        Output -> 1-sigma of its measurement; outputs not named are not measured.
    limits
        State or output -> largest deviation from its value at rest, at every sample.
    duration, dt
        Of the record [s].
    parameters
        Globs of the parameters that are to be estimated.
    values
        Parameters by name, put over the model's nominal values.

    Raises
    ------
    InputError
        For a name that does not exist, a limit or noise that is not positive.

    Examples
    --------
    After the example of `define_model`:

    >>> experiment = cs.Experiment(
    ...     model=lag, surfaces={"u": 1.0}, rest={"u": 0.0}, start=[0.0], noise={"y": 0.1},
    ...     duration=6.0, dt=0.1, parameters=["T"],
    ... )
    >>> experiment.free, len(experiment.t)
    (('T',), 61)
    """

    model: Model
    surfaces: Mapping[str, float]
    rest: Mapping[str, float]
    start: np.ndarray
    noise: Mapping[str, float]
    duration: float
    dt: float
    parameters: Sequence[str]
    limits: Mapping[str, float] = field(default_factory=dict)
    values: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        model = require(self.model, Model, "Experiment: model", "cs.aircraft_model(aircraft) or cs.define_model(...)")
        numbers_by_name(self.rest, "Experiment: rest")
        names(self.parameters, "Experiment: parameters")
        number(self.duration, "Experiment: duration", positive=True)
        number(self.dt, "Experiment: dt", positive=True)
        model.nominal_vector(numbers_by_name(self.values, "Experiment: values"))
        if np.shape(self.start) != (len(model.states),):
            order = ", ".join(model.states)
            raise InputError(f"Experiment: start has the shape {np.shape(self.start)}; expected a number each: {order}")
        for name, value in zip(model.states, self.start, strict=True):
            number(value, f"Experiment: start of '{name}'")
        for field_name, what, valid in (
            ("surfaces", "input", model.inputs),
            ("noise", "output", model.outputs),
            ("limits", "state or output", (*model.states, *model.outputs)),
        ):
            table = table_of(getattr(self, field_name), f"Experiment: {field_name}", "{'delta_e': 0.05}")
            check_known(what, table, valid, "Experiment")
            for name, size in table.items():
                number(size, f"Experiment: {what} '{name}'", positive=True)
        if not self.surfaces or not self.noise or not self.parameters:
            raise InputError(
                "Experiment: name a surface that moves, an output that is measured and a parameter at least"
            )
        for name in model.inputs:
            if name not in self.rest:
                raise InputError(f"Experiment: rest has no value of the input '{name}'; give one for each input")
        if not 0.0 < 10 * self.dt < self.duration:
            raise InputError(f"Experiment: {self.duration} s in steps of {self.dt} s; expected more than ten samples")
        chosen_parameters(self.parameters, model, "Experiment: parameters")

    @cached_property
    def free(self) -> tuple[str, ...]:
        """Parameters to be estimated, in the model's order."""
        return chosen_parameters(self.parameters, self.model, "Experiment: parameters")

    @cached_property
    def sizes(self) -> np.ndarray:
        """(free,) what a parameter's error is measured by: its value, or its a-priori 1-sigma where that is zero."""
        p = {**self.model.nominal, **self.values}
        return np.array([abs(p[name]) or self.model.prior_std.get(name, 1.0) for name in self.free], dtype=float)

    @property
    def t(self) -> np.ndarray:
        """(N,) time stamps [s]."""
        return np.arange(round(self.duration / self.dt) + 1) * self.dt

    def record(self, moves: Mapping[str, np.ndarray], name: str) -> Record:
        """The simulated record of deflections (N,) [rad] from rest by surface, under a name; its outputs are exact."""
        channels = {n: self.rest[n] + moves.get(n, np.zeros(len(self.t))) for n in self.model.inputs}
        record = Record(name=name, t=self.t, channels=channels, hold="linear", source="designed")
        return simulate(self.model, record, self.start, self.values).as_record()
