"""Slope of the likelihood in the noise variances, by one backward pass through a Kalman filter."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from casid.filtering.innovations import Linear, NoiseModel
from casid.filtering.kalman import Filter, augmented


@dataclass(frozen=True, eq=False, kw_only=True)
class UnitVariance:
    """Covariances of a filter from one variance, set to 1 and alone: state noise Q (N-1, R, n, n), measurement noise
    M (N, R, ny, ny) and initial state P (R, n, n). The covariances are linear in the variances."""

    Q: np.ndarray
    M: np.ndarray
    P: np.ndarray


def unit_variances(linear: Linear, noise: NoiseModel, measurement: bool) -> list[UnitVariance]:
    """One per measured channel (with `measurement`), per white and then per coloured disturbance, in their order."""
    silent = NoiseModel(
        measurement=dict.fromkeys(noise.measurement, 0.0),
        white=dict.fromkeys(noise.white, 0.0),
        coloured={name: (0.0, tau) for name, (_, tau) in noise.coloured.items()},
    )
    _, _, Q0, M0, _, P0 = augmented(linear, silent)
    alone = [replace(silent, measurement={**silent.measurement, n: 1.0}) for n in linear.model.outputs if measurement]
    alone += [replace(silent, white={**silent.white, n: 1.0}) for n in noise.white]
    alone += [replace(silent, coloured={**silent.coloured, n: (1.0, tau)}) for n, (_, tau) in noise.coloured.items()]
    units = []
    for one in alone:
        _, _, Q, M, _, P = augmented(linear, one)
        units.append(UnitVariance(Q=Q - Q0, M=M - M0, P=P - P0))
    return units


def variance_score(kalman: Filter, white: np.ndarray, units: list[UnitVariance]) -> np.ndarray:
    """(units,) derivative of -2 ln L in each variance, from white innovations (N, R, ny): r and N below for the state,
    u and D for the measurement, as in Koopman and Shephard, Biometrika 79 (1992), eq. 2.6."""
    A = kalman.A
    C = kalman.C
    gain = kalman.gain
    root = kalman.inverse_root
    steps, records, ny, n = C.shape
    r = np.zeros((records, n, 1))
    information = np.zeros((records, n, n))
    state = np.empty((steps, records, n, n))  # r r' - N after the sample
    output = np.empty((steps, records, ny, ny))
    for k in range(steps - 1, -1, -1):
        weighted = root[k].swapaxes(1, 2)
        u = weighted @ white[k][..., None]
        precision = weighted @ root[k]
        state[k] = r @ r.swapaxes(1, 2) - information
        if k < steps - 1:
            through = A[k] - gain[k] @ C[k]
            u = u - gain[k].swapaxes(1, 2) @ r
            output[k] = u @ u.swapaxes(1, 2) - precision - gain[k].swapaxes(1, 2) @ information @ gain[k]
            r = A[k].swapaxes(1, 2) @ r + C[k].swapaxes(1, 2) @ u
            information = C[k].swapaxes(1, 2) @ precision @ C[k] + through.swapaxes(1, 2) @ information @ through
        else:
            output[k] = u @ u.swapaxes(1, 2) - precision
            r = C[k].swapaxes(1, 2) @ u
            information = C[k].swapaxes(1, 2) @ precision @ C[k]
    first = r @ r.swapaxes(1, 2) - information
    return np.array(
        [-(np.sum(state[:-1] * unit.Q) + np.sum(output * unit.M) + np.sum(first * unit.P)) for unit in units]
    )
