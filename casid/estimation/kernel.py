"""The compiled kernel of a model on numpy arrays. `Shooting` is its only user; see `kernel_source` for what it does."""

from __future__ import annotations

import ctypes
import logging
import platform
import time
from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np

from casid.estimation.compiler import c_compiler, compile_first, compile_library, library_path
from casid.estimation.emit import UnknownOperationError
from casid.estimation.kernel_source import Sizes, kernel_source, sizes_of
from casid.estimation.layout import Layout

_LOG = logging.getLogger(__name__)
# with the vector mathematics of glibc where that exists
_GLIBC = platform.libc_ver()[0] == "glibc" and platform.machine() == "x86_64"
FLAGS = (
    "-O2", "-march=native", "-fno-math-errno", "-shared", "-fPIC", *(("-DCASID_MVEC", "-lmvec") if _GLIBC else ())
)  # fmt: skip
_COMPILE_BASE, _COMPILE_PER_INSTRUCTION = 0.2, 1.2e-4  # s, measured with gcc on one core
_SOURCE_PER_INSTRUCTION = 5e-6  # s, to write and hash the C source


@dataclass(frozen=True, eq=False, kw_only=True)
class Packed:
    """Data of a layout as the kernel reads them: (blocks, L, stride, lanes), and (blocks,) the samples of each block of
    segments after which there is nothing but padding."""

    data: np.ndarray
    live: np.ndarray


class Kernel:
    """A compiled kernel: simulation and linearisation of segments, lanes at a time."""

    def __init__(self, library: str, sizes: Sizes) -> None:
        loaded = ctypes.CDLL(library)
        self.sizes, self.lanes = sizes, int(loaded.lanes())
        self._simulate, self._linearise = loaded.simulate, loaded.linearise
        self._banded = loaded.banded
        self._simulate.restype = self._linearise.restype = None

    def pack(self, layout: Layout) -> Packed:
        """The data of a layout; the last block is filled up with the last segment."""
        count, w = layout.segments, self.lanes
        blocks, m, o = -(-count // w), self.sizes.m, self.sizes.o
        packed = _aligned((blocks, layout.length, self.sizes.stride, w))
        parts = ((0, layout.u0), (m, layout.u1), (2 * m, layout.dt[..., None]), (2 * m + 1, layout.z),
                 (2 * m + 1 + o, layout.present))  # fmt: skip
        which = np.minimum(np.arange(blocks * w), count - 1).reshape(blocks, w)
        for first, values in parts:
            last = first + values.shape[2]
            packed[:, :, first:last] = values[which].transpose(0, 2, 3, 1)
        used = np.zeros(count, dtype=ctypes.c_long)
        segment, position = np.divmod(np.concatenate(layout.sample), layout.length)
        np.maximum.at(used, segment, position + 1)
        return Packed(data=packed, live=used[which].max(axis=1))

    def simulate(
        self, packed: Packed, nodes: np.ndarray, parameters: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """states (K, L, n), y (K, L, o), end (K, n), squares (K, o)."""
        (count, n), length, o = nodes.shape, packed.data.shape[1], self.sizes.o
        states, y = np.empty((count, length, n)), np.empty((count, length, o))
        end, squares = np.empty((count, n)), np.empty((count, o))
        _call(self._simulate, count, length, packed.live, packed.data, nodes, parameters, states, y, end, squares)
        return states, y, end, squares

    def linearise(
        self, packed: Packed, nodes: np.ndarray, parameters: np.ndarray, weights: np.ndarray,
        intensity: np.ndarray, rows: bool = False,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray | None, np.ndarray]:  # fmt: skip
        """hessian (K, n+f, n+f), channel gradient (K, o, n+f), transition (K, n, n+f), end (K, n), covariance (K, n, n)
        of process noise or None, and, when asked for, rows (K, L, o, n+f)."""
        (count, n), length, o = nodes.shape, packed.data.shape[1], self.sizes.o
        nf = n + self.sizes.f
        hessian, gradient = np.empty((count, nf, nf)), np.empty((count, o, nf))
        transition, end = np.empty((count, n, nf)), np.empty((count, n))
        covariance = np.empty((count, n, n)) if self.sizes.v else None
        jacobian = np.zeros((count, length, o, nf) if rows else 0)
        _call(self._linearise, count, length, packed.live, packed.data, nodes, parameters, weights, intensity,
              hessian, gradient, transition, end, covariance, jacobian if rows else None)  # fmt: skip
        return hessian, gradient, transition, end, covariance, jacobian

    def solve_banded(self, matrix: np.ndarray, right: np.ndarray) -> None:
        """Solve in place, right (size, sides); row i of matrix (size, 3 band + 1) holds columns i-band ... i+2 band.

        Raises numpy.linalg.LinAlgError when the matrix is singular.
        """
        size, width = matrix.shape
        if _call(self._banded, size, (width - 1) // 3, ctypes.c_long(right.shape[1]), matrix, right):
            raise np.linalg.LinAlgError("singular states and multipliers")


def _aligned(shape: tuple[int, ...]) -> np.ndarray:
    """Zeros that start where a vector may."""
    size = int(np.prod(shape))
    held = np.zeros(size + 8)
    first = -(held.ctypes.data // 8) % 8
    return held[first : first + size].reshape(shape)


def _call(function, count: int, length: int, *arguments: np.ndarray | ctypes.c_long | None) -> int:
    given, kept = [], []
    for argument in arguments:
        if not isinstance(argument, np.ndarray):
            given.append(argument)
            continue
        array = np.ascontiguousarray(argument)
        kept.append(array)
        given.append(ctypes.c_void_p(array.ctypes.data))
    return function(ctypes.c_long(count), ctypes.c_long(length), *given)


def model_kernel(functions: tuple[ca.Function, ca.Function], noises: int) -> Kernel | None:
    """The kernel of `stage_functions`, from the cache or compiled now; None (and said) where there is no compiler.
    Raises UnknownOperationError."""
    if c_compiler() is None:
        return None
    return _compiled(kernel_source(*functions, noises), sizes_of(functions[1], noises))


def _compiled(source: str, sizes: Sizes) -> Kernel | None:
    library = compile_library(source, FLAGS)
    return None if library is None else Kernel(str(library), sizes)


class KernelOffer:
    """The kernel of a model once it has earned its compilation: what was spent without it pays for it.

    `get()` is None until then, and for good where there is no compiler or the emitter does not know an operation.
    """

    def __init__(self, name: str, functions: Callable[[], tuple[ca.Function, ca.Function]], noises: int) -> None:
        self.spent = 0.0
        self._name, self._functions, self._noises = name, functions, noises
        self._kernel: Kernel | None = None
        self._settled = False
        self._source: tuple[str, Sizes, float] | None = None

    def get(self) -> Kernel | None:
        """The kernel, when it is there or worth its while now."""
        if self._settled:
            return self._kernel
        if c_compiler() is None:
            self._settled = True
            return None
        try:
            source, sizes, price = self._source or self._write()
        except UnknownOperationError as error:
            _LOG.warning("model '%s' is estimated without the fast kernel: %s", self._name, error)
            self._settled = True
            return None
        if compile_first() or self.spent >= price or library_path(source, FLAGS).exists():
            self._kernel, self._settled = _compiled(source, sizes), True
        return self._kernel

    def _write(self) -> tuple[str, Sizes, float]:
        begin = time.perf_counter()
        plain, linear = self._functions()
        source = kernel_source(plain, linear, self._noises)
        price = _COMPILE_BASE + _COMPILE_PER_INSTRUCTION * (plain.n_instructions() + linear.n_instructions())
        self._source = source, sizes_of(linear, self._noises), price
        self.spent -= time.perf_counter() - begin
        return self._source
