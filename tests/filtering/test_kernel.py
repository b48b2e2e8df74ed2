"""Truth: the recursions in numpy, for matrices of all sizes around those of a vector."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from casid.filtering.innovations import Linear, NoiseModel
from casid.filtering.kalman import kalman_filter

N, R = 30, 3
SIZES = [
    (1, 0, 1),
    (2, 1, 3),
    (3, 2, 4),
    (4, 0, 5),
    (5, 4, 2),
    (6, 1, 6),
    (8, 0, 8),
    (9, 3, 12),
    (11, 6, 15),
    (20, 7, 26),
]


def a_model(nx: int, nw: int, ny: int, seed: int) -> Linear:
    """Random step matrices, stable; some readings are missing."""
    rng = np.random.default_rng(seed)
    names = {kind: tuple(f"{kind}{i}" for i in range(n)) for kind, n in (("x", nx), ("w", nw), ("y", ny))}
    model: Any = SimpleNamespace(
        states=names["x"], disturbances=names["w"], outputs=names["y"], state_scale=dict.fromkeys(names["x"], 2.0)
    )
    seen = rng.random((N, R, ny)) > 0.1
    A = np.linalg.qr(rng.standard_normal((N - 1, R, nx, nx)))[0] * 0.95
    by_samples = {"C": (ny, nx), "Dw": (ny, nw), "Dp": (ny, 4)}
    by_steps = {"Bw0": (nx, nw), "Bw1": (nx, nw), "Bp": (nx, 4)}
    given = {name: rng.standard_normal((N, R, *shape)) * seen[..., None] for name, shape in by_samples.items()}
    given |= {name: 0.3 * rng.standard_normal((N - 1, R, *shape)) for name, shape in by_steps.items()}
    for name in ("Bw0", "Bw1", "Dw"):
        given[name] *= rng.random(given[name].shape[2:]) > 0.6  # a disturbance acts on few
    given |= {"X": np.zeros((N, R, nx)), "output": np.zeros((N, R, ny)), "dt": np.full((N - 1, R), 0.1)}
    given |= {"residual": rng.standard_normal((N, R, ny)), "defect": rng.standard_normal((N - 1, R, nx))}
    return Linear(model=model, free=(), seen=seen, A=A, **given)


@pytest.mark.parametrize("nx, nz, ny", SIZES)
def test_compiled_recursions_equal_the_plain_ones_for_any_size(nx: int, nz: int, ny: int) -> None:
    nw = nz + 5
    linear, names = a_model(nx, nw, ny, nx), [f"w{i}" for i in range(nw)]
    noise = NoiseModel(
        measurement=dict.fromkeys(linear.model.outputs, 0.5),
        coloured={name: (0.4, 0.3) for name in names[:nz]},
        white={names[nz]: 0.2, names[nz + 1]: 0.3},
        inputs={names[nz + 2]: 0.1, names[nz + 3]: 0.4},
    )
    fast, plain = kalman_filter(linear, noise), kalman_filter(linear, noise, plain=True)
    assert fast.kernel is not None and plain.kernel is None
    rng = np.random.default_rng(3)
    stations, series = [4, 0, 4, *rng.integers(nw, size=18)], rng.standard_normal((N, R, 21))
    columns = rng.standard_normal((R, N, ny, 19))
    Y, F = linear.residual[..., None], -linear.defect[..., None]

    def made(of: Any) -> list[np.ndarray]:
        return [
            *(of.A, of.C, of.gain, of.inverse_root, of.P, of.log_determinant),
            *(of.whiten(Y, F), *of.predicted(Y, F), *of.smooth(Y, F)),
            *(of.whiten(linear.Dp, linear.Bp), of.whiten_histories(stations, series)),
            *(of.whiten_histories(stations[:3], series[..., :3], [0, 1]), *of.entrances([3, 0], columns.copy())),
        ]

    for i, (found, expected) in enumerate(zip(made(fast), made(plain), strict=True)):
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9 * np.abs(expected).max(), err_msg=str(i))
