"""Noise of recorded inputs, which does no more to the motion with a cause than without."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np

from casid.filtering.innovations import Linear, NoiseModel
from casid.model.path import STATES


def held_noise(
    noise: NoiseModel, linear: Linear, reference: Mapping[str, np.ndarray] | None, most: float
) -> tuple[NoiseModel, dict[str, np.ndarray]]:
    """The noise with that of recorded inputs as strong in the motion as in the reference, and the reference.

    Without a reference it is what this model makes of it; `most` as in `as_strong`."""
    into = _into_the_motion(linear, noise.inputs)
    reference = dict(reference or into)
    strength = {name: s * as_strong(into[name], reference[name], most) for name, s in noise.inputs.items()}
    return replace(noise, inputs=strength), reference


def _into_the_motion(linear: Linear, inputs: Iterable[str]) -> dict[str, np.ndarray]:
    """name -> (states of an aircraft,) what noise of an input does to the motion, on average, in typical sizes."""
    model = linear.model
    drive = (linear.Bw0 + linear.Bw1).mean(axis=(0, 1)) / model.scale_vector()[:, None]
    rows = [i for i, state in enumerate(model.states) if state in STATES]
    return {name: drive[rows, model.disturbances.index(name)] for name in inputs}


def as_strong(into: np.ndarray, reference: np.ndarray, most: float) -> float:
    """Factor with which noise of an input does no more to the motion than in the reference. A cause must not gain by
    making a control stronger, so that its noise explains what nothing else does. Nor by making it weaker: the noise is
    measured, and not stronger than that; and there are no more than `most` 1-sigmas of it."""
    ratio = abs(float(into @ reference)) / max(float(reference @ reference), 1e-300)
    return float(np.clip(1.0 / max(ratio, 1e-300), 1.0 / most, 1.0))
