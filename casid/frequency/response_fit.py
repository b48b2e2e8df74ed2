"""Parameters of a model fitted to one or more frequency responses: the cost, its minimum, and standard deviations."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from operator import attrgetter
from typing import Any

import numpy as np
import scipy

from casid.above import ask_above
from casid.arguments import one_line
from casid.errors import EstimationError, InputError
from casid.estimation.solvers.status import CONVERGED, Results, Status, out_of_steps
from casid.frames import Rows, brief
from casid.frequency.mismatch import PER_DB2, PER_DEG2, coherence_weight
from casid.frequency.precision import Precision, precision
from casid.frequency.response import USABLE, FrequencyResponse
from casid.frequency.transform import check_band

_DB = 20.0 / np.log(10.0)  # of a gain whose logarithm is one
_EVALUATIONS = 200  # of one start
_TOLERANCE = 1e-12  # relative change of cost and parameters: rounding
_FAR = 1e6  # dB, a response that is no number


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class MeasuredResponse:
    """A frequency response from elsewhere, such as a table, for `fit_transfer_functions` and `fit_state_space`.

    Attributes
    ----------
    input, output
        Names of the channels.
    omega
        (frequencies,) [rad/s].
    response
        (frequencies,) output over input, complex.
    coherence
        (frequencies,); default: 1 everywhere, so that all frequencies are known equally well.

    Raises
    ------
    InputError
        For arrays of unlike length, and values that are no numbers.

    Examples
    --------
    >>> import numpy as np, casid as cs
    >>> omega = np.geomspace(0.5, 12.0, 20)
    >>> roll = cs.TransferFunction(gain="K", poles=["1/T_roll"])
    >>> truth = roll.response(omega, {"K": -3.0, "1/T_roll": 1.5})
    >>> measured = cs.MeasuredResponse(input="delta_a", output="p", omega=omega, response=truth)
    >>> bool(np.all(measured.coherence == 1.0))
    True
    """

    input: str
    output: str
    omega: np.ndarray
    response: np.ndarray
    coherence: np.ndarray = field(default_factory=lambda: np.ones(1))

    def __post_init__(self) -> None:
        to = one_line(self.input, "MeasuredResponse: input")
        where = f"response of '{one_line(self.output, 'MeasuredResponse: output')}' to '{to}'"
        try:
            omega = np.asarray(self.omega, dtype=float)
            response = np.asarray(self.response, dtype=complex)
            coherence = np.asarray(self.coherence, dtype=float)
        except (TypeError, ValueError, OverflowError):
            raise InputError(f"{where}: omega, response or coherence has values that are no numbers") from None
        if omega.ndim != 1 or response.shape != omega.shape or coherence.shape not in (omega.shape, (1,)):
            raise InputError(f"{where}: omega, response and coherence differ in shape; expected (frequencies,) each")
        if not (np.isfinite(omega).all() and np.isfinite(response).all() and (response != 0.0).all()):
            raise InputError(f"{where}: expected finite frequencies and responses that are not zero")
        if not ((coherence >= 0.0) & (coherence <= 1.0)).all():
            raise InputError(f"{where}: coherence is outside of 0 to 1")
        object.__setattr__(self, "omega", omega)
        object.__setattr__(self, "response", response)
        object.__setattr__(self, "coherence", np.broadcast_to(coherence, omega.shape))

    @property
    def usable(self) -> np.ndarray:
        """(frequencies,) whether the coherence is at least 0.6."""
        return self.coherence >= USABLE

    __repr__ = brief


AnyResponse = FrequencyResponse | MeasuredResponse


@dataclass(frozen=True, kw_only=True)
class ResponseParameter:
    """A parameter of a response fit.

    Attributes
    ----------
    name
        Of the parameter.
    value, std
        Estimate and its standard deviation.

    Examples
    --------
    After the example of `MeasuredResponse`:

    >>> K = cs.fit_transfer_functions(measured, {"p": roll})["K"]
    >>> round(K.value, 6), K.std < 1e-3
    (-3.0, True)
    """

    name: str
    value: float
    std: float


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class ResponseFit:
    """Parameters fitted to frequency responses; print it for the tables.

    Attributes
    ----------
    parameters
        Name -> value and standard deviation.
    fixed
        Name -> value of what was not estimated.
    covariance
        (parameters, parameters) with the random error of every frequency, the correlation of neighbouring ones, and
        the size that the residuals show it to have.
    costs
        "output/input" -> cost J of that response: at most 100 for an acceptable model, at most 50 for one nearly
        indistinguishable from flight (guidelines of Tischler and Remple).
    responses
        "output/input" -> what was measured, at the frequencies that took part.
    fitted
        "output/input" -> the model's complex response there.
    ended
        How the iteration ended: result, reason and remedy; `status` is it in words.

    Examples
    --------
    After the example of `MeasuredResponse`:

    >>> fit = cs.fit_transfer_functions(measured, {"p": roll})
    >>> fit.status, sorted(fit.parameters)
    ('converged', ['1/T_roll', 'K'])
    """

    parameters: dict[str, ResponseParameter]
    fixed: dict[str, float]
    covariance: np.ndarray
    costs: dict[str, float]
    responses: dict[str, MeasuredResponse]
    fitted: dict[str, np.ndarray]
    ended: Status

    @property
    def status(self) -> str:
        """ "converged", or result, reason and remedy in words."""
        return self.ended.text

    @property
    def converged(self) -> bool:
        """Return True if the parameters are a minimum of the cost."""
        return self.ended.converged

    @property
    def cost(self) -> float:
        """Mean of the costs J of all responses."""
        return float(np.mean(list(self.costs.values())))

    @property
    def values(self) -> dict[str, float]:
        """Name -> estimate; `fixed` has the others."""
        return {name: one.value for name, one in self.parameters.items()}

    @cached_property
    def precision(self) -> Precision:
        """Cramer-Rao and insensitivity per cent, with remarks and what could be dropped."""
        return precision(self)

    def plot(self) -> Any:
        """Gain and phase, measured and fitted, as a matplotlib figure, which pyplot has."""
        return ask_above("ResponseFit.plot", self)

    def rows(self) -> Rows:
        """Parameters as rows, with Cramer-Rao bound and insensitivity."""
        found = self.precision.parameters
        rest = attrgetter("cramer_rao_percent", "insensitivity_percent", "remark")
        free = ((name, one.value, one.std, *rest(found[name])) for name, one in self.parameters.items())
        fixed = ((name, value, None, None, None, "fixed") for name, value in self.fixed.items())
        heads = {"parameter": "", "value": ".5g", "std": ".3g", "Cramer-Rao %": ".2f", "insensitivity %": ".2f", "": ""}
        return Rows(heads=heads, rows=[*free, *fixed], keys={"": "remark"})

    def __getitem__(self, name: str) -> ResponseParameter:
        return self.parameters[name]

    __repr__ = brief

    def __str__(self) -> str:
        lines = [f"{self.status}; mean cost J {self.cost:.3g}", "", self.rows().text()]
        if self.precision.drop:
            lines.append(f"to fix or drop, one after the other: {', '.join(self.precision.drop)}")
        lines.append("")
        for label, cost in self.costs.items():
            omega = self.responses[label].omega
            lines.append(f"{label}: J {cost:.3g}, {len(omega)} frequencies, {omega[0]:.3g} to {omega[-1]:.3g} rad/s")
        return "\n".join(lines)


# (response, values (parameters,)) -> (M,) what a model has at its frequencies, and (M, parameters) the derivatives of
# the logarithm of that
Respond = Callable[[MeasuredResponse, np.ndarray], tuple[np.ndarray, np.ndarray]]


def fit_responses(
    respond: Respond,
    measured: Sequence[Measured],
    starts: Sequence[Mapping[str, float]],
    free: Sequence[str],
    fixed: Mapping[str, float],
) -> ResponseFit:
    """The best fit of the `free` parameters from several starts, which are tables of values. Raises EstimationError
    where no start has a finite cost, and for more parameters than numbers in the responses."""
    count = sum(2 * len(one.error) for one in measured)
    if len(free) >= count:
        raise EstimationError(
            f"response fit: {len(free)} free parameters and {count} numbers in the responses; fix some"
        )
    best = None
    for start in np.unique([[table[name] for name in free] for table in starts], axis=0):
        if not np.isfinite(_rows(respond, measured, start)[0]).all():
            continue
        found = scipy.optimize.least_squares(
            lambda p: np.nan_to_num(_rows(respond, measured, p)[0], nan=_FAR, posinf=_FAR, neginf=-_FAR),
            start,
            jac=lambda p: np.nan_to_num(_rows(respond, measured, p)[1]),  # pyright: ignore[reportArgumentType]
            method="lm",
            x_scale="jac",
            ftol=_TOLERANCE,
            xtol=_TOLERANCE,
            gtol=_TOLERANCE,
            max_nfev=_EVALUATIONS,
        )
        if best is None or found.cost < best.cost:
            best = found
    if best is None:
        raise EstimationError("response fit: the model has no finite response at any start; give other start values")
    ended = CONVERGED if best.status > 0 else out_of_steps(_EVALUATIONS, "evaluations")
    residual, slopes = _rows(respond, measured, best.x)
    covariance = _covariance(measured, residual, slopes)
    if ended.converged and not np.isfinite(covariance).all():
        ended = Status(result=Results.NOT_IDENTIFIABLE, reason="the parameters cannot be told apart")
    std = np.sqrt(np.maximum(np.diagonal(covariance), 0.0))
    ends = np.cumsum([2 * len(one.error) for one in measured])[:-1]
    return ResponseFit(
        parameters={
            name: ResponseParameter(name=name, value=float(best.x[i]), std=float(std[i])) for i, name in enumerate(free)
        },
        fixed=dict(fixed),
        covariance=covariance,
        costs={one.label: float(rows @ rows) for one, rows in zip(measured, np.split(residual, ends), strict=True)},
        responses={one.label: one.response for one in measured},
        fitted={one.label: respond(one.response, best.x)[0] for one in measured},
        ended=ended,
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class Measured:
    """A response with its weights: `weight` (M,) of the coherence, `correlation` (M, M) of the random errors of the
    logarithm of the response, in units of `error` (M,)."""

    response: MeasuredResponse
    weight: np.ndarray
    error: np.ndarray
    correlation: np.ndarray

    @property
    def label(self) -> str:
        """Output over input."""
        return label_of(self.response)

    @property
    def factors(self) -> list[np.ndarray]:
        """(M,) each: size in the root of J of a logarithm of the gain of one, and of a phase of 1 rad."""
        return [size * np.sqrt(self.weight) for size in (_DB * np.sqrt(PER_DB2), np.degrees(1.0) * np.sqrt(PER_DEG2))]


def label_of(response: AnyResponse) -> str:
    """ "output/input"."""
    return f"{response.output}/{response.input}"


def measured_responses(
    responses: AnyResponse | Sequence[AnyResponse], band: tuple[float, float] | None, where: str
) -> list[Measured]:
    """Each response at the usable frequencies in the band, with its weights. Raises InputError for what is no band, no
    response, the same one twice, and a band without usable frequencies."""
    low, high = (0.0, np.inf) if band is None else check_band(band, where)
    many = [responses] if isinstance(responses, FrequencyResponse | MeasuredResponse) else list(responses)
    found: dict[str, Measured] = {}
    for one in many:
        if not isinstance(one, FrequencyResponse | MeasuredResponse):
            raise InputError(f"{where}: expected responses from cs.frequency_response or cs.MeasuredResponse(...)")
        if label_of(one) in found:
            raise InputError(f"{where}: two responses of {label_of(one)}; expected each once")
        use = (one.omega >= low * (1 - 1e-9)) & (one.omega <= high * (1 + 1e-9)) & one.usable
        if use.sum() < 2:
            raise InputError(
                f"{where}: {label_of(one)} has {int(use.sum())} usable frequencies (coherence {USABLE:g} or more) in "
                "the band; expected at least 2"
            )
        parts = {name: getattr(one, name)[use] for name in ("omega", "response", "coherence")}
        chosen = MeasuredResponse(input=one.input, output=one.output, **parts)
        error = np.sqrt((1.0 - chosen.coherence) / chosen.coherence)
        if isinstance(one, FrequencyResponse):
            error = one.random_error[use]
        if not error.any():
            error = np.ones(len(error))
        found[label_of(one)] = Measured(
            response=chosen,
            weight=coherence_weight(chosen.coherence) * 20.0 / len(error),
            error=error,
            correlation=_correlation(one, chosen.omega),
        )
    if not found:
        raise InputError(f"{where}: no response given")
    return list(found.values())


def _correlation(one: AnyResponse, omega: np.ndarray) -> np.ndarray:
    """(M, M) correlation of the errors at neighbouring frequencies: that of the products of two independent signals in
    Hann's window, of the shortest length that holds two periods of the lower frequency."""
    if not isinstance(one, FrequencyResponse):
        return np.eye(len(omega))
    lengths = np.array(sorted(one.windows))
    holding = [lengths[lengths * w >= 4.0 * np.pi * (1 - 1e-9)] for w in omega]
    length = np.array([own[0] if len(own) else lengths[-1] for own in holding])
    longer = np.maximum(length[:, None], length[None, :])
    return _hann_overlap(np.abs(omega[:, None] - omega[None, :]) * longer / (2.0 * np.pi)) ** 2


def _hann_overlap(bins: np.ndarray) -> np.ndarray:
    """Size of the correlation of two Fourier coefficients of white noise in Hann's window, `bins` = difference of their
    frequencies times the window's length: the transform of the squared window, 3/8 - cos/2 + cos/8, over its mean."""
    total = sum(
        weight * np.sinc(bins - k) for k, weight in ((0, 3 / 8), (1, 1 / 4), (-1, 1 / 4), (2, 1 / 16), (-2, 1 / 16))
    )
    return np.abs(total) / (3 / 8)


def _rows(respond: Respond, measured: Sequence[Measured], values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(rows,) of which the sum of squares is the sum of the costs J, dB then deg of each response, and (rows,
    parameters) their derivatives."""
    rows = []
    slopes = []
    for one in measured:
        found, gradient = respond(one.response, values)
        with np.errstate(all="ignore"):
            error = np.log(found / one.response.response)
        for part, factor in zip((np.real, np.imag), one.factors, strict=True):
            rows.append(part(error) * factor)
            slopes.append(part(gradient) * factor[:, None])
    return np.concatenate(rows), np.concatenate(slopes)


def _noise(measured: Sequence[Measured]) -> np.ndarray:
    """(rows, rows) covariance of the rows but for its size: random errors are as large in gain and in phase."""
    return scipy.linalg.block_diag(
        *(
            np.outer(one.error, one.error) * one.correlation * np.outer(factor, factor)
            for one in measured
            for factor in one.factors
        )
    )


def _covariance(measured: Sequence[Measured], residual: np.ndarray, slopes: np.ndarray) -> np.ndarray:
    """(parameters, parameters) of the estimate, NaN where the rows do not tell the parameters apart."""
    scale = np.linalg.norm(slopes, axis=0)
    scale = 1.0 / np.where(scale > 0.0, scale, 1.0)
    left, singular, right = np.linalg.svd(slopes * scale, full_matrices=False)
    if not singular[-1] > 1e-10 * singular[0]:
        return np.full((len(scale), len(scale)), np.nan)
    gain = scale[:, None] * (right.T / singular) @ left.T  # (parameters, rows) of the estimate by the rows
    noise = _noise(measured)
    rest = np.trace(noise) - np.trace(left.T @ noise @ left)  # what is left of it in the residuals
    return gain @ noise @ gain.T * float(residual @ residual) / rest
