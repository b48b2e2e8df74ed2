"""A model about a point: A, B, C, D and their exact derivatives in the free parameters, and the response that follows.

Sizes: n states, m inputs, o outputs, f free parameters, M frequencies.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
from scipy.linalg import expm

from casid.estimation.transcriptions.steps import quiet
from casid.model.built import cached
from casid.model.system import Model, check_continuous


@dataclass(frozen=True, eq=False, kw_only=True)
class LinearSensitivity:
    """dx/dt = A x + B u, y = C x + D u about a point."""

    matrix: np.ndarray  # (n+o, n+m) the matrices [[A, B], [C, D]]
    slopes: np.ndarray  # (f, n+o, n+m) its derivatives in the free parameters
    states: int  # how many states n there are

    def response(self, omega: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(M, o, m) frequency response at omega (M,) [rad/s], and (M, f, o, m) its derivatives."""
        n = self.states
        inputs = np.eye(self.matrix.shape[1] - self.states)
        a = self.matrix[:n, :n]
        b = self.matrix[:n, n:]
        c = self.matrix[n:, :n]
        d = self.matrix[n:, n:]
        resolvent = np.linalg.inv(1j * omega[:, None, None] * np.eye(n) - a)
        states = resolvent @ b
        costates = c @ resolvent
        right = np.concatenate([states, np.broadcast_to(inputs, (len(omega), *inputs.shape))], axis=1)
        left = np.concatenate([costates, np.broadcast_to(np.eye(len(c)), (len(omega), len(c), len(c)))], axis=2)
        return c @ states + d, left[:, None] @ self.slopes @ right[:, None]

    def sampled(self, dt: float, held: np.ndarray) -> Transition:
        """The step from one sample to the next, with inputs held where `held` (m,), else on straight lines."""
        n = self.states
        a = self.matrix[:n, :n]
        b = self.matrix[:n, n:]
        slopes = self.slopes[:, :n, :n], self.slopes[:, :n, n:]
        (phi0, phi1, phi2), moved = _exponentials(a, slopes[0], dt)
        constant = phi1 @ b
        dconstant = moved[1] @ b + phi1 @ slopes[1]
        later = np.where(held, 0.0, phi2 @ b / dt)
        dlater = np.where(held, 0.0, (moved[2] @ b + phi2 @ slopes[1]) / dt)
        return Transition(
            matrix=np.concatenate([phi0, constant - later, later], axis=1),
            slopes=np.concatenate([moved[0], dconstant - dlater, dlater], axis=2),
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class Transition:
    """x at the next sample = matrix (x, u, u at the next sample): matrix (n, n+2m), slopes (f, n, n+2m) its derivatives
    in the free parameters."""

    matrix: np.ndarray
    slopes: np.ndarray


def _exponentials(a: np.ndarray, slopes: np.ndarray, dt: float) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """exp(a dt) and its first two integrals over dt, (n, n) each, and their derivatives (f, n, n), where a has the
    derivatives slopes (f, n, n): blocks of the exponential of [[a, 1, 0], [0, 0, 1], [0, 0, 0]] (Van Loan, IEEE Trans.
    Automatic Control 23, 1978), of which [[a, da], [0, a]] gives the derivative."""
    n = len(a)
    f = len(slopes)
    big = np.zeros((3 * n, 3 * n))
    big[:n, :n], big[:n, n : 2 * n], big[n : 2 * n, 2 * n :] = a, np.eye(n), np.eye(n)
    doubled = np.zeros((f, 6 * n, 6 * n))
    doubled[:, : 3 * n, : 3 * n] = doubled[:, 3 * n :, 3 * n :] = big
    doubled[:, :n, 3 * n : 4 * n] = slopes
    value = expm(big * dt)
    moved = expm(doubled * dt)[:, :n, 3 * n :]
    columns = [slice(k * n, (k + 1) * n) for k in range(3)]
    return [value[:n, k] for k in columns], [moved[:, :, k] for k in columns]


def sensitivity_at(model: Model, free: np.ndarray, x: np.ndarray, u: np.ndarray, p: np.ndarray) -> LinearSensitivity:
    """Linearise a model about states x (n,), inputs u (m,) at parameters p, of which `free` (f,) are free, by exact
    derivatives."""
    check_continuous(model, "linear model")
    n = len(model.states)
    m = len(model.inputs)
    o = len(model.outputs)
    function = cached(model, ("linear model", *free), lambda: _function(model, free))
    matrix, columns = (part.full() for part in function(x, u, p))
    slopes = columns.reshape((n + o, n + m, len(free)), order="F").transpose(2, 0, 1)
    return LinearSensitivity(matrix=matrix, slopes=slopes, states=n)


def entering(model: Model, free: np.ndarray) -> np.ndarray:
    """(f,) whether each of the free parameters enters the linear model at all."""
    slopes = cached(model, ("linear model", *free), lambda: _function(model, free)).sparsity_out(1)
    pattern = np.zeros(len(free), dtype=bool)
    pattern[list(set(slopes.get_col()))] = True
    return pattern


def _function(model: Model, free: np.ndarray) -> ca.Function:
    equations = quiet(model, ca.vertcat(model.f, model.h))
    variables = ca.vertcat(model.x, model.u)
    matrix = ca.jacobian(equations, variables)
    slopes = ca.jacobian(ca.vec(ca.densify(matrix)), ca.vertcat(*[model.p[int(i)] for i in free]))
    return ca.Function("linear", [model.x, model.u, model.p], [ca.densify(matrix), slopes])
