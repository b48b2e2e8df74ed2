"""The reduced quadratic problem in the parameters, with their linear constraints."""

from __future__ import annotations

import casadi as ca
import numpy as np
from scipy.linalg import get_lapack_funcs, null_space

_potrf, _potri = get_lapack_funcs(("potrf", "potri"), dtype=np.float64)


def jacobi_scale(hessian: np.ndarray) -> np.ndarray:
    """Scales that make the diagonal of a positive semidefinite matrix one."""
    diagonal = np.diagonal(hessian)
    return 1.0 / np.sqrt(np.maximum(diagonal, 1e-14 * max(float(diagonal.max(initial=0.0)), 1e-300)))


def free_directions(rows: np.ndarray, multipliers: np.ndarray) -> np.ndarray:
    """(parameters, directions) in which linear constraints `rows` (rows, parameters) with active `multipliers` leave
    the parameters free."""
    active = rows[np.abs(multipliers) > 0]
    return null_space(active) if len(active) else np.eye(rows.shape[1])


def inverse_along(free: np.ndarray, information: np.ndarray) -> np.ndarray:
    """Inverse of an information matrix in the directions `free` (parameters, directions), zero across them.

    Raises numpy.linalg.LinAlgError where it is singular.
    """
    inner = free.T @ information @ free
    scale = jacobi_scale(inner)
    return free @ (scale[:, None] * np.linalg.inv(inner * np.outer(scale, scale)) * scale) @ free.T


def _inverse(matrix: np.ndarray) -> np.ndarray | None:
    """Of a positive definite matrix with a unit diagonal; None where its smallest eigenvalue is below about 1e-13."""
    factor, info = _potrf(matrix, lower=1)
    if info != 0:
        return None
    half, info = _potri(factor, lower=1, overwrite_c=1)
    inverse = np.tril(half) + np.tril(half, -1).T
    return inverse if info == 0 and np.linalg.norm(inverse) < 1e13 else None


def parameter_step(
    hessian: np.ndarray, gradient: np.ndarray, rows: np.ndarray, lower: np.ndarray, upper: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(step, multipliers of the rows) of min 1/2 d'Hd + g'd subject to lower <= rows d <= upper.

    A multiplier is positive at an active upper limit, negative at a lower one: H d + g + rows' m = 0.
    Raises numpy.linalg.LinAlgError when H is not positive definite or the constraints contradict each other.
    """
    scale = jacobi_scale(hessian)
    h, g = hessian * np.outer(scale, scale), gradient * scale
    for row, value in zip(rows[lower == upper] * scale, lower[lower == upper], strict=True):
        # what an equality holds needs no data: the square of its residual, zero at the solution, leaves that as it is
        size = np.linalg.norm(row)
        h, g = h + np.outer(row, row) / size**2, g - row * value / size**2
    inverse = _inverse(h)
    if inverse is None:
        raise np.linalg.LinAlgError("the parameters cannot be told apart")
    free = -inverse @ g
    if not len(rows):
        return free * scale, np.zeros(0)
    c = rows * scale
    size = np.linalg.norm(c, axis=1)
    c, low, high = c / size[:, None], lower / size, upper / size
    inside = c @ free
    if ((inside >= low) & (inside <= high)).all():
        return free * scale, np.zeros(len(rows))
    structure = {"h": ca.Sparsity.dense(*h.shape), "a": ca.Sparsity.dense(*c.shape)}
    options = {"print_iter": False, "print_header": False, "print_info": False, "error_on_fail": False}
    solver = ca.conic("reduced", "qrqp", structure, options)
    result = solver(h=h, g=g, a=c, lba=low, uba=high)
    if not solver.stats()["success"]:
        raise np.linalg.LinAlgError("the linear constraints cannot be satisfied together")
    multipliers = np.asarray(result["lam_a"]).ravel() / size
    return np.asarray(result["x"]).ravel() * scale, multipliers
