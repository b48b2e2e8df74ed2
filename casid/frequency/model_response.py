"""Models in the frequency domain: exact linearisation at an operating point, with the lags and delays of the file.

Sizes: n states, m inputs, o outputs, f free parameters, M frequencies.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import casadi as ca
import numpy as np
from scipy.linalg import expm

from casid.arguments import number, numbers_by_name
from casid.errors import InputError, check_known
from casid.estimation.transcriptions.steps import quiet
from casid.frames import brief
from casid.model.aircraft import Aircraft, given_aircraft
from casid.model.built import cached
from casid.model.dynamics import aircraft_model
from casid.model.flown_records import FlownRecords, axes_of, flown_records
from casid.model.system import Model, check_continuous
from casid.model.trim import Trim
from casid.model.with_effects import times_of_readings
from casid.records.given import given_records
from casid.records.record import Record

Point = Record | str | Path | Sequence[Record | str | Path] | Trim | Mapping[str, float]


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class LinearModel:
    """Linear model dx/dt = A x + B u, y = C x + D u, for deviations from an operating point.

    Attributes
    ----------
    name
        Of the model.
    states, inputs, outputs
        Names, in the order of the matrices.
    A, B, C, D
        Exact derivatives, (states, states), (states, inputs), (outputs, states), (outputs, inputs).
    point
        State and input -> its value at the operating point.
    not_linear
        Effects of the aircraft file that have no linear response, such as a dead zone: they are left out.

    Examples
    --------
    After the example of `linear_model`:

    >>> linear.A, linear.B
    (array([[-2.]]), array([[2.]]))
    """

    name: str
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    point: dict[str, float]
    not_linear: tuple[str, ...] = ()
    _applied: FlownRecords | None = None

    @cached_property
    def eigenvalues(self) -> np.ndarray:
        """(states,) eigenvalues of A [1/s], by falling natural frequency."""
        found = np.linalg.eigvals(self.A)
        return found[np.argsort(-np.abs(found), kind="stable")]

    def response(self, input: str, output: str, omega: np.ndarray, *, delay: float = 0.0) -> np.ndarray:
        """(frequencies,) output over input, complex, in SI units.

        Lags and delays of the aircraft file act on its surfaces and readings.

        Parameters
        ----------
        input, output
            Names.
        omega
            (frequencies,) [rad/s].
        delay
            A further one [s], such as that of a recorder.

        Raises
        ------
        InputError
            For a name that the model does not have.
        """
        check_known("input", (input,), self.inputs, f"linear model of '{self.name}'")
        check_known("output", (output,), self.outputs, f"linear model of '{self.name}'")
        omega = np.atleast_1d(np.asarray(omega, dtype=float))
        column = self.inputs.index(input)
        row = self.outputs.index(output)
        resolvent = 1j * omega[:, None, None] * np.eye(len(self.states)) - self.A
        moved = np.linalg.solve(resolvent, np.broadcast_to(self.B[:, column, None], (len(omega), len(self.A), 1)))
        found = moved[..., 0] @ self.C[row] + self.D[row, column]
        if self._applied is not None:
            found = found * self._applied.transfer(input, omega) * self._applied.transfer(output, omega)
        return found * np.exp(-1j * omega * number(delay, "response: delay"))

    __repr__ = brief


def linear_model(
    model: Model | Aircraft | str | Path,
    at: Point,
    *,
    axes: str | None = None,
    outputs: Sequence[str] | None = None,
    values: Mapping[str, float] | None = None,
) -> LinearModel:
    """Linearise a model, or the aircraft of a file, at an operating point by exact derivatives.

    Parameters
    ----------
    model
        Any model; or an aircraft, or the name of its file, whose effects are then in force.
    at
        The operating point: flight records (the medians of inputs and of what was measured of the states), a trim, or
        values by name of states and inputs, zero where there is none.
    axes
        Of an aircraft, as in `aircraft_model`; default: what the records allow.
    outputs
        Of an aircraft, as in `aircraft_model`.
    values
        Parameters by name, put over the nominal ones.

    Returns
    -------
    LinearModel
        Its matrices A, B, C, D by the names of states, inputs and outputs; `response` gives the frequency response.

    Raises
    ------
    InputError
        For an argument of another kind, and a name that the model does not have.

    Examples
    --------
    After the example of `define_model`:

    >>> linear = cs.linear_model(lag, {})
    >>> bool(np.allclose(linear.response("u", "y", [2.0]), 1.0 / (1.0 + 1.0j)))
    True
    """
    if isinstance(model, Model):
        chosen = model
        applied = None
        point = _by_name(at, chosen) if isinstance(at, Mapping | Trim) else None
        point = _medians(chosen, given_records(at, "linear_model", own=chosen.inputs)) if point is None else point
    else:
        aircraft = given_aircraft(model, "linear_model")
        applied = _in_force(aircraft, at, axes, outputs)
        chosen = applied.model
        point = _medians(chosen, applied.records) | (_by_name(at, chosen) if isinstance(at, Trim) else {})
    point = point | dict.fromkeys(times_of_readings(chosen), 0.0)  # a delay is in `response`
    x = np.array([point.get(name, 0.0) for name in chosen.states])
    u = np.array([point.get(name, 0.0) for name in chosen.inputs])
    matrix = sensitivity_at(chosen, np.zeros(0, dtype=int), x, u, chosen.nominal_vector(values)).matrix
    if not np.isfinite(matrix).all():
        at_point = ", ".join(f"{name} = {value:.4g}" for name, value in zip(chosen.states, x.tolist(), strict=True))
        raise InputError(
            f"linear_model: '{chosen.name}' has no derivatives at {at_point}; give another operating point"
        )
    n = len(x)
    return LinearModel(
        name=chosen.name,
        states=chosen.states,
        inputs=chosen.inputs,
        outputs=chosen.outputs,
        A=matrix[:n, :n],
        B=matrix[:n, n:],
        C=matrix[n:, :n],
        D=matrix[n:, n:],
        point=dict(zip((*chosen.states, *chosen.inputs), (*x.tolist(), *u.tolist()), strict=True)),
        not_linear=applied.not_linear if applied else (),
        _applied=applied,
    )


def _in_force(aircraft: Aircraft, at: Point, axes: str | None, outputs: Sequence[str] | None) -> FlownRecords:
    """The aircraft with its effects in the records; those of a trim are steady flight."""
    if isinstance(at, Mapping):
        raise InputError(
            "linear_model: an aircraft is linearised at records or at a cs.trim(...); cs.aircraft_model(aircraft) is a "
            "model that takes states and inputs by name"
        )
    records = (_steady(at),) if isinstance(at, Trim) else given_records(at, "linear_model")
    axes = axes or axes_of(records)
    chosen = outputs if outputs is not None else aircraft_model(aircraft, axes=axes, effects=()).outputs
    return flown_records(aircraft, records, axes, chosen)


def _steady(at: Trim) -> Record:
    """Two samples of steady flight."""
    channels = {"V": at.V, "alpha": at.alpha, "theta": at.theta, **dict.fromkeys(("beta", "p", "q", "r", "phi"), 0.0)}
    both = {name: np.full(2, value) for name, value in (channels | at.inputs).items()}
    return Record(name="trim", t=np.array([0.0, 1.0]), channels=both)


def _by_name(at: Mapping[str, float] | Trim, model: Model) -> dict[str, float]:
    """State and input -> value, of a table or a trim."""
    if isinstance(at, Trim):
        steady = dict(zip(("u", "v", "w", "p", "q", "r", "phi", "theta"), at.state.tolist(), strict=True)) | at.inputs
        return {name: value for name, value in steady.items() if name in (*model.states, *model.inputs)}
    found = numbers_by_name(at, "linear_model: at")
    check_known("state or input", found, (*model.states, *model.inputs), "linear_model: at")
    return found


def _medians(model: Model, records: Sequence[Record]) -> dict[str, float]:
    """State and input -> its median over the records."""
    states = np.concatenate([model.guess(record) for record in records])
    inputs = np.concatenate([record.matrix(model.inputs) for record in records])
    both = np.hstack([states, inputs])
    columns = zip((*model.states, *model.inputs), both.T, strict=True)
    known = {name: column[np.isfinite(column)] for name, column in columns}
    return {name: float(np.median(values)) if len(values) else 0.0 for name, values in known.items()}


@dataclass(frozen=True, eq=False, kw_only=True)
class LinearSensitivity:
    """dx/dt = A x + B u, y = C x + D u about a point."""

    matrix: np.ndarray  # (n+o, n+m) the matrices [[A, B], [C, D]]
    slopes: np.ndarray  # (f, n+o, n+m) its derivatives in the free parameters
    states: int  # how many states n there are

    def response(self, omega: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(M, o, m) frequency response at omega (M,) [rad/s], and (M, f, o, m) its derivatives."""
        n = self.states
        inputs = np.eye(self.matrix.shape[1] - self.states)
        a = self.matrix[:n, :n]
        b = self.matrix[:n, n:]
        c = self.matrix[n:, :n]
        d = self.matrix[n:, n:]
        resolvent = np.linalg.inv(1j * omega[:, None, None] * np.eye(n) - a)
        states = resolvent @ b
        costates = c @ resolvent
        right = np.concatenate([states, np.broadcast_to(inputs, (len(omega), *inputs.shape))], axis=1)
        left = np.concatenate([costates, np.broadcast_to(np.eye(len(c)), (len(omega), len(c), len(c)))], axis=2)
        return c @ states + d, left[:, None] @ self.slopes @ right[:, None]

    def sampled(self, dt: float, held: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The step from one sample to the next, with inputs held where `held` (m,), else on straight lines: the matrix
        (n, n+2m) that makes x there of (x, u, u there), and (f, n, n+2m) its derivatives in the free parameters."""
        n = self.states
        a = self.matrix[:n, :n]
        b = self.matrix[:n, n:]
        da = self.slopes[:, :n, :n]
        db = self.slopes[:, :n, n:]
        (phi0, phi1, phi2), moved = _exponentials(a, da, dt)
        constant = phi1 @ b
        dconstant = moved[1] @ b + phi1 @ db
        later = np.where(held, 0.0, phi2 @ b / dt)
        dlater = np.where(held, 0.0, (moved[2] @ b + phi2 @ db) / dt)
        slopes = np.concatenate([moved[0], dconstant - dlater, dlater], axis=2)
        return np.concatenate([phi0, constant - later, later], axis=1), slopes


def _exponentials(a: np.ndarray, slopes: np.ndarray, dt: float) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """exp(a dt) and its first two integrals over dt, (n, n) each, and their derivatives (f, n, n), where a has the
    derivatives slopes (f, n, n): blocks of the exponential of [[a, 1, 0], [0, 0, 1], [0, 0, 0]] (Van Loan, IEEE Trans.
    Automatic Control 23, 1978), of which [[a, da], [0, a]] gives the derivative."""
    n = len(a)
    f = len(slopes)
    big = np.zeros((3 * n, 3 * n))
    big[:n, :n], big[:n, n : 2 * n], big[n : 2 * n, 2 * n :] = a, np.eye(n), np.eye(n)
    doubled = np.zeros((f, 6 * n, 6 * n))
    doubled[:, : 3 * n, : 3 * n] = doubled[:, 3 * n :, 3 * n :] = big
    doubled[:, :n, 3 * n : 4 * n] = slopes
    value = expm(big * dt)
    moved = expm(doubled * dt)[:, :n, 3 * n :]
    columns = [slice(k * n, (k + 1) * n) for k in range(3)]
    return [value[:n, k] for k in columns], [moved[:, :, k] for k in columns]


def sensitivity_at(model: Model, free: np.ndarray, x: np.ndarray, u: np.ndarray, p: np.ndarray) -> LinearSensitivity:
    """Linearise a model about states x (n,), inputs u (m,) at parameters p, of which `free` (f,) are free, by exact
    derivatives."""
    check_continuous(model, "linear model")
    n = len(model.states)
    m = len(model.inputs)
    o = len(model.outputs)
    matrix, columns = (part.full() for part in _function(model, free)(x, u, p))
    slopes = columns.reshape((n + o, n + m, len(free)), order="F").transpose(2, 0, 1)
    return LinearSensitivity(matrix=matrix, slopes=slopes, states=n)


def entering(model: Model, free: np.ndarray) -> np.ndarray:
    """(f,) whether each of the free parameters enters the linear model at all."""
    slopes = _function(model, free).sparsity_out(1)
    pattern = np.zeros(len(free), dtype=bool)
    pattern[list(set(slopes.get_col()))] = True
    return pattern


def _function(model: Model, free: np.ndarray) -> ca.Function:
    return cached(model, ("linear model", *free), lambda: _made(model, free))


def _made(model: Model, free: np.ndarray) -> ca.Function:
    equations = quiet(model, ca.vertcat(model.f, model.h))
    variables = ca.vertcat(model.x, model.u)
    matrix = ca.jacobian(equations, variables)
    slopes = ca.jacobian(ca.vec(ca.densify(matrix)), ca.vertcat(*[model.p[int(i)] for i in free]))
    return ca.Function("linear", [model.x, model.u, model.p], [ca.densify(matrix), slopes])
