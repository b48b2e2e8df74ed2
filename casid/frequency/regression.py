"""Equation error in the frequency domain: the model's equations, Fourier transformed, as a cost for `solve`.

The transform of a linear combination is that of its parts, so an equation y = sum of theta_i x_i holds between the
transforms at every frequency (Klein and Morelli, Aircraft System Identification, AIAA 2006, ch. 7; Morelli, Real-time
parameter estimation in the frequency domain, J. Guidance, Control, and Dynamics 23, 2000). A band of frequencies then
takes the place of a filter: trim values and slow drifts have no part in it, nor has noise above it.

Frequencies are the multiples of 2 pi / T of the stretch of duration T that is transformed. White noise of the samples
is independent from one to the next there, so that real and imaginary parts are so many independent equations. They
are scaled so that their noise has the 1-sigma of the samples' noise.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Container, Iterable, Iterator, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from casid.errors import EstimationError
from casid.estimation.problem import Problem
from casid.estimation.transcriptions.equation import (
    EquationPart,
    EquationValue,
    equation_form,
    recorded_or_differentiated,
)
from casid.frequency.transform import Stretch, check_band, chirp_z, stretches
from casid.model.system import EquationForm, Model, check_continuous
from casid.records.record import Record


@dataclass(frozen=True, kw_only=True)
class FourierCost:
    """A cost of Fourier transforms in a band (low, high) of frequencies [rad/s]. Nothing is simulated in time."""

    band: tuple[float, float]

    output_weight = 0.0
    equation_weight = 1.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "band", check_band(self.band, type(self).__name__))


@dataclass(frozen=True, kw_only=True)
class FourierEquationError(FourierCost):
    """Equation error of the Fourier transforms of all signals, in a band of frequencies: a cost for `Problem`.

    The equations are those of `EquationError`: the coefficients of an aircraft, or the state equations with measured
    states. Of a state whose derivative is not recorded the transform is multiplied by j omega, so that no sample is
    differentiated; the step that it makes from the first sample to the last is an unknown, which is eliminated. A
    derivative inside the coefficients of an aircraft is smoothed in time, as for `EquationError`.

    Constants, such as `Cm_0` and biases, have no part in the band: fix them.

    Attributes
    ----------
    band
        (low, high) [rad/s].

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

    >>> cost = cs.FourierEquationError(band=(0.5, 6.0))
    >>> round(cs.solve(cs.Problem(roll, [record], free=["Lp"], cost=cost))["Lp"].value, 2)
    -2.0
    """

    def equations(self, problem: Problem) -> FourierEquations:
        """The transformed equations of a problem.

        Raises
        ------
        EstimationError
            For a free parameter that is a constant of the equations, and a band without a frequency.
        """
        check_continuous(problem.model, "FourierEquationError")
        return FourierEquations(problem, self.band)


@dataclass(frozen=True, eq=False, kw_only=True)
class Piece:
    """A stretch of a record, and the frequencies at which it is transformed."""

    record: int  # which record of the problem it is of
    stretch: Stretch  # its samples
    omega: np.ndarray  # (frequencies,) [rad/s], multiples of 2 pi / (N dt)

    def transform(self, values: np.ndarray) -> np.ndarray:
        """(frequencies, ...) of values (N, ...), scaled so that white noise keeps its 1-sigma in both parts."""
        count = len(self.stretch.values)
        flat = chirp_z(values.reshape(count, -1), self.stretch.dt, self.omega) * np.sqrt(2.0 / count)
        return flat.reshape(len(self.omega), *values.shape[1:])

    @property
    def step(self) -> np.ndarray:
        """(frequencies,) what j omega times the transform of a straight line through the stretch is short of."""
        theta = self.omega * self.stretch.dt
        return 1j * theta / (1.0 - np.exp(-1j * theta))


def real_rows(values: np.ndarray) -> np.ndarray:
    """(2 frequencies, ...) real parts, then imaginary parts, of (frequencies, ...)."""
    return np.concatenate([np.real(values), np.imag(values)])


def pieces_of(
    record: Record, index: int, channels: Sequence[str], band: tuple[float, float], where: str
) -> list[Piece]:
    """The stretches of a record that have a frequency in the band. Raises EstimationError where none has."""
    found = []
    for one in stretches(record, channels, band[1]):
        first = 2.0 * np.pi / (len(one.values) * one.dt)
        low = max(1, int(np.ceil(band[0] / first - 1e-9)))
        high = int(np.floor(band[1] / first + 1e-9))
        high = min(high, (len(one.values) - 1) // 2)  # at Nyquist's frequency there is no imaginary part
        if high >= low:
            found.append(Piece(record=index, stretch=one, omega=first * np.arange(low, high + 1)))
    if not found:
        raise EstimationError(
            f"{where}: record '{record.name}' has no stretch without gaps of {', '.join(channels)} that is long enough "
            f"for a frequency in the band of {band[0]:g} to {band[1]:g} rad/s; widen the band or fill the gaps"
        )
    return found


class FourierRows(ABC):
    """Rows of Fourier transforms: see `casid.estimation.transcriptions.equation.Equations`.

    Rows of a record are those of its pieces one after the other, of each first the real parts at all frequencies.
    """

    def __init__(self, pieces: Sequence[Piece]) -> None:
        self._record = np.array([one.record for one in pieces])
        self.frequencies = self.by_record([np.tile(one.omega, 2) for one in pieces])  # of each row [rad/s]

    def by_record(self, rows: list[np.ndarray]) -> list[np.ndarray]:
        """Per record the rows of its pieces, of which there are some of each."""
        records = range(int(self._record.max()) + 1)
        return [np.concatenate([rows[int(i)] for i in np.flatnonzero(self._record == r)]) for r in records]

    @abstractmethod
    def slopes(self, parameters: np.ndarray, piece: int) -> np.ndarray:
        """(rows, columns, free) derivatives of the residuals of a piece."""

    def slabs(self, parameters: np.ndarray, record: int) -> Iterator[tuple[slice, np.ndarray]]:
        """Rows of a record, and the derivatives (rows, columns, free) of the residuals there."""
        first = 0
        for i in np.flatnonzero(self._record == record):
            rows = self.slopes(parameters, int(i))
            yield slice(first, first + len(rows)), rows
            first += len(rows)


class FourierEquations(FourierRows):
    """The equations of a problem, Fourier transformed."""

    def __init__(self, problem: Problem, band: tuple[float, float]) -> None:
        form = equation_form(problem.model)
        idle = constants(form, problem.model, problem.shared + problem.local)
        if idle:
            raise EstimationError(
                f"{type(problem.cost).__name__}: {', '.join(idle)} add a constant, which has no part in a band of "
                f"frequencies; {fixing(problem.model, idle)}"
            )
        self.names = form.names
        self._pieces = [p for r, record in enumerate(problem.records) for p in _pieces(problem, record, r, form, band)]
        super().__init__([one.piece for one in self._pieces])
        self._part = EquationPart(problem, [(one.piece.record, one.signals) for one in self._pieces])
        self.eliminated = sum(len(one.differentiated) for one in self._pieces)
        targets = zip(self._pieces, self._part.targets, strict=True)
        self.targets = self.by_record([one.rows(target) + one.derivatives for one, target in targets])

    def value(self, parameters: np.ndarray) -> EquationValue:
        """Residuals at values (records, model parameters)."""
        found = self._part.value(parameters).residuals
        rows = [one.rows(residual) - one.derivatives for one, residual in zip(self._pieces, found, strict=True)]
        return EquationValue(residuals=self.by_record(rows))

    def slopes(self, parameters: np.ndarray, piece: int) -> np.ndarray:
        """(rows, equations, free) derivatives of the residuals of a piece."""
        samples = [rows for _, rows in self._part.slabs(parameters, piece)]
        return self._pieces[piece].rows(np.concatenate(samples))


@dataclass(frozen=True, eq=False, kw_only=True)
class _Signals:
    """Signals of a piece that the equations use."""

    piece: Piece
    signals: np.ndarray  # (N, channels of the form), zero for the derivatives that are not recorded
    differentiated: list[int]  # equations whose target is such a derivative
    derivatives: np.ndarray  # (rows, equations) transforms of these targets, free of steps; zero for the others
    step: np.ndarray  # (rows,) of unit length: what an unknown step adds

    def rows(self, values: np.ndarray) -> np.ndarray:
        """(rows, equations, ...) of values (N, equations, ...), free of steps."""
        return _free_of(self.step, real_rows(self.piece.transform(values)), self.differentiated)


def _free_of(step: np.ndarray, rows: np.ndarray, columns: list[int]) -> np.ndarray:
    """Rows (rows, columns, ...) with the direction `step` (rows,) taken out of some of the columns."""
    rows[:, columns] -= np.multiply.outer(step, np.tensordot(step, rows[:, columns], axes=(0, 0)))
    return rows


def _pieces(
    problem: Problem, record: Record, index: int, form: EquationForm, band: tuple[float, float]
) -> list[_Signals]:
    """The pieces of a record with what the equations take of them."""
    where = type(problem.cost).__name__
    lacking = lacking_derivatives(problem.model, form, record.channels)
    others = [n for n in form.channels if n not in record.channels and n not in lacking]
    smoothed = {name: recorded_or_differentiated(record, name) for name in others}
    channels = list(dict.fromkeys(lacking.get(name, name) for name in form.channels))
    found = []
    for piece in pieces_of(record.with_channels(**smoothed), index, channels, band, where):
        columns = dict(zip(channels, piece.stretch.values.T, strict=True))
        zero = np.zeros(len(piece.stretch.values))
        derivatives = np.zeros((2 * len(piece.omega), len(form.names)))
        differentiated = [form.names.index(name) for name in lacking]
        for i, base in zip(differentiated, lacking.values(), strict=True):
            derivatives[:, i] = real_rows(1j * piece.omega * piece.transform(columns[base]))
        step = real_rows(piece.step) / np.linalg.norm(piece.step)
        found.append(
            _Signals(
                piece=piece,
                signals=np.stack([zero if n in lacking else columns[n] for n in form.channels], axis=1),
                differentiated=differentiated,
                derivatives=_free_of(step, derivatives, differentiated),
                step=step,
            )
        )
    return found


def lacking_derivatives(model: Model, form: EquationForm, there: Container[str]) -> dict[str, str]:
    """Derivatives of states that the state equations of a model need and that are not `there` -> the states, which
    are."""
    if model.equation is not None or not model.states:
        return {}
    dots = {name: name.removesuffix("dot") for name in form.channels if name.endswith("dot") and name not in there}
    return {name: base for name, base in dots.items() if base in there}


def constants(form: EquationForm, model: Model, names: Iterable[str]) -> list[str]:
    """Those of the named parameters whose regressor is the same at every sample."""
    found = []
    for name in names:
        slope = ca.jacobian(form.prediction, model.p[model.parameters.index(name)])
        if slope.nnz() and not ca.depends_on(slope, form.m):
            found.append(name)
    return found


def fixing(model: Model, names: Sequence[str]) -> str:
    """Write how parameters are fixed that cannot be estimated."""
    values = ", ".join(f"'{name}': {model.nominal[name]:g}" for name in names)
    return f"fix them: fixed={{{values}}}"
