"""Truth: dense Gaussian algebra of all samples together, with noise of a recorded input that acts as the input does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from estimation_cases import NOISE, TRUTH, flight

from casid.filtering.innovations import Linear, NoiseModel, PointFunctions, linearise, make_batch
from casid.filtering.kalman import kalman_filter, residual_about, residual_column
from casid.model.system import Model, define_model
from casid.records.record import Record

DT, N = 0.02, 60
SIGMA = {**NOISE, "az": 0.3}
NOISY = NoiseModel(measurement=SIGMA, inputs={"d_e": 0.01}, coloured={"gust": (0.01, 0.5)})


def short_period() -> Model:
    """With noise of the elevator, which acts on the accelerometer at once, and a gust."""
    return define_model(
        "short period",
        states=("alpha", "q"),
        inputs=("delta_e",),
        parameters=TRUTH,
        outputs=("alpha", "q", "az"),
        disturbances=("gust", "d_e"),
        dynamics=lambda s: {
            "alpha": s.Za * (s.alpha + s.gust) + s.q + s.Zde * (s.delta_e + s.d_e),
            "q": s.Ma * (s.alpha + s.gust) + s.Mq * s.q + s.Mde * (s.delta_e + s.d_e),
        },
        output=lambda s: {
            "alpha": s.alpha + s.gust,
            "q": s.q,
            "az": 100.0 * (s.Za * (s.alpha + s.gust) + s.Zde * (s.delta_e + s.d_e)),
        },
    )


def measured(seed: int, hold: str, samples: int = N) -> Record:
    rng = np.random.default_rng(seed)
    record = replace(flight(f"m{seed}", t=DT * np.arange(samples)), hold=hold)
    noisy = {n: 3.0 * s * rng.standard_normal(samples) for n, s in SIGMA.items()}
    return record.with_channels(**noisy)


def linearised(model: Model, records: list[Record], W: np.ndarray | None = None) -> Linear:
    batch = make_batch(model, records)
    X = np.zeros((*batch.live.shape, len(model.states)))
    return linearise(PointFunctions(model, ()), batch, np.tile(model.nominal_vector(), (len(records), 1)), X, W)


def responses(linear: Linear, model: Model) -> np.ndarray:
    """(N, 3 outputs + 2 states + noise, sources) of the linear system to a unit of every independent source: initial
    state, initial gust, gust by step, noise of the elevator by sample."""
    A, B0, B1, C, D = (part[:, 0] for part in (linear.A, linear.Bw0, linear.Bw1, linear.C, linear.Dw))
    phi, columns = float(np.exp(-DT / 0.5)), []

    def run(state: np.ndarray, gust: np.ndarray, noise: np.ndarray) -> np.ndarray:
        w, x, rows = np.stack([gust, noise], axis=1), state, []
        for k in range(N):
            rows.append(np.r_[C[k] @ x + D[k] @ w[k], x, noise[k]])
            if k < N - 1:
                x = A[k] @ x + B0[k] @ w[k] + B1[k] @ w[k + 1]
        return np.array(rows)

    still = np.zeros(N)
    for i, scale in enumerate(model.scale_vector()):
        columns.append(run(5.0 * scale * np.eye(2)[i], still, still))
    for k in range(N):
        drive = 0.01 * (np.sqrt(1.0 - phi**2) if k else 1.0)
        columns.append(run(np.zeros(2), np.where(np.arange(N) < k, 0.0, drive * phi ** (np.arange(N) - k)), still))
        columns.append(run(np.zeros(2), still, 0.01 * np.eye(N)[k]))
    return np.stack(columns, axis=2)


@pytest.mark.parametrize("hold", ["linear", "held"])
def test_likelihood_and_smoothed_noise_are_those_of_the_dense_gaussian(hold: str) -> None:
    model = short_period()
    linear = linearised(model, [measured(3, hold)])
    kalman = kalman_filter(linear, NOISY)
    white = kalman.whiten(*residual_column(linear))
    found = responses(linear, model)
    out, inside = found[:, :3].reshape(3 * N, -1), found[:, 3:].reshape(3 * N, -1)
    covariance = out @ out.T + np.diag(np.tile([s**2 for s in SIGMA.values()], N))
    drift = np.zeros((N, 2))
    for k in range(N - 1):
        drift[k + 1] = linear.A[k, 0] @ drift[k] + linear.defect[k, 0]
    residual = (linear.residual[:, 0] - np.einsum("kij,kj->ki", linear.C[:, 0], drift)).ravel()
    solved = np.linalg.solve(covariance, residual)
    expected = float(residual @ solved) + float(np.linalg.slogdet(covariance)[1])
    assert np.sum(white**2) + kalman.log_determinant.sum() == pytest.approx(expected, rel=1e-9)
    posterior = (inside @ (out.T @ solved)).reshape(N, 3)
    deviation, noise = kalman.smooth(*residual_column(linear))
    np.testing.assert_allclose(noise[:, 0, 0], posterior[:, 2], rtol=0, atol=1e-9 * np.abs(posterior[:, 2]).max())
    expected_state = drift + posterior[:, :2]
    np.testing.assert_allclose(deviation[:, 0, :2], expected_state, rtol=0, atol=1e-8 * np.abs(expected_state).max())


def test_compiled_recursions_equal_the_plain_ones_to_rounding() -> None:
    """Records of unequal length, with held and with linear inputs, and missing samples."""
    records = [measured(1, "linear"), measured(2, "held", samples=45)]
    gappy = records[0]["az"].copy()
    gappy[[0, 7, 8, 59]] = np.nan
    linear = linearised(short_period(), [records[0].with_channels(az=gappy), records[1]])
    fast, plain = kalman_filter(linear, NOISY), kalman_filter(linear, NOISY, plain=True)
    assert fast.kernel is not None and plain.kernel is None
    for name in ("gain", "inverse_root", "P", "log_determinant"):
        np.testing.assert_allclose(getattr(fast, name), getattr(plain, name), rtol=1e-8, atol=1e-12, err_msg=name)
    for got, expected in zip(
        fast.smooth(*residual_column(linear)), plain.smooth(*residual_column(linear)), strict=True
    ):
        np.testing.assert_allclose(got, expected, rtol=0, atol=1e-10 * np.abs(expected).max())


def test_noise_linearised_about_changes_nothing_of_a_linear_model() -> None:
    """Innovations, the smoothed motion and the noise itself do not depend on the noise that it is linearised about."""
    model, records = short_period(), [measured(1, "linear"), measured(2, "held")]
    wiggle = 0.02 * np.random.default_rng(8).standard_normal((N, 2, 1))
    found = []
    for noise in (0.0 * wiggle, wiggle):
        linear = linearised(model, records, np.concatenate([np.zeros((N, 2, 1)), noise], axis=2))
        column, kalman = residual_about(linear, NOISY, np.zeros((N, 2, 1)), noise), kalman_filter(linear, NOISY)
        moved, most_likely = kalman.smooth(*column)
        found.append((kalman.whiten(*column), moved, most_likely))
    # the step matrices are of second order in the step, the simulation of fourth
    for still, about in zip(*found, strict=True):
        np.testing.assert_allclose(about, still, rtol=0, atol=2e-3 * np.abs(still).max())
