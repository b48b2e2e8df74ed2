"""Jumps of the state between two segments, at events: what they do to the end of the segment before.

Layouts cut a record at its events, so that every step of integration ends at one. The state at the end of a segment is
then the one after the event, with the derivatives of both the motion and the jump.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import casadi as ca
import numpy as np

from casid.estimation.transcriptions.dynamics import Blocks, Lift, ProblemSymbols, Trajectory
from casid.estimation.transcriptions.layout import Layout
from casid.estimation.transcriptions.steps import free_parameters
from casid.estimation.transcriptions.symbolic import SampleSymbols
from casid.model.built import cached
from casid.model.system import Model


@dataclass(frozen=True, eq=False, kw_only=True)
class JumpedLift:
    """Response of interior states of collocation, with multipliers of ends that are behind a jump; slope (K, n, n)
    of the state behind it in the one before."""

    inner: Lift
    slope: np.ndarray

    @property
    def shift(self) -> np.ndarray:
        """Return the shift of the inner one."""
        return self.inner.shift

    def follow(
        self, nodes: np.ndarray, local: np.ndarray, multipliers: np.ndarray, scale: np.ndarray
    ) -> tuple[np.ndarray, float]:
        """Follow a step as `Lift` asks."""
        before = np.einsum("kab,ka->kb", self.slope, multipliers)
        return self.inner.follow(nodes, local, before, scale)


class Jumps:
    """The jumps of a layout; falsy where it has none. `free` are the free parameters of the model."""

    def __init__(self, model: Model, free: np.ndarray, layout: Layout) -> None:
        self._model = model
        self._free = free
        self._layout = layout
        self._at = {name: np.flatnonzero(layout.jump == i) for i, name in enumerate(model.events)}
        self._at = {name: which for name, which in self._at.items() if len(which)}

    def __bool__(self) -> bool:
        return bool(self._at)

    @cached_property
    def _functions(self) -> dict[str, ca.Function]:
        """Event -> (x, u, p) -> x after it, its derivatives in x and in the free parameters."""
        model = self._model
        key = ("jumps", *(int(i) for i in self._free))
        free = free_parameters(model, self._free)

        def build() -> dict[str, ca.Function]:
            given = [model.x, model.u, model.p]
            return {
                name: ca.Function(
                    "jump", given, [ca.densify(e) for e in (g, ca.jacobian(g, model.x), ca.jacobian(g, free))]
                )
                for name, g in model.events.items()
            }

        return cached(model, key, build)

    def end(self, end: np.ndarray, parameters: np.ndarray) -> np.ndarray:
        """(K, n) states at the ends of segments, after jumps; parameters (K, model parameters)."""
        return self._derivatives(end, parameters)[0] if self else end

    def blocks(self, blocks: Blocks, at: np.ndarray, parameters: np.ndarray) -> Blocks:
        """The blocks of segments that were linearised with the ends `at` (K, n)."""
        if not self:
            return blocks
        n = at.shape[1]
        f = len(self._free)
        after, by_state, by_free = self._derivatives(at, parameters)
        transition = by_state @ blocks.transition
        transition[..., n : n + f] += by_free
        spread = blocks.covariance
        lift = blocks.lift
        return replace(
            blocks,
            transition=transition,
            end=after + (by_state @ (blocks.end - at)[..., None])[..., 0],
            covariance=None if spread is None else by_state @ spread @ by_state.transpose(0, 2, 1),
            lift=None if lift is None else JumpedLift(inner=lift, slope=by_state),
        )

    def shifted(self, trajectory: Trajectory, off: np.ndarray, parameters: np.ndarray) -> np.ndarray:
        """(K, n) ends after jumps, moved by what errors `off` (K, n) of the states before them make."""
        if not self:
            return trajectory.end + off
        by_state = self._derivatives(trajectory.arrived, parameters)[1]
        return trajectory.end + (by_state @ off[..., None])[..., 0]

    def _derivatives(self, end: np.ndarray, parameters: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(K, n) states after, (K, n, n) and (K, n, f) their derivatives; of segments without a jump the end itself."""
        (count, n), f = end.shape, len(self._free)
        after = end.copy()
        by_state = np.tile(np.eye(n), (count, 1, 1))
        by_free = np.zeros((count, n, f))
        for name, which in self._at.items():
            inputs = self._layout.u0[which + 1, 0]
            many = self._functions[name].map(len(which))
            found = [r.full() for r in many(end[which].T, inputs.T, parameters[which].T)]
            after[which] = found[0].T
            by_state[which] = found[1].reshape(n, len(which), n).transpose(1, 0, 2)
            by_free[which] = found[2].reshape(n, len(which), f).transpose(1, 0, 2)
        return after, by_state, by_free

    def symbolic(self, end: ca.MX, at: ProblemSymbols) -> ca.MX:
        """(n, K) ends after jumps, as an expression."""
        if not self:
            return end
        columns = ca.horzsplit(end)
        length = self._layout.length
        for name, which in self._at.items():
            of = SampleSymbols(self._model, self._free)
            jump = ca.Function("jump", [of.x, of.u0, of.base, of.q], [self._functions[name](of.x, of.u0, of.p)[0]])
            for k in which.tolist():
                columns[k] = jump(columns[k], at.u0[:, (k + 1) * length], at.base[:, k], at.free[:, k])
        return ca.horzcat(*columns)
