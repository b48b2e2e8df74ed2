"""Evaluation of a hypothesis at given values: its innovations, and their sensitivities to all fitted parameters."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Generic, Literal, TypeVar

import numpy as np
from scipy.linalg import get_blas_funcs

from casid.diagnosis.criteria import Criteria
from casid.diagnosis.flight.hypothesis import (
    OFFSET,
    Attached,
    HistorySlope,
    Slopes,
    acting_noise,
    disturbance_series,
    prior,
    readings,
)
from casid.diagnosis.flight.kept import Kept
from casid.diagnosis.flight.motion import AlongMotion, Motion, along_motion
from casid.diagnosis.flight.subject import Subject
from casid.filtering.innovations import Batch, Linear, NoiseModel, PointFunctions, linearise, scattered
from casid.filtering.kalman import Filter, coloured_news, kalman_filter, residual_about
from casid.filtering.kernel import COLUMNS, SAMPLES
from casid.model import operators
from casid.model.causes.instruments import group_channels
from casid.model.path import STATES
from casid.model.station import Station
from casid.model.system import Model

# What is estimated beside the motion: derivatives and effects; effects alone; effects and small offsets of all
# instruments; nothing.
Free = Literal["all", "effects", "offsets", "states"]

# Sensitivities, and time histories along the motion: most of the size of a fit.
_LARGE = frozenset(["linear", "filter", "slopes", "ends", "columns", "known", "regressors"])
(_SYRK,) = get_blas_funcs(("syrk",), dtype="d")
_ROWS = COLUMNS * SAMPLES  # of sensitivities that stay in the processor's cache
T = TypeVar("T")


class _Computed(Generic[T]):
    """An attribute of a fit that is computed where it is not at hand: by a function, or by an evaluation of the fit."""

    def __init__(self, by: Callable[[FlightFit], T] | None = None) -> None:
        self.by = by

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    def __get__(self, fit: FlightFit, owner: type) -> T:
        small = fit.kept.small
        kept = fit.kept.arrays if self.name in _LARGE and self.name not in small else small
        if self.name not in kept and self.by is not None:
            kept[self.name] = self.by(fit)
        elif self.name not in kept:
            work = Work(fit.flight, fit.attached, fit.noise, fit.free)
            work.reference = fit.reference
            work.filter = fit.filter_of_another
            again = evaluate(work, fit.attached, fit.values, fit.motion).kept
            fit.kept.small = again.small | small
            fit.kept.arrays.update(again.arrays)
            kept = fit.kept.small | again.arrays
        return kept[self.name]


@dataclass(frozen=True, eq=False, kw_only=True)
class Slot:
    """One fitted parameter: a parameter of the model, or a value of an attached effect that enters a time series."""

    name: str
    attached: int | None = None
    key: str = ""


@dataclass(frozen=True, eq=False, kw_only=True)
class FlightFit:
    """A fitted hypothesis: its values and its motion. Whatever else it has is computed from them on demand."""

    flight: Subject
    attached: tuple[Attached, ...]
    free: Free  # what was estimated
    noise: NoiseModel  # noise of instruments and recorded inputs
    acting: NoiseModel  # the same as changed by the attached effects
    held: NoiseModel  # the same, with noise of inputs that has the effect on the motion that it has in `reference`
    reference: dict[str, np.ndarray]
    filter_of_another: Filter | None = None  # from which that of this fit follows, where it must not be its own
    parameters: np.ndarray  # (R, np) parameters of the model in every record
    slots: tuple[Slot, ...]
    values: np.ndarray  # (slots,) estimates
    covariance: np.ndarray  # (slots, slots) their covariance under the assumed noise
    gradient: np.ndarray  # (slots,) gradient of the log likelihood; zero at a maximum
    motion: Motion  # its motion, about which the model is linearised
    prior_pull: np.ndarray  # (slots,) gradient of the prior
    prior_weight: np.ndarray  # (slots,) inverse variance of the prior
    readings: int  # number of readings that are compared
    deviance: float  # -2 log likelihood up to a constant of the data, prior included
    data_deviance: float  # the same without the prior
    converged: bool = False
    # change of the sum of squares in the last step, or predicted for the next, over the mean square residual
    left: float = np.inf
    kept: Kept = field(default_factory=Kept, init=False, repr=False)  # what was computed of it

    model = _Computed[Model]()
    batch = _Computed[Batch]()
    functions = _Computed[PointFunctions]()
    linear = _Computed[Linear]()
    filter = _Computed[Filter]()
    output = _Computed[np.ndarray]()  # (N, R, ny) outputs of the model, before effects of the instruments
    read = _Computed[np.ndarray]()  # (N, R, ny) readings
    seen = _Computed[np.ndarray]()  # (N, R, ny) True for readings that are compared, at the time that they refer to
    disturbances = _Computed[np.ndarray]()  # (N, R, nw) disturbances by attached effects
    errors = _Computed[np.ndarray]()  # (N, R, ni) correction of the recorded inputs in `known`
    white = _Computed[np.ndarray]()  # (N, R, ny) innovations
    slopes = _Computed[Slopes]()  # slopes of the model by the slots
    # states and disturbances (N-1, R, n) at the ends of intervals, where these are not those of the next sample
    ends = _Computed[tuple[np.ndarray, np.ndarray] | None](lambda fit: fit.slopes.ends)
    columns = _Computed[np.ndarray]()  # (N, R, ny, slots) whitened sensitivities
    grams = _Computed[np.ndarray]()  # (R, slots, slots) their products with each other, in every record
    pulls = _Computed[np.ndarray]()  # (R, slots) and with the innovations
    # name -> (N, R) denoised motion and inputs, from which effects are computed; and the same as the aerodynamics see
    # them, with effects on surfaces and wind included
    known = _Computed[dict[str, np.ndarray]](lambda fit: _along(fit).known)
    regressors = _Computed[dict[str, np.ndarray]](lambda fit: _regressors(fit))

    def lighter(self, filtered: bool = True) -> FlightFit:
        """The fit without its sensitivities, to save memory; not `filtered`, also without the filter of another, which
        a fit of another noise does not take from it."""
        found = replace(self, filter_of_another=self.filter_of_another if filtered else None)
        return _with_arrays(found, {n: one for n, one in self.kept.small.items() if n in _COMPUTED})

    def without_histories(self) -> FlightFit:
        """The fit with its values and its motion alone."""
        kept = self.kept.small
        return _with_arrays(replace(self), {n: kept[n] for n in ("model", "batch", "functions") if n in kept})

    def of_records(self, some: slice | list[int]) -> FlightFit:
        """The time histories, filter and sensitivities of some records; estimates are those of all."""
        names = ("output", "read", "seen", "disturbances", "errors", "white", "columns")
        arrays = {name: getattr(self, name)[:, some] for name in names}
        for name in ("known", "regressors"):
            arrays[name] = {key: of[:, some] for key, of in getattr(self, name).items()}
        arrays |= {"batch": self.batch.of_records(some), "filter": self.filter.of_records(some)}
        arrays["linear"] = arrays["filter"].linear
        arrays |= {"grams": self.grams[some], "pulls": self.pulls[some]}
        arrays["ends"] = None if self.ends is None else tuple(one[:, some] for one in self.ends)
        found = replace(self, motion=self.motion.of_records(some), parameters=self.parameters[some])
        found.kept.small.update(model=self.model, functions=self.functions, **arrays)  # they are not computed again
        return found

    def ended(self, left: float) -> FlightFit:
        """The converged fit that ends here; `left` is what may still change.

        Its large arrays may be those of the point before: they are computed at its end, so that what follows does not
        depend on which of them are still there.
        """
        own = {name: one for name, one in self.kept.small.items() if name in _COMPUTED}
        return _with_arrays(replace(self, converged=True, left=left), own)

    def __getitem__(self, name: str) -> float:
        """The estimate of a parameter by name."""
        return float(self.values[[s.name for s in self.slots].index(name)])

    def std(self, name: str) -> float:
        """The standard deviation of a parameter by name."""
        index = [s.name for s in self.slots].index(name)
        return float(np.sqrt(self.covariance[index, index]))

    def output_along(self, X: np.ndarray) -> np.ndarray:
        """(N, R, ny) Outputs of the fitted model along a trajectory, before effects of the instruments."""
        return self.functions.output(X, self.batch.U, self.parameters, self.disturbances)

    @property
    def criteria(self) -> Criteria:
        """The thresholds for all decisions made with this fit."""
        return self.flight.criteria

    @property
    def moving(self) -> np.ndarray:
        """(N, R, nw) All disturbances of the linearisation."""
        W = scattered(self.model, self.acting.coloured, self.motion.about[1])
        return self.disturbances + W + scattered(self.model, self.acting.inputs, self.errors)

    @property
    def filter_held(self) -> bool:
        """Return True if the filter must be that of another fit.

        This is so in turbulence if a parameter is estimated that decides how the air moves the aircraft: a derivative,
        or the offset of an instrument, since one is that of the airspeed.
        """
        return _is_held(self.flight, self.noise, self.slots)

    @property
    def noise_held(self) -> bool:
        """Return True if the noise of an input differs clearly from that which the effectiveness in this fit implies.

        It is also true if the noise does not yet pass through an effect that it should pass through.
        """
        if any(one.effect.forms.noise is not None and not one.passes for one in self.attached):
            return True
        change = self.criteria.parts.quarter
        return any(abs(held / self.noise.inputs[name] - 1.0) > change for name, held in self.held.inputs.items())

    @property
    def derivatives(self) -> dict[str, float]:
        """Fitted derivatives and terms of the aircraft file."""
        given = {name for name in self.flight.model().parameters if not name.startswith(OFFSET)}
        return {s.name: float(v) for s, v in zip(self.slots, self.values, strict=True) if s.name in given}


def _is_held(flight: Subject, noise: NoiseModel, slots: Sequence[Slot]) -> bool:
    """See `FlightFit.filter_held`."""
    own = flight.model().parameters
    return bool(noise.coloured) and any(slot.name.startswith(OFFSET) or slot.name in own for slot in slots)


def _with_arrays(fit: FlightFit, arrays: Mapping[Any, Any]) -> FlightFit:
    """The fit, with what is at hand of its arrays."""
    fit.kept.small.update({name: one for name, one in arrays.items() if name not in _LARGE})
    if large := {name: one for name, one in arrays.items() if name in _LARGE}:
        fit.kept.arrays.update(large)
    return fit


_COMPUTED = frozenset(name for name, one in vars(FlightFit).items() if isinstance(one, _Computed))


class Work:
    """Data that stay the same over the iterations of one fit."""

    def __init__(self, flight: Subject, attached: Sequence[Attached], noise: NoiseModel, free: Free) -> None:
        self.flight = flight
        self.noise = noise
        self.free: Free = free
        self.model = flight.model([a.effect for a in attached])
        self.batch = flight.batch(self.model)
        self.dt = float(np.median(self.batch.dt))
        symbolic = [a.name for a in attached if a.effect.symbolic]
        aerodynamic = flight.freed
        offsets = [OFFSET + name for name in self.model.outputs]
        by_free = {"all": [*aerodynamic, *symbolic], "effects": symbolic, "offsets": [*offsets, *symbolic]}
        names = by_free.get(free, [])
        self.functions = flight.functions(self.model)
        self.by_parameters = self.functions.by_parameters(names)
        self.regressors = flight.regressors(self.model)
        numeric = [] if free == "states" else [(i, key) for i, a in enumerate(attached) for key in a.numeric]
        self.slots = (
            *(Slot(name=name) for name in names),
            *(
                Slot(name=attached[i].name + ("" if key == "value" else f".{key}"), attached=i, key=key)
                for i, key in numeric
            ),
        )
        names = [slot.name if slot.attached is None else None for slot in self.slots]
        self.mean, self.weight = prior(flight, self.model, names)
        nuisance = {a.name: flight.smallest_that_matters(a.effect) or np.inf for a in attached if a.nuisance}
        for i, slot in enumerate(self.slots):
            if slot.name in nuisance:
                self.weight[i] = nuisance[slot.name] ** -2.0
            elif slot.attached is not None and slot.key in (usual := attached[slot.attached].effect.further.usual):
                self.mean[i] = usual[slot.key][0]
                self.weight[i] = usual[slot.key][1] ** -2.0
        self.reference: dict[str, np.ndarray] = {}
        self.filter: Filter | None = None
        self.filter_held = _is_held(flight, noise, self.slots)  # as `FlightFit.filter_held`

    def with_recorded(self, known: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """The series from which effects are computed during a fit: the inputs as recorded.

        With the most likely inputs, effects would depend on a motion that does not yet include them, and a fit would
        stop before its maximum.
        """
        return known | self.regressors.recorded

    def seen_earlier(self, late: np.ndarray) -> Batch:
        """The batch with readings at the time that they refer to, where the sensitivities are needed."""
        return replace(self.batch, Z=np.where(earlier(np.isfinite(self.batch.Z), late), 0.0, np.nan))

    def series(self, attached: Sequence[Attached], known: dict[str, np.ndarray]) -> np.ndarray:
        """(N, R, nw) Time histories of attached effects.

        They are computed from denoised inputs, except for effects whose transmission of noise is modelled.
        """
        names = self.batch.names
        t = self.batch.t
        stations = self.model.disturbances
        passing = [one for one in attached if one.passes_noise]
        others = [one for one in attached if one not in passing]
        recorded = known | {name: self.batch.U[..., i] for i, name in enumerate(self.model.inputs)}
        W = disturbance_series(others, names, t, known, stations)
        return W + disturbance_series(passing, names, t, recorded, stations) if passing else W

    def parameters(self, values: np.ndarray, attached: Sequence[Attached]) -> np.ndarray:
        """(R, np) Parameters of every record."""
        P = np.tile(self.model.nominal_vector(), (len(self.batch.names), 1))
        for slot, value in zip(self.slots, values, strict=True):
            if slot.attached is None:
                P[:, self.model.parameters.index(slot.name)] = value
        for one in attached:
            if one.effect.symbolic:
                index = self.model.parameters.index(one.name)
                if one.name not in {slot.name for slot in self.slots}:
                    P[:, index] = one.values["value"]
                P[:, index] *= [one.concerns(record) for record in self.batch.names]
        return P

    def slopes(
        self,
        attached: Sequence[Attached],
        batch: Batch,
        P: np.ndarray,
        moving: np.ndarray,
        ends: tuple[np.ndarray, np.ndarray] | None,
        histories: tuple[HistorySlope, ...],
    ) -> Slopes:
        """The slopes by all slots; a symbolic effect has none in records in which it does not act."""
        effects = {a.name: a for a in attached if a.effect.symbolic}
        present = np.ones((len(batch.names), len(self.slots)))
        for i, slot in enumerate(self.slots):
            if slot.attached is None and slot.name in effects:
                present[:, i] = [effects[slot.name].concerns(record) for record in batch.names]
        return Slopes(
            functions=self.by_parameters,
            batch=batch,
            parameters=P,
            moving=moving,
            ends=ends,
            present=present,
            histories=histories,
        )


def _along(fit: FlightFit, further: np.ndarray | float = 0.0) -> AlongMotion:
    return along_motion(fit.flight.regressors(fit.model), fit.model, fit.acting, fit.motion, further)


def _regressors(fit: FlightFit) -> dict[str, np.ndarray]:
    quiet = disturbance_series(fit.attached, fit.batch.names, fit.batch.t, fit.known, fit.model.disturbances)
    return _along(fit, quiet).known if quiet.any() else fit.known


def evaluate(work: Work, attached: tuple[Attached, ...], values: np.ndarray, motion: Motion) -> FlightFit:
    """The hypothesis at given values of its parameters, along a motion."""
    batch = work.batch
    model = work.model
    acting = acting_noise(work.noise, attached, work.dt)
    along = along_motion(work.regressors, model, acting, motion)
    at = [model.inputs.index(Station.at(name).name) for name in acting.inputs]
    errors = along.inputs[..., at] - batch.U[..., at]
    of_histories = any(one.effect.series is not None or one.effect.output is not None for one in attached)
    made_of = work.with_recorded(along.known) if of_histories else {}
    W = work.series(attached, made_of)
    P = work.parameters(values, attached)
    late = lateness(attached, work.flight, model)
    seen = np.isfinite(batch.Z)
    moved = work.seen_earlier(late) if late.any() else batch
    X, coloured = motion.about
    moving = W + scattered(model, acting.coloured, coloured) + scattered(model, acting.inputs, errors)
    ahead = motion.predicted is not None
    news = None
    if ahead:
        news = scattered(model, acting.coloured, coloured_news(batch.dt, acting, coloured))
    linear = linearise(work.functions, moved, P, X, moving, news)
    read = readings(attached, batch.names, batch.t, linear.output, model.outputs, made_of)
    residual = np.where(seen, batch.Z - read, 0.0)
    linear = replace(linear, residual=earlier(residual, late) if late.any() else residual)
    held, reference = held_noise(work.noise, linear, work.reference, work.flight.criteria.significance.sigmas)
    acting = acting_noise(held, attached, work.dt)  # the same names as before, with the effect of the reference
    kalman = kalman_filter(linear, acting) if work.filter is None else work.filter.along(linear, acting)
    histories = _slopes_of_histories(work, attached, linear, made_of, late)
    ends = None if news is None else _without_news(linear, moving, news)
    slopes = work.slopes(attached, moved, P, moving, ends, histories)
    about = residual_about(linear, acting, coloured, errors, kalman.through)
    white = kalman.predicted(*about)[0] if ahead else kalman.whiten(*about)[..., 0]
    if not np.abs(white).max(initial=0.0) < np.finfo(float).max ** 0.25:
        raise np.linalg.LinAlgError("the innovations are so large that their squares have no sum")
    columns = slopes.whitened(kalman)
    deviation = values - work.mean
    data = float(np.sum(white**2) + np.sum(kalman.log_determinant)) + _lost(kalman, white, seen)
    pull = work.weight * deviation
    grams, pulls = _products(columns, white)
    found = FlightFit(
        held=held,
        reference=reference,
        acting=acting,
        covariance=scaled_inverse(grams.sum(axis=0) + np.diag(work.weight)),
        gradient=pulls.sum(axis=0) - pull,
        flight=work.flight,
        attached=attached,
        free=work.free,
        noise=work.noise,
        parameters=P,
        slots=work.slots,
        values=values,
        motion=motion,
        prior_pull=pull,
        prior_weight=work.weight,
        readings=int(linear.seen.sum()),
        data_deviance=data,
        deviance=data + float(np.sum(work.weight * deviation**2)),
    )
    if work.filter_held:
        found = replace(found, filter_of_another=replace(kalman, linear=kalman.through))
    arrays = {"model": model, "batch": batch, "functions": work.functions, "linear": linear, "filter": kalman}
    arrays |= {"output": linear.output, "read": read, "seen": linear.seen, "disturbances": W, "errors": errors}
    arrays |= {"white": white, "slopes": slopes, "columns": columns, "grams": grams, "pulls": pulls}
    return _with_arrays(found, arrays | ({"known": along.known} if of_histories else {}))


def _without_news(linear: Linear, moving: np.ndarray, news: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """States and disturbances (N-1, R, n) that are predicted for the end of each interval, before the next sample."""
    return linear.X[1:] + linear.defect - (linear.Bw1 @ news[..., None])[..., 0], moving[1:] - news


def by_rows(columns: np.ndarray) -> np.ndarray:
    """(R N ny, slots) Whitened sensitivities (N, R, ny, slots) one record after the other, as they are in memory."""
    return columns.swapaxes(0, 1).reshape(math.prod(columns.shape[:3]), columns.shape[3])


def _products(columns: np.ndarray, white: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(R, slots, slots) and (R, slots) Products of whitened sensitivities (N, R, ny, slots) with each other and with
    innovations (N, R, ny), of so few rows at a time that they are read from memory once."""
    N, R, ny, k = columns.shape
    grams = [Gram(k) for _ in range(R)]
    pulls = np.zeros((R, k))
    rows = by_rows(columns).reshape(R, N * ny, k)
    residual = white.swapaxes(0, 1).reshape(R, N * ny)
    for r, gram in enumerate(grams):
        for first in range(0, N * ny, _ROWS):
            some = rows[r, first : first + _ROWS]
            gram.add(some)
            pulls[r] += residual[r, first : first + _ROWS] @ some
    return np.array([gram.whole for gram in grams]), pulls


class Gram:
    """Product of transposed columns with themselves, summed over parts of their rows, at half the cost of a general
    product."""

    def __init__(self, columns: int) -> None:
        self._half = np.zeros((columns, columns), order="F")

    def add(self, columns: np.ndarray) -> None:
        """Add the product of further rows (rows, columns)."""
        if columns.size:
            self._half = _SYRK(1.0, columns.T, 1.0, self._half, overwrite_c=1)

    @property
    def whole(self) -> np.ndarray:
        return self._half + np.triu(self._half, 1).T


def gram_of(columns: np.ndarray) -> np.ndarray:
    """Product of the transposed columns with themselves."""
    gram = Gram(columns.shape[1])
    gram.add(columns)
    return gram.whole


def _lost(kalman: Filter, white: np.ndarray, seen: np.ndarray) -> float:
    """Contribution to the deviance of the samples that late readings lose at the end of a record.

    It is estimated with the mean of the other samples of the channel.
    """
    kept = kalman.linear.seen.sum(axis=(0, 1))
    all_of_it = seen.sum(axis=(0, 1))
    if np.array_equal(kept, all_of_it):
        return 0.0
    by_channel = white**2 - 2.0 * np.log(np.diagonal(kalman.inverse_root, axis1=2, axis2=3))
    by_channel = by_channel + kalman.colouring.log_determinant
    mean = np.where(kalman.linear.seen, by_channel, 0.0).sum(axis=(0, 1)) / np.maximum(kept, 1)
    return float(((all_of_it - kept) * mean).sum())


def scaled_inverse(information: np.ndarray, rcond: float = 1e-13) -> np.ndarray:
    """Inverse of information matrices (..., n, n), scaled to unit diagonal.

    Directions without information have none in the inverse either. Information below 1e-30 is rounding, as for the end
    of an event that outlasts the records.
    """
    diagonal = np.diagonal(information, axis1=-2, axis2=-1)
    scale = np.where(diagonal > 1e-30, 1.0 / np.sqrt(np.maximum(diagonal, 1e-30)), 0.0)
    row = scale[..., :, None]
    column = scale[..., None, :]
    return np.linalg.pinv(information * row * column, rcond=rcond, hermitian=True) * row * column


def _slopes_of_histories(
    work: Work, attached: Sequence[Attached], linear: Linear, known: dict, late: np.ndarray
) -> tuple[HistorySlope, ...]:
    """Derivatives of the time histories by the values of attached effects that are made of them."""
    batch = work.batch
    model = work.model
    found = []
    for slot in work.slots:
        if slot.attached is None:
            continue
        one = attached[slot.attached]
        moved = one.along(slot.key)
        if one.effect.series is not None:
            change = np.imag(work.series([moved], known)) / operators.IMAGINARY
            acting = np.flatnonzero(change.any(axis=(0, 1)))
            found.append(HistorySlope(stations=acting, series=change[..., acting]))  # of no stations if it does nothing
        else:
            chain = [moved if a is one else a for a in attached]
            read = readings(chain, batch.names, batch.t, linear.output, model.outputs, known)
            change = earlier(np.imag(read) / operators.IMAGINARY, late)
            seen = np.where(linear.seen, change, 0.0)
            found.append(HistorySlope(stations=np.zeros(0, dtype=int), series=seen))
    return tuple(found)


def gauss_newton_step(now: FlightFit) -> tuple[np.ndarray, Motion]:
    """Change of values and motion by one full Gauss-Newton step."""
    change = now.covariance @ now.gradient
    Y, F, first = about_motion(now)
    read, driven = now.slopes.along(now.linear, change)
    F[:, :, : len(now.model.states)] -= driven
    return change, smoothed(now, Y - read, F, first)


def about_motion(now: FlightFit) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The residual about the motion of a fit (`residual_about`)."""
    return residual_about(now.linear, now.acting, now.motion.about[1], now.errors, now.filter.through)


def smoothed(now: FlightFit, Y: np.ndarray, F: np.ndarray, first: np.ndarray) -> Motion:
    """Change to the most likely motion, given a residual, and to the predicted one."""
    moved, noise = now.filter.smooth(Y, F, first)
    most = now.criteria.significance.sigmas * np.array(list(now.acting.inputs.values()))
    nx = now.motion.X.shape[2]
    noise = np.where(now.batch.live[..., None], np.clip(noise, -most, most), 0.0)
    motion, (X, coloured) = now.motion, now.motion.about
    ahead = None if motion.predicted is None else predicted(now, Y, F, first) - motion.predicted
    return Motion(
        X=X + moved[..., :nx] - motion.X,
        coloured=coloured + moved[..., nx:] - motion.coloured,
        inputs=noise - motion.inputs,
        predicted=ahead,
    )


def predicted(now: FlightFit, Y: np.ndarray, F: np.ndarray, first: np.ndarray) -> np.ndarray:
    """(N, R, nx + nc) States and coloured disturbances as predicted from the samples before, given a residual."""
    about = np.concatenate(now.motion.about, axis=2)
    return about + now.filter.predicted(Y, F, first)[1][..., : about.shape[2]]


def held_noise(
    noise: NoiseModel, linear: Linear, reference: Mapping[str, np.ndarray] | None, most: float
) -> tuple[NoiseModel, dict[str, np.ndarray]]:
    """The noise with inputs whose noise has the same effect on the motion as in the reference, and the reference.

    Without a reference, the effect in this model is used; `most` is as in `as_strong`.
    """
    into = _into_the_motion(linear, noise.inputs)
    reference = dict(reference or into)
    strength = {name: s * as_strong(into[name], reference[name], most) for name, s in noise.inputs.items()}
    return replace(noise, inputs=strength), reference


def _into_the_motion(linear: Linear, inputs: Iterable[str]) -> dict[str, np.ndarray]:
    """Name -> (states of an aircraft,) mean effect of the noise of an input on the motion, in typical sizes."""
    model = linear.model
    names = list(inputs)
    at = [model.disturbances.index(name) for name in names]
    drive = (linear.Bw0.mean(axis=(0, 1)) + linear.Bw1.mean(axis=(0, 1)))[:, at] / model.scale_vector()[:, None]
    rows = [i for i, state in enumerate(model.states) if state in STATES]
    return dict(zip(names, drive[rows].T, strict=True))


def as_strong(into: np.ndarray, reference: np.ndarray, most: float) -> float:
    """Factor of the noise of an input that limits its effect on the motion to that in the reference.

    A cause must not gain by making a control more effective, so that its noise explains other errors. A less effective
    control does not increase the noise either, because the noise was measured. The factor is between 1/`most` and 1.
    """
    ratio = abs(float(into @ reference)) / max(float(reference @ reference), 1e-300)
    return float(np.clip(1.0 / max(ratio, 1e-300), 1.0 / most, 1.0))


def lateness(attached: Sequence[Attached], flight: Subject, model: Model) -> np.ndarray:
    """(R, ny) Delay of a reading in samples; the reading is compared with the state at the time that it refers to."""
    outputs = model.outputs
    records = flight.records
    late = np.zeros((len(records), len(outputs)), dtype=int)
    for one in (a for a in attached if a.effect.traits.late):
        rows = [outputs.index(c) for c in group_channels(one.effect.target) if c in outputs]
        for j, record in enumerate(records):
            late[j, rows] += round(one.values["value"] / record.dt) if one.concerns(record.name) else 0
    return np.maximum(late, 0)


def earlier(series: np.ndarray, late: np.ndarray) -> np.ndarray:
    """(N, R, ny, ...) Series of readings moved to the time that they refer to; zero at the end."""
    moved = series.copy()
    for j, i in np.argwhere(late):
        k = min(late[j, i], len(series))
        moved[: len(series) - k, j, i] = series[k:, j, i]
        moved[len(series) - k :, j, i] = 0
    return moved


def as_read(late: np.ndarray, series: np.ndarray) -> np.ndarray:
    """(N, R, ny, ...) Series of a fit with each reading at the time at which it was made; the inverse of `earlier`."""
    if not late.any():
        return series
    moved = series.copy()
    for j, i in np.argwhere(late):
        k = min(late[j, i], len(series))
        moved[k:, j, i] = series[: len(series) - k, j, i]
        moved[:k, j, i] = 0
    return moved
