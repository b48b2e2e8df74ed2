"""Output error in the frequency domain: measured transforms against those of the linear model, as a cost for `solve`.

The model is linear about the mean of a record's measured motion. From one sample to the next it moves by

    x' = F x + G u + H u',    y = C x + D u,

exactly, for inputs on straight lines between samples (or held, H = 0). So the transforms over the N samples satisfy

    (z I - F) X = (G + z H) U + z step,    Y = C X + D U,    z = exp(j omega dt),

without simulation, initial states and biases, and for unstable aircraft as well (Klein and Morelli, Aircraft System
Identification, AIAA 2006, ch. 7, with z in the place of j omega). The vector `step` is what states and inputs differ by
between both ends of the record. It is unknown and eliminated, for every output by itself, by the projection of Golub
and Pereyra (SIAM J. Numerical Analysis 10, 1973), with exact derivatives.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from casid.errors import EstimationError, check_known
from casid.estimation.problem import Problem
from casid.estimation.transcriptions.equation import EquationValue
from casid.frequency.model_response import LinearSensitivity, entering, sensitivity_at
from casid.frequency.regression import FourierCost, FourierRows, Piece, fixing, pieces_of, real_rows
from casid.model.system import check_continuous
from casid.records.record import Record

_SHOWN = 1e-9  # of the largest singular value: with a smaller one the output does not show a step in that direction


@dataclass(frozen=True, kw_only=True)
class FourierOutputError(FourierCost):
    """Output error of the Fourier transforms in a band of frequencies: a cost for `Problem`.

    The model is linear about the mean of each record's measured motion, so the motion has to be small enough for that.
    Nothing is simulated: initial states and biases have no part, and every transcription gives the same fit. Inputs are
    held between samples where `Record.hold` states it, else on straight lines, cubic ones too.

    Attributes
    ----------
    band
        (low, high) [rad/s], well below the frequency of Nyquist.

    Raises
    ------
    InputError
        For what is no band.

    References
    ----------
    Klein and Morelli, Aircraft System Identification: Theory and Practice, AIAA 2006, ch. 7.

    Examples
    --------
    After the example of `track_derivatives`:

    >>> cost = cs.FourierOutputError(band=(0.5, 6.0))
    >>> round(cs.solve(cs.Problem(roll, [record], free=["Lp"], cost=cost))["Lp"].value, 6)
    -2.0
    """

    def equations(self, problem: Problem) -> FourierOutputs:
        """The transformed outputs of a problem.

        Raises
        ------
        EstimationError
            For a model without states, that depends on time or has no derivatives at the mean motion, a free parameter
            that does not enter the linear model, and a band without a frequency.
        """
        check_continuous(problem.model, "FourierOutputError")
        return FourierOutputs(problem, self.band)


class FourierOutputs(FourierRows):
    """Transformed outputs of a problem."""

    def __init__(self, problem: Problem, band: tuple[float, float]) -> None:
        _check(problem)
        self._problem = problem
        self.names = problem.model.outputs
        self._pieces = [p for r, record in enumerate(problem.records) for p in _transformed(problem, record, r, band)]
        super().__init__([one.piece for one in self._pieces])
        self.targets = self.by_record([real_rows(one.outputs) for one in self._pieces])
        self.eliminated = 0
        for one in self._pieces:
            linear = self._linear(one, problem.start_parameters)
            if not np.isfinite(linear.matrix).all():
                raise EstimationError(
                    f"FourierOutputError: '{problem.model.name}' has no derivatives at the mean motion of record "
                    f"'{problem.records[one.piece.record].name}'; measure its states, or use OutputError"
                )
            self.eliminated += _Outputs(one, linear).eliminated

    def value(self, parameters: np.ndarray) -> EquationValue:
        """Residuals at values (records, model parameters)."""
        found = [_Outputs(one, self._linear(one, parameters)).residuals for one in self._pieces]
        return EquationValue(residuals=self.by_record(found))

    def slopes(self, parameters: np.ndarray, piece: int) -> np.ndarray:
        """(rows, outputs, free) derivatives of the residuals of a piece."""
        one = self._pieces[piece]
        return _Outputs(one, self._linear(one, parameters)).derivatives

    def _linear(self, one: _Transformed, parameters: np.ndarray) -> LinearSensitivity:
        model = self._problem.model
        free = self._problem.free_index
        return sensitivity_at(model, free, one.x, one.u, parameters[one.piece.record])


@dataclass(frozen=True, eq=False, kw_only=True)
class _Transformed:
    """A piece of a record: its mean states x (n,) and inputs u (m,), and the transforms of what is measured.

    outputs (M, outputs), NaN where not measured; inputs (M, inputs).
    `held` (inputs,) marks those that are held between samples.
    """

    piece: Piece
    held: np.ndarray
    x: np.ndarray
    u: np.ndarray
    outputs: np.ndarray
    inputs: np.ndarray


def _transformed(problem: Problem, record: Record, index: int, band: tuple[float, float]) -> list[_Transformed]:
    """The pieces of a record with the transforms of its inputs and outputs."""
    model = problem.model
    check_known("channel", model.inputs, record.channels, f"record '{record.name}': input of '{model.name}'")
    measured = [name for name in model.outputs if name in record and np.isfinite(record[name]).any()]
    held = np.array([record.hold_of(name) == "held" for name in model.inputs], dtype=bool)
    guess = np.asarray(model.guess(record), dtype=float)
    found = []
    channels = [*model.inputs, *measured]
    for piece in pieces_of(record, index, channels, band, "FourierOutputError"):
        transform = piece.transform(piece.stretch.values)
        inputs = transform[:, : len(model.inputs)]
        outputs = np.full((len(piece.omega), len(model.outputs)), complex(np.nan, np.nan))
        outputs[:, [model.outputs.index(name) for name in measured]] = transform[:, len(model.inputs) :]
        t = record.t
        stretch = piece.stretch
        within = (t >= stretch.t[0] - 0.5 * stretch.dt) & (t <= stretch.t[-1] + 0.5 * stretch.dt)
        x = guess[within].mean(axis=0)
        u = stretch.values[:, : len(model.inputs)].mean(axis=0)
        found.append(_Transformed(piece=piece, held=held, x=x, u=u, outputs=outputs, inputs=inputs))
    return found


class _Outputs:
    """Modelled outputs of a piece: residuals (rows, outputs), NaN where not measured, and their derivatives (rows,
    outputs, free), zero there. Both are free of the unknown step, output by output."""

    def __init__(self, one: _Transformed, linear: LinearSensitivity) -> None:
        self._linear = linear
        transition, self._moved = linear.sampled(one.piece.stretch.dt, one.held)
        n = linear.states
        m = len(one.u)
        z = np.exp(1j * one.piece.omega * one.piece.stretch.dt)
        resolvent = np.linalg.inv(z[:, None, None] * np.eye(n) - transition[:, :n])
        inputs = np.concatenate([one.inputs, z[:, None] * one.inputs], axis=1)
        states = np.einsum("kab,bc,kc->ka", resolvent, transition[:, n:], inputs, optimize=True)
        self._motion = np.concatenate([states, inputs], axis=1)  # (M, n+2m)
        self._measuring = linear.matrix[n:]  # (o, n+m)
        self._error = self._motion[:, : n + m] @ self._measuring.T - one.outputs
        self._resolvent = resolvent
        self._z = z
        self._n = n
        self._m = m
        self._present = np.flatnonzero(np.isfinite(one.outputs).all(axis=0)).tolist()

    @cached_property
    def _steps(self) -> dict[int, tuple[np.ndarray, np.ndarray]]:
        """Output -> (rows, n) what unit steps of the states add to it, and the pseudo-inverse (n, rows) of that."""
        through = self._measuring[:, : self._n] @ self._resolvent * self._z[:, None, None]  # (M, o, n)
        added = {o: real_rows(through[:, o]) for o in self._present}
        return {o: (one, np.linalg.pinv(one, rcond=_SHOWN)) for o, one in added.items()}

    @property
    def eliminated(self) -> int:
        """Number of unknowns that the projections remove."""
        return sum(int(np.linalg.matrix_rank(t, tol=_SHOWN * np.linalg.norm(t, 2))) for t, _ in self._steps.values())

    @cached_property
    def residuals(self) -> np.ndarray:
        """(rows, outputs) modelled minus measured."""
        rows = real_rows(self._error)
        for o, (added, inverse) in self._steps.items():
            rows[:, o] -= added @ (inverse @ rows[:, o])
        return rows

    @property
    def derivatives(self) -> np.ndarray:
        """(rows, outputs, free) of the residuals."""
        n = self._n
        m = self._m
        moved = self._moved  # (f, n, n+2m)
        slopes = self._linear.slopes[:, n:]  # (f, o, n+m)
        through = self._measuring[:, :n] @ self._resolvent  # (M, o, n)
        plain = np.einsum("foc,kc->kof", slopes, self._motion[:, : n + m], optimize=True)
        plain += np.einsum("koa,fac,kc->kof", through, moved, self._motion, optimize=True)
        unit = self._resolvent * self._z[:, None, None]  # (M, n, n) states per unit step
        rows = np.zeros((2 * len(plain), *plain.shape[1:]))
        error = real_rows(self._error)
        for o, (added, inverse) in self._steps.items():
            steps = np.einsum("fa,kab->kfb", slopes[:, o, :n], unit, optimize=True)
            steps += np.einsum("ka,fac,kcb->kfb", through[:, o], moved[:, :, :n], unit, optimize=True)
            dadded = real_rows(steps)
            step = -inverse @ error[:, o]
            own = real_rows(plain[:, o]) + dadded @ step
            own -= added @ (inverse @ own)
            rows[:, o] = own - inverse.T @ np.einsum("kfb,k->bf", dadded, self.residuals[:, o])
        return rows


def _check(problem: Problem) -> None:
    """Raise EstimationError for what has no transform of its own in the band."""
    model = problem.model
    if not model.states:
        raise EstimationError(
            f"FourierOutputError: model '{model.name}' has no states, only equations; use FourierEquationError"
        )
    if "t" in model.inputs:
        raise EstimationError(
            f"FourierOutputError: model '{model.name}' depends on time and has no frequency response; use OutputError"
        )
    names = problem.shared + problem.local
    idle = [name for name, used in zip(names, entering(model, problem.free_index), strict=True) if not used]
    idle = [name for name in idle if not (problem.prior and name in model.prior_std)]
    if idle:
        raise EstimationError(
            f"FourierOutputError: {', '.join(idle)} do not enter the linear model of '{model.name}', so a band of "
            f"frequencies says nothing of them; {fixing(model, idle)}"
        )
