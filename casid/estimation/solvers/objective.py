"""The weighted residuals of a problem in one transcription: value at a point, and the step towards the minimum.

A point is the parameters, the start states of all segments (nodes), the process noise of every tied pair of segments
in units of its standard deviation, and, for collocation, the interior states. Nothing here changes: what residuals are
weighed with goes with the value, and every method is a function of its arguments.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import replace

import numpy as np

from casid.errors import EstimationError
from casid.estimation.noise import Huber, Noise, StudentT
from casid.estimation.problem import Problem
from casid.estimation.solvers.effort import Effort
from casid.estimation.solvers.full_noise import full_noise, moments_of
from casid.estimation.solvers.kkt import BandedKKT, Reduced
from casid.estimation.solvers.levels import noise_levels
from casid.estimation.solvers.limits import ParameterLimits
from casid.estimation.solvers.paths import HeldPaths, PathLimits, PathStep
from casid.estimation.solvers.point import Levels, Linearised, NoiseState, ObjectiveValue, Point, SolverStep
from casid.estimation.solvers.quadratic import jacobi_scale, parameter_step
from casid.estimation.transcriptions.dynamics import Blocks, Dynamics, Reducing, Trajectory
from casid.estimation.transcriptions.equation import EquationPart, EquationValue, equations_of
from casid.estimation.transcriptions.kernel import whitened

_MOST = 0.75  # of the curvature that the noise may take away: the rest keeps the step a descent
_DEFINITE = 1e-6  # of the largest pivot: with smaller ones rounding of 1e-16 is more than 1e-10 of the covariance


class Objective:
    """Residuals of `problem`; `dynamics` is None where nothing is simulated. `noise` is what to begin with, and `begin`
    the point, that of the problem's start and guess if None. `effort` counts what is evaluated."""

    def __init__(
        self,
        problem: Problem,
        dynamics: Dynamics | None,
        begin: Point | None = None,
        effort: Effort | None = None,
    ) -> None:
        self.problem = problem
        self.dynamics = dynamics
        self._begin = begin
        self.effort = effort or Effort()
        self.part, self.equation_share = problem.weights
        self.equations = equations_of(problem) if self.equation_share else None
        n = len(problem.model.states)
        self.scale = problem.state_size
        self.limits = ParameterLimits(problem)
        if not np.isfinite(self.limits.at(problem.start_vector)[0]).all():
            raise EstimationError(
                "solve: the function of a nonlinear constraint is no number at the start values; start elsewhere, or "
                "write it without the division, root or logarithm"
            )
        self.paths: PathLimits | None = None
        own = [problem.columns(r) for r in range(len(problem.records))]
        self._columns = [(columns, np.ix_(columns, columns)) for columns in own]
        factor = None
        if dynamics is not None:
            self.layout = layout = dynamics.layout
            segments = [layout.segments_of(r) for r in range(len(problem.records))]
            self.kkt = [BandedKKT(one.stop - one.start, n) for one in segments]
            known, std = problem.initial_knowledge
            self.centre = np.where(np.isnan(known), layout.start[layout.first], known)
            self.exact = std == 0.0
            self.initial_precision = np.where(self.exact, 0.0, 1.0 / np.where(self.exact, 1.0, std))
            if self.soft:
                factor = np.zeros((len(layout.tied), n, n))
            if problem.path_constraints:
                self.paths = PathLimits(problem, dynamics)
        self.noise = NoiseState(levels=self._noise_levels(), factor=factor)
        self._triangular = True  # whether the root of the covariance of random defects is

    @property
    def soft(self) -> bool:
        """Return True if defects are random with a covariance."""
        return self.dynamics is not None and self.dynamics.soft

    @property
    def eliminated(self) -> int:
        """Unknowns that the residuals are free of, at the price of a degree of freedom each."""
        return 0 if self.equations is None else self.equations.eliminated

    @property
    def in_time(self) -> bool:
        """Return True if residuals follow each other in time: those of a regression have no order."""
        equations = isinstance(self.equations, EquationPart) and bool(self.problem.model.states)
        return self.dynamics is not None or equations

    # ---- weights

    def _noise_levels(self) -> Levels:
        measured = np.zeros((1, 0))
        if self.dynamics is not None:
            measured = np.concatenate([self.problem.outputs_of(record) for record in self.problem.records])
        if self.equations is not None:
            measured = _side_by_side(measured, np.concatenate(self.equations.targets))
        share = np.full(measured.shape[1], self.equation_share)
        share[: self._outputs] = self.part
        noise = self.problem.noise
        names = self.channel_names
        if isinstance(noise, StudentT | Huber):  # solved by weights; elsewhere its scale is what noise there is
            noise = noise.sigma
        if isinstance(noise, Mapping):
            noise = {n: float(s) for n, s in noise.items() if not isinstance(s, Noise)}
        if not isinstance(noise, str | np.ndarray):
            return noise_levels(noise, names, measured, share)
        independent = noise_levels(None, names, measured, share)
        layout = self.layout
        given = noise if isinstance(noise, np.ndarray) else None
        return full_noise(independent, given, names, layout.seen, layout.pattern, layout.z)

    @property
    def channel_names(self) -> tuple[str, ...]:
        """Outputs (when they take part), then equations."""
        outputs = self.problem.model.outputs if self.dynamics is not None else ()
        return outputs + (self.equations.names if self.equations is not None else ())

    @property
    def _outputs(self) -> int:
        return len(self.problem.model.outputs) if self.dynamics is not None else 0

    def whitening(self, levels: Levels) -> np.ndarray:
        """(patterns, o, o) lower triangle that whitens the residuals of each pattern of present samples."""
        return np.sqrt(self.part) * levels.whitening(self.layout.seen)

    def equation_weights(self, levels: Levels) -> np.ndarray:
        """(e,) factor of each equation residual."""
        return np.sqrt(self.equation_share) / levels.sigma[self._outputs :]

    def _squares(self, trajectory: Trajectory | None, equations: EquationValue | None) -> np.ndarray:
        """(channels,) sums of squared residuals; with a full covariance their moments."""
        if self.noise.levels.full and trajectory is not None:
            return moments_of(self.layout.residuals(trajectory.y), self.layout.pattern, self.layout.seen)
        found = []
        if trajectory is not None and trajectory.squares is not None:
            found.append(trajectory.squares.sum(axis=0))
        elif trajectory is not None:
            found.append((self.layout.residuals(trajectory.y) ** 2).sum(axis=(0, 1)))
        if equations is not None:
            found.append(np.nansum(np.concatenate(equations.residuals) ** 2, axis=0))
        return np.concatenate(found)

    def likelihood_cost(self, value: ObjectiveValue) -> float:
        """The cost with the noise at its optimum instead of its present value, up to a constant."""
        return value.rest + value.noise.levels.concentrated(value.squares)

    def misfit(self, value: ObjectiveValue) -> float:
        """-ln(likelihood x prior) up to a constant of the problem, by which its solutions compare; infinite where the
        motion departed."""
        found = value.cost if value.noise.levels.fixed else self.likelihood_cost(value)
        return found if np.isfinite(found) else np.inf

    # ---- value

    def start(self) -> Point:
        """Parameters at their start values, nodes at the model's guess from the measurements."""
        if self._begin is not None:
            return self._begin
        theta = self.problem.start_vector
        if self.dynamics is None:
            return Point(theta=theta, nodes=np.zeros((0, 0)), noise=np.zeros((0, 0)))
        nodes = self.layout.start.copy()
        nodes[self.layout.first] = self.centre
        noise = np.zeros((len(self.layout.tied), nodes.shape[1]))
        return Point(theta=theta, nodes=nodes, noise=noise, points=self.dynamics.points0)

    def parameters(self, theta: np.ndarray) -> np.ndarray:
        """(K, model parameters) per segment."""
        return self.problem.model_parameters(theta)[self.layout.record]

    def value(self, point: Point, noise: NoiseState | None = None) -> ObjectiveValue:
        """Simulate and weigh with `noise`, that of the start if None; not finite where the simulation departs."""
        self.effort.add()
        trajectory = None
        parameters = self.problem.model_parameters(point.theta)
        if self.dynamics is not None:
            trajectory = self.dynamics.trajectory(point.nodes, parameters[self.layout.record], point.points)
        equations = self.equations.value(parameters) if self.equations is not None else None
        return self._weighed(point, parameters, trajectory, equations, noise or self.noise)

    def reweighed(self, point: Point, value: ObjectiveValue, noise: NoiseState) -> ObjectiveValue:
        """The value at the same point with another noise; nothing is simulated."""
        if noise is value.noise:
            return value
        return self._weighed(point, value.parameters, value.trajectory, value.equations, noise)

    def relaxed(self, point: Point, value: ObjectiveValue) -> tuple[ObjectiveValue, float]:
        """The value with the levels by its residuals, maximum likelihood for the present parameters, and the
        largest relative change of a level."""
        levels, change = value.noise.levels.relaxed(value.squares)
        if levels is value.noise.levels:
            return value, change
        return self.reweighed(point, value, replace(value.noise, levels=levels)), change

    def _weighed(
        self,
        point: Point,
        parameters: np.ndarray,
        trajectory: Trajectory | None,
        equations: EquationValue | None,
        noise: NoiseState,
    ) -> ObjectiveValue:
        prior = (point.theta - self.problem.nominal) / self.problem.prior_std
        rest = float(prior @ prior)
        defects = gap = beyond_path = np.zeros((0, 0))
        if trajectory is not None:
            layout = self.layout
            x0 = (point.nodes[layout.first] - self.centre) * self.initial_precision
            rest += float((x0**2).sum() + (point.noise**2).sum())
            defects = trajectory.end[layout.tied] - point.nodes[layout.tied + 1]
            if noise.factor is not None:
                defects = defects + (noise.factor @ point.noise[..., None])[..., 0]
            defects = defects / self.scale
            if trajectory.gap is not None:
                gap = trajectory.gap / self.scale
            if self.paths is not None:
                at_samples = self.paths.values(trajectory)
                beyond_path = self.paths.violation(at_samples)
                rest = rest + 2.0 * self.paths.paid(at_samples)
        squares = self._squares(trajectory, equations)
        return ObjectiveValue(
            cost=0.5 * rest + noise.levels.cost(squares),
            rest=0.5 * rest,
            squares=squares,
            parameters=parameters,
            trajectory=trajectory,
            equations=equations,
            noise=noise,
            defects=defects,
            limits=self.limits.beyond(point.theta),
            gap=gap,
            path=beyond_path,
        )

    # ---- linearisation

    def linearise(self, point: Point, value: ObjectiveValue) -> Linearised:
        """Blocks, the reduced system of each record, and the information matrix of all parameters, with the noise of
        the value; the covariance of random defects is that at the point.

        Raises numpy.linalg.LinAlgError when a record's states are not determined.
        """
        self.effort.add()
        precision = 1.0 / self.problem.prior_std**2
        hessian = np.diag(precision)
        equation_hessian = np.zeros((len(precision), len(precision)))
        gradient = precision * (point.theta - self.problem.nominal)
        channels = np.zeros((len(self.channel_names), len(gradient)))
        reduced: list[Reduced] = []
        blocks = None
        paths = None
        noise = value.noise
        if value.trajectory is not None and self.dynamics is not None:
            layout = self.layout
            n = len(self.scale)
            parameters = value.parameters[layout.record]
            blocks = self.dynamics.blocks(value.trajectory, parameters, self.whitening(noise.levels))
            diagonal = np.arange(n)
            weight = self.initial_precision**2
            blocks.hessian[layout.first[:, None], diagonal, diagonal] += weight
            blocks.gradient[layout.first, :n] += (point.nodes[layout.first] - self.centre) * weight
            if self.exact.any():
                self._hold(blocks)
            if self.soft and blocks.covariance is not None:
                noise = replace(noise, factor=self._square_root(blocks.covariance[layout.tied]))
            if self.paths is not None:
                paths = self.paths.linearised(value.trajectory, parameters, self.exact)
            kernel = self.dynamics.kernel
            for r in range(len(self.problem.records)):
                own = layout.segments_of(r)
                bordered = blocks.hessian[own], blocks.gradient[own], blocks.transition[own]
                reduced.append(self.reduced(r, bordered, blocks, point, kernel))
                columns, grid = self._columns[r]
                hessian[grid] += reduced[r].hessian
                gradient[columns] += reduced[r].gradient
                if not noise.levels.fixed:
                    by_channel = blocks.channel_gradient[own]
                    by_state = np.einsum("kon,knf->of", by_channel[..., :n], reduced[r].ds_p)
                    along = by_channel[..., n:].sum(axis=0) - by_state
                    channels[: along.shape[0], columns] += along
        for r, residuals in enumerate(value.equations.residuals if value.equations is not None else ()):
            columns, grid = self._columns[r]
            for samples, rows in self.equation_slabs(value, r):
                residual = np.nan_to_num(residuals[samples]) * self.equation_weights(noise.levels)
                flat = rows.reshape(-1, rows.shape[2])
                equation_hessian[grid] += flat.T @ flat
                by_equation = np.einsum("kef,ke->ef", rows, residual)
                channels[-len(by_equation) :, columns] += by_equation
                gradient[columns] += by_equation.sum(axis=0)
        return Linearised(
            point=point,
            blocks=blocks,
            reduced=reduced,
            hessian=hessian + equation_hessian,
            gradient=gradient,
            channel_gradients=channels,
            equation_hessian=equation_hessian,
            noise=noise,
            paths=paths,
        )

    def _square_root(self, covariance: np.ndarray) -> np.ndarray:
        """(T, n, n) F with F F' = covariance, also where it is singular; continuous in the covariance, as long as it is
        always of the same kind: a triangle if it was one the first time."""
        scaled = covariance / np.outer(self.scale, self.scale)
        found = _lower_triangle(scaled) if self._triangular else None
        if found is None:
            self._triangular = False
            values, vectors = np.linalg.eigh(scaled)
            # the root turns rounding of 1e-16 into 1e-8: what is below it is a direction without noise
            values = np.where(values > 1e-13 * values[:, -1:], values, 0.0)
            found = (vectors * np.sqrt(values)[:, None, :]) @ vectors.transpose(0, 2, 1)
        return self.scale[:, None] * found

    def _hold(self, blocks: Blocks) -> None:
        """Take initial states that are known exactly, where the nodes begin, out of the unknowns."""
        for first, exact in zip(self.layout.first, self.exact, strict=True):
            held = np.flatnonzero(exact)
            blocks.hessian[first, held, :] = 0.0
            blocks.hessian[first, :, held] = 0.0
            blocks.hessian[first, held, held] = 1.0 / self.scale[held] ** 2
            blocks.gradient[first, held] = 0.0
            blocks.channel_gradient[first][:, held] = 0.0
            blocks.transition[first][:, held] = 0.0

    def equation_slabs(self, value: ObjectiveValue, record: int) -> Iterator[tuple[slice, np.ndarray]]:
        """Samples of a record and the derivatives (samples, equations, free) of the weighted equation residuals."""
        if self.equations is not None:
            for samples, rows in self.equations.slabs(value.parameters, record):
                yield samples, rows * self.equation_weights(value.noise.levels)[:, None]

    def parts(
        self, value: ObjectiveValue, linear: Linearised, paths: HeldPaths | None, r: int
    ) -> Iterator[tuple[int, np.ndarray, np.ndarray, np.ndarray]]:
        """(first channel, rows (m, c, f), weighted residuals (m, c), present (m, c)) of the output and of the equation
        part, piece by piece: the rows of all samples would take most of the memory."""
        outputs = 0
        if value.trajectory is not None and self.dynamics is not None:
            layout = self.layout
            n = len(self.scale)
            weights = self.whitening(value.noise.levels)
            own = layout.segments_of(r)
            outputs = layout.z.shape[2]
            motion = -linear.reduced[r].ds_p
            motion = motion if paths is None else np.concatenate([motion, paths.motion[r]], axis=2)
            for slab in self.dynamics.slabs(value.trajectory, value.parameters[layout.record], weights, own):
                at = slab.segments, slab.samples
                by_state = motion[slab.segments.start - own.start : slab.segments.stop - own.start, None]
                rows = slab.rows[..., :n] @ by_state
                rows[..., : slab.rows.shape[3] - n] += slab.rows[..., n:]
                residuals = whitened(value.trajectory.y[at] - layout.z[at], weights, layout.pattern[at])
                present = layout.present[at] > 0
                width = rows.shape[3]
                yield (
                    0,
                    rows.reshape(residuals.size // outputs, outputs, width),
                    residuals.reshape(-1, outputs),
                    present.reshape(-1, outputs),
                )
        if value.equations is not None:
            residuals = value.equations.residuals[r]
            weighted = np.nan_to_num(residuals) * self.equation_weights(value.noise.levels)
            for samples, rows in self.equation_slabs(value, r):
                yield outputs, rows, weighted[samples], np.isfinite(residuals[samples])

    def reduced(
        self,
        record: int,
        bordered: tuple[np.ndarray, np.ndarray, np.ndarray],
        blocks: Blocks,
        point: Point,
        kernel: Reducing | None = None,
    ) -> Reduced:
        """The reduced system of a record from the Hessian, gradient and transition of its segments, `bordered` by its
        parameters and whatever else is left; the blocks of all segments."""
        own = self.layout.segments_of(record)
        tied = slice(own.start, own.stop - 1)
        following = slice(own.start + 1, own.stop)
        defect = blocks.end[tied] - point.nodes[following]
        covariance = blocks.covariance[tied] if blocks.covariance is not None else None
        return self.kkt[record].solve(*bordered, defect, covariance, self.scale, kernel)

    def step(
        self, point: Point, value: ObjectiveValue, linear: Linearised, damping: float, concentrated: bool = False
    ) -> SolverStep:
        """The Gauss-Newton step, with `damping` times its diagonal added to the information of the parameters; a
        diagonal entry counts as 1e-14 of the largest at least.

        concentrated: towards the minimum of `likelihood_cost`, in which the noise moves with the parameters.
        Raises numpy.linalg.LinAlgError when the parameters cannot be separated.
        """
        curved = linear.hessian - self._noise_curvature(linear) if concentrated else linear.hessian
        # a parameter that the data do not determine here keeps its value
        return self.step_by(linear, curved + damping * np.diag(jacobi_scale(linear.hessian) ** -2.0))

    def step_by(self, linear: Linearised, curvature: np.ndarray) -> SolverStep:
        """The step whose parameters minimise the gradient's line with a curvature (parameters, parameters) of their
        own within the linear limits. Raises numpy.linalg.LinAlgError when it is not positive definite."""
        found = self._within_limits(linear, curvature)
        bent = self.limits.curvature(linear.point.theta, found.limit_multipliers)
        if bent.any():  # Newton's step on the limits, where that is still one downhill
            with suppress(np.linalg.LinAlgError):
                found = self._within_limits(linear, curvature + bent)
        return found

    def _within_limits(self, linear: Linearised, curvature: np.ndarray) -> SolverStep:
        limits = self.limits.about(linear.point.theta)
        if self.paths is None:
            return self.step_along(linear, *parameter_step(curvature, linear.gradient, *limits))
        return self.step_along(linear, *self.paths.step(self.reduced, linear, curvature, limits))

    def held_paths(self, linear: Linearised) -> HeldPaths | None:
        """Return what hard path limits hold at a solution."""
        if self.paths is None or linear.paths is None:
            return None
        return self.paths.held(self.reduced, linear, self.limits.about(linear.point.theta))

    def step_along(
        self, linear: Linearised, theta: np.ndarray, limit_multipliers: np.ndarray, path: PathStep | None = None
    ) -> SolverStep:
        """The step that changes the parameters by `theta` and everything else as the linearisation then wants it, with
        what path limits add."""
        point = linear.point
        precision = 1.0 / self.problem.prior_std**2
        slope = float((precision * (point.theta - self.problem.nominal)) @ theta)
        curvature = float(theta @ (precision * theta))
        price = float(np.abs(limit_multipliers * self.limits.size).max(initial=0.0))
        nodes = np.zeros_like(point.nodes)
        noise = np.zeros_like(point.noise)
        points = None
        if linear.blocks is not None:
            blocks = linear.blocks
            local = np.stack([theta[self.problem.columns(r)] for r in range(len(self.problem.records))])
            if path is None:
                nodes, multipliers = self._expand(linear.reduced, list(local))
            else:
                sides = [np.concatenate(pair) for pair in zip(local, path.forces, strict=True)]
                nodes, multipliers = self._expand(path.reduced, sides)
                slope = slope + path.change
                price = max(price, path.price)
            whole = np.concatenate([nodes, local[self.layout.record]], axis=1)
            slope += float((blocks.gradient * whole).sum())
            curvature += float((whole * (blocks.hessian @ whole[..., None])[..., 0]).sum())
            price = max(price, float(np.abs(multipliers * self.scale).max(initial=0.0)))
            factor = linear.noise.factor
            if factor is not None:
                noise = (factor.transpose(0, 2, 1) @ multipliers[..., None])[..., 0] - point.noise
                slope += float((point.noise * noise).sum())
                curvature += float((noise**2).sum())
            if blocks.lift is not None:
                shift = blocks.lift.shift
                along = float((shift[:, :-2] * whole).sum())
                slope += float(shift[:, -2].sum()) - along
                curvature += float(shift[:, -1].sum()) + 2.0 * along
                at_ends = np.zeros_like(nodes)
                at_ends[self.layout.tied] = multipliers
                points, inside = blocks.lift.follow(nodes, local[self.layout.record], at_ends, self.scale)
                price = max(price, inside)
        if self.equations is not None:
            slope += float(linear.channel_gradients[-len(self.equations.names) :].sum(axis=0) @ theta)
            curvature += float(theta @ linear.equation_hessian @ theta)
        return SolverStep(
            theta=theta,
            nodes=nodes,
            noise=noise,
            points=points,
            slope=slope,
            curvature=curvature,
            price=price,
            limit_multipliers=limit_multipliers,
            path_multipliers=None if path is None else path.multipliers,
            feasible=path is None or path.feasible,
        )

    def _noise_curvature(self, linear: Linearised) -> np.ndarray:
        """Return what the curvature loses when the noise follows: the second derivative of N/2 ln(sum of squares)
        has the term - 2/N g g' for each channel's gradient g. Without it the noise and the parameters chase each
        other. With a full covariance it is the part of the whitened channels' own variances."""
        levels = linear.noise.levels
        if levels.proportional:
            return np.zeros_like(linear.hessian)
        counts = np.maximum(levels.share * levels.present, 1.0)
        root = linear.channel_gradients.T * np.sqrt(2.0 / counts)
        scale = jacobi_scale(linear.hessian)
        scaled = root * scale[:, None]
        matrix = linear.hessian * np.outer(scale, scale)
        if not (np.isfinite(matrix).all() and np.isfinite(scaled).all()):  # LAPACK prints complaints of these
            raise np.linalg.LinAlgError("the sensitivities are no numbers here")
        inner = scaled.T @ np.linalg.lstsq(matrix, scaled, rcond=1e-12)[0]
        largest = float(np.linalg.eigvalsh(0.5 * (inner + inner.T))[-1])
        return root @ root.T * min(1.0, _MOST / max(largest, 1e-300))

    def _expand(self, reduced: list[Reduced], local: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        nodes = [red.ds0 - red.ds_p @ local[r] for r, red in enumerate(reduced)]
        multipliers = [red.l0 - red.l_p @ local[r] for r, red in enumerate(reduced)]
        return np.concatenate(nodes), np.concatenate(multipliers)


def _lower_triangle(covariance: np.ndarray) -> np.ndarray | None:
    """(T, n, n) Cholesky's factors, a tenth of the work of eigenvalues; None where any of the matrices is near to be
    singular, or is."""
    try:
        lower = np.linalg.cholesky(covariance)
    except np.linalg.LinAlgError:
        return None
    pivots = np.diagonal(lower, axis1=1, axis2=2) ** 2
    return lower if (pivots.min(axis=1) > _DEFINITE * pivots.max(axis=1)).all() else None


def _side_by_side(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Columns of both, the shorter one filled with NaN."""
    rows = max(len(left), len(right))
    out = np.full((rows, left.shape[1] + right.shape[1]), np.nan)
    out[: len(left), : left.shape[1]] = left
    out[: len(right), left.shape[1] :] = right
    return out
