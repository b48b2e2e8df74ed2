"""The error of a simulation that no reading corrects, if the model is right: noise and moving air."""

from __future__ import annotations

import numpy as np

from casid.filtering.innovations import Linear, NoiseModel
from casid.filtering.kalman import augmented_in_stretches


def free_flight_sigma(linear: Linear, noise: NoiseModel) -> np.ndarray:
    """(N, R, ny) 1-sigma of measured minus simulated readings of the right model, its initial state known, without the
    updates of a filter; infinite where the model is unstable."""
    known, variance, P = linear.X.shape[2], np.empty(linear.residual.shape), np.zeros(0)
    for first, (A, C, Q, M, _, begin) in augmented_in_stretches(linear, noise):
        if not first:
            P = begin
            P[:, :known], P[:, :, :known] = 0.0, 0.0
        with np.errstate(over="ignore", invalid="ignore"):
            for k in range(len(C)):
                variance[first + k] = np.einsum("rij,rjk,rik->ri", C[k], P, C[k]) + np.diagonal(M[k], axis1=1, axis2=2)
                if k < len(A):
                    P = A[k] @ P @ A[k].swapaxes(1, 2) + Q[k]
    return np.sqrt(np.where(np.isfinite(variance), np.maximum(variance, 0.0), np.inf))
