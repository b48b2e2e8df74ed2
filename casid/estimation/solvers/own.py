"""Likelihoods that a cost makes itself: whitened residuals, their Jacobian, a log determinant; limits and priors here.

Solvers take an `OwnObjective` as they take an `Objective`. Innovations of a filter are such a likelihood, whose noise
and motion follow the parameters, and so is whatever a cost of a user's own returns.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np

from casid.arguments import given
from casid.errors import InputError
from casid.estimation.cost import Likelihood, OwnLikelihood
from casid.estimation.fitted import StateHistory
from casid.estimation.problem import Problem
from casid.estimation.solvers.effort import Effort
from casid.estimation.solvers.levels import NoiseLevels
from casid.estimation.solvers.limits import ParameterLimits
from casid.estimation.solvers.objective import Objective
from casid.estimation.solvers.point import Linearised, NoiseState, ObjectiveValue, Point, SolverStep
from casid.estimation.solvers.quadratic import jacobi_scale, parameter_step


@dataclass(frozen=True, eq=False, kw_only=True)
class Whitened:
    """A likelihood at a point: residual (m,), squares (channels,) of what the channels' noise is read off, `slope`
    (parameters,) of the log determinant, zero where it is left out, and whatever else the likelihood keeps of it."""

    residual: np.ndarray
    log_determinant: float
    squares: np.ndarray
    slope: np.ndarray
    kept: Any = None


@dataclass(frozen=True, eq=False, kw_only=True)
class Told:
    """Findings at an end besides the parameters; record -> arrays, as `Fit` has them."""

    measured: Mapping[str, np.ndarray] = field(default_factory=dict)
    predicted: Mapping[str, np.ndarray] = field(default_factory=dict)
    innovations: Mapping[str, np.ndarray] = field(default_factory=dict)
    states: Mapping[str, StateHistory] = field(default_factory=dict)
    process_noise: Mapping[str, tuple[float, float]] = field(default_factory=dict)


class Following(Protocol):
    """A likelihood with unknowns besides the parameters, a motion and the levels of the noise, which follow these."""

    names: tuple[str, ...]  # of the channels that `levels` has
    levels: NoiseLevels  # of the readings, to begin with
    process: np.ndarray  # logarithms of the other levels, to begin with
    eliminated: int  # unknowns of the motion, each a degree of freedom
    follows: bool  # whether there is anything to follow

    def motion(self, theta: np.ndarray) -> np.ndarray:
        """(K, n) the motion to begin with."""
        ...

    def at(self, theta: np.ndarray, motion: np.ndarray, noise: NoiseState) -> Whitened:
        """The likelihood at a point; not finite where the motion departs. Raises numpy.linalg.LinAlgError where the
        residuals have no density."""
        ...

    def again(self, at: Whitened, noise: NoiseState) -> Whitened:
        """The likelihood at the same point with another noise, and the slope that was there."""
        ...

    def jacobian(self, at: Whitened) -> np.ndarray:
        """(m, parameters) of the residual there."""
        ...

    def followed(self, at: Whitened, change: np.ndarray) -> np.ndarray:
        """(K, n) change of the motion to the most likely one after a change of the parameters."""
        ...

    def relaxed(self, at: Whitened, noise: NoiseState, step: LimitedStep | None) -> NoiseState:
        """The noise of highest likelihood, parameters at their optimum for every trial by a `step`, or else held."""
        ...

    def bent(self, at: Whitened) -> Whitened:
        """Return the likelihood with the slope of the log determinant."""
        ...

    def parts(self, at: Whitened, record: int) -> Iterator[tuple[int, np.ndarray, np.ndarray, np.ndarray]]:
        """Parts as of `Objective.parts`, of the residuals that follow each other in time."""
        ...

    def told(self, at: Whitened, noise: NoiseState) -> Told:
        """Return what it states of an end."""
        ...


# (Hessian, gradient) -> change (parameters,) of the parameters that minimises 1/2 d'Hd + g'd within the limits
LimitedStep = Callable[[np.ndarray, np.ndarray], np.ndarray]


class OwnObjective:
    """The residuals of a problem whose cost makes its likelihood itself; `effort` counts what is evaluated."""

    dynamics = None
    equations = None
    paths = None
    soft = False

    def __init__(self, problem: Problem, effort: Effort | None = None) -> None:
        assert isinstance(problem.cost, OwnLikelihood)
        made = problem.cost.likelihood(problem)
        self.problem = problem
        self.own: Following = made if hasattr(made, "followed") else _Given(problem, made)  # pyright: ignore
        self.effort = effort or Effort()
        self.limits = ParameterLimits(problem)
        self.noise = NoiseState(levels=self.own.levels, process=self.own.process)
        self.channel_names = self.own.names
        self.eliminated = self.own.eliminated
        self.in_time = bool(self.own.names)
        self.precision = 1.0 / problem.prior_std**2

    def start(self) -> Point:
        """Parameters at their start values, and the motion that the likelihood begins with."""
        theta = self.problem.start_vector
        return Point(theta=theta, nodes=self.own.motion(theta), noise=np.zeros((0, 0)))

    def value(self, point: Point, noise: NoiseState | None = None) -> ObjectiveValue:
        """The likelihood with a `noise`, that of the start if None; not finite where the prediction departs."""
        self.effort.add()
        noise = noise or self.noise
        try:
            return self._weighed(point, noise, self.own.at(point.theta, point.nodes, noise))
        except np.linalg.LinAlgError:  # the innovations have no density
            return self._weighed(point, noise, None)

    def _weighed(self, point: Point, noise: NoiseState, at: Whitened | None) -> ObjectiveValue:
        off = point.theta - self.problem.nominal
        rest = 0.5 * float(self.precision @ off**2)
        values = self.limits.at(point.theta)[0]
        beyond = np.maximum(values - self.limits.upper, 0.0) + np.minimum(values - self.limits.lower, 0.0)
        nothing = np.zeros((0, 0))
        return ObjectiveValue(
            cost=np.inf if at is None else rest + 0.5 * float(at.residual @ at.residual),
            rest=rest,
            squares=np.full(len(noise.levels.sigma), np.inf) if at is None else at.squares,
            parameters=self.problem.model_parameters(point.theta),
            trajectory=None,
            equations=None,
            noise=noise,
            defects=nothing,
            limits=beyond,
            gap=nothing,
            path=nothing,
            own=at,
        )

    def reweighed(self, point: Point, value: ObjectiveValue, noise: NoiseState) -> ObjectiveValue:
        """The value at the same point with another noise."""
        if noise is value.noise or value.own is None:
            return value
        try:
            return self._weighed(point, noise, self.own.again(value.own, noise))
        except np.linalg.LinAlgError:
            return self._weighed(point, noise, None)

    def relaxed(self, point: Point, value: ObjectiveValue, held: bool = False) -> tuple[ObjectiveValue, float]:
        """The value with the noise of highest likelihood, and the largest relative change of a level; with parameters
        `held`, or at their optimum for the linearised likelihood."""
        if not self.own.follows or value.own is None:
            return value, 0.0

        def step(hessian: np.ndarray, gradient: np.ndarray) -> np.ndarray:
            return self._limited(point.theta, hessian, gradient)[0]

        noise = self.own.relaxed(value.own, value.noise, None if held else step)
        return self.reweighed(point, value, noise), noise.change_from(value.noise)

    def bent(self, value: ObjectiveValue) -> ObjectiveValue:
        """The value with the slope of the log determinant, which `linearise` then counts."""
        assert value.own is not None
        return replace(value, own=self.own.bent(value.own))

    def linearise(self, point: Point, value: ObjectiveValue) -> Linearised:
        """Information and gradient of the parameters. Raises numpy.linalg.LinAlgError where there are none."""
        self.effort.add()
        at = value.own
        if at is None:
            raise np.linalg.LinAlgError("the likelihood does not exist here")
        J = self.own.jacobian(at)
        off = point.theta - self.problem.nominal
        return Linearised(
            point=point,
            blocks=None,
            reduced=[],
            hessian=J.T @ J + np.diag(self.precision),
            gradient=J.T @ at.residual + self.precision * off + 0.5 * at.slope,
            channel_gradients=np.zeros((0, len(off))),
            equation_hessian=np.zeros((len(off), len(off))),
            noise=value.noise,
        )

    def step(
        self, point: Point, value: ObjectiveValue, linear: Linearised, damping: float, concentrated: bool = False
    ) -> SolverStep:
        """The Gauss-Newton step, with `damping` times its diagonal added to the information; the noise is not counted
        as following it, `concentrated` or not. Raises numpy.linalg.LinAlgError as `step_by`."""
        return self.step_by(linear, linear.hessian + damping * np.diag(jacobi_scale(linear.hessian) ** -2.0))

    def step_by(self, linear: Linearised, curvature: np.ndarray) -> SolverStep:
        """The step whose parameters minimise the gradient's line with a curvature of their own within the limits.
        Raises numpy.linalg.LinAlgError when it is not positive definite and limits act."""
        point = linear.point
        change, multipliers = self._limited(point.theta, curvature, linear.gradient)
        bent = self.limits.curvature(point.theta, multipliers)
        if bent.any():
            with suppress(np.linalg.LinAlgError):
                change, multipliers = self._limited(point.theta, curvature + bent, linear.gradient)
        return SolverStep(
            theta=change,
            nodes=np.zeros_like(point.nodes),
            noise=np.zeros_like(point.noise),
            points=None,
            slope=float(linear.gradient @ change),
            curvature=float(change @ linear.hessian @ change),
            price=float(np.abs(multipliers).max(initial=0.0)),
            limit_multipliers=multipliers,
        )

    def with_motion(self, value: ObjectiveValue, step: SolverStep) -> SolverStep:
        """The step with the motion that follows it."""
        return step if value.own is None else replace(step, nodes=self.own.followed(value.own, step.theta))

    def _limited(self, theta: np.ndarray, hessian: np.ndarray, gradient: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        if not len(self.limits):  # directions of which the data say nothing stay where they are
            scale = jacobi_scale(hessian)
            inverse = np.linalg.pinv(hessian * np.outer(scale, scale), rcond=1e-13, hermitian=True)
            return -scale * (inverse @ (scale * gradient)), np.zeros(0)
        return parameter_step(hessian, gradient, *self.limits.about(theta))

    def likelihood_cost(self, value: ObjectiveValue) -> float:
        """-ln(likelihood x prior), up to a constant."""
        return value.cost + 0.5 * (0.0 if value.own is None else value.own.log_determinant)

    def misfit(self, value: ObjectiveValue) -> float:
        """See `Objective.misfit`."""
        found = self.likelihood_cost(value)
        return found if np.isfinite(found) else np.inf

    def log_likelihood(self, value: ObjectiveValue) -> float:
        """ln(likelihood) of all readings, without priors."""
        if value.own is None:
            return np.nan
        samples = value.noise.levels.count
        return value.rest - self.likelihood_cost(value) - 0.5 * samples * float(np.log(2.0 * np.pi))

    def held_paths(self, linear: Linearised) -> None:
        """None: a likelihood of its own has no limits on its path."""

    def parts(
        self, value: ObjectiveValue, linear: Linearised, paths: Any, record: int
    ) -> Iterator[tuple[int, np.ndarray, np.ndarray, np.ndarray]]:
        """See `Objective.parts`."""
        if value.own is not None:
            yield from self.own.parts(value.own, record)

    def told(self, value: ObjectiveValue) -> Told:
        """Return what the likelihood states of an end."""
        return Told() if value.own is None else self.own.told(value.own, value.noise)


class _Given:
    """A likelihood of a user's own, in which nothing follows the parameters: what a `Following` does besides is not
    asked of it."""

    names = ()
    process = np.zeros(0)
    eliminated = 0
    follows = False

    def __init__(self, problem: Problem, made: Likelihood) -> None:
        for name in ("residual", "jacobian", "log_determinant"):
            if not callable(getattr(made, name, None)):
                cost = type(problem.cost).__name__
                raise InputError(
                    f"Problem: {cost}.likelihood returned {given(made)}, without a method '{name}'; expected an object "
                    "with residual(theta), jacobian(theta) and log_determinant(theta)"
                )
        self.made = made
        self.where = f"{type(made).__name__} of {type(problem.cost).__name__}"
        count = len(self._numbers("residual", problem.start_vector, None))
        one = np.ones(1)
        self.levels = NoiseLevels(
            sigma=one,
            fixed=True,
            proportional=False,
            share=one,
            present=np.array([count]),
            floor=one,
            start=one,
            magnitude=np.array([float(count)]),
        )

    def _numbers(self, name: str, theta: np.ndarray, shape: tuple[int, ...] | None) -> np.ndarray:
        """Evaluate a method, of a `shape`, or of one row."""
        found = np.asarray(getattr(self.made, name)(theta.copy()), dtype=float)
        if found.ndim != 1 if shape is None else found.shape != shape:
            expected = "(residuals,)" if shape is None else str(shape)
            raise InputError(f"{self.where}: {name}(theta) has the shape {found.shape}; expected {expected}")
        return found

    def motion(self, theta: np.ndarray) -> np.ndarray:
        return np.zeros((0, 0))

    def at(self, theta: np.ndarray, motion: np.ndarray, noise: NoiseState) -> Whitened:
        residual = self._numbers("residual", theta, (self.levels.count,))
        determinant = float(self._numbers("log_determinant", theta, ()))
        squares = np.array([float(residual @ residual)])
        nothing = np.zeros(len(theta))
        return Whitened(residual=residual, log_determinant=determinant, squares=squares, slope=nothing, kept=theta)

    def jacobian(self, at: Whitened) -> np.ndarray:
        return self._numbers("jacobian", at.kept, (len(at.residual), len(at.kept)))

    def parts(self, at: Whitened, record: int) -> Iterator[tuple[int, np.ndarray, np.ndarray, np.ndarray]]:
        yield from ()

    def told(self, at: Whitened, noise: NoiseState) -> Told:
        return Told()


AnyObjective = Objective | OwnObjective
