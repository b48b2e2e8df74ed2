"""The reduced quadratic problem in the parameters, with their linearised constraints."""

from __future__ import annotations

import casadi as ca
import numpy as np
from scipy.linalg import get_lapack_funcs, null_space

from casid.estimation.solvers.status import INFEASIBLE, NOT_NUMBERS, NoStepError

_potrf, _potri = get_lapack_funcs(("potrf", "potri"), dtype=np.float64)
# residuals of the optimality conditions, absolute and relative, of unknowns with unit curvature; more where rounding
# does not allow that: what is active is solved exactly afterwards
_CLOSE = ((1e-11, 0.0), (1e-11, 1e-13), (1e-8, 1e-10))
_FAR = 100.0  # times as far as the longest way that the curvature allows: what is beyond is no limit
_POLISH = 1e-10  # that the exact solution for the active limits may contradict what they are taken for
_CORRECTIONS = 50  # of which limits are active


def own_curvature(diagonal: np.ndarray) -> np.ndarray:
    """Return the diagonal (n,) of a positive semidefinite matrix; for what has none a small part of the largest.

    Unknowns have units: how small an entry is beside another says nothing.
    """
    return np.where(diagonal > 0.0, diagonal, 1e-14 * max(float(diagonal.max(initial=0.0)), 1e-286))


def jacobi_scale(hessian: np.ndarray) -> np.ndarray:
    """Scales that make the diagonal of a positive semidefinite matrix one."""
    return 1.0 / np.sqrt(own_curvature(np.diagonal(hessian)))


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
    """Invert a positive definite matrix with a unit diagonal; None where its smallest eigenvalue is below about
    1e-13."""
    if not matrix.size:
        return matrix
    factor, info = _potrf(matrix, lower=1)
    if info != 0:
        return None
    half, info = _potri(factor, lower=1, overwrite_c=1)
    inverse = np.tril(half) + np.tril(half, -1).T
    return inverse if info == 0 and np.linalg.norm(inverse) < 1e13 else None


def parameter_step(
    hessian: np.ndarray,
    gradient: np.ndarray,
    rows: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
    price: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """(step, multipliers of the rows) of min 1/2 d'Hd + g'd subject to lower <= rows d <= upper.

    A multiplier is positive at an active upper limit, negative at a lower one: H d + g + rows' m = 0. Limits with a
    finite `price` (rows,) may be exceeded, which costs price * excess: their multipliers are no larger than that.
    Raises numpy.linalg.LinAlgError when H is not positive definite or the constraints contradict each other.
    """
    scale = jacobi_scale(hessian)
    h = hessian * np.outer(scale, scale)
    g = gradient * scale
    for row, value in zip(rows[lower == upper] * scale, lower[lower == upper], strict=True):
        # what an equality holds needs no data: the square of its residual, zero at the solution, leaves that as it is
        size = np.linalg.norm(row)
        h = h + np.outer(row, row) / size**2
        g = g - row * value / size**2
    inverse = _inverse(h)
    if inverse is None:
        raise np.linalg.LinAlgError("the parameters cannot be told apart")
    free = -inverse @ g
    if not len(rows):
        return free * scale, np.zeros(0)
    c = rows * scale
    size = np.linalg.norm(c, axis=1)
    moves = size > 0.0
    if ((lower > 0.0) | (upper < 0.0))[~moves].any():  # a limit that no step moves
        raise NoStepError(INFEASIBLE)
    size = np.where(moves, size, 1.0)
    c = c / size[:, None]
    low = lower / size
    high = upper / size
    inside = c @ free
    if ((inside >= low) & (inside <= high)).all():
        return free * scale, np.zeros(len(rows))
    if not np.isfinite(c).all() or np.isnan(low).any() or np.isnan(high).any():
        raise NoStepError(NOT_NUMBERS)
    weight = np.full(len(rows), np.inf) if price is None else price * size
    # in units of the way to go: the free step, and to the limits where they are exceeded
    unit = max(float(np.abs(free).max()), float(np.maximum(low, -high).max(initial=0.0)), 1e-300)
    far = _FAR * unit * max(float(np.sqrt(np.linalg.norm(inverse))), 1.0)
    if not np.isfinite(far):
        raise NoStepError(NOT_NUMBERS)
    low = np.where(low < -far, -np.inf, low)
    high = np.where(high > far, np.inf, high)
    step, multipliers = _interior_point(h, g / unit, c, low / unit, high / unit, weight / unit)
    return unit * step * scale, unit * multipliers / size


def _interior_point(
    h: np.ndarray, g: np.ndarray, c: np.ndarray, low: np.ndarray, high: np.ndarray, price: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The step and the multipliers of `parameter_step` in scaled unknowns, rows of unit length: by PIQP's proximal
    interior point method, and exactly for the limits that it finds active."""
    soft = np.isfinite(price)
    n = len(g)
    excess = int(soft.sum())
    quadratic = np.zeros((n + excess, n + excess))
    quadratic[:n, :n] = h
    # with the excess s >= 0 of each soft limit: c d - s <= high, c d + s >= low
    slack = np.eye(excess)
    which = np.concatenate([np.flatnonzero(~soft), *[np.flatnonzero(soft)] * 2])
    matrix = np.hstack([c[which], np.vstack([np.zeros((len(c) - excess, excess)), -slack, slack])])
    first = np.concatenate([low[~soft], np.full(excess, -np.inf), low[soft]])
    last = np.concatenate([high[~soft], high[soft], np.full(excess, np.inf)])
    order = np.argsort(which, kind="stable")
    order = order[(np.isfinite(first) | np.isfinite(last))[order]]
    if not len(order):
        raise NoStepError(NOT_NUMBERS)
    matrix = matrix[order]
    first = first[order]
    last = last[order]
    which = which[order]
    structure = {"h": ca.Sparsity.dense(*quadratic.shape), "a": ca.Sparsity.dense(*matrix.shape)}
    least = np.concatenate([np.full(n, -np.inf), np.zeros(excess)])
    given = {
        "h": quadratic,
        "g": np.concatenate([g, price[soft]]),
        "a": matrix,
        "lba": first,
        "uba": last,
        "lbx": least,
    }
    for absolute, relative in _CLOSE:
        close = {"eps_abs": absolute, "eps_rel": relative}
        gap = {"eps_duality_gap_abs": absolute, "eps_duality_gap_rel": relative}
        solver = ca.conic("reduced", "piqp", structure, {"error_on_fail": False, "piqp": close | gap})
        result = solver(**given)
        found, dual = (np.asarray(result[name]).ravel() for name in ("x", "lam_a"))
        if solver.stats()["success"] and np.isfinite(found).all():
            break
    else:
        raise NoStepError(INFEASIBLE)
    multipliers = np.bincount(which, dual, len(c))
    return _polished(h, g, c, (low, high), price, (found[:n], multipliers))


def _polished(
    h: np.ndarray,
    g: np.ndarray,
    c: np.ndarray,
    limits: tuple[np.ndarray, np.ndarray],
    price: np.ndarray,
    near: tuple[np.ndarray, np.ndarray],
) -> tuple[np.ndarray, np.ndarray]:
    """The exact solution from one `near` it: limits are active where the multiplier is larger than what is left to the
    limit. Where that guess is not yet consistent, it is corrected by an active-set method."""
    (low, high), (step, multipliers) = limits, near
    equal = low == high
    side = np.where(equal | (multipliers > 0.0), 1.0, -1.0)  # at which limit
    limit = np.where(side > 0.0, high, low)
    left = np.where(np.isfinite(limit), side * (limit - c @ step), np.inf)  # negative beyond the limit
    active = (np.abs(multipliers) > left) | equal
    paid = active & (price - np.abs(multipliers) < -left)
    n = len(g)
    for _ in range(_CORRECTIONS):
        held = np.flatnonzero(active & ~paid)
        pushed = np.where(paid, side * price, 0.0) if paid.any() else np.zeros(len(c))
        limit = np.where(side > 0.0, high, low)
        rows = c[held]
        matrix = np.block([[h, rows.T], [rows, np.zeros((len(held), len(held)))]])
        right = np.concatenate([-g - c.T @ np.where(paid, pushed, 0.0), limit[held]])
        solved = np.linalg.lstsq(matrix, right, rcond=1e-13)[0]
        exact = solved[:n]
        dual = np.where(paid, pushed, 0.0)
        dual[held] = solved[n:]
        at = c @ exact
        # by how much each row contradicts what it is taken for
        wrong_side = np.where(active & ~paid & ~equal, -side * dual, 0.0)
        too_dear = np.where(active & ~paid, np.abs(dual) - price, -np.inf)
        returned = np.where(paid, -side * (at - limit), 0.0)
        beyond = np.where(~active, np.maximum(at - high, low - at), 0.0)
        wrong = np.stack([wrong_side, np.maximum(too_dear, 0.0), returned, beyond])
        kind, row = np.unravel_index(int(np.argmax(wrong)), wrong.shape)
        if wrong[kind, row] <= _POLISH:
            return exact, dual
        active[row] = kind != 0
        paid[row] = kind == 1
        if kind == 3:
            side[row] = 1.0 if at[row] > high[row] else -1.0
    return step, multipliers
