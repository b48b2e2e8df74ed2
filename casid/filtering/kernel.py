"""The recursions of `kalman` and `innovations` as compiled C; the numpy versions beside them define what they compute.

Nothing in the source depends on the model: one library serves all, compiled once per machine. Records know nothing of
each other, nor columns of columns: processors share them out (`OMP_NUM_THREADS` limits how many do).
"""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Callable, Iterator, Sequence
from functools import cache

import numpy as np

from casid.native.compiler import c_compiler, compile_library, is_time_to_compile
from casid.native.processors import share_out
from casid.native.sources import c_source

_MOST = 64  # states, outputs; beyond that numpy does the work
_POINTS = 256  # in a stretch of a linearisation, whose Jacobians stay in the processor's cache
_SAMPLES = 8  # in such a stretch at least, as its last one is evaluated twice
_TILE = 16  # columns that go through the filter side by side
# in memory together: columns, samples of columns that stay in the cache, samples of records with all their columns
COLUMNS = 2 * _TILE
SAMPLES = 64
WHOLE = 4096
_SOURCES = ("filter", "whiten", "step")
_LOADING = threading.Lock()  # of several threads one compiles
_FLAGS = (
    "-O3",
    "-march=native",
    "-fno-math-errno",
    "-fno-tree-loop-distribute-patterns",
    "-shared",
    "-fPIC",
    f"-DMOST={_MOST}",
    f"-DTILE={_TILE}",
)


class FilterKernel:
    """The compiled recursions; arrays as in `kalman`."""

    def __init__(self, library: str) -> None:
        loaded = ctypes.CDLL(library)
        self._covariance = loaded.covariance
        self._whiten = loaded.whiten
        self._costates = loaded.costates
        self._interval = loaded.interval
        self._augment = loaded.augment
        self._entrances = loaded.entrances
        self._whiten_one = loaded.whiten_one
        self._whiten_histories = loaded.whiten_histories
        self._driven = loaded.driven
        without = self._whiten, self._whiten_one, self._whiten_histories, self._costates, self._interval, self._augment
        for function in (*without, self._entrances, self._driven):
            function.restype = None

    def __reduce__(self) -> tuple[Callable[[int, int], FilterKernel | None], tuple[int, int]]:
        return filter_kernel, (1, 1)  # that of the process that reads it; None where there is no compiler

    def interval(self, jacobians, sizes, dt, live, held, seen) -> tuple[np.ndarray, ...]:
        """(A, Bp, Bw0, Bw1, C, Dp, Dw) of `Linear` from `jacobians` (first sample, stop) -> (samples, R, nx + ny,
        columns) of both equations, and the same at the ends of the intervals between, for a stretch of samples at a
        time; `sizes` (nx, n_p, nw)."""
        (N, R, ny), (nx, n_p, nw) = seen.shape, sizes
        shapes = [(nx, nx), (nx, n_p), (nx, nw), (nx, nw), (ny, nx), (ny, n_p), (ny, nw)]
        made = [np.empty((N - (i < 4), R, *shape)) for i, shape in enumerate(shapes)]
        flags = (live.view(np.uint8), seen.view(np.uint8))
        shares = held.astype(float)
        stretch = max(_POINTS // R - 1, _SAMPLES)
        for first in range(0, N, stretch):
            here = slice(first, min(first + stretch + 1, N))  # the last one is the end of an interval only
            count = here.stop - first
            given = dt[here], flags[0][here], shares, flags[1][here]
            parts = count if here.stop == N else count - 1
            of = (count, R, nx, ny, n_p, nw)
            at, ends = jacobians(here.start, here.stop)
            _call(self._interval, parts, of, *at, *ends, *given, *(one[first:] for one in made))
            if here.stop == N:
                break
        return tuple(made)

    def driven(self, by_x, by_p, end_x, end_p, dt, live, seen) -> tuple[np.ndarray, np.ndarray]:
        """(Bp, Dp) of `Linear` from Jacobians (N, R, nx, nx) of the state equation and (N, R, nx + ny, n_p) of both,
        and the same at the ends of the intervals."""
        (N, R, ny), nx, n_p = seen.shape, by_x.shape[3], by_p.shape[3]
        Bp = np.empty((N - 1, R, nx, n_p))
        Dp = np.empty((N, R, ny, n_p))
        flags = live.view(np.uint8), seen.view(np.uint8)
        _call(self._driven, N, (N, R, nx, ny, n_p), by_x, by_p, end_x, end_p, dt, *flags, Bp, Dp)
        return Bp, Dp

    def augmented(self, linear, sources) -> tuple[np.ndarray, ...]:
        """(A, C, Q, M, S) of `kalman.augmented`."""
        (N, R, ny, nx), nw, nz = linear.C.shape, linear.Dw.shape[3], len(sources.coloured)
        n = nx + nz
        shapes = ((1, (n, n)), (0, (ny, n)), (1, (n, n)), (0, (ny, ny)), (1, (n, ny)))
        made = [np.empty((N - steps, R, *shape)) for steps, shape in shapes]
        places = (sources.coloured, sources.white, sources.inputs)
        index = [np.asarray(one, dtype=ctypes.c_long) for one in places]
        strength = (sources.sigma, sources.tau, sources.of_white, sources.of_inputs, sources.variance)
        given = (linear.dt, linear.seen.astype(np.uint8), linear.A, linear.Bw0, linear.Bw1, linear.C, linear.Dw)
        sizes = (N, R, nx, ny, nw, *(len(one) for one in places))
        _call(self._augment, N, sizes, *index, *strength, *given, *made)
        return tuple(made)

    def covariance(self, A, C, Q, M, S, P0, to: Sequence[np.ndarray]) -> None:
        """Write (gain, inverse root, prediction covariance, log determinant) to the arrays `to`; S may be None. Raises
        numpy.linalg.LinAlgError when a covariance of an innovation is not positive definite."""
        N, R, ny, n = C.shape
        if not _call(self._covariance, R, (N, R, n, ny), A, C, Q, M, S, P0, *map(_as_it_lies, to)):
            raise np.linalg.LinAlgError("the covariance of an innovation is not positive definite")

    def whiten(self, of, Y, F, first, white: np.ndarray, states: np.ndarray | None) -> None:
        """Write the innovations (R, N, ny, nc) `of` a `kalman.Filter`, of columns Y, F, first, to the array `white`,
        and of one column the `states` (N, R, n, 1). `first` has the states after the last step afterwards."""
        (N, R, ny, n), nc = of.C.shape, Y.shape[3]
        apart = (ctypes.c_long(white.strides[axis] // white.itemsize) for axis in (0, 2))
        given = (of.A, of.C, of.gain, of.inverse_root, Y, F, first, ctypes.c_long(len(F)), *apart, _as_it_lies(white))
        if nc == 1:  # as most calls have, which would leave fifteen places of a tile empty
            _call(self._whiten_one, R, (N, R, n, F.shape[2], ny), *given, states)
            return
        assert states is None, "states are kept of one column"
        _call(self._whiten, _tiles(R, nc), (N, R, n, F.shape[2], ny, nc), *given)

    def whiten_histories(self, of, stations, first, series, squares: bool = False) -> np.ndarray:
        """Innovations (R, N, ny, nc) `of` a `kalman.Filter`, of columns that are sums of time histories (N, R,
        histories) at disturbance `stations`, from number `first` (nc,) on to that of the next column. Or their sums of
        squares (R, nc) alone."""
        return self._of_histories(of, stations, first, series, squares)

    def histories_in_parts(self, of, stations, series, together: int) -> Iterator[tuple[int, np.ndarray]]:
        """(first sample, `whiten_histories` of each time history), `together` samples at a time."""
        (N, R, _, n), nc = of.C.shape, series.shape[2]
        held = np.zeros((R, n, nc))
        for begin in range(0, N, together):
            part = slice(begin, begin + together + 1)  # with the first sample of the next part, whose states are kept
            white = self._of_histories(of, stations, np.arange(nc), series, part=part, held=held)
            yield begin, white[:, :together]

    def _of_histories(
        self, of, stations, first, series, squares: bool = False, part: slice = slice(None), held=None
    ) -> np.ndarray:
        """`whiten_histories` of some samples; `held` (R, n, nc): states at the first one, then those at the last."""
        C = of.C[part]
        Dw = of.linear.Dw[part]
        (N, R, ny, n), nc = C.shape, len(first)
        found = np.empty((R, nc) if squares else (R, N, ny, nc))
        sizes = (N, R, n, of.linear.Bw0.shape[2], ny, nc)
        begin = np.array([*first, series.shape[2]], dtype=ctypes.c_long)
        index = np.asarray(stations, dtype=ctypes.c_long)
        low, among = _range_of(index)
        at = (*(ctypes.c_long(one) for one in (Dw.shape[3], low, among)), index, begin)
        to = (None, found) if squares else (found, None)
        given = (of.A[part], C, of.gain[part], of.inverse_root[part], *at, series[part], Dw)
        by_state = of.linear.Bw0[part], of.linear.Bw1[part]
        _call(self._whiten_histories, _tiles(R, nc), sizes, *given, *by_state, held, *to)
        return found

    def entrances(self, of, stations, white, read: bool) -> tuple[np.ndarray, np.ndarray]:
        """(entering (ns, R, N, nc), read (ny, R, N, nc) or nothing of it) of `kalman.Filter.entrances`, from columns
        (R, N, ny, nc)."""
        (N, R, ny, n), nc, ns = of.C.shape, white.shape[3], len(stations)
        Dw = of.linear.Dw
        B0 = of.linear.Bw0
        B1 = of.linear.Bw1
        entering = np.empty((ns, R, N, nc))
        by_output = np.empty((ny if read else 0, R, N, nc))
        index = np.asarray(stations, dtype=ctypes.c_long)
        low, among = _range_of(index)
        at = (*(ctypes.c_long(one) for one in (Dw.shape[3], low, among, ns)), index)
        given = (of.A, of.C, of.gain, of.inverse_root, white, *at, Dw, B0, B1, entering, by_output if read else None)
        _call(self._entrances, _tiles(R, nc), (N, R, n, B0.shape[2], ny, nc), *given)
        return entering, by_output

    def costates(self, of, stations, white) -> tuple[np.ndarray, np.ndarray]:
        """Costates (N, R, n) of the predicted states, from innovations (R, N, ny, 1) `of` a `kalman.Filter`, and what
        these have in common with a unit at each sample of the disturbances `stations` (N, R, ns)."""
        N, R, ny, n = of.C.shape
        through = of.through
        found = np.empty((N, R, n))
        entering = np.empty((N, R, len(stations)))
        sizes = (ctypes.c_long(size) for size in (*through.Bw0.shape[2:], len(stations)))
        given = (of.A, of.C, of.gain, of.inverse_root, white, *sizes, np.asarray(stations, dtype=ctypes.c_long))
        _call(self._costates, R, (N, R, n, ny), *given, through.Dw, through.Bw0, through.Bw1, found, entering)
        return found, entering


def _tiles(records: int, columns: int) -> int:
    return records * -(-columns // _TILE)


def _range_of(index: np.ndarray) -> tuple[int, int]:
    """The lowest, and how many from it to the highest."""
    return (int(index.min()), int(np.ptp(index)) + 1) if len(index) else (0, 0)


def _as_it_lies(array: np.ndarray) -> ctypes.c_void_p:
    """Return where an array begins that the function writes to, also one that is part of a larger one."""
    return ctypes.c_void_p(array.ctypes.data)


Argument = np.ndarray | ctypes.c_long | ctypes.c_void_p | None


def _call(function, parts: int, sizes: tuple[int, ...], *arguments: Argument) -> bool:
    """Run the function on all its parts, shared out among threads; whether it returned 0 everywhere."""
    given = []
    kept = []
    failed = []
    for argument in arguments:
        if isinstance(argument, np.ndarray):
            kept.append(np.ascontiguousarray(argument))
            argument = ctypes.c_void_p(kept[-1].ctypes.data)
        given.append(argument)

    def run(first: int, last: int) -> None:
        if function(*(ctypes.c_long(size) for size in (first, last, *sizes)), *given):
            failed.append(first)

    if sizes[0] * sizes[1] <= 2 * _POINTS:  # to begin a thread would take longer
        run(0, parts)
    else:
        share_out(parts, run)
    return not failed


def filter_kernel(states: int, outputs: int) -> FilterKernel | None:
    """The compiled recursions, from the cache or compiled now; None without a compiler or time to compile, and where a
    system is too large for them."""
    if max(states, outputs) > _MOST:
        return None
    with _LOADING:
        found = _loaded(c_compiler())
        if found is None and not is_time_to_compile():  # there may be next time
            _loaded.cache_clear()
    return found


@cache
def _loaded(compiler: str | None) -> FilterKernel | None:
    library = None if compiler is None else compile_library("".join(map(c_source, _SOURCES)), _FLAGS)
    return None if library is None else FilterKernel(str(library))
