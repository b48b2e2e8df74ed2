"""Many data sets of one problem estimated together, by Gauss-Newton steps from a solution that is near all of them.

All records of all runs are segments of one simulation and one linearisation, and the steps of all runs one batch of
small linear systems, so that a run costs little more than its arithmetic. Steps are whole ones and every run takes its
own. A run that they do not bring to a solution is left to `solve`.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from casid.estimation.cost import OutputError
from casid.estimation.fit import Fit
from casid.estimation.noise import Huber, StudentT
from casid.estimation.solvers.kkt import without_starts
from casid.estimation.solvers.levels import NoiseLevels
from casid.estimation.solvers.objective import Objective
from casid.estimation.solvers.own import OwnObjective
from casid.estimation.transcriptions.dynamics import Blocks
from casid.estimation.transcriptions.layout import Layout
from casid.estimation.transcriptions.shooting import Shooting
from casid.estimation.transcriptions.transcription import SingleShooting, Transcription
from casid.records.record import Record

_ITERATIONS = 20  # of whole steps: from next to a solution they need five
_SEGMENT_SAMPLES = 1 << 16  # of all runs that are solved at once: their sensitivities stay small


class Together:
    """Common part of all runs with a fit: its problem, in the coordinates of the solvers, and its motion.

    tolerance   as of `Automatic`
    """

    def __init__(self, fit: Fit, tolerance: float) -> None:
        end = fit.uncertainty.solved
        solved = end.objective.problem
        assert not isinstance(end.objective, OwnObjective)  # `takes` leaves those
        shooting = SingleShooting(substeps=fit.substeps, implicit=fit.implicit).dynamics(solved)
        assert isinstance(shooting, Shooting)
        self.problem = solved
        self.tolerance = tolerance
        self.layout = shooting.layout
        self.one = Objective(solved, shooting)
        assert end.linear is not None
        nodes = [end.linear.point.nodes[end.objective.layout.first[r]] for r in range(len(solved.records))]
        self.theta, self.nodes = end.linear.point.theta, np.array(nodes)
        self.most = max(_SEGMENT_SAMPLES // shooting.layout.dt.size, 1)

    @staticmethod
    def takes(fit: Fit, method: Transcription) -> bool:
        """Return True if a fit is one of output error with independent noise, without limits, events and random
        defects, and its repetition by a method too."""
        end = fit.uncertainty.solved
        objective = end.objective
        if objective is None or end.linear is None:  # it was read from a file
            return False
        problem = objective.problem
        levels = end.value.noise.levels
        posed = fit.problem
        same = all(a is b for a, b in zip(problem.records, fit.problem.records, strict=True))
        in_turns = posed.spread or posed.noise_formulas or posed.sigma_channels or not same
        in_turns = in_turns or isinstance(posed.noise, StudentT | Huber) or getattr(method, "process_noise", None)
        plain = type(problem.cost) is OutputError and isinstance(levels, NoiseLevels) and not levels.proportional
        unlimited = not problem.constraints and not problem.model.events and problem.feedback is None
        shooting = isinstance(objective.dynamics, Shooting) and not objective.soft
        return bool(plain and unlimited and shooting and not in_turns)

    def solved(self, runs: Sequence[Sequence[Record]]) -> np.ndarray:
        """(runs, parameters) estimates from the records of every run, not a number where none were found."""
        found = np.full((len(runs), len(self.theta)), np.nan)
        for first in range(0, len(runs), self.most):
            part = slice(first, first + self.most)
            with (
                suppress(np.linalg.LinAlgError),  # one is singular, on its way: each by itself then
                np.errstate(over="ignore", invalid="ignore", divide="ignore"),
            ):
                found[part] = _Runs(self, runs[part]).iterated()
        return found


class _Runs:
    """Runs that are solved at once. Arrays are (runs B, records R, ...)."""

    def __init__(self, common: Together, runs: Sequence[Sequence[Record]]) -> None:
        self.common, self.shape = common, (len(runs), len(common.problem.records))
        problem = common.problem
        model = common.problem.model
        layout = common.layout
        z = np.zeros((len(runs), *layout.z.shape))
        self.centre = np.empty((*self.shape, len(model.states)))
        flat = z.reshape(len(runs), -1, layout.z.shape[2])
        for b, records in enumerate(runs):
            for r, record in enumerate(records):
                flat[b, layout.sample[r]] = np.nan_to_num(problem.outputs_of(record))
                self.centre[b, r] = np.asarray(model.guess(record))[0]
        self.centre = np.where(np.isnan(problem.initial_knowledge[0]), self.centre, common.one.centre)
        self.layout = _repeated(layout, len(runs), z)
        self.shooting = Shooting(model, problem.free_index, self.layout, {})

    def iterated(self) -> np.ndarray:
        """(B, parameters)."""
        common, (B, R) = self.common, self.shape
        theta = np.tile(common.theta, (B, 1))
        nodes = np.tile(common.nodes, (B, 1, 1))
        exact = np.broadcast_to(common.one.exact, nodes.shape)
        nodes = np.where(exact, self.centre, nodes)
        sigma = np.tile(common.one.noise.levels.sigma, (B, 1))
        done = np.zeros(B, dtype=bool)
        for _ in range(_ITERATIONS):
            parameters = np.concatenate([common.problem.model_parameters(one) for one in theta])
            trajectory = self.shooting.trajectory(nodes.reshape(B * R, -1), parameters)
            off = self.layout.residuals(trajectory.y)
            squares = (off**2).reshape(B, -1, off.shape[2]).sum(axis=1)
            before = sigma
            if not common.one.noise.levels.fixed:  # those of highest likelihood
                sigma = np.array([common.one.noise.levels.rms(one) for one in squares])
            # one noise for each run, whose patterns follow those of the run before
            weights = self.layout.seen.reshape(B, -1, len(sigma[0]), 1) * (np.eye(len(sigma[0])) / sigma[:, None, None])
            blocks = self.shooting.blocks(trajectory, parameters, weights.reshape(-1, *weights.shape[2:]))
            change, moved, length = self._step(blocks, theta, nodes)
            settled = np.abs(np.log(sigma / before)).max(axis=1) < 10.0 * common.tolerance
            noise = np.sqrt((squares / sigma**2).sum(axis=1) / common.one.noise.levels.count)
            done = settled & (length < common.tolerance * noise)
            if done.all():
                break
            theta = theta + change
            nodes = nodes + moved
        return np.where(done[:, None], theta, np.nan)

    def _step(self, blocks: Blocks, theta: np.ndarray, nodes: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Changes of the parameters (B, parameters) and of the initial states (B, R, n), and the length (B,) of both in
        standard deviations."""
        common, (B, R), n, problem = self.common, self.shape, nodes.shape[2], self.common.problem
        exact = common.one.exact
        weight = common.one.initial_precision**2
        free = ~np.concatenate([exact, np.zeros((R, len(problem.free_index)), dtype=bool)], axis=1)
        hessian = blocks.hessian.reshape(B, R, *blocks.hessian.shape[1:]) * (free[:, :, None] & free[:, None])
        gradient = blocks.gradient.reshape(B, R, -1) * free
        diagonal = np.arange(n)
        hessian[..., diagonal, diagonal] += np.where(exact, 1.0 / common.one.scale**2, weight)
        gradient[..., :n] += np.where(exact, 0.0, (nodes - self.centre) * weight)
        by_state, inner, slope = without_starts(hessian, gradient, n)
        precision = 1.0 / problem.prior_std**2
        whole = np.tile(np.diag(precision), (B, 1, 1))
        right = precision * (theta - problem.nominal)
        for r in range(R):
            columns = problem.columns(r)
            whole[:, columns[:, None], columns] += inner[:, r]
            right[:, columns] += slope[:, r]
        scale = 1.0 / np.sqrt(np.maximum(np.diagonal(whole, axis1=1, axis2=2), 1e-300))
        solved = np.linalg.solve(whole * scale[:, :, None] * scale[:, None], (right * scale)[..., None])
        change = -solved[..., 0] * scale
        own = np.stack([change[:, problem.columns(r)] for r in range(R)], axis=1)
        moved = -by_state[..., -1] - (by_state[..., :-1] @ own[..., None])[..., 0]
        both = np.concatenate([moved, own], axis=2)
        curvature = np.einsum("brf,brfg,brg->b", both, hessian, both) + (change**2 * precision).sum(axis=1)
        return change, moved, np.sqrt(np.maximum(curvature, 0.0))


def _repeated(layout: Layout, runs: int, z: np.ndarray) -> Layout:
    """The segments of a layout once for every run, with other measurements z (runs, K, L, o), and each run with
    patterns of its own, so that it can have a noise of its own."""
    count = layout.segments
    patterns = len(layout.seen)
    first = (np.arange(runs)[:, None] * count + layout.first).ravel()
    number = patterns * np.repeat(np.arange(runs, dtype=np.int32), count)
    same = ("record", "start", "guess", "u0", "u1", "dt", "present", "live", "jump")
    arrays = {name: np.concatenate([getattr(layout, name)] * runs) for name in same}
    pattern = np.concatenate([layout.pattern] * runs) + number[:, None]
    return replace(
        layout,
        **arrays,
        first=first,
        z=z.reshape(-1, *z.shape[2:]),
        pattern=pattern.astype(np.int32),
        seen=np.concatenate([layout.seen] * runs),
    )
