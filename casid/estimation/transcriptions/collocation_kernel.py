"""The compiled kernel of collocation on numpy arrays; `LiftedCollocation` is its only user."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from dataclasses import dataclass

import casadi as ca
import numpy as np

from casid.estimation.transcriptions.dynamics import Blocks
from casid.estimation.transcriptions.kernel import KernelOffer, Packed, Reduction, aligned, call, triangles, unfilled
from casid.native.kernel_source import Sizes, collocation_sizes, collocation_source


@dataclass(frozen=True, eq=False, kw_only=True)
class KernelLift:
    """A `Lift` of the compiled kernel, which keeps it in its own order."""

    kernel: CollocationKernel
    kept: np.ndarray
    shift: np.ndarray

    def follow(
        self, nodes: np.ndarray, local: np.ndarray, multipliers: np.ndarray, scale: np.ndarray
    ) -> tuple[np.ndarray, float]:
        """Follow a step as `Lift` asks."""
        return self.kernel.follow(self.kept, nodes, local, multipliers, scale)


class CollocationKernel:
    """Residuals and linearisation of collocation, lanes of segments at a time, and the step of a record."""

    def __init__(self, library: str, sizes: Sizes, degree: int) -> None:
        self._loaded = loaded = ctypes.CDLL(library)
        self.sizes = sizes
        self.degree = degree
        self.lanes = call(loaded.lanes)
        self.reduce = Reduction(loaded, sizes)
        points = degree * sizes.n
        self._work = aligned((points * (points + 1 + sizes.n + sizes.f) * self.lanes,))

    def gaps(
        self, packed: Packed, nodes: np.ndarray, points: np.ndarray, parameters: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """y (K, L, o), gap like points (K, L d, n), squares (K, o)."""
        count = len(nodes)
        length = packed.data.shape[1]
        o = self.sizes.o
        y = np.empty((count, length, o))
        gap = np.empty(points.shape)
        squares = np.empty((count, o))
        call(self._loaded.gaps, count, length, packed.data, nodes, points, parameters, packed.seen, y, gap, squares)
        return y, gap, squares

    def motion(
        self, packed: Packed, nodes: np.ndarray, parameters: np.ndarray, scale: np.ndarray, tolerance: float
    ) -> np.ndarray:
        """points (K, L d, n) of the motion from the nodes, to a relative tolerance of each state or of its scale."""
        (count, n), length = nodes.shape, packed.data.shape[1]
        points = np.empty((count, length * self.degree, n))
        call(self._loaded.motion, count, length, packed.data, nodes, parameters, scale, tolerance, self._work, points)
        return points

    def lift(
        self,
        packed: Packed,
        nodes: np.ndarray,
        points: np.ndarray,
        parameters: np.ndarray,
        weights: np.ndarray,
        rows: bool = False,
        keep: bool = False,
    ) -> Blocks:
        """weights (patterns, o, o) as in `Shooting.blocks`; keep: what interior states follow by."""
        count = len(nodes)
        blocks, length = packed.data.shape[:2]
        shift = np.empty((count, self.sizes.n + self.sizes.f + 2))
        kept = aligned((blocks, length, call(self._loaded.kept), self.lanes)) if keep else None
        lift = None if kept is None else KernelLift(kernel=self, kept=kept, shift=shift)
        found = unfilled(self.sizes, count, length if rows else 0, lift)
        given = packed.data, nodes, points, parameters, *triangles(weights), self._work
        to = found.hessian, found.channel_gradient, found.transition, found.end, shift, kept, found.rows
        call(self._loaded.lift, count, length, *given, *to)
        found.channel_gradient.sum(axis=1, out=found.gradient)
        return found

    def follow(
        self, kept: np.ndarray, nodes: np.ndarray, local: np.ndarray, multipliers: np.ndarray, scale: np.ndarray
    ) -> tuple[np.ndarray, float]:
        """Step of the interior states (K, L d, n) for steps of nodes (K, n) and parameters (K, f), and the largest
        costate times scale (n,), from the multipliers (K, n) of the ends."""
        (count, n), length = nodes.shape, kept.shape[1]
        steps = np.empty((count, length * self.degree, n))
        price = np.empty(count)
        call(self._loaded.follow, count, length, kept, nodes, local, multipliers, scale, steps, price)
        return steps, float(price.max(initial=0.0))


def collocation_offer(
    name: str, functions: Mapping[str, ca.Function], tau: np.ndarray, c: np.ndarray
) -> KernelOffer[CollocationKernel]:
    """The offer of the kernel; arguments as of `collocation_source`."""

    def write() -> tuple[str, int]:
        return collocation_source(functions, tau, c), sum(f.n_instructions() for f in functions.values())

    sizes = collocation_sizes(functions)
    return KernelOffer(name, write, lambda library: CollocationKernel(library, sizes, len(tau)))
