"""The compiled kernel of a model on numpy arrays. `Shooting` is its only user; see `kernel_source` for what it does."""

from __future__ import annotations

import ctypes
import logging
import platform
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from typing import Generic, TypeVar

import casadi as ca
import numpy as np

from casid.estimation.transcriptions.dynamics import Blocks, Lift
from casid.estimation.transcriptions.layout import Layout
from casid.native.compiler import c_compiler, cached_library, compile_first, compile_library, is_time_to_compile
from casid.native.emitter import UnknownOperationError
from casid.native.kernel_source import Sizes, kernel_source, sizes_of

K = TypeVar("K")
_LOG = logging.getLogger(__name__)
# with the vector mathematics of glibc where that exists
_GLIBC = platform.libc_ver()[0] == "glibc" and platform.machine() == "x86_64"
FLAGS = (
    "-O2",
    "-funroll-loops",
    "-march=native",
    "-fno-math-errno",
    "-shared",
    "-fPIC",
    *(("-DCASID_MVEC", "-lmvec") if _GLIBC else ()),
)
# s, measured with gcc on one core
_COMPILE_BASE = 0.2
_COMPILE_PER_INSTRUCTION = 1.2e-4


@dataclass(frozen=True, eq=False, kw_only=True)
class Packed:
    """Data of a layout as the kernel reads them: (blocks, L, stride, lanes), and (blocks,) the samples of each block of
    segments after which there is nothing but padding. `seen` (patterns, o) as in the layout."""

    data: np.ndarray
    live: np.ndarray
    seen: np.ndarray

    def part(self, blocks: slice, first: int, stop: int) -> Packed:
        """Return some blocks, samples first ... stop-1."""
        data = self.data[blocks, first:stop]
        live = np.clip(self.live[blocks] - first, 0, stop - first)
        copy = aligned(data.shape)
        copy[...] = data
        return replace(self, data=copy, live=live)


def pack(layout: Layout, sizes: Sizes, lanes: int) -> Packed:
    """The data of a layout; the last block is filled up with the last segment."""
    count = layout.segments
    w = lanes
    blocks = -(-count // w)
    m = sizes.m
    o = sizes.o
    packed = aligned((blocks, layout.length, sizes.stride, w))
    parts = (
        (0, layout.u0),
        (m, layout.u1),
        (2 * m, layout.dt[..., None]),
        (2 * m + 1, layout.z),
        (2 * m + 1 + o, layout.pattern[..., None]),
    )
    which = np.minimum(np.arange(blocks * w), count - 1).reshape(blocks, w)
    for first, values in parts:
        last = first + values.shape[2]
        packed[:, :, first:last] = values[which].transpose(0, 2, 3, 1)
    used = layout.live.astype(ctypes.c_long)
    return Packed(data=packed, live=used[which].max(axis=1), seen=layout.seen)


class Reduction:
    """The step of a record by compiled code; see `reduce.c`."""

    def __init__(self, loaded: ctypes.CDLL, sizes: Sizes) -> None:
        self.sizes = sizes
        self._loaded = loaded
        loaded.work.restype = ctypes.c_long
        self._space = np.empty(0)

    def __call__(
        self,
        hessian: np.ndarray,
        gradient: np.ndarray,
        transition: np.ndarray,
        defect: np.ndarray,
        covariance: np.ndarray | None,
        scale: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """states (M, n, 1+f), multipliers (M-1, n, 1+f) and (f, 1+f) minus the gradient and information, see `kkt`; not
        for two threads at once. Raises numpy.linalg.LinAlgError when the system is singular."""
        count = len(hessian)
        sides = 1 + self.sizes.f
        n = self.sizes.n
        size = call(self._loaded.work, count)
        if len(self._space) < size:
            self._space = aligned((size,))
        states = np.empty((count, n, sides))
        multipliers = np.empty((count - 1, n, sides))
        information = np.empty((self.sizes.f, sides))
        given = hessian, gradient, transition, defect, covariance, scale
        if call(self._loaded.reduce, count, *given, self._space, states, multipliers, information):
            raise np.linalg.LinAlgError("singular states and multipliers")
        return states, multipliers, information


class Kernel:
    """A compiled kernel: simulation and linearisation of segments, lanes at a time, and the step of a record."""

    def __init__(self, library: str, sizes: Sizes) -> None:
        self._loaded = ctypes.CDLL(library)
        self.sizes = sizes
        self.lanes = call(self._loaded.lanes)
        self.reduce = Reduction(self._loaded, sizes)

    def simulate(
        self, packed: Packed, nodes: np.ndarray, parameters: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """states (K, L, n), y (K, L, o), end (K, n), squares (K, o)."""
        (count, n), length, o = nodes.shape, packed.data.shape[1], self.sizes.o
        states = np.empty((count, length, n))
        y = np.empty((count, length, o))
        end = np.empty((count, n))
        squares = np.empty((count, o))
        given = packed.live, packed.data, nodes, parameters, packed.seen
        call(self._loaded.simulate, count, length, *given, states, y, end, squares)
        return states, y, end, squares

    def linearise(
        self,
        packed: Packed,
        nodes: np.ndarray,
        parameters: np.ndarray,
        weights: np.ndarray,
        intensity: np.ndarray,
        rows: bool = False,
    ) -> Blocks:
        """weights (patterns, o, o) as in `Shooting.blocks`."""
        count = len(nodes)
        length = packed.data.shape[1]
        found = unfilled(self.sizes, count, length if rows else 0)
        given = packed.live, packed.data, nodes, parameters, *triangles(weights), intensity
        to = found.hessian, found.channel_gradient, found.transition, found.end, found.covariance, found.rows
        call(self._loaded.linearise, count, length, *given, *to)
        found.channel_gradient.sum(axis=1, out=found.gradient)
        return found


def unfilled(sizes: Sizes, count: int, length: int, lift: Lift | None = None) -> Blocks:
    """Blocks of `count` segments for a kernel to fill, with the rows of so many samples, None of none."""
    n = sizes.n
    nf = n + sizes.f
    return Blocks(
        hessian=np.empty((count, nf, nf)),
        channel_gradient=np.empty((count, sizes.o, nf)),
        gradient=np.empty((count, nf)),
        transition=np.empty((count, n, nf)),
        end=np.empty((count, n)),
        covariance=np.empty((count, n, n)) if sizes.v else None,
        lift=lift,
        rows=np.zeros((count, length, sizes.o, nf)) if length else None,
    )


def triangles(weights: np.ndarray) -> tuple[np.ndarray, bool]:
    """Lower triangles (patterns, o (o + 1)/2) of weights (patterns, o, o), and whether any has more than a diagonal."""
    return weights[:, *_below(weights.shape[1])], is_dense(weights)


_below = cache(np.tril_indices)  # asked at every linearisation


def is_dense(weights: np.ndarray) -> bool:
    """Return True if any of the matrices (patterns, o, o) has more than a diagonal."""
    return bool(np.count_nonzero(weights) > np.count_nonzero(np.diagonal(weights, axis1=1, axis2=2)))


def whitened(values: np.ndarray, weights: np.ndarray, pattern: np.ndarray) -> np.ndarray:
    """values (..., o) or (..., o, columns), weighed by the triangle (o, o) of the pattern (...) of their sample;
    what is not measured may be no number."""
    vector = values.ndim == pattern.ndim + 1
    factor = np.diagonal(weights, axis1=1, axis2=2)[pattern]
    factor = factor if vector else factor[..., None]
    values = np.where(factor != 0.0, values, 0.0)
    if not is_dense(weights):
        return values * factor
    matrix = weights[pattern]
    return (matrix @ values[..., None])[..., 0] if vector else matrix @ values


def aligned(shape: tuple[int, ...]) -> np.ndarray:
    """Zeros that start where a vector may."""
    size = int(np.prod(shape))
    held = np.zeros(size + 8)
    first = -(held.ctypes.data // 8) % 8
    return held[first : first + size].reshape(shape)


def call(function, *arguments: np.ndarray | float | None) -> int:
    """What a C function returns: arrays go as the address of their numbers in C order, whole numbers as long."""
    kept = [np.ascontiguousarray(a) if isinstance(a, np.ndarray) else a for a in arguments]
    return function(*map(_passed, kept))


def _passed(argument: np.ndarray | float | None):
    if isinstance(argument, np.ndarray):
        return ctypes.c_void_p(argument.__array_interface__["data"][0])
    if isinstance(argument, float):
        return ctypes.c_double(argument)
    return None if argument is None else ctypes.c_long(argument)


@cache
def _say(model: str, why: str) -> None:
    """Once of each model, however many kernels it has."""
    _LOG.warning("model '%s' is estimated without the fast kernel, slower with the same result: %s", model, why)


class KernelOffer(Generic[K]):
    """A kernel of a model once it has earned its compilation: what was spent without it pays for it.

    `get()` is None until then, and for good where there is no compiler or the emitter does not know an operation.

    write   makes the source and counts its instructions
    load    makes the kernel of the compiled library
    """

    def __init__(self, name: str, write: Callable[[], tuple[str, int]], load: Callable[[str], K]) -> None:
        self.spent = 0.0
        self._name = name
        self._make = write
        self._load = load
        self._kernel: K | None = None
        self._settled = self._looked = self._cached = False
        self._source: tuple[str, float] | None = None

    def get(self) -> K | None:
        """The kernel, when it is there or worth its while now."""
        if self._settled:
            return self._kernel
        if c_compiler() is None:
            self._settled = True
            return None
        try:
            source, price = self._source or self._write()
        except UnknownOperationError as error:
            _say(self._name, str(error))
            self._settled = True
            return None
        if not self._looked:  # once: to look through the cache takes as long as a small simulation
            self._looked, self._cached = True, cached_library(source, FLAGS) is not None
        earned = self.spent >= price and is_time_to_compile(price)
        if compile_first() or earned or self._cached:
            library = compile_library(source, FLAGS)
            self._kernel = None if library is None else self._load(str(library))
            self._settled = library is not None or is_time_to_compile()
        return self._kernel

    def _write(self) -> tuple[str, float]:
        begin = time.perf_counter()
        source, instructions = self._make()
        self._source = source, _COMPILE_BASE + _COMPILE_PER_INSTRUCTION * instructions
        self.spent -= time.perf_counter() - begin
        return self._source


def shooting_offer(
    name: str, functions: Callable[[], tuple[ca.Function, ca.Function]], noises: int
) -> KernelOffer[Kernel]:
    """The offer of the kernel of shooting, of what `stage_functions` gives."""

    def write() -> tuple[str, int]:
        plain, linear = functions()
        return kernel_source(plain, linear, noises), plain.n_instructions() + linear.n_instructions()

    return KernelOffer(name, write, lambda library: Kernel(library, sizes_of(functions()[1], noises)))
