"""The initial state from which a model explains a record best, everything else given."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from casid.filtering.innovations import NoiseModel, PointFunctions, linearise, make_batch
from casid.filtering.kalman import kalman_filter, residual_column
from casid.model.system import Model
from casid.records.noise import pooled_sigma
from casid.records.record import Record

_LEAST_NOISE = 1e-3  # of a channel's variation: a noise-free simulation must not have infinite weight
_ITERATIONS = 6


def fit_initial_state(
    model: Model, record: Record, window_s: float = np.inf, values: Mapping[str, float] | None = None
) -> np.ndarray:
    """(states,) initial state by weighted least squares over the first `window_s` seconds, with `values` of parameters
    put over the model's nominal ones.

    Channels are weighted by their noise, judged from the band above the motion. Starts from the measured states; for a
    model that is unstable or wrong the fit over a whole record says little about its beginning: then take a window.
    """
    part = record.between(record.t[0], record.t[0] + window_s)
    names = [o for o in model.outputs if o in part and np.isfinite(part[o]).any()]
    sigma = {o: 1.0 for o in model.outputs} | {o: _sigma(record[o]) for o in names}
    batch, functions = make_batch(model, [part]), PointFunctions(model, ())
    X, P = model.guess(part)[:, None], model.nominal_vector(values)[None]
    for _ in range(_ITERATIONS):
        linear = linearise(functions, batch, P, X)
        X = X + kalman_filter(linear, NoiseModel(measurement=sigma)).smooth(*residual_column(linear))[0]
    return X[0, 0]


def _sigma(values: np.ndarray) -> float:
    high = pooled_sigma([values])
    return max(high if np.isfinite(high) else 0.0, _LEAST_NOISE * float(np.nanstd(values)), 1e-12)
