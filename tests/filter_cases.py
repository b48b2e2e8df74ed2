"""A short period in gusts, its filter, and first-order Gauss-Markov processes: what tests of filters share."""

from __future__ import annotations

import numpy as np
from estimation_cases import NOISE, TRUTH, flight

from casid.filtering.innovations import Linear, NoiseModel, PointFunctions, linearise, make_batch
from casid.filtering.kalman import Filter, kalman_filter, residual_column
from casid.model.simulate import simulate
from casid.model.system import Model, define_model
from casid.records.record import Record

DT = 0.02


def gusty_short_period(outputs: tuple[str, ...] = ("alpha", "q")) -> Model:
    """Short period with a vertical gust angle at alpha and a pitch disturbance."""
    return define_model(
        "gusty short period",
        states=("alpha", "q"),
        inputs=("delta_e",),
        parameters=TRUTH,
        outputs=outputs,
        disturbances=("gust", "pitch"),
        dynamics=lambda s: {
            "alpha": s.Za * (s.alpha + s.gust) + s.q + s.Zde * s.delta_e,
            "q": s.Ma * (s.alpha + s.gust) + s.Mq * s.q + s.Mde * s.delta_e + s.pitch,
        },
        output=lambda s: {n: {"alpha": s.alpha + s.gust, "q": s.q}[n] for n in outputs},
    )


def gusty_flight(seed: int, name: str = "m1", samples: int = 1500) -> Record:
    """Flown with a first-order Gauss-Markov gust, white pitch disturbance and measurement noise."""
    rng = np.random.default_rng(seed)
    t = DT * np.arange(samples)
    phi = np.exp(-DT / 0.5)
    gust = np.zeros(samples)
    gust[0] = 0.01 * rng.standard_normal()
    for k in range(samples - 1):
        gust[k + 1] = phi * gust[k] + 0.01 * np.sqrt(1.0 - phi**2) * rng.standard_normal()
    clean = flight(name, t=t, hold="held")
    pitch = 0.2 * rng.standard_normal(samples)
    # a disturbance that is held over the sample is what the filter calls white
    flown = simulate(gusty_short_period(), clean, np.zeros(2), disturbances={"gust": gust, "pitch": pitch}, substeps=4)
    noisy = {n: flown.output(n) + NOISE[n] * rng.standard_normal(samples) for n in ("alpha", "q")}
    return flown.as_record().with_channels(**noisy)


GUSTY = NoiseModel(measurement=NOISE, white={"pitch": 0.2}, coloured={"gust": (0.01, 0.5)})


def filtered(model: Model, records: list[Record], noise: NoiseModel) -> tuple[Linear, Filter, np.ndarray]:
    """Linearised about the measured motion, the filter, and the innovations (N, R, ny)."""
    batch = make_batch(model, records)
    X = np.zeros((*batch.live.shape, len(model.states)))
    for j, record in enumerate(records):
        guess = model.guess(record)
        X[: len(record), j], X[len(record) :, j] = guess, guess[-1]
    P = np.tile(model.nominal_vector(), (len(records), 1))
    linear = linearise(PointFunctions(model, model.parameters), batch, P, X)
    kalman = kalman_filter(linear, noise)
    return linear, kalman, kalman.whiten(*residual_column(linear))[..., 0]


def process(rng: np.random.Generator, t: np.ndarray, sigma: float, tau: float) -> np.ndarray:
    """(n,) first-order Gauss-Markov process at times t."""
    x = sigma * rng.standard_normal(len(t))
    for k in range(1, len(t)):
        rho = np.exp(-(t[k] - t[k - 1]) / tau)
        x[k] = rho * x[k - 1] + np.sqrt(1.0 - rho**2) * x[k]
    return x


def covariance(t: np.ndarray, sigma: float, tau: float) -> np.ndarray:
    return sigma**2 * np.exp(-np.abs(t[:, None] - t) / tau)
