"""The Kalman filter of a linearised model: prediction, whitening of columns, smoothing.

The recursions run as compiled C (`filter_kernel`); without a compiler, or with `plain`, in numpy. Legend and frames of
the arrays as in `innovations`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from casid.estimation.filter_kernel import FilterKernel, filter_kernel
from casid.estimation.innovations import Linear, NoiseModel

_INITIAL_SIGMA = 5.0  # prior of the initial state, in units of Model.state_scale: practically free


@dataclass(frozen=True, eq=False, kw_only=True)
class Filter:
    """Kalman filter of a linearised model under a noise model: prediction error e = Y + C E, whitened by `inverse_root`
    (N, R, ny, ny), gain K (N, R, n, ny), prediction covariance P (N, R, n, n), log determinant per sample (N, R)."""

    linear: Linear
    A: np.ndarray
    C: np.ndarray
    K: np.ndarray
    inverse_root: np.ndarray
    P: np.ndarray
    log_determinant: np.ndarray
    kernel: FilterKernel | None

    def whiten(self, Y: np.ndarray, F: np.ndarray, first: np.ndarray | None = None) -> np.ndarray:
        """Innovations (N, R, ny, nc), white with unit variance, of columns with output part Y and state part F.

        Y (N, R, ny, nc), F (N-1, R, nx or n, nc): response of the model to a unit of the column's cause, output and
        state equation; first (R, n, nc) at the first sample. The residual is the column (residual, -defect); see
        `residual_column`. In memory the records are apart."""
        return self._columns(Y, F, first)[0].swapaxes(0, 1)

    def whiten_histories(self, stations: Sequence[int], series: np.ndarray) -> np.ndarray:
        """`whiten` of time histories (N, R, nc) that enter at disturbance `stations` (nc indices)."""
        linear, index = self.linear, np.asarray(stations, dtype=int)
        if self.kernel is not None:
            parts = (linear.Dw, linear.Bw0, linear.Bw1)
            white = self.kernel.whiten_histories(self.A, self.C, self.K, self.inverse_root, index, series, *parts)
            return white.swapaxes(0, 1)

        def forced(k: int) -> np.ndarray:
            now, after = linear.Bw0[k][..., index], linear.Bw1[k][..., index]
            return now * series[k][:, None, :] + after * series[k + 1][:, None, :]

        white, _ = self._run(len(index), lambda k: linear.Dw[k][..., index] * series[k][:, None, :], forced)
        return white.swapaxes(0, 1)

    def smooth(self, Y: np.ndarray, F: np.ndarray, first: np.ndarray | None = None) -> np.ndarray:
        """Most likely deviation of the augmented state (N, R, n) given one column (Y, F) with nc = 1, by the
        Bryson-Frazier backward recursion."""
        white, states = self._columns(Y, F, first, keep=True)
        if self.kernel is not None:
            return self.kernel.smooth(self.A, self.C, self.K, self.inverse_root, self.P, white, states)
        N, n = states.shape[0], states.shape[2]
        deviation = np.empty(states.shape[:3])
        costate = np.zeros((*states.shape[1:3], 1))
        eye = np.eye(n)
        for k in range(N - 1, -1, -1):
            back = eye - self.K[k] @ self.C[k]
            if k < N - 1:
                costate = (self.A[k] @ back).swapaxes(1, 2) @ costate
            costate = costate + (self.inverse_root[k] @ self.C[k]).swapaxes(1, 2) @ white[:, k]
            deviation[k] = (self.P[k] @ costate - states[k])[..., 0]
        return deviation

    def _columns(
        self, Y: np.ndarray, F: np.ndarray, first: np.ndarray | None, keep: bool = False
    ) -> tuple[np.ndarray, np.ndarray]:
        """Innovations (R, N, ny, nc) and, when they are to be kept, predicted states (N, R, n, nc)."""
        if self.kernel is not None:
            return self.kernel.whiten(self.A, self.C, self.K, self.inverse_root, Y, F, first, keep)
        return self._run(Y.shape[3], lambda k: Y[k], lambda k: F[k], first, keep)

    def _run(
        self, columns: int, output: Callable[[int], np.ndarray], forced: Callable[[int], np.ndarray],
        first: np.ndarray | None = None, keep: bool = False,
    ) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
        N, R, ny, n = self.C.shape
        white = np.empty((R, N, ny, columns))
        states = np.empty((N if keep else 0, R, n, columns))
        E = np.zeros((R, n, columns)) if first is None else first.copy()
        AK = self.A @ self.K[:-1]
        for k in range(N):
            if keep:
                states[k] = E
            e = self.C[k] @ E
            e += output(k)
            np.matmul(self.inverse_root[k], e, out=white[:, k])
            if k < N - 1:
                E = self.A[k] @ E
                E -= AK[k] @ e
                drive = forced(k)
                E[:, : drive.shape[1]] += drive
        return white, states


def kalman_filter(linear: Linear, noise: NoiseModel, plain: bool = False) -> Filter:
    """Covariance pass of the filter; it does not look at the data, only at which samples are seen.

    plain  in numpy, as without a compiler. Raises numpy.linalg.LinAlgError when the innovations have no density.
    """
    A, C, Q, M, P0 = augmented(linear, noise, plain)
    kernel = None if plain else filter_kernel(C.shape[3], C.shape[2])
    passed = kernel.covariance(A, C, Q, M, P0) if kernel is not None else _covariance_pass(A, C, Q, M, P0)
    K, inverse_root, P, log_determinant = passed
    return Filter(
        linear=linear, A=A, C=C, K=K, inverse_root=inverse_root, P=P, log_determinant=log_determinant, kernel=kernel
    )


def _covariance_pass(A, C, Q, M, P) -> tuple[np.ndarray, ...]:
    N, records, ny, n = C.shape
    K = np.empty((N, records, n, ny))
    inverse_root = np.empty((N, records, ny, ny))
    kept = np.empty((N, records, n, n))
    log_determinant = np.empty((N, records))
    for k in range(N):
        kept[k] = P
        PC = P @ C[k].swapaxes(1, 2)
        S = C[k] @ PC
        S += M[k]
        root = np.linalg.cholesky(S)
        inverse = np.linalg.inv(root)
        inverse_root[k] = inverse
        log_determinant[k] = 2.0 * np.log(np.diagonal(root, axis1=1, axis2=2)).sum(axis=1)
        W = PC @ inverse.swapaxes(1, 2)
        K[k] = W @ inverse
        if k < N - 1:
            P = P - W @ W.swapaxes(1, 2)
            P = A[k] @ P @ A[k].swapaxes(1, 2)
            P += Q[k]
            P = 0.5 * (P + P.swapaxes(1, 2))
    return K, inverse_root, kept, log_determinant


def residual_column(linear: Linear) -> tuple[np.ndarray, np.ndarray]:
    """(Y, F) of the residual itself, one column."""
    return linear.residual[..., None], -linear.defect[..., None]


def residual_about(
    linear: Linear, noise: NoiseModel, coloured: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(Y, F, first) of the residual of a model linearised about histories `coloured` (N, R, nc) of the noise's coloured
    disturbances, which their processes expect to begin near zero and to decay from sample to sample."""
    Y, F = residual_column(linear)
    decay = np.exp(-linear.dt[..., None] / np.array([tau for _, tau in noise.coloured.values()]))
    news = (coloured[1:] - decay * coloured[:-1])[..., None]
    index = [linear.model.disturbances.index(name) for name in noise.coloured]
    F = np.concatenate([F + linear.Bw1[..., index] @ news, news], axis=2)
    first = np.zeros((F.shape[1], F.shape[2], 1))
    first[:, linear.X.shape[2] :, 0] = coloured[0]
    return Y, F, first


def augmented(linear: Linear, noise: NoiseModel, plain: bool = False) -> tuple[np.ndarray, ...]:
    """A, C, Q, R of the model with its coloured disturbances as further states, and the initial covariance; `plain` in
    numpy, as without a compiler."""
    model, ny = linear.model, linear.C.shape[2]
    coloured = [model.disturbances.index(name) for name in noise.coloured]
    white = [model.disturbances.index(name) for name in noise.white]
    sigma = np.array([value for value, _ in noise.coloured.values()])
    tau = np.array([value for _, value in noise.coloured.values()])
    of_inputs = np.array(list(noise.white.values()))
    variance = np.array([noise.measurement[name] ** 2 for name in model.outputs])
    n = len(model.states) + len(coloured)
    kernel = None if plain else filter_kernel(n, ny)
    made = (_augmented if kernel is None else kernel.augmented)(
        linear, coloured, white, sigma, tau, of_inputs, variance
    )
    P = np.zeros((linear.C.shape[1], n, n))
    P[:, range(n), range(n)] = np.r_[(_INITIAL_SIGMA * model.scale_vector()) ** 2, sigma**2]
    return *made, P


def _augmented(linear: Linear, coloured, white, sigma, tau, of_inputs, variance) -> tuple[np.ndarray, ...]:
    """(A, C, Q, R), as the compiled recursions compute them."""
    N, records, ny, nx = linear.C.shape
    n = nx + len(coloured)
    phi = np.exp(-linear.dt[..., None] / tau) if coloured else np.zeros((N - 1, records, 0))
    A = np.zeros((N - 1, records, n, n))
    A[..., :nx, :nx] = linear.A
    A[..., :nx, nx:] = linear.Bw0[..., coloured] + linear.Bw1[..., coloured] * phi[..., None, :]
    A[..., range(nx, n), range(nx, n)] = phi
    C = np.concatenate([linear.C, linear.Dw[..., coloured]], axis=3)
    G = (linear.Bw0 + linear.Bw1)[..., white] * of_inputs
    Q = np.zeros((N - 1, records, n, n))
    Q[..., :nx, :nx] = G @ G.swapaxes(2, 3)
    driven = sigma**2 * (1.0 - phi**2)
    Q[..., range(nx, n), range(nx, n)] = driven
    through = linear.Bw1[..., coloured] * driven[..., None, :]
    Q[..., :nx, nx:] = through
    Q[..., nx:, :nx] = through.swapaxes(2, 3)
    Q[..., :nx, :nx] += through @ linear.Bw1[..., coloured].swapaxes(2, 3)
    feed = linear.Dw[..., white] * of_inputs
    R = feed @ feed.swapaxes(2, 3)
    R[..., range(ny), range(ny)] += np.where(linear.seen, variance, 1.0)
    return A, C, Q, R
