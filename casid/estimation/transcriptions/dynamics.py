"""Define the dynamics of a transcription: segments that can be simulated and linearised.

Sizes: K segments, L samples each, n states, f free parameters (of the segment's record), o outputs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Protocol

import casadi as ca
import numpy as np

from casid.estimation.transcriptions.layout import Layout


@dataclass(frozen=True, eq=False, kw_only=True)
class Trajectory:
    """Simulated from nodes: states (K, L, n) and outputs y (K, L, o) at the samples. `arrived` (K, n) state after the
    last step and `end` (K, n) the same after an event there, squares (K, o) sums of squared residuals where they were
    gathered on the way. `points`, `gap` are only those of collocation: (K, L d, n) interior states and what they leave
    unsatisfied."""

    states: np.ndarray
    y: np.ndarray
    arrived: np.ndarray
    end: np.ndarray
    squares: np.ndarray | None = None
    points: np.ndarray | None = None
    gap: np.ndarray | None = None


class Lift(Protocol):
    """Response of the interior states of collocation to a step. The offset o of the predictions that its equations
    make while they are left open, with the residuals r and rows R: shift (K, n+f+2) is R'o, r'o, o'o of each
    segment."""

    @property
    def shift(self) -> np.ndarray:
        """(K, n+f+2)."""
        ...

    def follow(
        self, nodes: np.ndarray, local: np.ndarray, multipliers: np.ndarray, scale: np.ndarray
    ) -> tuple[np.ndarray, float]:
        """Step of the interior states (K, points, n) for steps of nodes (K, n) and parameters (K, f), and the largest
        costate times scale (n,), from the multipliers (K, n) of the ends, zero where nothing follows."""
        ...


@dataclass(frozen=True, eq=False, kw_only=True)
class Blocks:
    """Blocks that the simulation of each segment gives."""

    hessian: np.ndarray  # (K, n+f, n+f) of 1/2 sum (whitened residual)^2
    channel_gradient: np.ndarray  # (K, o, n+f) of the same for each whitened output; gradient (K, n+f) is its sum
    gradient: np.ndarray
    # transition, end: the end state (K, n) and its derivatives (K, n, n+f) in start state and parameters
    transition: np.ndarray
    end: np.ndarray
    covariance: np.ndarray | None  # (K, n, n) that process noise adds to the end state; None without
    # how interior states follow, only of collocation; gradients are then those at the predictions that satisfy its
    # linearised equations
    lift: Lift | None = None
    rows: np.ndarray | None = None  # (K, L, o, n+f) derivatives of the whitened outputs, where they were asked for


class Reducing(Protocol):
    """A kernel, of shooting or collocation, that has the step of a record."""

    @property
    def reduce(self) -> Callable[..., tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """The step, see `Reduction`."""
        ...


@dataclass(frozen=True, eq=False, kw_only=True)
class Slab:
    """rows (k, l, o, n+f): derivatives of the whitened outputs in (start state of their segment, parameters), for some
    segments and some samples of each. All rows of a record at once would take most of the memory."""

    segments: slice
    samples: slice
    rows: np.ndarray


@dataclass(frozen=True, eq=False, kw_only=True)
class ProblemSymbols:
    """The unknowns and data of a nonlinear programme, one column per segment or sample (CasADi MX)."""

    nodes: ca.MX  # (n, K) start states; points (n, K*d) interior states of collocation, None without
    points: ca.MX | None
    u0: ca.MX  # u0, u1: (m, K*L) inputs at both ends of each sample interval; dt (1, K*L) its length [s]
    u1: ca.MX
    dt: ca.MX
    base: ca.MX  # (q, K) fixed values of all model parameters; free (f, K) the free ones, which replace theirs
    free: ca.MX


@dataclass(frozen=True, eq=False, kw_only=True)
class ShotDerivatives:
    """Functions of segments, columns of (x, u0, u1, dt, base, q) as `shot` takes them; w = (start, free parameters)."""

    first: ca.Function  # -> (n (n+f), K) derivative of the end state in w, column-major
    # (..., multipliers of end (n, K) and outputs (o, K*L), curvature of outputs (o, K*L)) -> the upper triangle of the
    # Hessian in w, column-major; the curvature is that of the cost in each output
    second: ca.Function


@dataclass(frozen=True, eq=False, kw_only=True)
class Simulated:
    """Motion as expressions of a nonlinear programme: states (n, K*L), end (n, K), outputs y (o, K*L), and a column
    `gap` that must vanish besides the defects. `derivatives` where the motion knows those of its own: in every
    segment's start state and free parameters, of `end` and of a sum of `end` and `y`."""

    states: ca.MX
    end: ca.MX
    y: ca.MX
    gap: ca.MX
    derivatives: ShotDerivatives | None = None


class Dynamics(Protocol):
    """A problem's motion on a layout of segments: what solvers work on.

    `points0` are interior unknowns at the start, None without; `soft` states whether defects are random with the
    covariance that `blocks` gives; `kernel` eliminates states fast where there is one.
    """

    layout: Layout

    @property
    def points0(self) -> np.ndarray | None:
        """Interior unknowns at the start."""
        ...

    @property
    def soft(self) -> bool:
        """Return True if defects are random."""
        ...

    @property
    def kernel(self) -> Reducing | None:
        """The compiled kernel when there is one now."""
        ...

    def trajectory(self, nodes: np.ndarray, parameters: np.ndarray, points: np.ndarray | None = None) -> Trajectory:
        """Simulate from nodes (K, n), parameters (K, model parameters) and interior unknowns."""
        ...

    def blocks(self, trajectory: Trajectory, parameters: np.ndarray, weights: np.ndarray) -> Blocks:
        """Linearised along a trajectory; weights (patterns, o, o): the lower triangle that whitens the residuals of
        each pattern of present samples, zero in the rows and columns of what is missing."""
        ...

    def slabs(
        self, trajectory: Trajectory, parameters: np.ndarray, weights: np.ndarray, segments: slice
    ) -> Iterator[Slab]:
        """The rows of some segments in the order of time."""
        ...

    def watching(self, names: tuple[str, ...]) -> Dynamics:
        """The same motion with the named states and outputs as its outputs, present at every sample: its `slabs` take
        a trajectory of this one."""
        ...

    def symbolic(self, at: ProblemSymbols) -> Simulated:
        """The same motion as expressions, for solvers that take a nonlinear programme."""
        ...
