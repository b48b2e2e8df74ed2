"""Models in the frequency domain: exact linearisation at an operating point, with the lags and delays of the file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from casid.arguments import number, numbers_by_name
from casid.errors import InputError, check_known
from casid.frames import brief
from casid.frequency.sensitivity import sensitivity_at
from casid.model.aircraft import Aircraft, given_aircraft
from casid.model.dynamics import aircraft_model
from casid.model.flown_records import FlownRecords, axes_of, flown_records
from casid.model.system import Model
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
    A, B, C, D = _derivatives(chosen, x, u, chosen.nominal_vector(values))
    return LinearModel(
        name=chosen.name,
        states=chosen.states,
        inputs=chosen.inputs,
        outputs=chosen.outputs,
        A=A,
        B=B,
        C=C,
        D=D,
        point=dict(zip((*chosen.states, *chosen.inputs), (*x.tolist(), *u.tolist()), strict=True)),
        not_linear=applied.not_linear if applied else (),
        _applied=applied,
    )


def _derivatives(model: Model, x: np.ndarray, u: np.ndarray, p: np.ndarray) -> list[np.ndarray]:
    """A, B, C, D at a point, disturbances at rest."""
    matrix = sensitivity_at(model, np.zeros(0, dtype=int), x, u, p).matrix
    n = len(x)
    if not np.isfinite(matrix).all():
        at = ", ".join(f"{name} = {value:.4g}" for name, value in zip(model.states, x.tolist(), strict=True))
        raise InputError(f"linear_model: '{model.name}' has no derivatives at {at}; give another operating point")
    return [matrix[:n, :n], matrix[:n, n:], matrix[n:, :n], matrix[n:, n:]]


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
