"""Path limits in the structured step: states and outputs at the samples, held within limits or made to pay for excess.

The step of a record is a banded system with the parameters as its border. A sample that reaches a limit adds a column
to that border: its multiplier, which enters the system as one more parameter does. What the elimination of the states
then leaves is, in parameters p and multipliers m,
    H p + D'm = -g,    D p - Q m + r = value at the sample
where Q is how far a multiplier moves its sample through initial states and random defects. With Q = L L' this is the
quadratic problem min 1/2 p'Hp + g'p + 1/2 v'v subject to lower <= D p + L v + r <= upper: small and dense, as only the
samples that come to a limit take part. They are found in turns: solve, look at all samples, add the peaks beyond.
Samples that stay beyond a soft limit push with its price: a known force, which adds to the gradient.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from casid.estimation.problem import Problem
from casid.estimation.solvers.kkt import Reduced
from casid.estimation.solvers.point import Linearised, LinearisedPaths, ObjectiveValue, Point
from casid.estimation.solvers.quadratic import jacobi_scale, parameter_step
from casid.estimation.transcriptions.dynamics import Blocks, Dynamics, Trajectory
from casid.signals import scale_of

# record; Hessian, gradient and transition of its segments; blocks of all segments; point -> its system
Reduce = Callable[[int, tuple[np.ndarray, np.ndarray, np.ndarray], Blocks, Point], Reduced]
# (rows, lower, upper) of the parameters' own limits on a step
Limits = tuple[np.ndarray, np.ndarray, np.ndarray]

_ROUNDS = 50  # of samples that are added
_BEYOND = 1e-10  # of a quantity's size: less is no excess
_NEAR = 1e-6  # of a quantity's size: samples as near as that to a limit take part from the beginning
_RANK = 1e-14  # of the largest eigenvalue of Q: what is below is rounding
_ELASTIC_ROUNDS = 2  # of them where the linearised limits contradict each other: the step only leads nearer
_ELASTIC = 1e4  # what an excess costs, in the scaled step, where linearised limits contradict each other


@dataclass(frozen=True, eq=False, kw_only=True)
class PathStep:
    """Contribution of path limits to a step: per record the reduced system whose border has the multipliers too, and
    these; `multipliers` (constraints, N) are those of all samples, positive at an upper limit. `change` is that of
    the cost of excess over soft limits, `price` the largest scaled multiplier of the others, `feasible` whether the
    linearised limits can all be satisfied."""

    reduced: list[Reduced]
    forces: list[np.ndarray]
    multipliers: np.ndarray
    change: float = 0.0
    price: float = 0.0
    feasible: bool = True


@dataclass(frozen=True, eq=False, kw_only=True)
class HeldPaths:
    """Hard path limits that hold at a point, in the parameters and in unknowns v of unit information, independent of
    them, by which initial states and random defects move the samples that are held."""

    # (limits, parameters + v) derivatives: one limit for all samples that follow each other at it, whose maximum lies
    # between them
    rows: np.ndarray
    multipliers: np.ndarray  # (limits,) positive at an upper limit
    equal: np.ndarray  # (limits,) whether a limit is upper and lower one
    # per record (segments, n, v of the record) how its v move the nodes; the v of records follow each other
    motion: list[np.ndarray]
    pressed: tuple[np.ndarray, ...]  # record -> (constraints, N) multipliers of the samples that are held, else zero

    def columns(self, record: int) -> np.ndarray:
        """Return the columns of the v of a record among all unknowns."""
        sizes = [moves.shape[2] for moves in self.motion]
        first = self.rows.shape[1] - sum(sizes[record:])
        return np.arange(first, first + sizes[record])


class PathLimits:
    """lower <= quantity <= upper at every sample, `price` (constraints,) infinite where a limit must hold.

    `scale` (constraints,) is the typical size of each quantity.
    """

    def __init__(self, problem: Problem, dynamics: Dynamics) -> None:
        self._problem = problem
        self._layout = dynamics.layout
        constraints = problem.path_constraints
        model = problem.model
        layout = dynamics.layout
        names = tuple(dict.fromkeys(c.name for c in constraints))
        self._watching = dynamics.watching(names)
        self._column = np.array([names.index(c.name) for c in constraints])
        where = [model.states if c.name in model.states else model.outputs for c in constraints]
        self._source = [(of is model.states, of.index(c.name)) for of, c in zip(where, constraints, strict=True)]
        self.lower, self.upper = (np.array([getattr(c, side) for c in constraints]) for side in ("lower", "upper"))
        self.price = np.array([c.price for c in constraints])
        self.soft = np.isfinite(self.price)
        sizes = dict(model.state_scale)
        self.scale = np.array([sizes.get(c.name, scale_of(c.name)) for c in constraints])
        self.flat = np.concatenate(layout.sample)
        self.segment, self.within = np.divmod(self.flat, layout.length)
        self.record = layout.record[self.segment]

    def values(self, trajectory: Trajectory) -> np.ndarray:
        """(constraints, N) of the constrained quantities at all samples of all records."""
        states, y = (v.reshape(-1, v.shape[2])[self.flat] for v in (trajectory.states, trajectory.y))
        return np.array([(states if is_state else y)[:, i] for is_state, i in self._source])

    def excess(self, values: np.ndarray) -> np.ndarray:
        """(constraints, N) how far beyond a limit: positive above, negative below, else zero."""
        above = values - self.upper[:, None]
        below = values - self.lower[:, None]
        return np.maximum(above, 0.0) + np.minimum(below, 0.0)

    def violation(self, values: np.ndarray) -> np.ndarray:
        """Scaled excess over the limits that must hold."""
        return (self.excess(values) / self.scale[:, None])[~self.soft]

    def paid(self, values: np.ndarray) -> float:
        """Return the cost of the excess over soft limits."""
        return float((self.price[self.soft, None] * np.abs(self.excess(values)[self.soft])).sum())

    def soft_excess(self, value: ObjectiveValue) -> np.ndarray:
        """(N, soft limits) by how many sizes the samples are beyond each."""
        assert value.trajectory is not None
        return np.abs(self.excess(self.values(value.trajectory)) / self.scale[:, None])[self.soft].T

    def linearised(self, trajectory: Trajectory, parameters: np.ndarray, exact: np.ndarray) -> LinearisedPaths:
        """At a trajectory with parameters (K, model parameters), where initial states `exact` (records, n) are held."""
        layout = self._watching.layout
        count = layout.segments
        identity = np.eye(layout.z.shape[2])[None]
        rows = np.zeros(0)
        for slab in self._watching.slabs(trajectory, parameters, identity, slice(0, count)):
            if not rows.size:
                rows = np.zeros((count, layout.length, *slab.rows.shape[2:]))
            rows[slab.segments, slab.samples] = slab.rows
        chosen = rows[self.segment, self.within].transpose(1, 0, 2)[self._column].copy()
        for first, known in zip(layout.first, exact, strict=True):  # what is known exactly does not move
            held = np.flatnonzero(known)
            chosen[np.ix_(np.arange(len(chosen)), np.flatnonzero(self.segment == first), held)] = 0.0
        return LinearisedPaths(values=self.values(trajectory), rows=chosen)

    def step(
        self, reduce: Reduce, linear: Linearised, curvature: np.ndarray, limits: Limits
    ) -> tuple[np.ndarray, np.ndarray, PathStep]:
        """Return the step of the parameters, the multipliers of their own `limits`, and what the path limits add;
        `reduce` reduces a record. Raises numpy.linalg.LinAlgError where the parameters' own limits contradict each
        other."""
        paths = linear.paths
        assert paths is not None
        excess = self.excess(paths.values)
        pushed = np.where(self.soft[:, None], np.sign(excess) * (np.abs(excess) > (_NEAR * self.scale)[:, None]), 0.0)
        working = self._near(paths.values) & (pushed == 0.0)
        for rounds in range(_ROUNDS):
            theta, own, found = self._solved(reduce, linear, curvature, limits, (working, pushed))
            predicted = self._predicted(linear, theta, found)
            change = self.paid(predicted) - self.paid(paths.values)
            beyond = self.excess(predicted)
            returned = (pushed != 0.0) & (np.sign(beyond) != pushed)
            new = returned | (self._peaks(beyond) & ~working & (pushed == 0.0))
            if not new.any() or (rounds >= _ELASTIC_ROUNDS and not found.feasible):
                break
            working = working | new
            pushed = np.where(returned, 0.0, pushed)
        price = np.abs((found.multipliers * self.scale[:, None])[~self.soft]).max(initial=0.0)
        return theta, own, replace(found, change=change, price=float(price))

    def held(self, reduce: Reduce, linear: Linearised, limits: Limits) -> HeldPaths | None:
        """Return what holds at a solution; arguments as in `step`. None where no sample is held."""
        paths = linear.paths
        problem = self._problem
        count = len(linear.gradient)
        assert paths is not None
        pressed = self.step(reduce, linear, linear.hessian, limits)[2].multipliers
        held = (pressed != 0.0) & self._near(paths.values) & ~self.soft[:, None]
        if not held.any():
            return None
        rows = []
        roots = []
        multipliers = []
        equal = []
        motion = []
        for r in range(len(problem.records)):
            own = np.argwhere(held & (self.record == r))
            solved = self._bordered(reduce, linear, r, own, np.zeros_like(pressed))
            f = len(problem.columns(r))
            together = self._together(own, pressed)
            root = _root(-solved.hessian[f:, f:])
            motion.append(solved.ds_p[..., f:] @ np.linalg.pinv(root).T)
            by_parameter = np.zeros((len(together), count))
            by_parameter[:, problem.columns(r)] = together @ solved.hessian[f:, :f]
            rows.append(by_parameter)
            roots.append(together @ root)
            multipliers.append(np.sign(together) @ pressed[own[:, 0], own[:, 1]])
            equal.append((together > 0.0) @ (self.lower == self.upper)[own[:, 0]])
        return HeldPaths(
            rows=np.hstack([np.concatenate(rows), diagonal(*roots)]),
            multipliers=np.concatenate(multipliers),
            equal=np.concatenate(equal),
            motion=motion,
            pressed=tuple(np.where(held, pressed, 0.0)[:, self.record == r] for r in range(len(problem.records))),
        )

    def _together(self, own: np.ndarray, pressed: np.ndarray) -> np.ndarray:
        """(limits, w) weights of the samples `own` (w, 2) of a record in each limit, by their multipliers."""
        follows = (np.diff(own, axis=0) == [0, 1]).all(axis=1) & (self.lower < self.upper)[own[1:, 0]]
        limit = np.cumsum(np.concatenate([[False], ~follows])) if len(own) else np.zeros(0, dtype=int)
        weights = np.zeros((int(limit.max(initial=-1)) + 1, len(own)))
        weights[limit, np.arange(len(own))] = np.abs(pressed[own[:, 0], own[:, 1]])
        return weights / weights.sum(axis=1, keepdims=True)

    def _near(self, values: np.ndarray) -> np.ndarray:
        """(constraints, N) samples at or beyond a limit, and of those beyond only the peaks."""
        near = np.zeros(values.shape, dtype=bool)
        for limit in (self.lower, self.upper):
            near |= np.abs(values - limit[:, None]) <= (_NEAR * self.scale)[:, None]
        return near | self._peaks(self.excess(values))

    def _peaks(self, excess: np.ndarray) -> np.ndarray:
        """(constraints, N) the sample farthest beyond of every run of samples beyond a limit; of soft ones all."""
        found = np.zeros(excess.shape, dtype=bool)
        for c, one in enumerate(excess):
            beyond = np.abs(one) > _BEYOND * self.scale[c]
            if self.soft[c]:
                found[c] = beyond
                continue
            number = np.cumsum(np.diff(beyond, prepend=False) | np.diff(self.record, prepend=-1).astype(bool))
            for run in np.unique(number[beyond]):
                own = np.flatnonzero(beyond & (number == run))
                found[c, own[np.argmax(np.abs(one[own]))]] = True
        return found

    def _solved(
        self,
        reduce: Reduce,
        linear: Linearised,
        curvature: np.ndarray,
        limits: Limits,
        samples: tuple[np.ndarray, np.ndarray],
    ) -> tuple[np.ndarray, np.ndarray, PathStep]:
        """The step where of all samples (constraints, N) those `working` may come to their limit, and those pushed by
        the price of theirs, with a sign, are beyond it."""
        problem = self._problem
        count = len(linear.gradient)
        working, pushed = samples
        rows, low, high = limits
        pushed = pushed * np.where(self.soft, self.price, 0.0)[:, None]
        chosen = [np.argwhere(working & (self.record == r)) for r in range(len(problem.records))]
        reduced = [self._bordered(reduce, linear, r, own, pushed) for r, own in enumerate(chosen)]
        slope = linear.gradient.copy()
        by_parameter = []
        roots = []
        reached = []
        for r, one in enumerate(reduced):
            columns = problem.columns(r)
            f = len(columns)
            slope[columns] += one.gradient[:f] - linear.reduced[r].gradient
            by_parameter.append(np.zeros((len(chosen[r]), count)))
            by_parameter[r][:, columns] = one.hessian[f:, :f]
            roots.append(_root(-one.hessian[f:, f:]))
            reached.append(one.gradient[f:])
        every = np.concatenate(chosen)
        which = every[:, 0]
        matrix = diagonal(rows, *roots)
        matrix[len(rows) :, :count] = np.concatenate(by_parameter)
        further = matrix.shape[1] - count
        hessian = diagonal(curvature, np.eye(further))
        gradient = np.concatenate([slope, np.zeros(further)])
        lower = np.concatenate([low, self.lower[which] - np.concatenate(reached)])
        upper = np.concatenate([high, self.upper[which] - np.concatenate(reached)])
        price = np.concatenate([np.full(len(rows), np.inf), self.price[which]])
        feasible = True
        try:
            found, dual = parameter_step(hessian, gradient, matrix, lower, upper, price)
        except np.linalg.LinAlgError:
            feasible = False
            size = np.linalg.norm(matrix * jacobi_scale(hessian), axis=1)
            price[len(rows) :] = np.minimum(price[len(rows) :], _ELASTIC / np.maximum(size[len(rows) :], 1e-300))
            found, dual = parameter_step(hessian, gradient, matrix, lower, upper, price)
        multipliers = pushed.copy()
        multipliers[every[:, 0], every[:, 1]] = dual[len(rows) :]
        forces = np.split(dual[len(rows) :], np.cumsum([len(own) for own in chosen])[:-1])
        found_paths = PathStep(reduced=reduced, forces=forces, multipliers=multipliers, feasible=feasible)
        return found[:count], dual[: len(rows)], found_paths

    def _bordered(
        self, reduce: Reduce, linear: Linearised, record: int, own: np.ndarray, pushed: np.ndarray
    ) -> Reduced:
        """The reduced system of a record with the multipliers of samples `own` (w, 2) behind its parameters, and
        forces `pushed` (constraints, N) on others."""
        blocks = linear.blocks
        paths = linear.paths
        segments = self._layout.segments_of(record)
        assert blocks is not None and paths is not None
        more = len(own)
        wide = np.pad(blocks.hessian[segments], ((0, 0), (0, more), (0, more)))
        slope = np.pad(blocks.gradient[segments], ((0, 0), (0, more)))
        transition = np.pad(blocks.transition[segments], ((0, 0), (0, 0), (0, more)))
        size = paths.rows.shape[2]
        for c, j in np.argwhere((pushed != 0.0) & (self.record == record)):
            slope[self.segment[j] - segments.start, :size] += pushed[c, j] * paths.rows[c, j]
        for i, (c, j) in enumerate(own):
            k = self.segment[j] - segments.start
            wide[k, :size, size + i] = wide[k, size + i, :size] = paths.rows[c, j]
            slope[k, size + i] = paths.values[c, j]
        return reduce(record, (wide, slope, transition), blocks, linear.point)

    def _predicted(self, linear: Linearised, theta: np.ndarray, step: PathStep) -> np.ndarray:
        """(constraints, N) values after a whole step, by the linearisation."""
        paths = linear.paths
        problem = self._problem
        assert paths is not None
        local = [theta[problem.columns(r)] for r in range(len(problem.records))]
        nodes = np.concatenate(
            [
                one.ds0 - one.ds_p @ np.concatenate([p, force])
                for one, p, force in zip(step.reduced, local, step.forces, strict=True)
            ]
        )
        whole = np.concatenate([nodes[self.segment], np.array(local)[self.record]], axis=1)
        return paths.values + np.einsum("cnf,nf->cn", paths.rows, whole)


def diagonal(*blocks: np.ndarray) -> np.ndarray:
    """The matrix with these blocks, which may have no rows or no columns, along its diagonal."""
    sizes = np.array([block.shape for block in blocks])
    found = np.zeros(sizes.sum(axis=0))
    for block, (row, column) in zip(blocks, sizes.cumsum(axis=0) - sizes, strict=True):
        found[row : row + block.shape[0], column : column + block.shape[1]] = block
    return found


def _root(matrix: np.ndarray) -> np.ndarray:
    """(w, rank) L with L L' = matrix, positive semidefinite but for rounding."""
    if not len(matrix):
        return np.zeros((0, 0))
    values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
    kept = values > _RANK * max(float(values[-1]), 0.0)
    return vectors[:, kept] * np.sqrt(values[kept])
