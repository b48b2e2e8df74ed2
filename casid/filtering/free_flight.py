"""The error of a simulation that no reading corrects, if the model is right: noise, moving air, and where it begins."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import special

from casid.filtering.initial_state import read_start
from casid.filtering.innovations import Linear, NoiseModel
from casid.filtering.kalman import augmented_in_stretches


def free_flight_sigma(linear: Linear, noise: NoiseModel) -> np.ndarray:
    """(N, R, ny) 1-sigma of measured minus simulated readings of the right model, its initial state known, without the
    updates of a filter; infinite where the model is unstable."""
    known = linear.X.shape[2]
    variance = np.empty(linear.residual.shape)
    P = np.zeros(0)
    for first, (A, C, Q, M, _, begin) in augmented_in_stretches(linear, noise):
        if not first:
            P = begin
            P[:, :known] = 0.0
            P[:, :, :known] = 0.0
        with np.errstate(over="ignore", invalid="ignore"):
            for k in range(len(C)):
                variance[first + k] = np.einsum("rij,rjk,rik->ri", C[k], P, C[k]) + np.diagonal(M[k], axis1=1, axis2=2)
                if k < len(A):
                    P = A[k] @ P @ A[k].swapaxes(1, 2) + Q[k]
    return np.sqrt(np.where(np.isfinite(variance), np.maximum(variance, 0.0), np.inf))


@dataclass(frozen=True, eq=False, kw_only=True)
class ChanceError:
    """Mean square, over the readings of each channel (ny,), of the error of the right model from a measured start: by
    the noise of the readings themselves, and by states that noise has led astray. The latter are few, and their square
    is spread like one of `freedom` random numbers."""

    noise: np.ndarray
    astray: np.ndarray
    freedom: np.ndarray

    def most(self, probability: float) -> np.ndarray:
        """The mean square that is exceeded with a `probability`; infinite where the model is unstable."""
        beyond = special.chdtri(self.freedom, probability) / self.freedom
        return np.where(np.isfinite(self.astray), self.noise + self.astray * beyond, np.inf)


def chance_error(linear: Linear, noise: NoiseModel, beginning_s: float) -> ChanceError:
    """The error of a simulation that begins at the `measured_start` of the same beginning.

    Error covariances follow from sample to sample. The variance of their mean square takes, beside them, the weight
    that an error at a sample has in the squares of all later ones (Isserlis, Biometrika 12, 134, 1918).
    """
    parts = [of for _, of in augmented_in_stretches(linear, noise)]
    A, Q = (np.concatenate([of[i] for of in parts])[: len(linear.A)] for i in (0, 2))
    C, M = (np.concatenate([*(of[i][:-1] for of in parts), parts[-1][i][-1:]]) for i in (1, 3))
    count = np.maximum(linear.seen.sum((0, 1)), 1)
    C = np.where(linear.seen[..., None], C, 0.0)
    of_readings = np.where(linear.seen, np.diagonal(M, axis1=2, axis2=3), 0.0).sum((0, 1)) / count
    P = parts[0][5]
    known = linear.X.shape[2]
    state, variance = read_start(linear, noise, beginning_s)
    of_air = -state @ parts[0][1][0][:, :, known:]
    P[:, :known, known:] = of_air @ P[:, known:, known:]
    P[:, known:, :known] = P[:, :known, known:].swapaxes(1, 2)
    by_readings = (state * variance[:, None]) @ state.swapaxes(1, 2)
    P[:, :known, :known] = by_readings + P[:, :known, known:] @ of_air.swapaxes(1, 2)
    with np.errstate(over="ignore", invalid="ignore"):
        shared = np.empty(C.shape)  # covariance of each error with the states
        for k in range(len(C)):
            shared[k] = C[k] @ P
            if k < len(A):
                P = A[k] @ P @ A[k].swapaxes(1, 2) + Q[k]
        square = np.einsum("krij,krij->kri", C, shared)
        spread = (square**2).sum((0, 1))
        weight = np.zeros((*C.shape[1:3], *P.shape[1:]))
        for k in range(len(A) - 1, -1, -1):
            through = A[k][:, None]
            weight = through.swapaxes(2, 3) @ (weight + C[k + 1][..., None] * C[k + 1][..., None, :]) @ through
            spread += 2.0 * np.einsum("ria,riab,rib->i", shared[k], weight, shared[k])
        astray = square.sum((0, 1)) / count
        freedom = (square.sum((0, 1)) ** 2) / np.maximum(spread, 1e-300)
    return ChanceError(noise=of_readings, astray=astray, freedom=np.where(freedom > 0.0, freedom, 1.0))
