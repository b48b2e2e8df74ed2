"""Readings that neither the model nor the readings beside them bear out, and that no least squares may follow.

The data stage takes out what is far from its neighbours in a channel by itself, where any motion may come between.
Beside a fitted model innovations are noise, and smaller outliers show. What a model misses lasts for some samples, or
shows when a surface moves; an outlier is alone. Left out, it has no weight, as with a redescending loss; without any,
nothing changes, and no efficiency is lost.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from casid.diagnosis.flight.evaluation import FlightFit
from casid.diagnosis.flight.fit import fit
from casid.model.station import control
from casid.records.noise import isolated
from casid.signals import SURFACES


def without_outliers(fitted: FlightFit) -> FlightFit:
    """The fit without the outliers that it shows, and without those that then show; the same when there is none."""
    for _ in range(fitted.criteria.numerics.fit.outlier_fits):
        at, outputs = outliers(fitted), fitted.model.outputs
        if not at.any():
            break
        records = []
        for r, record in enumerate(fitted.flight.records):
            off = {o: at[: len(record), r, i] for i, o in enumerate(outputs) if at[:, r, i].any()}
            kept = {o: np.where(alone, np.nan, record[o]) for o, alone in off.items()}
            notes = [f"{o}: {alone.sum()} single readings far from all others left out" for o, alone in off.items()]
            records.append(replace(record.with_channels(**kept), notes=(*record.notes, *notes)))
        flight = replace(fitted.flight, records=tuple(records), _regressors={})
        fitted = fit(flight, fitted.attached, fitted.noise, iterations=20)
    return fitted


def outliers(fitted: FlightFit) -> np.ndarray:
    """(N, R, ny) True at single innovations far from those before and behind. Not of an output that a surface enters
    at once, where one moves: a surface that is late by a sample makes such an innovation, too."""
    white, seen, at_once = fitted.white, fitted.linear.seen, _at_once(fitted)
    found = np.zeros(seen.shape, dtype=bool)
    for r in range(seen.shape[1]):
        for i in range(seen.shape[2]):
            at = np.flatnonzero(seen[:, r, i])
            found[at, r, i] = isolated(white[at, r, i], fitted.criteria.noise.outlier)
    return found & ~(at_once & _moving(fitted)[..., None])


def _at_once(fitted: FlightFit) -> np.ndarray:
    """(ny,) True of outputs that a surface enters without a state between."""
    stations = [control(name) for name in SURFACES if control(name) in fitted.model.disturbances]
    index = [fitted.model.disturbances.index(name) for name in stations]
    return np.any(fitted.linear.Dw[..., index] != 0.0, axis=(0, 1, 3))


def _moving(fitted: FlightFit) -> np.ndarray:
    """(N, R) samples at which a surface moves, and those beside them that feel it."""
    flight, batch, moving = fitted.flight, fitted.batch, np.zeros(fitted.batch.live.shape, dtype=bool)
    for name in (one for one in SURFACES if one in fitted.model.inputs):
        U = batch.U[..., fitted.model.inputs.index(name)]
        least = flight.criteria.noise.outlier_input * np.sqrt(2.0) * flight.input_sigma.get(control(name), 0.0)
        moves = np.abs(np.diff(U, axis=0)) > least
        moving[1:] |= moves
        moving[:-1] |= moves
    wide = moving.copy()
    wide[1:] |= moving[:-1]
    wide[:-1] |= moving[1:]
    return wide
