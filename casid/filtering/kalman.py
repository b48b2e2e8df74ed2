"""The Kalman filter of a linearised model: prediction, whitening of columns, smoothing.

The recursions run as compiled C (`filter_kernel`); without a compiler, or with `plain`, in numpy. Legend and frames of
the arrays as in `innovations`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from casid.filtering.colour import Colouring, colouring
from casid.filtering.innovations import Linear, NoiseModel, scattered
from casid.filtering.kernel import FilterKernel, filter_kernel
from casid.filtering.slow import slow_states, with_slow_readings

_STRETCH = 256  # samples of all records whose covariances of the noise are in memory together
_INITIAL_SIGMA = 5.0  # prior of the initial state in sizes: practically free, and the covariances keep their digits


@dataclass(frozen=True, eq=False, kw_only=True)
class Filter:
    """Kalman filter of a linearised model under a noise model: prediction error e = Y + C E. It is whitened by
    `inverse_root` (N, R, ny, ny), gain of the prediction (N-1, R, n, ny), prediction covariance P (N, R, n, n), log
    determinant per sample (N, R). `noise` what is random; `through` the model that predicts and that noise goes
    through: `linear` but for `along`."""

    linear: Linear
    through: Linear
    noise: NoiseModel
    A: np.ndarray
    C: np.ndarray
    gain: np.ndarray
    inverse_root: np.ndarray
    P: np.ndarray
    log_determinant: np.ndarray
    kernel: FilterKernel | None

    @cached_property
    def colouring(self) -> Colouring:
        """Filter that makes innovations white where the noise model gives them a colour."""
        return colouring(self.linear, self.noise.colour)

    @property
    def in_free_flight(self) -> Filter:
        """The same without the updates by readings: its innovations are those of a simulation that no reading corrects,
        in units of the noise of a reading."""
        sigma = np.array([self.noise.measurement[name] for name in self.linear.model.outputs])
        alone = replace(self.noise, colour={})
        root = np.broadcast_to(np.diag(1.0 / sigma), self.inverse_root.shape).copy()
        return replace(self, noise=alone, gain=np.zeros_like(self.gain), inverse_root=root)

    def of_records(self, some: slice | list[int]) -> Filter:
        """The same of some records: copies, for every compiled recursion would make its own of views."""
        arrays = {name: of[:, some].copy() for name, of in vars(self).items() if isinstance(of, np.ndarray)}
        linear = self.linear.of_records(some)
        through = linear if self.through is self.linear else self.through.of_records(some)
        return replace(self, linear=linear, through=through, **arrays)

    def along(self, linear: Linear, noise: NoiseModel) -> Filter:
        """This filter for another model of the same records: what it predicts from what, and how it weighs it, stay; a
        state that it does not know no sample moves. For readings at other times, as of a late instrument, weights and
        gain are those that its model has for them. Models are then compared by their residuals alone, to first order
        in their change."""
        if self._knows(linear, noise):
            if np.array_equal(linear.seen, self.through.seen):
                return replace(self, linear=linear, noise=noise)
            return replace(kalman_filter(_held(linear, self.through), noise), linear=linear)
        through = _held(linear, self.through)
        A, C, *_ = augmented(through, noise)
        own = _names(self.through, self.noise)
        names = _names(linear, noise)
        into, of = _shared(names, own)
        gain = np.zeros((*A.shape[:3], self.gain.shape[3]))
        P = np.zeros((*C.shape[:2], len(names), len(names)))
        gain[:, :, into] = self.gain[:, :, of]
        P[:, :, into[:, None], into] = self.P[:, :, of[:, None], of]
        return replace(self, linear=linear, through=through, noise=noise, A=A, C=C, gain=gain, P=P)

    def _knows(self, linear: Linear, noise: NoiseModel) -> bool:
        """Return True if all that another model could change of it but the times of its readings is already in it."""
        model = linear.model
        before = self.through.model
        same_model = model.states == before.states and model.disturbances == before.disturbances
        same_noise = (noise.coloured, noise.slow) == (self.noise.coloured, self.noise.slow)
        same_noise = same_noise and list(noise.inputs) == list(self.noise.inputs)
        return same_model and same_noise

    def predicted(self, Y: np.ndarray, F: np.ndarray, first: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Innovations (N, R, ny) of one column as by `whiten`, and (N, R, n) states and coloured disturbances as they
        are predicted from the samples before, less those about which the model is linearised.

        What the model of `linear` makes of that distance, other than the one that the filter goes `through`, is added
        to the residual once: to first order in the change, the innovations are those of the predictor of `linear` with
        this gain. That predictor itself may be unstable."""
        begun = self._begun(first)
        white, states = self._columns(Y, F, None if begun is None else begun.copy(), keep=True)
        if self.through is not self.linear:
            held = self.through
            nx = self.linear.X.shape[2]
            moved = states[..., :nx, :]
            coloured = states[..., nx : nx + len(self.noise.coloured), 0]
            gusts = scattered(held.model, self.noise.coloured, coloured)[..., None]
            left = scattered(held.model, self.noise.coloured, _decay(held.dt, self.noise) * coloured[:-1])[..., None]

            def made(linear: Linear) -> tuple[np.ndarray, np.ndarray]:
                ahead = linear.A @ moved[:-1] + linear.Bw0 @ gusts[:-1] + linear.Bw1 @ left
                return linear.C @ moved + linear.Dw @ gusts, ahead

            (read, ahead), (read_held, ahead_held) = made(self.linear), made(held)
            Y = Y + (read - read_held)
            F = F.copy()
            F[:, :, :nx] += ahead - ahead_held
            white, states = self._columns(Y, F, begun, keep=True)
        return self.colouring.taken_off(white).swapaxes(0, 1)[..., 0], -states[..., 0]

    def whiten(self, Y: np.ndarray, F: np.ndarray, first: np.ndarray | None = None) -> np.ndarray:
        """Innovations (N, R, ny, nc), white with unit variance, of columns with output part Y (N, R, ny, nc), state
        part F (N-1, R, nx or n, nc), and first (R, n, nc) at the first sample. The residual is `residual_column`. In
        memory the records are apart."""
        return self.colouring.taken_off(self._columns(Y, F, self._begun(first))[0]).swapaxes(0, 1)

    def whiten_in_stretches(
        self, stretches: Iterable[tuple[slice, np.ndarray, np.ndarray]], columns: int, room: int = 0
    ) -> np.ndarray:
        """`whiten` of so many columns that are given as (samples, Y, F) of one stretch after the other, of which none
        is kept: F over the intervals between these samples and the next. There is `room` for further columns."""
        N, R, ny, n = self.C.shape
        white = np.empty((R, N, ny, columns + room))
        held = np.zeros((R, n, columns))
        for at, Y, F in stretches if columns else ():
            steps = slice(at.start, at.start + len(F))
            part = {
                "A": self.A[steps],
                "gain": self.gain[steps],
                "C": self.C[at],
                "inverse_root": self.inverse_root[at],
            }
            replace(self, **part)._columns(Y, F, held, to=white[:, at, :, :columns])
        if self.colouring.stretches:
            white[..., :columns] = self.colouring.taken_off(white[..., :columns])
        return white.swapaxes(0, 1)

    def whiten_histories(
        self,
        stations: Sequence[int] | np.ndarray,
        series: np.ndarray,
        first: Sequence[int] | np.ndarray | None = None,
    ) -> np.ndarray:
        """`whiten` of time histories (N, R, nh) that enter at disturbance `stations` (nh indices): of each, or of sums,
        from history number `first` (nc,) of each sum to that of the next."""
        linear = self.linear
        index = np.asarray(stations, dtype=int)
        begin = np.arange(len(index)) if first is None else np.asarray(first, dtype=int)
        if self.kernel is not None:
            return self.colouring.taken_off(self.kernel.whiten_histories(self, index, begin, series)).swapaxes(0, 1)

        def entering(by: np.ndarray, at: int) -> np.ndarray:
            return np.add.reduceat(by[..., index] * series[at][:, None, :], begin, axis=2)

        def forced(k: int) -> np.ndarray:
            return entering(linear.Bw0[k], k) + entering(linear.Bw1[k], k + 1)

        white = np.empty((*self.C.shape[1::-1], self.C.shape[2], len(begin)))
        self._run(white, lambda k: entering(linear.Dw[k], k), forced, len(self.A))
        return self.colouring.taken_off(white).swapaxes(0, 1)

    def histories_in_parts(
        self, stations: Sequence[int] | np.ndarray, series: np.ndarray, together: int
    ) -> Iterator[tuple[int, np.ndarray]]:
        """(number of the first sample, (R, samples, ny, nh)) `whiten_histories` of each, `together` samples at a time:
        what is summed over samples needs no memory for all. In one part where colour joins a reading to the one before.
        """
        if self.kernel is None or self.colouring.stretches:
            yield 0, self.whiten_histories(stations, series).swapaxes(0, 1)
        else:
            yield from self.kernel.histories_in_parts(self, stations, series, together)

    def squares_of_histories(self, stations: Sequence[int], series: np.ndarray, first: np.ndarray) -> np.ndarray:
        """(R, nc) sums of squares of `whiten_histories`, which are not kept."""
        if self.kernel is not None and not self.colouring.stretches:
            return self.kernel.whiten_histories(self, np.asarray(stations, dtype=int), first, series, squares=True)
        return np.einsum("krij,krij->rj", *[self.whiten_histories(stations, series, first)] * 2)

    def entrances(
        self, stations: Sequence[int] | np.ndarray, columns: np.ndarray, read: bool = True
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return what columns of innovations (R, N, ny, nc), which are overwritten, have in common with the response
        to a unit at each sample: of each disturbance of `stations` (ns, R, N, nc), and of each output as `read` (ny,
        R, N, nc). One pass of the transposed filter for all histories: its sum over samples times one is the product
        with that history's response."""
        white = self.colouring.transposed(columns)
        if self.kernel is not None:
            return self.kernel.entrances(self, stations, white, read)
        return self._entrances(np.asarray(stations, dtype=int), white)

    def _entrances(self, index: np.ndarray, white: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        (N, R, ny, n), columns, linear = self.C.shape, white.shape[3], self.linear
        entering, by_output = (np.zeros((count, R, N, columns)) for count in (len(index), ny))
        costate = np.zeros((R, n, columns))

        def enter(k: int, through: np.ndarray, rows: np.ndarray) -> None:
            entering[:, :, k] += (through[..., index].swapaxes(1, 2) @ rows[:, : through.shape[1]]).swapaxes(0, 1)

        for k in range(N - 1, -1, -1):
            u = self.inverse_root[k].swapaxes(1, 2) @ white[:, k]
            before = 0.0
            if k < N - 1:
                u -= self.gain[k].swapaxes(1, 2) @ costate
                before = self.A[k].swapaxes(1, 2) @ costate
                enter(k, linear.Bw0[k], costate)
            costate = before + self.C[k].swapaxes(1, 2) @ u
            by_output[:, :, k] = u.swapaxes(0, 1)
            enter(k, linear.Dw[k], u)
            if k:
                enter(k, linear.Bw1[k - 1], costate)
        return entering, by_output

    def smooth(self, Y: np.ndarray, F: np.ndarray, first: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Most likely deviation of states and coloured disturbances (N, R, nx + nc), and noise of the recorded inputs
        (N, R, ni), given one column (Y, F) with nc = 1, by the Bryson-Frazier backward recursion and the disturbance
        smoother (Koopman, Biometrika 80, 1993)."""
        white, states = self._columns(Y, F, self._begun(first), keep=True)
        through = self.through
        found = self._costates if self.kernel is None else partial(self.kernel.costates, self)
        stations = [through.model.disturbances.index(name) for name in self.noise.inputs]
        costates, entering = found(stations, white)
        noise = entering * np.array([sigma**2 for sigma in self.noise.inputs.values()])
        deviation = (self.P @ costates[..., None] - states)[..., 0]
        entered = scattered(through.model, self.noise.inputs, noise[1:])
        deviation[1:, :, : self.linear.X.shape[2]] += (through.Bw1 @ entered[..., None])[..., 0]
        return deviation[..., : deviation.shape[2] - len(slow_states(self.noise.slow))], noise

    def _costates(self, stations: Sequence[int], white: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        found = np.zeros(self.C.shape[:2] + self.C.shape[3:])
        pulls = np.zeros(self.C.shape[:3])
        turned = self.inverse_root.swapaxes(2, 3)
        for k in range(len(found) - 1, -1, -1):
            pull = turned[k] @ white[:, k]
            if k < len(found) - 1:
                after = found[k + 1][..., None]
                pull = pull - self.gain[k].swapaxes(1, 2) @ after
                found[k] = (self.A[k].swapaxes(1, 2) @ after)[..., 0]
            found[k] += (self.C[k].swapaxes(1, 2) @ pull)[..., 0]
            pulls[k] = pull[..., 0]
        through = self.through
        of_states = found[1:, :, : self.linear.X.shape[2], None]
        entering = through.Dw.swapaxes(2, 3) @ pulls[..., None]
        entering[:-1] += through.Bw0.swapaxes(2, 3) @ of_states
        entering[1:] += through.Bw1.swapaxes(2, 3) @ of_states
        return found, entering[..., stations, 0]

    def _begun(self, first: np.ndarray | None) -> np.ndarray | None:
        """(R, n, nc) predicted states at the first sample; of slow noise nothing is expected."""
        if first is None:
            return None
        return np.pad(first, ((0, 0), (0, self.C.shape[3] - first.shape[1]), (0, 0)))

    def _columns(
        self,
        Y: np.ndarray,
        F: np.ndarray,
        first: np.ndarray | None,
        keep: bool = False,
        to: np.ndarray | None = None,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Innovations (R, N, ny, nc), in the array `to` if that is given, and, when they are to be kept, predicted
        states (N, R, n, nc). `first` has the states after the last step of F afterwards."""
        (N, R, ny, n), columns = self.C.shape, Y.shape[3]
        white = np.empty((R, N, ny, columns)) if to is None else to
        states = np.empty((N if keep else 0, R, n, columns))
        if self.kernel is not None:
            self.kernel.whiten(self, Y, F, first, white, states if keep else None)
        else:
            self._run(white, lambda k: Y[k], lambda k: F[k], len(F), first, states if keep else None)
        return white, states

    def _run(
        self,
        white: np.ndarray,
        output: Callable[[int], np.ndarray],
        forced: Callable[[int], np.ndarray],
        steps: int,
        first: np.ndarray | None = None,
        states: np.ndarray | None = None,
    ) -> None:
        N, R, _, n = self.C.shape
        E = np.zeros((R, n, white.shape[3])) if first is None else first.copy()
        for k in range(N):
            if states is not None:
                states[k] = E
            e = self.C[k] @ E
            e += output(k)
            white[:, k] = self.inverse_root[k] @ e
            if k < steps:
                E = self.A[k] @ E
                E -= self.gain[k] @ e
                drive = forced(k)
                E[:, : drive.shape[1]] += drive
        if first is not None:
            first[...] = E


def kalman_filter(linear: Linear, noise: NoiseModel, plain: bool = False) -> Filter:
    """Covariance pass of the filter: which samples are seen, not the data; `plain` in numpy, as without a compiler.
    Raises numpy.linalg.LinAlgError when the innovations have no density."""
    kernel = None if plain else filter_kernel(len(_names(linear, noise)), linear.C.shape[2])
    A, C, gain, inverse_root, P, log_determinant = _covariances(linear, noise, kernel)
    return Filter(
        linear=linear,
        through=linear,
        noise=noise,
        A=A,
        C=C,
        gain=gain,
        inverse_root=inverse_root,
        P=P,
        log_determinant=log_determinant + colouring(linear, noise.colour).log_determinant.sum(axis=2),
        kernel=kernel,
    )


def _covariances(linear: Linear, noise: NoiseModel, kernel: FilterKernel | None) -> tuple[np.ndarray, ...]:
    """(A, C, gain, inverse root, prediction covariance, log determinant), a stretch of samples at a time: the
    covariances of the noise, which nothing needs afterwards, take as much memory as these."""
    (N, R, ny, nx), n = linear.C.shape, len(_names(linear, noise))
    of_noise = [(N - 1, R, n, ny), (N, R, ny, ny), (N, R, n, n), (N, R)]
    by_state = (linear.A, linear.C) if n == nx else (np.empty((N - 1, R, n, n)), np.empty((N, R, ny, n)))
    made = gain, root, kept, log_determinant = [np.empty(shape) for shape in of_noise]
    for first, (A, C, Q, M, S, P) in augmented_in_stretches(linear, noise, kernel is None):
        here = slice(first, first + len(C))
        steps = slice(first, first + len(A))
        given = A, C, Q, M, S, kept[first] if first else P
        to = gain[steps], root[here], kept[here], log_determinant[here]
        if kernel is not None:
            kernel.covariance(*given, to)
        else:
            _covariance_pass(*given, to)
        if n != nx:  # without further states the filter has those of the model
            by_state[0][steps] = A
            by_state[1][here] = C
    return (*by_state, *made)


def augmented_in_stretches(
    linear: Linear, noise: NoiseModel, plain: bool = False
) -> Iterator[tuple[int, tuple[Any, ...]]]:
    """(number of the first sample, `augmented`) of some samples and the next one, then from that one on."""
    N, R = linear.seen.shape[:2]
    together = N if plain else max(_STRETCH // R, 1)
    for first in range(0, max(N - 1, 1), together):
        before = min(first, 1)  # noise of inputs at a sample acts in the interval before it too
        *made, S, P = augmented(_between(linear, first - before, first + together + 1), noise, plain)
        yield first, (*(part[before:] for part in made), None if S is None else S[before:], P)


def _between(linear: Linear, first: int, stop: int) -> Linear:
    """A linearised model between two samples."""
    at = slice(first, stop)
    steps = slice(first, stop - 1)
    by_step = {name: getattr(linear, name)[steps] for name in ("defect", "A", "Bp", "Bw0", "Bw1", "dt")}
    by_sample = {name: getattr(linear, name)[at] for name in ("X", "output", "residual", "seen", "C", "Dp", "Dw")}
    return replace(linear, **by_step, **by_sample)


def _names(linear: Linear, noise: NoiseModel) -> list[str]:
    """List the filter's states: those of the model, coloured disturbances, slow noise of readings."""
    return [*linear.model.states, *noise.coloured, *slow_states(noise.slow)]


def _held(linear: Linear, before: Linear) -> Linear:
    """The linearisation with the sensitivities to states and disturbances of the one before, where that has them: not
    of readings that it does not have at that sample."""
    into, of = _shared(linear.model.states, before.model.states)
    A, C, Bw0, Bw1 = (part.copy() for part in (linear.A, linear.C, linear.Bw0, linear.Bw1))
    A[:, :, into[:, None], into] = before.A[:, :, of[:, None], of]
    known = before.seen[..., None]
    seen = linear.seen[..., None]
    C[..., into] = np.where(known, before.C[..., of], C[..., into])
    Bw0[:, :, into] = before.Bw0[:, :, of]
    Bw1[:, :, into] = before.Bw1[:, :, of]
    Dw = np.where(known, before.Dw, linear.Dw)
    return replace(linear, A=A, Bw0=Bw0, Bw1=Bw1, C=np.where(seen, C, 0.0), Dw=np.where(seen, Dw, 0.0))


def _shared(names: Sequence[str], before: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
    """Indices in both of the names that both have."""
    both = [name for name in before if name in names]
    return np.array([names.index(name) for name in both]), np.array([before.index(name) for name in both])


def _covariance_pass(A, C, Q, M, S, P, to: Sequence[np.ndarray]) -> None:
    gain, inverse_root, kept, log_determinant = to
    N = len(C)
    for k in range(N):
        kept[k] = P
        PC = P @ C[k].swapaxes(1, 2)
        root = np.linalg.cholesky(C[k] @ PC + M[k])
        inverse = np.linalg.inv(root)
        inverse_root[k] = inverse
        log_determinant[k] = 2.0 * np.log(np.diagonal(root, axis1=1, axis2=2)).sum(axis=1)
        if k < N - 1:
            Z = (A[k] @ PC if S is None else A[k] @ PC + S[k]) @ inverse.swapaxes(1, 2)
            gain[k] = Z @ inverse
            P = A[k] @ P @ A[k].swapaxes(1, 2) + Q[k] - Z @ Z.swapaxes(1, 2)
            P = 0.5 * (P + P.swapaxes(1, 2))


def residual_column(linear: Linear) -> tuple[np.ndarray, np.ndarray]:
    """(Y, F) of the residual itself, one column."""
    return linear.residual[..., None], -linear.defect[..., None]


def residual_about(
    linear: Linear,
    noise: NoiseModel,
    coloured: np.ndarray,
    inputs: np.ndarray | None = None,
    through: Linear | None = None,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(Y, F, first) of the residual of a model linearised about histories `coloured` (N, R, nc) of the noise's coloured
    disturbances, which their processes expect to begin near zero and to decay from sample to sample. Also about the
    noise `inputs` (N, R, ni) of recorded inputs, which is expected to be zero; it goes `through` the model that the
    filter has (`Filter.through`), by default this one, so that a control gains nothing by its noise."""
    Y, F = residual_column(linear)
    if noise.coloured:
        news = coloured_news(linear.dt, noise, coloured)
        entered = linear.Bw1 @ scattered(linear.model, noise.coloured, news)[..., None]
        F = np.concatenate([F + entered, news[..., None]], axis=2)
    linear = through or linear
    if inputs is not None:
        W = scattered(linear.model, noise.inputs, inputs)[..., None]
        nx = linear.X.shape[2]
        Y = Y + linear.Dw @ W
        F[:, :, :nx] += linear.Bw0 @ W[:-1] + linear.Bw1 @ W[1:]
    first = np.zeros((F.shape[1], F.shape[2], 1))
    first[:, linear.X.shape[2] :, 0] = coloured[0]
    return Y, F, first


def coloured_news(dt: np.ndarray, noise: NoiseModel, coloured: np.ndarray) -> np.ndarray:
    """(N-1, R, nc) What coloured disturbances (N, R, nc) are after each interval, less what is left of them."""
    return coloured[1:] - _decay(dt, noise) * coloured[:-1]


def _decay(dt: np.ndarray, noise: NoiseModel) -> np.ndarray:
    """(N-1, R, nc) Part of each coloured disturbance that is left after an interval."""
    return np.exp(-dt[..., None] / np.array([tau for _, tau in noise.coloured.values()]))


@dataclass(frozen=True, eq=False, kw_only=True)
class _Sources:
    """Random sources: places among the model's disturbances, and strengths in their order."""

    coloured: list[int]  # coloured, white, inputs: indices; inputs are the noise of recorded ones
    white: list[int]
    inputs: list[int]
    sigma: np.ndarray  # sigma, tau: standard deviation and correlation time [s] of the coloured ones
    tau: np.ndarray
    of_white: np.ndarray  # of_white, of_inputs: 1-sigma of the others
    of_inputs: np.ndarray
    variance: np.ndarray  # (ny,) of the measurements


def _sources(linear: Linear, noise: NoiseModel) -> _Sources:
    model = linear.model

    def places(names: Iterable[str]) -> list[int]:
        return [model.disturbances.index(name) for name in names]

    return _Sources(
        coloured=places(noise.coloured),
        white=places(noise.white),
        inputs=places(noise.inputs),
        sigma=np.array([value for value, _ in noise.coloured.values()]),
        tau=np.array([value for _, value in noise.coloured.values()]),
        of_white=np.array(list(noise.white.values()), dtype=float),
        of_inputs=np.array(list(noise.inputs.values()), dtype=float),
        variance=np.array([noise.measurement[name] ** 2 for name in model.outputs]),
    )


def augmented(linear: Linear, noise: NoiseModel, plain: bool = False) -> tuple[Any, ...]:
    """A, C, Q, M of the model with coloured disturbances and slow noise of readings as further states, S that state and
    outputs share (None without noise of inputs), and the initial covariance. `plain` in numpy, as without a compiler.
    """
    model = linear.model
    ny = linear.C.shape[2]
    sources = _sources(linear, noise)
    n = len(model.states) + len(sources.coloured)
    kernel = None if plain else filter_kernel(n, ny)
    if kernel is None:
        *made, S = _augmented(linear, sources)
    else:
        *made, S = kernel.augmented(linear, sources)
    P = np.zeros((linear.C.shape[1], n, n))
    sizes = np.array([noise.initial.get(name, model.state_scale[name]) for name in model.states])
    P[:, range(n), range(n)] = np.r_[(_INITIAL_SIGMA * sizes) ** 2, sources.sigma**2]
    found = *made, S if noise.inputs else None, P
    return with_slow_readings(linear, noise.slow, found) if noise.slow else found


def _augmented(linear: Linear, sources: _Sources) -> tuple[np.ndarray, ...]:
    """(A, C, Q, M, S), as the compiled recursions compute them.

    The filter's state is the model's without what the noise of a recorded input at the sample has put into it over the
    interval before. So that noise enters one interval (`now`) and one sample (`out`), which share it.
    """
    coloured = sources.coloured
    white = sources.white
    sigma = sources.sigma
    N, records, ny, nx = linear.C.shape
    n = nx + len(coloured)
    phi = np.exp(-linear.dt[..., None] / sources.tau) if coloured else np.zeros((N - 1, records, 0))
    A = np.zeros((N - 1, records, n, n))
    A[..., :nx, :nx] = linear.A
    A[..., :nx, nx:] = linear.Bw0[..., coloured] + linear.Bw1[..., coloured] * phi[..., None, :]
    A[..., range(nx, n), range(nx, n)] = phi
    C = np.concatenate([linear.C, linear.Dw[..., coloured]], axis=3)
    G = (linear.Bw0 + linear.Bw1)[..., white] * sources.of_white
    now, before, out = (of[..., sources.inputs] * sources.of_inputs for of in (linear.Bw0, linear.Bw1, linear.Dw))
    now[1:] += linear.A[1:] @ before[:-1]
    out[1:] += linear.C[1:] @ before
    Q = np.zeros((N - 1, records, n, n))
    Q[..., :nx, :nx] = G @ G.swapaxes(2, 3) + now @ now.swapaxes(2, 3)
    driven = sigma**2 * (1.0 - phi**2)
    Q[..., range(nx, n), range(nx, n)] = driven
    through = linear.Bw1[..., coloured] * driven[..., None, :]
    Q[..., :nx, nx:] = through
    Q[..., nx:, :nx] = through.swapaxes(2, 3)
    Q[..., :nx, :nx] += through @ linear.Bw1[..., coloured].swapaxes(2, 3)
    feed = linear.Dw[..., white] * sources.of_white
    M = feed @ feed.swapaxes(2, 3) + out @ out.swapaxes(2, 3)
    M[..., range(ny), range(ny)] += np.where(linear.seen, sources.variance, 1.0)
    S = np.zeros((N - 1, records, n, ny))
    S[..., :nx, :] = now @ out[:-1].swapaxes(2, 3)
    return A, C, Q, M, S
