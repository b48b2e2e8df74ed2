"""The equation-error part of a cost: equations evaluated on measured signals (paper eq. 6-9)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import casadi as ca
import numpy as np
import scipy

from casid.errors import EstimationError
from casid.estimation.problem import Problem
from casid.estimation.transcriptions.steps import free_parameters, quiet
from casid.model.built import cached
from casid.model.system import EquationForm as EquationForm
from casid.model.system import Model
from casid.native.compiler import Compilable
from casid.records.record import Record

_SLAB_SAMPLES = 4096
_NEXT = "[k+1]"  # behind the name of a state: one sample later
_SMOOTHING_SECONDS = 0.25  # half width of the smoothing polynomial: below the short period, above sensor noise


@dataclass(frozen=True, eq=False, kw_only=True)
class EquationValue:
    """residuals: per record (rows, equations) prediction minus target, NaN where a signal is missing."""

    residuals: list[np.ndarray]


class Equations(Protocol):
    """The equation part of a cost: residuals that need no simulated trajectory.

    A record has one row per sample, or whatever rows a cost of its own makes of it (`OwnEquations`).
    """

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the equations, the columns."""
        ...

    @property
    def targets(self) -> list[np.ndarray]:
        """Per record (rows, equations) what the equations are to give; NaN where a signal is missing."""
        ...

    @property
    def eliminated(self) -> int:
        """Unknowns besides the parameters that the residuals are free of, at the price of a degree of freedom each."""
        ...

    def value(self, parameters: np.ndarray) -> EquationValue:
        """Residuals at values (records, model parameters)."""
        ...

    def slabs(self, parameters: np.ndarray, record: int) -> Iterator[tuple[slice, np.ndarray]]:
        """Rows of a record, and the derivatives (rows, equations, free) of the residuals there."""
        ...


@runtime_checkable
class OwnEquations(Protocol):
    """A cost whose equation part is not that of the model's equations sample by sample, but one that it makes itself.

    The costs of the frequency domain are such: their residuals are Fourier transforms.
    """

    def equations(self, problem: Problem) -> Equations:
        """The equation part of the cost. Raises EstimationError for a problem that it cannot take."""
        ...


def equations_of(problem: Problem) -> Equations:
    """The equation part of the problem's cost. Raises EstimationError where it cannot be had."""
    cost = problem.cost
    return cost.equations(problem) if isinstance(cost, OwnEquations) else EquationPart(problem)


def smoothed_derivative(t: np.ndarray, values: np.ndarray) -> np.ndarray:
    """(N,) time derivative by local cubic polynomials (Savitzky-Golay) on a uniform grid of the median interval."""
    good = np.isfinite(values)
    if good.sum() < 5:
        return np.full(len(t), np.nan)
    dt = float(np.median(np.diff(t)))
    grid = t[0] + dt * np.arange(int(round((t[-1] - t[0]) / dt)) + 1)
    half = max(2, int(round(_SMOOTHING_SECONDS / dt)))
    window = min(2 * half + 1, len(grid) - (len(grid) + 1) % 2)
    if window < 5:
        return np.full(len(t), np.nan)
    smooth = scipy.signal.savgol_filter(np.interp(grid, t[good], values[good]), window, 3, deriv=1, delta=dt)
    return np.where(good, np.interp(t, grid, np.asarray(smooth)), np.nan)


def equation_form(model: Model) -> EquationForm:
    """The model's own form; its outputs at the measured inputs where it has no states; otherwise its state equations:
    measured state derivatives, in discrete time measured states one sample later, against f at measured states."""
    if model.equation is not None:
        return model.equation
    names = model.outputs
    prediction = model.h
    if model.states:
        names = tuple(f"{name}dot" if model.period is None else f"{name}{_NEXT}" for name in model.states)
        prediction = model.f
    target = ca.SX.sym("target", len(names))
    return EquationForm(
        names=names,
        channels=(*model.states, *model.inputs, *names),
        m=ca.vertcat(model.x, model.u, target),
        target=target,
        prediction=quiet(model, prediction),
    )


def recorded_or_differentiated(record: Record, name: str) -> np.ndarray:
    """(N,) a channel; a derivative that is not recorded is that of its channel, smoothed, and "x[k+1]" is the channel x
    one sample later. Raises EstimationError."""
    if name in record or name == "t":
        return record[name]
    if name.endswith(_NEXT):
        return np.append(recorded_or_differentiated(record, name.removesuffix(_NEXT))[1:], np.nan)
    base = name.removesuffix("dot")
    if base != name and base in record:
        return smoothed_derivative(record.t, record[base])
    raise EstimationError(
        f"record '{record.name}': the equation error needs the channel '{name}', which is not recorded"
        + (f", nor is '{base}' to differentiate" if base != name else "")
        + "; record it, or use OutputError where there is one"
    )


class EquationPart:
    """Residuals and Jacobians of the equations on the measured signals of all records.

    `pieces`, each the number of a record and (samples, channels of the form), may replace the whole records; they
    take the place of records in all that this gives.

    Raises EstimationError at construction when a channel is not recorded or, for a pure equation-error cost, when a
    free parameter is in no equation.
    """

    eliminated = 0

    def __init__(self, problem: Problem, pieces: Sequence[tuple[int, np.ndarray]] | None = None) -> None:
        self.problem = problem
        model = problem.model
        form = equation_form(model)
        self.names = form.names
        residual = form.prediction - form.target
        jacobian = ca.jacobian(residual, free_parameters(model, problem.free_index))
        self._check_parameters(jacobian)

        def compilable(name: str, expression: ca.SX, *key: object) -> Compilable:
            function = ca.Function(name, [form.m, model.p], [ca.cse(ca.densify(expression))])
            return cached(model, (name, *key), lambda: Compilable(function))

        self._residual = compilable("equation", residual)
        self._target = compilable("target", form.target)
        self._jacobian = compilable("equation_jacobian", jacobian.T, *problem.free_index)
        self.residual = self._residual.symbolic
        if pieces is None:
            pieces = [(r, self._signals(record, form.channels)) for r, record in enumerate(problem.records)]
        self.data = [signals for _, signals in pieces]
        self._record = np.array([r for r, _ in pieces])
        self._cuts = np.cumsum([len(data) for data in self.data])[:-1]
        self.targets = self._targets(problem.start_parameters)

    def _signals(self, record: Record, names: tuple[str, ...]) -> np.ndarray:
        """(N, channels); without states a measured output that is not there is missing, as where it is simulated."""
        if self.problem.model.states:
            return np.stack([recorded_or_differentiated(record, name) for name in names], axis=1)
        inputs = [record[name][:, None] for name in self.problem.model.inputs]
        return np.concatenate([*inputs, self.problem.outputs_of(record)], axis=1)

    def _check_parameters(self, jacobian: ca.SX) -> None:
        used = set(jacobian.sparsity().get_col())
        names = self.problem.shared + self.problem.local
        idle = [name for i, name in enumerate(names) if i not in used and not np.isfinite(self._prior(name))]
        if idle and not self.problem.simulated:
            other = ", or use OutputError or CombinedError" if self.problem.model.states else ""
            raise EstimationError(
                f"Problem: {', '.join(idle)} stand in no equation of model '{self.problem.model.name}'; fix them{other}"
            )

    def _prior(self, name: str) -> float:
        return self.problem.model.prior_std.get(name, np.inf) if self.problem.prior else np.inf

    def _evaluate(self, kernel: Compilable, parameters: np.ndarray) -> list[np.ndarray]:
        """Per record (N * rows, columns) of the function's transposed result."""
        lengths = [len(data) for data in self.data]
        values = np.repeat(parameters[self._record], lengths, axis=0)
        result = kernel.mapped(sum(lengths))(np.concatenate(self.data), values)[0].copy()
        return np.split(result, self._cuts * (len(result) // sum(lengths)))

    def _targets(self, parameters: np.ndarray) -> list[np.ndarray]:
        found = self._evaluate(self._target, parameters)
        usable = self._evaluate(self._residual, parameters)
        return [np.where(np.isfinite(e), t, np.nan) for t, e in zip(found, usable, strict=True)]

    def value(self, parameters: np.ndarray) -> EquationValue:
        """Residuals at values (records, model parameters)."""
        return EquationValue(residuals=self._evaluate(self._residual, parameters))

    def slabs(self, parameters: np.ndarray, record: int) -> Iterator[tuple[slice, np.ndarray]]:
        """Samples of a record and the derivatives (samples, equations, free) there in its free parameters, zero where
        a signal is missing; not all at once, which would take most of the memory."""
        data = self.data[record]
        p = parameters[self._record[record]]
        size = min(max(map(len, self.data)), _SLAB_SAMPLES)
        values = np.tile(p, (size, 1))
        derivatives = self._jacobian.mapped(size)
        residuals = self._residual.mapped(size)
        for first in range(0, len(data), size):
            part = data[first : first + size]
            filled = np.concatenate([part, np.repeat(part[-1:], size - len(part), axis=0)])
            error = residuals(filled, values)[0][: len(part)]
            rows = derivatives(filled, values)[0].reshape(size, error.shape[1], -1)[: len(part)]
            good = np.isfinite(error)[..., None]
            yield slice(first, first + len(part)), np.where(good, np.nan_to_num(rows), 0.0)
