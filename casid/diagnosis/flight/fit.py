"""Fit of a hypothesis to a flight: Gauss-Newton on the innovations, trajectory and parameters together.

How many iterations each fit may take is in `casid/diagnosis/numerics.py`.
"""

from __future__ import annotations

import operator
from collections.abc import Collection, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from casid.diagnosis.flight.evaluation import (
    FlightFit,
    Free,
    Slot,
    Work,
    about_motion,
    evaluate,
    gauss_newton_step,
    predicted,
    smoothed,
)
from casid.diagnosis.flight.hypothesis import Attached, acting_noise
from casid.diagnosis.flight.motion import Motion
from casid.diagnosis.flight.subject import Subject
from casid.diagnosis.numerics import Extent
from casid.errors import InputError
from casid.estimation.solvers.search import longest, rises_from_the_start
from casid.filtering.innovations import NoiseModel, brought_inside, moved_inside
from casid.filtering.kalman import residual_about


def fit(
    flight: Subject,
    attached: Sequence[Attached],
    noise: NoiseModel,
    start: FlightFit | None = None,
    *,
    free: Free = "all",
    extent: Extent | tuple[float, ...] = "settled",
    give_up: float = np.inf,
    anew: bool = False,
    far: bool = False,
) -> FlightFit:
    """Maximum-likelihood estimate of derivatives, effects and trajectory.

    In turbulence, derivatives decide how the air moves the aircraft. If the filter were free, a fit or a cause would
    gain by making the aircraft move less. The filter is therefore that of `start`, so that prediction errors are
    compared. Noise of a recorded input has the same effect on the motion as in `start`, whatever the effectiveness of
    the control. Both are taken from the first point if the fit begins `anew` (see `relaxed`); the filter also if the
    noise differs.

    The fit has converged when the last step changed the sum of squares (`_squares`) by less than `tolerance` and the
    predicted change of the next step is smaller too. The unit of the tolerance is the mean square residual, if that
    exceeds the noise. A step of a small part of a standard deviation is the last one if this holds with the
    sensitivities of the point before it. A fit that starts where it has converged already ends there, and one whose
    next step has a smaller predicted decrease than `tolerance` and does not decrease the sum.

    start       fit from which values (by name) and trajectory are taken; by default the aircraft file and the measured
                motion
    free        what is estimated: "effects" and "offsets" leave out the derivatives, "states" all but the trajectory
    extent      largest number of iterations, and change of the sum of squares at which the fit ends: a field of
                `FitNumerics`, or both numbers
    give_up     a fit that is unlikely to come below this deviance is abandoned after two iterations: twice the
                predicted decrease would not suffice
    anew        whether filter and reference of `start` are ignored
    far         whether prediction errors are compared about the most likely motion, as far from the end, where the
                predicted motion may depart
    FlightFit   the best point found, converged or not
    raises      InputError if the model diverges along the records at the first point
    raises      TimeIsUpError if the time for the search is over, in a fit that the search can do without
    """
    attached = tuple(attached)
    numerics = flight.criteria.numerics.fit
    iterations, tolerance = getattr(numerics, extent) if isinstance(extent, str) else extent
    if start is not None and not anew and start.left < tolerance and _is_of(start, flight, attached, noise, free):
        return start
    work = Work(flight, attached, noise, free)
    if start is not None and start.flight.records is flight.records and not anew:
        work.reference = start.reference
        if start.noise == noise:
            work.filter = start.filter_of_another
    best = now = _first_point(work, attached, start, ahead=work.filter_held and free == "all" and not far)
    count = 1
    gained = np.inf
    refused: list[tuple[float, np.ndarray]] = []  # longer parts of the present step, and what rises there

    def tried(length: float) -> _Point | None:
        nonlocal best, count
        if count >= iterations or (refused and best.left(0.0) < tolerance) or rises_from_the_start(refused[-2:]):
            return None
        count += 1
        flight.limit.check()
        best = best.lighter()
        after = None
        with suppress(InputError):  # a step may be too long
            values = best.fit.values + length * step[0]
            motion = best.fit.motion.moved(step[1], length)
            if not _turned_negative(attached, work.slots, best.fit.values, values):
                after = _flown(work, attached, values, motion)
        if after is None or best.leads_to(after, tolerance, full=length == 1.0):
            return after
        refused.append((length, best.rise(after)))
        return None

    while now is not None:
        work.filter = work.filter or now.fit.filter_of_another
        best = now
        if now.left(gained) < tolerance:
            return now.converged(gained)
        if count >= 2 and now.fit.deviance - 2.0 * now.promise > give_up:
            break
        # of the present point only what `best` keeps stays in memory
        step = gauss_newton_step(now.fit)
        now = None
        refused.clear()
        now = longest(tried)
        gained = np.inf if now is None else abs(best.squares - now.squares)
    return best.converged(0.0) if refused and best.left(0.0) < tolerance else best.fit


def _first_point(work: Work, attached: tuple[Attached, ...], start: FlightFit | None, ahead: bool) -> _Point:
    """The point at which a fit begins; about the predicted motion if it compares prediction errors `ahead`."""
    values = _start_values(work, attached, start)
    motion = _start_motion(work, attached, start, values)
    motion = motion if ahead else replace(motion, predicted=None)
    work.flight.limit.check()
    now = _flown(work, attached, values, motion)
    if not ahead or motion.predicted is not None:
        return now
    work.filter = work.filter or now.fit.filter_of_another
    return _flown(work, attached, values, replace(motion, predicted=predicted(now.fit, *about_motion(now.fit))))


def _is_of(found: FlightFit, flight: Subject, attached: Sequence[Attached], noise: NoiseModel, free: Free) -> bool:
    """Return True if a fit is one of this hypothesis, with these values of its effects."""
    same = len(found.attached) == len(attached) and all(map(operator.is_, found.attached, attached))
    return same and found.flight is flight and found.noise == noise and found.free == free


def from_elsewhere(fitted: FlightFit) -> FlightFit | None:
    """Another fit of a model that ended unconverged and 10 sigmas from the data on average; None for other fits.

    This happens if the model misses something large. The new fit starts from a fit under wider noise, which has fewer
    local minima.
    """
    far = fitted.criteria.parts.tenfold
    if fitted.converged or fitted.deviance < far**2 * fitted.readings:
        return None
    return by_wider_noise(fitted, far)[1]


def by_wider_noise(fitted: FlightFit, factor: float) -> tuple[FlightFit, FlightFit]:
    """The fit anew with measurement noise wider by a factor, and from there with its own noise."""
    wide = replace(fitted.noise, measurement={name: factor * s for name, s in fitted.noise.measurement.items()})
    first = fit(fitted.flight, fitted.attached, wide, extent="settled")
    return first, fit(fitted.flight, fitted.attached, fitted.noise, first, extent="settled")


def without(fitted: FlightFit, names: Collection[str], near: FlightFit | None = None) -> FlightFit:
    """The fit without some of its effects, converged; begun `near` it, with the values of its effects, if that is a
    fit of the same effects in calm air, whose filter is its own."""
    known = fitted.kept.small  # alternatives, needless causes and held-out records ask for the same
    left_out = frozenset(names)
    if ("without", left_out) not in known:
        start = fitted
        others = tuple(a for a in fitted.attached if a.name not in left_out)
        if (
            near is not None
            and not fitted.noise.coloured
            and [a.name for a in near.attached] == [a.name for a in others]
        ):
            start = near
            others = near.attached
        known["without", left_out] = fit(fitted.flight, others, fitted.noise, start, extent="settled")
    return known["without", left_out]


def all_free(fitted: FlightFit) -> FlightFit:
    """The same fit with the sensitivities to derivatives and effects, although they were not estimated."""
    work = Work(fitted.flight, fitted.attached, fitted.noise, "all")
    work.reference = fitted.reference
    return evaluate(work, fitted.attached, _start_values(work, fitted.attached, fitted), fitted.motion)


def relaxed(fitted: FlightFit) -> FlightFit:
    """The fit of everything that is free, converged under its own noise of inputs and its own filter; or the first that
    predicts worse than the fit before."""
    numerics = fitted.criteria.numerics.fit
    lowest = np.inf
    for _ in range(numerics.repeats if fitted.filter_held else 1):
        before = fitted = fitted.lighter(filtered=False)  # it is fitted anew, under a filter of its own
        attached = [replace(one, passes=True) for one in before.attached]
        fitted = fit(before.flight, attached, before.noise, before, extent="settled", anew=True)
        stays = np.all(
            np.abs(fitted.values - before.values) < fitted.criteria.parts.half * np.sqrt(np.diag(before.covariance))
        )
        if stays or fitted.deviance > lowest:
            break
        lowest = fitted.deviance
    return fitted


def _turned_negative(
    attached: Sequence[Attached], slots: Sequence[Slot], before: np.ndarray, after: np.ndarray
) -> bool:
    """Return True if a value that cannot be negative has become so, such as a lag: the step to it was too long."""
    own = {one.name: one.effect for one in attached}
    for slot, old, new in zip(slots, before, after, strict=True):
        effect = own.get(slot.name) if slot.attached is None else attached[slot.attached].effect
        if effect is not None and new < 0.0 < old and (slot.key or "value") in effect.further.unsigned:
            return True
    return False


def _flown(work: Work, attached: tuple[Attached, ...], values: np.ndarray, motion: Motion) -> _Point:
    """The hypothesis evaluated at a point; raises InputError if the model diverges, or if all readings are so late that
    none is left to compare.
    """
    try:
        found = evaluate(work, _with_values(attached, work.slots, values), values, motion)
        if found.readings == 0:
            raise InputError(f"'{work.flight.title}': every reading is late by more than its record lasts")
        return _Point.of(found)
    except np.linalg.LinAlgError as error:
        raise InputError(
            f"'{work.flight.title}' diverges along the records or leaves the range in which it has numbers, so that "
            "nothing can be compared; check the units and signs of its values and of the records' channels"
        ) from error


@dataclass(frozen=True, eq=False)
class _Point:
    """A point of the iteration.

    `squares`  sum of squares that the steps decrease
    `promise`  predicted decrease by the next full step
    """

    fit: FlightFit
    squares: float
    promise: float

    @classmethod
    def of(cls, fit: FlightFit) -> _Point:
        return cls(fit, _squares(fit), float(fit.gradient @ fit.covariance @ fit.gradient))

    def lighter(self) -> _Point:
        """The point without the arrays of its fit: those of one point are in memory at a time."""
        return replace(self, fit=self.fit.lighter())

    @property
    def misfit(self) -> float:
        """Mean square residual, at least 1."""
        return max(1.0, self.squares / self.fit.readings)

    def rise(self, now: _Point) -> np.ndarray:
        """(2,) Increase of the sum of squares and of the deviance from this point to `now`."""
        return np.array([now.squares - self.squares, now.fit.deviance - self.fit.deviance])

    def left(self, gained: float) -> float:
        """Return what may still change after a step that `gained`, over the mean square residual."""
        return max(gained, self.promise) / self.misfit

    def converged(self, gained: float) -> FlightFit:
        """The fit that ends here, after a step that `gained`."""
        return self.fit.ended(self.left(gained))

    def leads_to(self, now: _Point, tolerance: float, *, full: bool) -> bool:
        """Return True if the point `now` is nearer to the maximum than this one, or equally near within `tolerance`.

        The sum of squares is that of the model linearised about the motion. It is too low while the motion is not the
        most likely one, and a correct full step near the maximum may increase it. After such a step the predicted
        decrease is smaller (natural monotonicity, Deuflhard). Far from the maximum this criterion may mislead, so it
        must be much smaller there; where noise drives the motion, the sum of squares must be nearly as low besides.
        """
        if now.squares - self.squares < tolerance * now.misfit or now.fit.deviance < self.fit.deviance:
            return True
        left = now.promise / self.promise if self.promise else np.inf
        numerics = now.fit.criteria.numerics.fit
        much = left < now.fit.criteria.parts.quarter
        as_low = now.squares < (1.0 + numerics.stays) * self.squares
        nearer = (much and as_low) if now.fit.noise.coloured else (much or (left < 1.0 and as_low))
        return full and nearer


def _squares(now: FlightFit) -> float:
    """The quantity that Gauss-Newton steps decrease.

    It is the sum of squares with the prior and without the log determinant of the covariance. Noise in a regressor
    biases an estimate towards zero; the most likely noise, which the regressors contain, compensates for this. The
    gradient with such regressors is that of this sum, in which noise has its likelihood as a cost (orthogonal
    distance). It is not that of the deviance, by which models are compared. Fits that used the deviance stopped at any
    point between the two minima.
    """
    measured, compared = (seen.sum(axis=(0, 1)) for seen in (np.isfinite(now.batch.Z), now.seen))
    by_channel = np.sum(now.white**2, axis=(0, 1)) * measured / np.maximum(compared, 1)  # a late reading loses its last
    return float(by_channel.sum()) + now.deviance - now.data_deviance


def _start_motion(work: Work, attached: tuple[Attached, ...], start: FlightFit | None, values: np.ndarray) -> Motion:
    """The motion at which the iteration starts.

    Without `start` it is the result of the filter with the measured motion. The deviance of a model linearised about a
    noisy motion is not comparable with another, and a line search that starts there may not leave it.
    """
    acting = acting_noise(work.noise, attached, work.dt)
    shape = work.batch.live.shape
    still = Motion(
        X=work.flight.measured(work.model),
        coloured=np.zeros((*shape, len(acting.coloured))),
        inputs=np.zeros((*shape, len(acting.inputs))),
    )
    if start is None or start.flight.records is not work.flight.records:
        P = work.parameters(values, attached)
        still = replace(still, X=brought_inside(work.functions, work.batch, P, still.X))
        measured = _flown(work, attached, values, still).fit
        step = smoothed(measured, *residual_about(measured.linear, measured.acting, still.coloured))
        return replace(still.moved(step), X=moved_inside(work.functions, work.batch, P, still.X, step.X))
    before = start.motion
    same = tuple(start.acting.coloured) == tuple(acting.coloured)
    found = Motion(
        X=_carried(work.model.states, start.model.states, before.X, still.X),
        coloured=before.coloured if same else still.coloured,
        inputs=_carried(acting.inputs, start.acting.inputs, before.inputs, still.inputs),
    )
    if not (work.filter_held and same and before.predicted is not None):
        return found
    now = np.concatenate([found.X, found.coloured], axis=2)
    names, known = ((*model.states, *acting.coloured) for model in (work.model, start.model))
    return replace(found, predicted=_carried(names, known, before.predicted, now))


def _carried(names: Iterable[str], known: Iterable[str], before: np.ndarray, otherwise: np.ndarray) -> np.ndarray:
    """(N, R, names) Columns of `before`, which has those of `known`; missing columns are taken from `otherwise`."""
    found = otherwise.copy()
    at = list(known)
    for i, name in enumerate(names):
        if name in at:
            found[..., i] = before[..., at.index(name)]
    return found


def _start_values(work: Work, attached: Sequence[Attached], start: FlightFit | None) -> np.ndarray:
    """Initial values of all parameters, from `attached`, `start` or the file."""
    before = {} if start is None else {s.name: v for s, v in zip(start.slots, start.values, strict=True)}
    own = {a.name: a for a in attached}
    values = []
    for slot in work.slots:
        if slot.attached is not None:
            values.append(attached[slot.attached].values[slot.key])
        elif slot.name in own:
            values.append(own[slot.name].values["value"])
        else:
            values.append(before.get(slot.name, work.model.nominal[slot.name]))
    return np.array(values, dtype=float)


def _with_values(attached: Sequence[Attached], slots: Sequence[Slot], values: np.ndarray) -> tuple[Attached, ...]:
    """The effects with the values of a point."""
    by_effect: dict[int, dict[str, float]] = {}
    names = {a.name: i for i, a in enumerate(attached)}
    for slot, value in zip(slots, values, strict=True):
        if slot.attached is not None:
            by_effect.setdefault(slot.attached, {})[slot.key] = float(value)
        elif slot.name in names:
            by_effect.setdefault(names[slot.name], {})["value"] = float(value)
    return tuple(a.with_values(by_effect.get(i, {})) for i, a in enumerate(attached))
