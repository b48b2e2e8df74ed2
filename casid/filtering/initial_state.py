"""The initial state from which a model explains a record best, everything else given."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca
import numpy as np

from casid.filtering.innovations import Linear, NoiseModel, PointFunctions, linearise, make_batch
from casid.filtering.kalman import kalman_filter, residual_column
from casid.model.built import cached
from casid.model.system import Model
from casid.records.noise import pooled_sigma
from casid.records.record import Record

_LEAST_NOISE = 1e-3  # of a channel's variation: a noise-free simulation must not have infinite weight
_ITERATIONS = 6
_NEWTON = 8
BEGINNING_S = 1.0  # of a record, through which a straight line gives the beginning of a reading


def fit_initial_state(
    model: Model, record: Record, window_s: float = np.inf, values: Mapping[str, float] | None = None
) -> np.ndarray:
    """(states,) initial state by weighted least squares over the first `window_s` seconds, with `values` of parameters
    put over the model's nominal ones. Channels are weighted by their high-band noise. A whole record contains little
    about its beginning for a model that is unstable or wrong: then take a window."""
    part = record.between(record.t[0], record.t[0] + window_s)
    names = [o for o in model.outputs if o in part and np.isfinite(part[o]).any()]
    sigma = {o: 1.0 for o in model.outputs} | {o: _sigma(record[o]) for o in names}
    batch = make_batch(model, [part])
    functions = PointFunctions(model, ())
    X = model.guess(part)[:, None]
    P = model.nominal_vector(values)[None]
    sizes = zip(model.states, np.abs(X).max(axis=(0, 1)).tolist(), strict=True)
    noise = NoiseModel(measurement=sigma, initial={name: size for name, size in sizes if size > 0.0})
    for _ in range(_ITERATIONS):
        linear = linearise(functions, batch, P, X)
        X = X + kalman_filter(linear, noise).smooth(*residual_column(linear))[0]
    return X[0, 0]


def _sigma(values: np.ndarray) -> float:
    high = pooled_sigma([values])
    return max(high if np.isfinite(high) else 0.0, _LEAST_NOISE * float(np.nanstd(values))) or 1e-12


def measured_start(
    model: Model,
    record: Record,
    start: np.ndarray,
    parameters: np.ndarray | None = None,
    beginning_s: float = BEGINNING_S,
) -> np.ndarray:
    """(states,) `start` with what is measured of it: outputs that do not depend on inputs begin on the straight line
    through their first `beginning_s` seconds, of three samples or more. Fitted to a record, such a state would make up
    for what is wrong with the model. `parameters` (np,) are the nominal ones by default."""
    by_input = ca.which_depends(model.h, model.u, 1, True)
    t = record.t - record.t[0]
    begins = {}
    for name, depends in zip(model.outputs, by_input, strict=True):
        if depends or name not in record:
            continue
        seen = (t <= beginning_s) & np.isfinite(record[name])
        if seen.sum() >= 3:
            begins[name] = float(np.polynomial.Polynomial.fit(t[seen], record[name][seen], 1)(0.0))
    return state_of_outputs(model, record, begins, start, parameters) if begins else start


def read_start(linear: Linear, noise: NoiseModel, beginning_s: float = BEGINNING_S) -> tuple[np.ndarray, np.ndarray]:
    """(R, states, ny) change of a `measured_start` by where each reading begins, and (R, ny) variance of that by noise
    of the readings, which is white or a first-order process."""
    model = linear.model
    scale = linear.model.scale_vector()
    by_input = ca.which_depends(model.h, model.u, 1, True)
    R, ny = linear.seen.shape[1:]
    state = np.zeros((R, len(model.states), ny))
    variance = np.zeros((R, ny))
    t = np.concatenate([np.zeros((1, R)), np.cumsum(linear.dt, axis=0)])
    for r in range(R):
        seen = linear.seen[:, r] & (t[:, r, None] <= beginning_s)
        rows = [i for i, depends in enumerate(by_input) if not depends and seen[:, i].sum() >= 3]
        state[r][:, rows] = scale[:, None] * np.linalg.pinv(linear.C[0, r, rows] * scale)
        for i in rows:
            at = t[seen[:, i], r]
            name = model.outputs[i]
            of_line = np.linalg.pinv(np.stack([np.ones(len(at)), at], axis=1))[0]
            size, time = noise.colour.get(name, (1.0, 0.0))
            apart = np.abs(at[:, None] - at)
            alike = np.exp(-apart / time) if time > 0.0 else np.eye(len(at))
            variance[r, i] = (noise.measurement[name] * size) ** 2 * (of_line @ alike @ of_line)
    return state, variance


def _outputs_by_state(model: Model, rows: list[int]) -> ca.Function:
    """(x, u, p, w) -> some outputs, and their derivatives by the state."""
    h = model.h[rows]
    return ca.Function("outputs", [model.x, model.u, model.p, model.w], [h, ca.jacobian(h, model.x)])


def state_of_outputs(
    model: Model, record: Record, outputs: Mapping[str, float], start: np.ndarray, parameters: np.ndarray | None = None
) -> np.ndarray:
    """(states,) the state at the first sample that has these `outputs`, by Newton's method from `start`, where states
    that the outputs do not determine stay."""
    rows = [model.outputs.index(name) for name in outputs]
    scale = model.scale_vector()
    function = cached(model, (_outputs_by_state, *rows), lambda: _outputs_by_state(model, rows))
    p = model.nominal_vector() if parameters is None else parameters
    u = record.matrix(model.inputs)[0]
    w = np.zeros(len(model.disturbances))
    x = np.array(start, dtype=float)
    z = np.array(list(outputs.values()))
    for _ in range(_NEWTON):
        now, H = (one.full() for one in function(x, u, p, w))
        x = x + scale * np.linalg.lstsq(H * scale, z - now[:, 0], rcond=None)[0]
    return x
