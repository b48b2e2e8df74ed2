"""Derivatives as the samples come: recursive Fourier transforms and complex least squares, with forgetting.

Each sample multiplies the transforms by the forgetting factor and adds its own part. The regression at any time is then
a small least-squares problem over the frequencies (Morelli, Real-time parameter estimation in the frequency domain, J.
Guidance, Control, and Dynamics 23, 2000; Klein and Morelli, Aircraft System Identification, AIAA 2006, ch. 11).

Frequencies need not suit the time that has passed. A constant in an equation therefore shows in the transforms. So do
both ends of a state whose derivative is taken by j omega. All of these have known shapes over frequency and are
eliminated. The errors at neighbouring frequencies are correlated as the weights of the samples imply, and the
standard deviations hold that.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from casid.arguments import names, number, numbers_by_name, require
from casid.errors import EstimationError, InputError
from casid.estimation.problem import chosen_parameters
from casid.estimation.transcriptions.equation import equation_form
from casid.frames import brief
from casid.frequency.regression import constants, fixing, lacking_derivatives, real_rows
from casid.model.system import Model
from casid.records.record import Record

_FORGOTTEN = 1e-9  # of a column's size when it was new: it is rounding now
_SINGULAR = 1e-10  # of the largest singular value


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class TrackedDerivatives:
    """Estimates at one time.

    Attributes
    ----------
    t
        Time of the last sample that they hold [s].
    values, std
        Name -> estimate, and its standard deviation for white noise of the equation's samples.
    noise
        Equation -> 1-sigma of its noise in the band.

    Examples
    --------
    After the example of `track_derivatives`:

    >>> round(now.t), round(now.values["Lp"], 2)
    (20, -2.0)
    """

    t: float
    values: dict[str, float]
    std: dict[str, float]
    noise: dict[str, float]

    __repr__ = brief


def track_derivatives(
    model: Model,
    samples: Record | Iterable[Mapping[str, float]],
    *,
    free: Sequence[str],
    omega: np.ndarray | Sequence[float],
    memory: float = np.inf,
    every: float = 1.0,
    fixed: Mapping[str, float] | None = None,
) -> Iterator[TrackedDerivatives]:
    """Estimate the parameters of a model's equations while the samples come.

    Parameters
    ----------
    model
        Its equations are those of `EquationError`, and linear in the free parameters.
    samples
        One table of channel -> value at a time, with the time under "t"; or a record, for a flight that is over. A
        sample with a missing channel (nan) is left out if the derivatives of the states are channels (`pdot`).
    free
        Globs of the parameters to estimate, each in one equation.
    omega
        (frequencies,) [rad/s], such as `numpy.arange(0.5, 9.0, 0.25)`.
    memory
        Time after which a sample weighs 1/e as much as a new one [s]; infinite: nothing is forgotten.
    every
        Time between two estimates [s]; one more comes after the last sample.
    fixed
        Name -> value of parameters that are not estimated; all others stay nominal.

    Yields
    ------
    TrackedDerivatives
        The first result comes once the samples determine the parameters.

    Raises
    ------
    InputError
        For a name that does not exist, fewer than two frequencies or one that is not positive, a sample without a
        channel that is needed, and a missing value (nan) or uneven times where the derivative of a state is not a
        channel.
    EstimationError
        For an equation that is not linear in a free parameter, and a parameter that only adds a constant to its
        equation (a bias) or enters several.

    Notes
    -----
    If the derivative of a state is not a channel, the samples must be evenly spaced and complete. A sample that is half
    an interval or more from its time is refused; less than that degrades the estimates.

    Examples
    --------
    >>> import numpy as np, casid as cs
    >>> roll = cs.define_model(
    ...     "roll", states=["p"], inputs=["delta_a"], parameters={"Lp": -1.0, "Lda": -5.0}, outputs=["p"],
    ...     dynamics=lambda s: {"p": s.Lp * s.p + s.Lda * s.delta_a}, output=lambda s: {"p": s.p},
    ... )
    >>> t = 0.02 * np.arange(1000)
    >>> inputs = cs.Record(name="m1", t=t, channels={"delta_a": 0.05 * np.sin(t) * np.cos(2.3 * t)})
    >>> record = cs.simulate(roll, inputs, np.zeros(1), {"Lp": -2.0}).as_record("m1")
    >>> for now in cs.track_derivatives(roll, record, free=["Lp"], omega=np.arange(0.5, 6.0, 0.3), every=10.0):
    ...     print(round(now.t), round(now.values["Lp"], 2))
    10 -2.0
    20 -2.0
    """
    where = "track_derivatives"
    require(model, Model, f"{where}: model", "cs.aircraft_model(aircraft) or cs.define_model(...)")
    grid = np.asarray(omega, dtype=float)
    if grid.ndim != 1 or len(grid) < 2 or not np.isfinite(grid).all() or not (grid > 0.0).all():
        raise InputError(f"{where}: omega has to be at least two positive frequencies in rad/s, (frequencies,)")
    if memory != np.inf:
        number(memory, f"{where}: memory", positive=True)
    number(every, f"{where}: every", positive=True)
    known = numbers_by_name(fixed or {}, f"{where}: fixed")
    chosen = chosen_parameters(names(free, f"{where}: free"), model, f"{where}: free")
    own = tuple(name for name in chosen if name not in known)
    return _tracked(_Equations(model, own, known), _samples(samples), grid, memory, every)


class _Equations:
    """Equations of a model, linear in its free parameters `names`; all others but the `known` ones are nominal.

    function    channels -> (target less what is known, regressors (equations, free))
    places      per equation the free parameters in it

    Raises EstimationError for a parameter that cannot be determined.
    """

    def __init__(self, model: Model, names: Sequence[str], known: Mapping[str, float]) -> None:
        self.model = model
        self.names = names
        self.form = form = equation_form(model)
        free = [model.parameters.index(name) for name in names]
        symbols = ca.vertcat(*[model.p[i] for i in free])
        slopes = ca.jacobian(form.prediction, symbols)
        for i, name in enumerate(names):
            if ca.depends_on(slopes[:, i], symbols):
                raise EstimationError(f"track_derivatives: the equations are not linear in '{name}'; fix it")
        constant = constants(form, model, names)
        if constant:
            raise EstimationError(
                f"track_derivatives: {', '.join(constant)} add a constant, which is left out; {fixing(model, constant)}"
            )
        pattern = np.array(ca.DM(ca.jacobian_sparsity(form.prediction, symbols), 1.0).full(), dtype=bool)
        for name, count in zip(names, pattern.sum(axis=0).tolist(), strict=True):
            if count != 1:
                stands = "in no equation" if count == 0 else f"in {count} equations; expected one"
                raise EstimationError(f"track_derivatives: '{name}' stands {stands}; fix it")
        self.places = [np.flatnonzero(row).tolist() for row in pattern]
        values = model.nominal_vector(known)
        values[free] = 0.0
        rest, slopes = ca.substitute([form.target - form.prediction, slopes], [model.p], [ca.DM(values)])
        self.function = ca.Function("regressors", [form.m], [ca.densify(rest), ca.densify(slopes)])

    def differentiated(self, sample: Mapping[str, float]) -> dict[str, str]:
        """Derivative that the samples do not have -> the state that it is of. Raises InputError for a missing
        channel."""
        found = lacking_derivatives(self.model, self.form, sample)
        for name in self.form.channels:
            if name not in sample and name not in found:
                raise InputError(f"track_derivatives: the samples have no channel '{name}', which the equations need")
        return found


def _samples(samples: Record | Iterable[Mapping[str, float]]) -> Iterable[Mapping[str, float]]:
    if not isinstance(samples, Record):
        return samples
    columns = {"t": samples.t, **samples.channels}
    return ({name: float(values[k]) for name, values in columns.items()} for k in range(len(samples)))


def _tracked(
    equations: _Equations, samples: Iterable[Mapping[str, float]], omega: np.ndarray, memory: float, every: float
) -> Iterator[TrackedDerivatives]:
    sums: _Sums | None = None
    due = -np.inf
    given = -np.inf
    for sample in samples:
        if sums is None:
            sums = _Sums(equations, equations.differentiated(sample), omega, memory)
            due = _value(sample, "t") + every
        sums.add(sample)
        if sums.last >= due - 1e-9 * every:
            due = due + every * np.ceil((sums.last - due) / every + 1e-9)
            given = sums.last
            yield from _estimates(sums)
    if sums is not None and sums.last > given:
        yield from _estimates(sums)


def _value(sample: Mapping[str, float], name: str) -> float:
    if name not in sample:
        raise InputError(
            f"track_derivatives: the sample has no '{name}'; expected a table of channel -> value with 't'"
        )
    return float(sample[name])


class _Sums:
    """Transforms of the samples so far, each sample with its weight: (frequencies, columns) of the equations' targets
    and regressors, of states to be differentiated, and of a constant; and the correlation of white noise in them."""

    def __init__(
        self, equations: _Equations, differentiated: Mapping[str, str], omega: np.ndarray, memory: float
    ) -> None:
        self.equations = equations
        self.differentiated = differentiated
        self.omega = omega
        self.memory = memory
        self._width = len(equations.form.names)
        columns = self._width + sum(map(len, equations.places)) + len(differentiated) + 1
        self.total = np.zeros((len(omega), columns), complex)
        self.across = np.zeros((len(omega), len(omega)), complex)  # sum of w^2 e e^H
        self.along = np.zeros_like(self.across)  # sum of w^2 e e^T
        self.count = 0
        self.first = np.nan
        self.last = np.nan
        self.weight = 1.0
        self.interval = np.nan

    def add(self, sample: Mapping[str, float]) -> None:
        """Add a sample."""
        t = _value(sample, "t")
        decay = 1.0
        if self.count:
            if t <= self.last:
                raise InputError(f"track_derivatives: t = {t:g} s follows {self.last:g} s; expected increasing times")
            self._check_even(t)
            decay = float(np.exp((self.last - t) / self.memory))
        else:
            self.first = t
        self.count, self.last, self.weight = self.count + 1, t, self.weight * decay
        signals = [0.0 if n in self.differentiated else _value(sample, n) for n in self.equations.form.channels]
        states = [_value(sample, base) for base in self.differentiated.values()]
        rest, slopes = (part.full() for part in self.equations.function(signals))
        row = [*rest[:, 0], *(slopes[e, i] for e, own in enumerate(self.equations.places) for i in own), *states, 1.0]
        self.total *= decay
        self.across *= decay**2
        self.along *= decay**2
        if not np.isfinite(row).all():
            if self.differentiated:
                raise InputError(
                    f"track_derivatives: a sample is missing at t = {t:g} s; then the samples must have the channels "
                    f"{', '.join(self.differentiated)}"
                )
            return
        turn = np.exp(-1j * self.omega * (t - self.first))
        self.total += np.outer(turn, row)
        self.across += np.outer(turn, turn.conj())
        self.along += np.outer(turn, turn)

    def _check_even(self, t: float) -> None:
        """The interval is that of the first two samples. Where derivatives come from the samples, InputError for one
        that is nearer to another time than to its own."""
        step = t - self.last
        if self.count == 1:
            self.interval = step
        elif self.differentiated and abs(step - self.interval) > 0.5 * self.interval:
            raise InputError(
                f"track_derivatives: t = {t:g} s comes {step:g} s after the sample before; expected "
                f"{self.interval:g} s, or the channels {', '.join(self.differentiated)}"
            )

    def noise(self) -> np.ndarray:
        """(2 frequencies, 2 frequencies) covariance of the real rows for white noise of variance 1."""
        plus = self.across + self.along
        minus = self.along - self.across
        across = np.imag(minus)
        return 0.5 * np.block([[np.real(plus), across], [across.T, -np.real(minus)]])

    def regression(self, equation: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Real rows of the target (rows,), of its regressors (rows, free) and of what is eliminated (rows, shapes)."""
        first = self._width + sum(map(len, self.equations.places[:equation]))
        x = self.total[:, first : first + len(self.equations.places[equation])]
        z = self.total[:, equation]
        shapes = [self.total[:, -1]]
        name = self.equations.form.names[equation]
        if name in self.differentiated:
            place = list(self.differentiated).index(name)
            dt = (self.last - self.first) / (self.count - 1)
            rate = 1j * self.omega - 1.0 / self.memory
            z = z + rate * self.total[:, place - len(self.differentiated) - 1]
            difference = rate / (np.exp(rate * dt) - 1.0)
            # what the state differs by at both ends: the sample that is to come, and the first one
            shapes.append(difference * np.exp(-1j * self.omega * (self.last - self.first)))
            shapes.append(difference * np.exp(rate * dt) * self.weight)
        return real_rows(z), real_rows(x), real_rows(np.stack(shapes, axis=1))


def _basis(shapes: np.ndarray, constant: float) -> np.ndarray:
    """(rows, directions) of unit length that span the shapes (rows, shapes), a constant before the ends of a state,
    without those that have been forgotten; `constant` is the size of the first one when nothing cancels in it."""
    size = np.linalg.norm(shapes, axis=0)
    new = np.array([constant, *[size[1:].max(initial=0.0)] * (len(size) - 1)])
    shapes = shapes[:, size > _FORGOTTEN * new]
    directions, kept, _ = np.linalg.svd(shapes / np.linalg.norm(shapes, axis=0), full_matrices=False)
    return directions[:, kept > _FORGOTTEN]


def _estimates(sums: _Sums) -> Iterator[TrackedDerivatives]:
    """The least-squares estimates of all equations, nothing while the samples do not determine them."""
    if sums.count < 2:
        return
    own = sums.equations.names
    values = {}
    std = {}
    noise = {}
    covariance = sums.noise()
    for equation, places in enumerate(sums.equations.places):
        if not places:
            continue
        z, x, shapes = sums.regression(equation)
        basis = _basis(shapes, np.sqrt(sums.count * len(sums.omega)))
        x = x - basis @ (basis.T @ x)
        z = z - basis @ (basis.T @ z)
        scale = np.linalg.norm(x, axis=0)
        if not (scale > 0.0).all():
            return
        left, singular, right = np.linalg.svd(x / scale, full_matrices=False)
        if singular[-1] < _SINGULAR * singular[0] or len(z) <= x.shape[1] + basis.shape[1]:
            return
        gain = (right.T / singular) @ left.T / scale[:, None]
        theta = gain @ z
        taken = np.concatenate([basis, left], axis=1)
        residual = z - x @ theta
        freedom = np.trace(covariance) - np.trace(taken.T @ covariance @ taken)
        variance = float(residual @ residual) / freedom
        spread = np.sqrt(np.maximum(np.diagonal(gain @ covariance @ gain.T), 0.0) * variance)
        values |= {own[i]: float(value) for i, value in zip(places, theta, strict=True)}
        std |= {own[i]: float(value) for i, value in zip(places, spread, strict=True)}
        noise[sums.equations.form.names[equation]] = float(np.sqrt(variance))
    yield TrackedDerivatives(t=sums.last, values={n: values[n] for n in own}, std={n: std[n] for n in own}, noise=noise)
