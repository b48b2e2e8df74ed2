"""A dynamic system linearised along its records, for the innovations: the whitened residual.

The model is linearised about a nominal trajectory, the deviation from it goes through a time-varying Kalman filter (see
`kalman`). What comes out of the filter is white with unit variance when the model is right. The filter is a fixed
linear operator on (output residual, state defect), so residual, parameter sensitivities and any candidate's fingerprint
go through it side by side. Without process noise it is output error; with unknown forces and moments, flight path
reconstruction.

Legend: N samples (longest record), R records, n states with coloured disturbances, ny outputs, nw disturbances,
nc columns. Arrays run (time, record, ...); shorter records are padded and masked.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import casadi as ca
import numpy as np

from casid.errors import InputError
from casid.filtering.kernel import filter_kernel
from casid.model.splines import cubic_inputs
from casid.model.system import Model, runge_kutta
from casid.native.compiler import BUILDING, Compilable
from casid.records.record import Record

_HALVINGS = 20  # of a step at a sample
_AWAY = (0.1, 1.0)  # of the usual size of a state
_BLOCK = 256  # points per call of a mapped CasADi function: their arrays stay in the processor's cache


@dataclass(frozen=True, kw_only=True)
class NoiseModel:
    """Random part of a model: noise of measurements, inputs and states."""

    measurement: Mapping[str, float]  # output -> 1-sigma, white from sample to sample
    # disturbance -> 1-sigma of the noise of a recorded input: white from sample to sample and, like the input, linear
    # or held between; a sample's acts in both intervals beside it and in its outputs
    inputs: Mapping[str, float] = field(default_factory=dict)
    # disturbance -> 1-sigma, white from sample to sample and held between (process noise)
    white: Mapping[str, float] = field(default_factory=dict)
    # disturbance -> (1-sigma, correlation time [s]): a first-order Gauss-Markov process (gust, missing X)
    coloured: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    # output -> (1-sigma, correlation time [s]): what its innovations are instead of white with unit variance, a
    # first-order Gauss-Markov process from one reading to the next
    colour: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    # output -> (1-sigma, correlation time [s]) of first-order Gauss-Markov processes beside the white noise; an offset
    # that is another one in every record has an infinite time
    slow: Mapping[str, tuple[tuple[float, float], ...]] = field(default_factory=dict)
    # state -> its largest magnitude in the records, of which the prior of the initial state is a multiple; that of the
    # model where it is not named
    initial: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, eq=False, kw_only=True)
class Batch:
    """Records side by side, padded to the longest: t (N, R), dt (N-1, R), U (N, R, nu), Z (N, R, ny) with NaN where a
    sample is missing, live (N, R) true inside the record. held (R, nu) states how inputs run between samples: 0
    linearly, 1 held until the next, -1 as the next from the beginning, and shares of these."""

    names: tuple[str, ...]
    t: np.ndarray
    dt: np.ndarray
    U: np.ndarray
    Z: np.ndarray
    live: np.ndarray
    held: np.ndarray

    @property
    def samples(self) -> int:
        return int(self.live.sum())

    def of_records(self, some: slice | list[int]) -> Batch:
        """The same of some records; as views, where these follow each other."""
        arrays = {name: getattr(self, name)[:, some] for name in ("t", "dt", "U", "Z", "live")}
        return replace(self, names=tuple(np.array(self.names)[some].tolist()), held=self.held[some], **arrays)

    def held_at(self, model: Model) -> np.ndarray:
        """(R, nw) the same of disturbances: those of recorded inputs run as these do, and all others linearly."""
        found = np.zeros((len(self.held), len(model.disturbances)))
        for j, name in enumerate(model.disturbances):
            if name.startswith("d_") and name[2:] in model.inputs:
                found[:, j] = self.held[:, model.inputs.index(name[2:])]
        return found

    def ends(self, series: np.ndarray, held: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """(N-1, R, n) values of (N, R, n) inputs, or of disturbances that are `held_at`, at the beginning and at the
        end of each interval."""
        share = (self.held if held is None else held)[None]
        change = series[1:] - series[:-1]
        first = np.where(share < 0.0, series[:-1] - share * change, series[:-1])
        last = np.where(share > 0.0, series[1:] - share * change, series[1:])
        return first, np.where(share == 1.0, first, last)


def make_batch(model: Model, records: Sequence[Record]) -> Batch:
    """Stack records for a model; an output that a record does not have is missing throughout. InputError for cubic
    inputs."""
    for name in cubic_inputs(model, records)[:1]:
        raise InputError(f"input '{name}' is cubic between samples, which is not taken here; write hold='linear'")
    N = max(len(r) for r in records)
    R = len(records)
    t = np.zeros((N, R))
    U = np.zeros((N, R, len(model.inputs)))
    Z = np.full((N, R, len(model.outputs)), np.nan)
    live = np.zeros((N, R), dtype=bool)
    for j, record in enumerate(records):
        n = len(record)
        t[:n, j], t[n:, j] = record.t, record.t[-1] + record.dt * np.arange(1, N - n + 1)
        U[:n, j] = record.matrix(model.inputs)
        U[n:, j] = U[n - 1, j]
        live[:n, j] = True
        for i, name in enumerate(model.outputs):
            if name in record:
                Z[:n, j, i] = record[name]
    held = np.array([[float(record.hold_of(name) == "held") for name in model.inputs] for record in records])
    held = held.reshape(R, len(model.inputs))
    return Batch(names=tuple(r.name for r in records), t=t, dt=np.diff(t, axis=0), U=U, Z=Z, live=live, held=held)


def padded(parts: Sequence[np.ndarray]) -> np.ndarray:
    """(N, R, ...) Arrays (samples, ...) of records side by side; a shorter one keeps its last row."""
    longest = max(map(len, parts))
    rows = [np.concatenate([one, np.repeat(one[-1:], longest - len(one), axis=0)]) for one in parts]
    return np.stack(rows, axis=1).astype(float, copy=False)


class PointFunctions:
    """Values and Jacobians of a model at single points, mapped over all samples of a batch."""

    def __init__(self, model: Model, free: Sequence[str]) -> None:
        self.model, self.free = model, tuple(free)
        index = [model.parameters.index(name) for name in self.free]
        x = model.x
        u = model.u
        p = model.p
        w = model.w
        both = ca.vertcat(model.f, model.h)
        by_p = ca.jacobian(both, p)[:, index] if index else ca.SX(both.shape[0], 0)
        values = [ca.jacobian(both, x), by_p, ca.jacobian(both, w)]
        u1 = ca.SX.sym("u1", u.shape[0])
        dt = ca.SX.sym("dt")
        w1 = ca.SX.sym("w1", w.shape[0])
        f = ca.Function("f", [x, ca.vertcat(u, w), p], [model.f])
        first = ca.vertcat(u, w)
        last = ca.vertcat(u1, w1)
        after = runge_kutta(f, x, (first, (first + last) / 2, last), dt, p)
        self._jacobians = Compilable(ca.Function("jacobians", [x, u, p, w], ca.cse([ca.densify(e.T) for e in values])))
        self._step = Compilable(ca.Function("step", [x, u, u1, p, w, w1, dt], [after]))
        self._output = Compilable(ca.Function("output", [x, u, p, w], [model.h]))
        self._by_parameters: dict[tuple[str, ...], ParameterFunctions] = {}

    def by_parameters(self, free: Sequence[str]) -> ParameterFunctions:
        """The sensitivities of the same model to `free` parameters, built once."""
        key = tuple(free)
        with BUILDING:
            if key not in self._by_parameters:
                self._by_parameters[key] = ParameterFunctions(self.model, key)
        return self._by_parameters[key]

    def __reduce__(self) -> tuple[type[PointFunctions], tuple[Model, tuple[str, ...]]]:
        return PointFunctions, (self.model, self.free)

    def jacobians(self, X: np.ndarray, U: np.ndarray, P: np.ndarray, W: np.ndarray) -> list[np.ndarray]:
        """[d/dx, d/dp_free, d/dw] of (f, h) stacked, each (N, R, rows, columns)."""
        return [turned.swapaxes(2, 3) for turned in at_points(self._jacobians, X, U, P, W)]  # as they lie in memory

    def step(self, X, U0, U1, P, W0, W1, dt) -> np.ndarray:
        """State after one sample interval (N-1, R, n_states), Runge-Kutta of fourth order."""
        return at_points(self._step, X, U0, U1, P, W0, W1, dt[..., None])[0][..., 0]

    @property
    def step_function(self) -> ca.Function:
        """(x, u, u at the end, p, w, w at the end, dt) -> state after one sample interval."""
        return self._step.symbolic

    def output(self, X, U, P, W) -> np.ndarray:
        """Outputs (N, R, ny)."""
        return at_points(self._output, X, U, P, W)[0][..., 0]


class ParameterFunctions:
    """Sensitivities of the steps and outputs of a model to its `free` parameters, a stretch of samples at a time: those
    of all samples take several times the memory of everything else that is linearised."""

    def __init__(self, model: Model, free: Sequence[str]) -> None:
        self.model, self.free = model, tuple(free)
        index = [model.parameters.index(name) for name in self.free]
        x = model.x
        u = model.u
        p = model.p
        w = model.w
        both = ca.vertcat(model.f, model.h)
        direction = ca.SX.sym("direction", len(index))
        by_x = ca.densify(ca.jacobian(model.f, x).T)
        by_p = ca.densify(ca.jacobian(both, p)[:, index].T) if index else ca.SX(0, both.shape[0])
        among_all = ca.SX(p.shape[0], 1)
        among_all[index] = direction
        along = ca.densify(ca.jtimes(both, p, among_all).T)
        self.each = Compilable(ca.Function("by_parameters", [x, u, p, w], ca.cse([by_x, by_p])))
        self.along = Compilable(ca.Function("along_parameters", [x, u, p, w, direction], ca.cse([by_x, along])))

    def __reduce__(self) -> tuple[type[ParameterFunctions], tuple[Model, tuple[str, ...]]]:
        return ParameterFunctions, (self.model, self.free)

    def in_stretches(
        self,
        batch: Batch,
        P: np.ndarray,
        X: np.ndarray,
        W: np.ndarray,
        direction: np.ndarray | None = None,
        ends: tuple[np.ndarray, np.ndarray] | None = None,
    ) -> Iterator[tuple[slice, np.ndarray, np.ndarray]]:
        """(samples, Dp, Bp) of stretches about X (N, R, nx), as `linearise` makes them: over the samples, and over the
        intervals between these and the next. With `direction` (R, n) one column, the sum along it. `ends` are states
        and disturbances (N-1, R, n) at the end of each interval, where these are not those of the next sample."""
        (N, R, nx), along = X.shape, () if direction is None else (direction,)
        kernel = filter_kernel(nx, len(self.model.outputs))
        driven = _driven if kernel is None else kernel.driven
        function = self.along if along else self.each
        seen = np.isfinite(batch.Z)
        together = max(_BLOCK // R - 1, 1)
        for first in range(0, N, together):
            here = slice(first, min(first + together + 1, N))  # the last one is the end of an interval only
            by_x, by_p = at_points(function, X[here], batch.U[here], P, W[here], *along)
            until = slice(first, here.stop - 1)
            last = (by_x[1:], by_p[1:])
            if ends is not None:
                last = at_points(function, ends[0][until], batch.U[first + 1 : here.stop], P, ends[1][until], *along)
            by_x, by_p, end_x, end_p = (one.swapaxes(2, 3) for one in (by_x, by_p, *last))
            Bp, Dp = driven(by_x, by_p, end_x, end_p, batch.dt[until], batch.live[here], seen[here])
            count = min(together, N - first)
            yield slice(first, first + count), Dp[:count], Bp


def at_points(function: Compilable, *arguments: np.ndarray) -> list[np.ndarray]:
    """A function of column vectors at every (time, record): arguments (N, R, n) or (R, n), results (N, R, rows,
    columns). Threads take turns."""
    N, R = arguments[0].shape[:2]
    flat = [a.reshape(math.prod(a.shape[:-1]), a.shape[-1]) for a in arguments]
    # those of records alone are the same at every sample: a block begins at one of R places
    flat = [a if len(a) == N * R else np.resize(a, (_BLOCK + R, a.shape[1])) for a in flat]
    shapes = [function.symbolic.size_out(i) for i in range(function.symbolic.n_out())]
    room = -(-N * R // _BLOCK) * _BLOCK
    results = [np.empty((room, columns, rows)) for rows, columns in shapes]
    for first in range(0, room, _BLOCK):
        here = slice(first, first + _BLOCK)
        again = slice(first % R, first % R + _BLOCK)
        if first + _BLOCK > N * R:  # the last point fills the block
            here = np.minimum(np.arange(first, first + _BLOCK), N * R - 1)
        given = [a[here] if len(a) == N * R else a[again] for a in flat]
        with function.lock:
            function.write(given, [r[first : first + _BLOCK] for r in results])
    return [r[: N * R].reshape(N, R, *r.shape[1:]).swapaxes(2, 3) for r in results]


def in_domain(functions: PointFunctions, batch: Batch, P: np.ndarray, X: np.ndarray) -> np.ndarray:
    """Return (N, R) whether the model has numbers at a sample of X (N, R, nx): its rates and outputs there, their
    derivatives, and the state one sample later."""
    W = np.zeros((*batch.live.shape, len(functions.model.disturbances)))
    after = functions.step(X[:-1], *batch.ends(batch.U), P, W[:-1], W[1:], batch.dt)
    there = [functions.output(X, batch.U, P, W), *functions.jacobians(X, batch.U, P, W)]
    values = np.concatenate([one.reshape(*X.shape[:2], -1) for one in there], axis=2)
    found = np.asarray(np.isfinite(values).all(axis=2))
    found[:-1] &= np.isfinite(after).all(axis=2) | ~batch.live[1:]
    return found | ~batch.live


def brought_inside(functions: PointFunctions, batch: Batch, P: np.ndarray, X: np.ndarray) -> np.ndarray:
    """Return the motion X (N, R, nx) with samples interpolated at which the model has no numbers. In a record that has
    no others, states that nothing reads, which stand at zero, are moved from there by a part of their usual size."""
    found = X.copy()
    inside = in_domain(functions, batch, P, found)
    for share in _AWAY:
        nowhere = np.asarray(~inside.any(axis=0))
        if not nowhere.any():
            break
        unread = nowhere[:, None] & ~X.any(axis=0)
        found = np.where(unread, share * functions.model.scale_vector(), found)
        inside = in_domain(functions, batch, P, found)
    for r in np.flatnonzero(~inside.all(axis=0) & inside.any(axis=0)):
        at = np.flatnonzero(inside[:, r])
        for i in range(X.shape[2]):
            found[:, r, i] = np.interp(np.arange(len(X)), at, found[at, r, i])
    return found


def moved_inside(functions: PointFunctions, batch: Batch, P: np.ndarray, X: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Return the motion X (N, R, nx) after a step, which goes at samples where the model has no numbers after the whole
    one at most half of the way to where it has none."""
    length = np.ones((*X.shape[:2], 1))
    inside = in_domain(functions, batch, P, X + step)
    for _ in range(_HALVINGS):
        if inside.all():
            break
        length[~inside] *= 0.5
        inside = in_domain(functions, batch, P, X + length * step)
    length[~inside] = 0.0
    return X + np.where(length < 1.0, 0.5 * length, 1.0) * step


@dataclass(frozen=True, eq=False, kw_only=True)
class Linear:
    """A model linearised about a nominal trajectory X (N, R, nx).

    residual (N, R, ny) is Z - output, NaN-free with `seen` telling the samples that count; defect (N-1, R, nx) is the
    model's next state minus the nominal next state. A, Bp, Bw0, Bw1 act over a sample interval (w linear between
    samples, or as `Batch.held_at` says), C, Dp, Dw at a sample.
    """

    model: Model
    free: tuple[str, ...]
    X: np.ndarray
    output: np.ndarray
    residual: np.ndarray
    seen: np.ndarray
    defect: np.ndarray
    A: np.ndarray
    Bp: np.ndarray
    Bw0: np.ndarray
    Bw1: np.ndarray
    C: np.ndarray
    Dp: np.ndarray
    Dw: np.ndarray
    dt: np.ndarray

    def of_records(self, some: slice | list[int]) -> Linear:
        """The same of some records, as copies."""
        arrays = {name: of[:, some].copy() for name, of in vars(self).items() if isinstance(of, np.ndarray)}
        return replace(self, **arrays)


def linearise(
    functions: PointFunctions,
    batch: Batch,
    P: np.ndarray,
    X: np.ndarray,
    W: np.ndarray | None = None,
    news: np.ndarray | None = None,
) -> Linear:
    """Linearise about X (N, R, nx) with parameters P (R, np) and disturbances W (N, R, nw). State and output are those
    of a Runge-Kutta step, the step matrices its derivatives for a linear model: a resonance with a few samples per
    cycle stays as stable as it is. Motion that is predicted from sample to sample jumps at each: with `news` (N-1, R,
    nw), the part of disturbances that a sample adds, an interval ends where it was predicted to end."""
    model = functions.model
    W = np.zeros((*batch.live.shape, len(model.disturbances))) if W is None else W
    held = batch.held_at(model)
    (U0, U1), (W0, W1) = batch.ends(batch.U), batch.ends(W, held)
    W1 = W1 if news is None else W1 - news
    after = functions.step(X[:-1], U0, U1, P, W0, W1, batch.dt)
    output = functions.output(X, batch.U, P, W)
    seen = np.isfinite(batch.Z)
    residual = np.where(seen, batch.Z - output, 0.0)
    defect = np.where(batch.live[1:, :, None], after - X[1:], 0.0)
    kernel = filter_kernel(len(model.states), len(model.outputs))

    def jacobians(first: int, stop: int) -> tuple[list[np.ndarray], list[np.ndarray]]:
        """The Jacobians at samples, and at the ends of the intervals between them."""
        at = slice(first, stop)
        steps = slice(first, stop - 1)
        found = functions.jacobians(X[at], batch.U[at], P, W[at])
        if news is None:
            return found, [one[1:] for one in found]
        following = W[first + 1 : stop] - news[steps]
        return found, functions.jacobians(after[steps], batch.U[first + 1 : stop], P, following)

    sizes = len(model.states), len(functions.free), len(model.disturbances)
    interval = _interval if kernel is None else kernel.interval
    A, Bp, Bw0, Bw1, C, Dp, Dw = interval(jacobians, sizes, batch.dt, batch.live, held, seen)
    if news is not None:
        defect = defect + np.where(batch.live[1:, :, None], (Bw1 @ news[..., None])[..., 0], 0.0)
    return Linear(
        model=model,
        free=functions.free,
        X=X,
        output=output,
        seen=seen,
        residual=residual,
        defect=defect,
        A=A,
        Bp=Bp,
        Bw0=Bw0,
        Bw1=Bw1,
        C=C,
        Dp=Dp,
        Dw=Dw,
        dt=batch.dt,
    )


def _interval(jacobians, sizes, dt, live, held, seen) -> tuple[np.ndarray, ...]:
    """(A, Bp, Bw0, Bw1, C, Dp, Dw) of `Linear`, as the compiled recursions compute them."""
    (by_x, by_p, by_w), (end_x, end_p, end_w) = jacobians(0, len(live))
    nx = sizes[0]
    inside = live[1:, :, None, None]
    h = dt[..., None, None]
    J = by_x[:-1, :, :nx]
    K = end_x[:, :, :nx]
    S = K @ J
    A = np.eye(nx) + h / 2 * (J + K) + h**2 * (S / 2 + S @ (h / 12 * (J + K) + h**2 / 24 * S))
    Bp, Dp = _driven(by_x[:, :, :nx], by_p, K, end_p, dt, live, seen)
    Fw0 = by_w[:-1, :, :nx]
    Fw1 = end_w[:, :, :nx]
    once = h**2 * (K @ Fw0)
    again = h**3 * (S @ Fw0)
    Bw0 = h / 2 * Fw0 + once / 3 + again / 8
    Bw1 = h / 2 * Fw1 + once / 6 + again / 24
    late = np.maximum(held, 0.0)[None, :, None]
    early = np.maximum(-held, 0.0)[None, :, None]
    Bw0, Bw1 = (1.0 - early) * Bw0 + late * Bw1, (1.0 - late) * Bw1 + early * Bw0
    A = np.where(inside, A, np.eye(nx))
    Bw0 = np.where(inside, Bw0, 0.0)
    Bw1 = np.where(inside, Bw1, 0.0)
    C, Dw = (np.where(seen[..., None], by[:, :, nx:], 0.0) for by in (by_x, by_w))
    return A, Bp, Bw0, Bw1, C, Dp, Dw


def _driven(by_x, by_p, K, end_p, dt, live, seen) -> tuple[np.ndarray, np.ndarray]:
    """(Bp, Dp) of `Linear`, as the compiled recursions compute them."""
    nx = by_x.shape[3]
    inside = live[1:, :, None, None]
    h = dt[..., None, None]
    Fp0 = by_p[:-1, :, :nx]
    Fp1 = end_p[:, :, :nx]
    Kp = K @ Fp0
    Bp = h / 2 * (Fp0 + Fp1) + h**2 * (Kp / 2 + K @ by_x[:-1] @ (h / 6 * Fp0 + h**2 / 24 * Kp))
    return np.where(inside, Bp, 0.0), np.where(seen[..., None], by_p[:, :, nx:], 0.0)


def scattered(model: Model, names: Iterable[str], histories: np.ndarray) -> np.ndarray:
    """(N, R, nw) Histories (N, R, names) of named disturbances in their places among all."""
    W = np.zeros((*histories.shape[:2], len(model.disturbances)))
    W[..., [model.disturbances.index(name) for name in names]] = histories
    return W


def inject(linear: Linear, stations: Sequence[int], series: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(Y, F) columns of time histories (N, R, nc) that enter at disturbance `stations` (nc indices)."""
    index = np.asarray(stations, dtype=int)
    Y = linear.Dw[..., index] * series[:, :, None, :]
    F = linear.Bw0[..., index] * series[:-1, :, None, :] + linear.Bw1[..., index] * series[1:, :, None, :]
    return Y, F
