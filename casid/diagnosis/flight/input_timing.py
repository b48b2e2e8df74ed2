"""How recorded inputs run between samples: linearly, as a sampled continuous signal does, or held, as a digital control
law or a simulation in steps makes them. A record rarely says; half a sample of all inputs, left alone, looks like any
fault that moves with them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from casid.diagnosis.flight.evaluation import FlightFit, scaled_inverse
from casid.diagnosis.flight.fit import fit
from casid.model.station import control
from casid.signals import SURFACES


def as_inputs_run(fitted: FlightFit, *, named: bool = False) -> FlightFit:
    """The fit with inputs that run between samples as the surfaces agree that they do, if that is another way and gains
    enough. And, beside causes that are `named` already, if it is worth another naming."""
    criteria, share = fitted.criteria.input_timing, held_share(fitted, named=named)
    late = 2.0 * criteria.change_s / float(np.median(fitted.batch.dt))
    worth = min(criteria.change, late) if named else criteria.step
    if abs(share - fitted.flight.held) < worth:
        return fitted
    flight = fitted.flight.with_inputs_held(share)
    other = fit(flight, fitted.attached, fitted.noise, fitted, iterations=20)
    return other if other.deviance < fitted.deviance - criteria.gain else fitted


def held_share(fitted: FlightFit, *, named: bool = False) -> float:
    """Share of a sample interval over which inputs are held (`Batch.held`), in steps, on which two surfaces agree that
    move enough to tell; as it is where they do not. One that tells alone may be late for other reasons: it does so of
    inputs that are wholly held, and beside causes that are `named` already."""
    shares, stds, gains = surface_shares(fitted)
    criteria = fitted.criteria.input_timing
    clear = stds < criteria.std
    needed = min(criteria.surfaces, int(clear.sum()) if named else len(shares))
    if clear.sum() < max(needed, 1):
        return fitted.flight.held
    share = float(np.clip(round(float(np.median(shares[clear])) / criteria.step) * criteria.step, -1.0, 1.0))
    agree = clear & (np.abs(shares - share) < criteria.agreement)
    alone = needed == 1 and not named
    if agree.sum() < needed or (alone and share != 1.0) or gains[agree].sum() < criteria.gain:
        return fitted.flight.held
    return share


def surface_shares(fitted: FlightFit) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of each surface that moves and acts the share that linearisation predicts, its 1-sigma, and the deviance's drop.

    What the fit leaves of each channel is taken as a first-order autoregressive process, whitened once more: timing
    shows in quick movements, and most of what a model may miss is slower.
    """
    linear, batch = fitted.linear, fitted.batch
    moving = dict(zip(fitted.model.inputs, np.ptp(batch.U, axis=(0, 1)), strict=True))
    inputs = [name for name in SURFACES if moving.get(name, 0.0) > 0.0]
    stations = [fitted.model.disturbances.index(control(name)) for name in inputs]
    columns = [fitted.model.inputs.index(name) for name in inputs]
    last = batch.U[:-1, :, columns] - batch.U[1:, :, columns]
    F = 0.5 * (linear.Bw0 + linear.Bw1)[..., stations] * last[:, :, None, :]
    white = fitted.filter.whiten(np.zeros((*fitted.read.shape, len(inputs))), F)
    left, (slots, shifted) = _whiter(fitted.white, (fitted.columns, white))
    k, both = len(fitted.slots), np.concatenate([slots, shifted], axis=3).reshape(left.size, -1)
    information = both.T @ both
    information[range(k), range(k)] += fitted.prior_weight
    covariance = scaled_inverse(information)[k:]
    change, variance = covariance @ (both.T @ left.reshape(-1)), np.diag(covariance[:, k:])
    acts = variance > 0.0  # a surface of axes that do not move tells nothing, and rounding may leave less than that
    change, variance = change[acts], variance[acts]
    return fitted.flight.held + change, np.sqrt(variance), change**2 / variance


def _whiter(white: np.ndarray, parts: Sequence[np.ndarray]) -> tuple[np.ndarray, list[np.ndarray]]:
    """Innovations (N, R, ny), and (N, R, ny, columns) with them, less what the sample before tells, in units of what is
    left: channels that the model misses count for less."""
    before, after = white[:-1], white[1:]
    carried = np.sum(before * after, axis=(0, 1)) / np.maximum(np.sum(before**2, axis=(0, 1)), 1e-300)
    left = after - carried * before
    unit = np.sqrt(np.maximum(np.mean(left**2, axis=(0, 1)), 1.0))
    return left / unit, [(one[1:] - carried[:, None] * one[:-1]) / unit[:, None] for one in parts]
