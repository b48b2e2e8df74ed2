"""Hold what an objective gives: a point, the value there, the linearisation about it, and the step that it predicts."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from casid.estimation.solvers.full_noise import FullNoise
from casid.estimation.solvers.kkt import Reduced
from casid.estimation.solvers.levels import NoiseLevels
from casid.estimation.transcriptions.dynamics import Blocks, Trajectory
from casid.estimation.transcriptions.equation import EquationValue


@dataclass(frozen=True, eq=False, kw_only=True)
class Point:
    """theta (parameters,), nodes (K, n), noise (T, n), points (K, L d, n) of collocation or None."""

    theta: np.ndarray
    nodes: np.ndarray
    noise: np.ndarray
    points: np.ndarray | None = None


Levels = NoiseLevels | FullNoise


@dataclass(frozen=True, eq=False, kw_only=True)
class NoiseState:
    """Weights of the residuals: the levels of the measured channels and, where defects are random, factor (T, n, n),
    a square root of their covariance. It belongs to a value: a change makes a new one."""

    levels: Levels
    factor: np.ndarray | None = None
    process: np.ndarray = field(default_factory=lambda: np.zeros(0))  # logarithms of levels that are no channel's

    def change_from(self, before: NoiseState) -> float:
        """Largest relative change of a level since another noise."""
        changes = np.log(self.levels.sigma / before.levels.sigma), self.process - before.process
        return max(float(np.abs(one).max(initial=0.0)) for one in changes)


@dataclass(frozen=True, eq=False, kw_only=True)
class ObjectiveValue:
    """cost at a point, weighed with `noise`: `rest` of priors, process noise and excess over soft path limits, and what
    `squares` (channels,), the sums of squared residuals (with a full covariance their moments, see full_noise), cost.
    Constraint residuals: defects (T, n), limits (rows,) beyond the limits of parameters in sizes of what is limited,
    gap of collocation, path (constraints, N) beyond the limits of states and outputs that must hold, in sizes of these.
    `parameters` (records, model parameters) are what each record was simulated with."""

    cost: float
    rest: float
    squares: np.ndarray
    parameters: np.ndarray
    trajectory: Trajectory | None
    equations: EquationValue | None
    noise: NoiseState
    defects: np.ndarray
    limits: np.ndarray
    gap: np.ndarray
    path: np.ndarray
    own: Any = None  # of a likelihood that the cost makes itself: `own.Whitened`, None where there is none

    def violation(self) -> float:
        """L1 norm of all constraint residuals, scaled by the typical size of the states."""
        return float(sum(np.abs(part).sum() for part in (self.defects, self.limits, self.gap, self.path)))

    def worst(self) -> float:
        """Largest constraint residual, scaled."""
        parts = (self.defects, self.limits, self.gap, self.path)
        return max(float(np.abs(part).max(initial=0.0)) for part in parts)


@dataclass(frozen=True, eq=False, kw_only=True)
class SolverStep:
    """A step, what it promises (slope of the cost, curvature along it) and the price of the constraints; `feasible`
    states whether the linearised constraints can all be satisfied."""

    theta: np.ndarray
    nodes: np.ndarray
    noise: np.ndarray
    points: np.ndarray | None
    slope: float
    curvature: float
    price: float
    limit_multipliers: np.ndarray
    path_multipliers: np.ndarray | None = None
    feasible: bool = True


@dataclass(frozen=True, eq=False, kw_only=True)
class LinearisedPaths:
    """values (constraints, N) at all samples of all records, and rows (constraints, N, n+f), their derivatives in the
    start state of the sample's segment and the free parameters of its record."""

    values: np.ndarray
    rows: np.ndarray


@dataclass(frozen=True, eq=False, kw_only=True)
class Linearised:
    """All that one linearisation at a point gives: blocks per segment, reduced systems per record, information matrix
    and gradient in the parameters, the gradient (channels, parameters) of each channel's part of the cost.
    `equation_hessian` is the part that the equations have in the information. `noise` is the value's, with the
    covariance that random defects have here."""

    point: Point
    blocks: Blocks | None
    reduced: list[Reduced]
    hessian: np.ndarray
    gradient: np.ndarray
    channel_gradients: np.ndarray
    equation_hessian: np.ndarray
    noise: NoiseState
    paths: LinearisedPaths | None = None


_ROUNDING = 1e-5  # of the norm of all measurements: a step below tolerance times this is not meaningful


def step_length(step: SolverStep, value: ObjectiveValue) -> float:
    """Length of a step in standard deviations of the solution."""
    noise = np.sqrt(2 * value.cost / value.noise.levels.count)
    return float(np.sqrt(max(step.curvature, 0.0)) / max(noise, 1e-300))


def negligible(step: SolverStep, value: ObjectiveValue, tolerance: float) -> bool:
    """Return True if a step moves the solution by less than `tolerance` of its standard deviations, or by rounding."""
    levels = value.noise.levels
    noise = np.sqrt(2 * value.cost / levels.count)
    return bool(np.sqrt(max(step.curvature, 0.0)) < tolerance * max(noise, _ROUNDING * levels.size))


def moved(point: Point, step: SolverStep, length: float) -> Point:
    """The point after `length` times the step."""
    points = None if point.points is None or step.points is None else point.points + length * step.points
    return replace(
        point,
        theta=point.theta + length * step.theta,
        nodes=point.nodes + length * step.nodes,
        noise=point.noise + length * step.noise,
        points=points,
    )
