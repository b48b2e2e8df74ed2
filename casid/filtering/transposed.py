"""The filter transposed, in numpy, as without a compiler: from innovations back to what could have made them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from casid.filtering.innovations import Linear


def transposed(
    linear: Linear,
    A: np.ndarray,
    C: np.ndarray,
    gain: np.ndarray,
    inverse_root: np.ndarray,
    stations: Sequence[int] | np.ndarray,
    white: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """`kalman.Filter.entrances` of columns (R, N, ny, nc) without colour."""
    (N, R, ny, n), index = C.shape, np.asarray(stations, dtype=int)
    entering, by_output = (np.zeros((count, R, N, white.shape[3])) for count in (len(index), ny))
    costate = np.zeros((R, n, white.shape[3]))

    def enter(k: int, through: np.ndarray, rows: np.ndarray) -> None:
        entering[:, :, k] += (through[..., index].swapaxes(1, 2) @ rows[:, : through.shape[1]]).swapaxes(0, 1)

    for k in range(N - 1, -1, -1):
        u, before = inverse_root[k].swapaxes(1, 2) @ white[:, k], 0.0
        if k < N - 1:
            u -= gain[k].swapaxes(1, 2) @ costate
            before = A[k].swapaxes(1, 2) @ costate
            enter(k, linear.Bw0[k], costate)
        costate = before + C[k].swapaxes(1, 2) @ u
        by_output[:, :, k] = u.swapaxes(0, 1)
        enter(k, linear.Dw[k], u)
        if k:
            enter(k, linear.Bw1[k - 1], costate)
    return entering, by_output
