"""Theil's inequality coefficient of a simulated channel, and the parts of its squared error.

With measured z and simulated y, U = rms(z - y) / (rms z + rms y). The mean square of z - y is the sum of
(mean z - mean y)^2, of (s_z - s_y)^2 and of 2 (1 - r) s_z s_y for the standard deviations s and the correlation r: the
parts of bias, variance and covariance, which add up to one (Theil, Applied Economic Forecasting, 1966; Jategaonkar,
Flight Vehicle System Identification, 2nd ed., 11.2.5).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from casid.errors import InputError
from casid.filtering.initial_state import fit_initial_state, measured_start
from casid.model.aircraft import Aircraft, given_aircraft
from casid.model.flown_records import FlownRecords, flown_records
from casid.model.simulate import simulate
from casid.records.given import given_records
from casid.records.record import Record

_WINDOW_S = 5.0  # of a record, to which the initial state is fitted


@dataclass(frozen=True, kw_only=True)
class Theil:
    """Theil's coefficient of a channel and the parts of its mean square error.

    Attributes
    ----------
    coefficient
        0 for equal histories, 1 at worst.
    bias, variance, covariance
        Parts of the mean square error by a difference of the means, by a difference of the sizes of the motions, and by
        all that is left; their sum is 1. All 0 where there is no error.
    rms
        Of measured minus simulated, in the unit of the channel.

    Examples
    --------
    >>> import casid as cs
    >>> q = cs.theil("casid/cli/demo/aircraft.toml", ["casid/cli/demo/m4.csv"])["m4"]["q"]
    >>> 0.0 < q.coefficient < 1.0, round(q.bias + q.variance + q.covariance, 9)
    (True, 1.0)
    """

    coefficient: float
    bias: float
    variance: float
    covariance: float
    rms: float


def theil(
    aircraft: Aircraft | str | Path, records: Sequence[Record | str | Path], *, axes: str | None = None
) -> dict[str, dict[str, Theil]]:
    """Theil's coefficients of an aircraft file flown open loop through the inputs of records.

    Every flight begins at the measured state; states that are not measured begin as they fit the first 5 s of the
    record best.

    Parameters
    ----------
    aircraft
        The aircraft, or the name of its file.
    records
        Flight records, or names of files.
    axes
        "full", "longitudinal" or "lateral"; by default what the surfaces allow.

    Returns
    -------
    dict
        Record -> channel -> Theil, of the channels that are measured; empty for a record on which the flight diverges.

    Raises
    ------
    InputError
        For records that cannot feed the model.

    Examples
    --------
    >>> import casid as cs
    >>> found = cs.theil("casid/cli/demo/aircraft.toml", ["casid/cli/demo/m4.csv"])["m4"]["q"]
    >>> round(found.bias + found.variance + found.covariance, 9)
    1.0
    """
    file = given_aircraft(aircraft, "theil")
    read = given_records(records, "theil")
    applied = flown_records(file, read, axes)
    found: dict[str, dict[str, Theil]] = {}
    for original, record in zip(read, applied.records, strict=True):
        flown = fly(applied, record)
        found[record.name] = {
            name: theil_of(original[name], flown[:, i])
            for i, name in enumerate(applied.model.outputs)
            if not isinstance(flown, str) and name in original and np.isfinite(original[name]).any()
        }
    return found


def fly(applied: FlownRecords, record: Record) -> np.ndarray | str:
    """Return (N, outputs) what the instruments would have read; or where the simulation diverged."""
    try:
        start = fit_initial_state(applied.model, record, _WINDOW_S)
        return simulate(applied.model, record, measured_start(applied.model, record, start)).outputs
    except (InputError, np.linalg.LinAlgError) as fault:
        return str(fault)


def theil_of(measured: np.ndarray, simulated: np.ndarray) -> Theil:
    """Theil's coefficient of a channel of (N,) samples; missing ones (NaN) take no part. InputError when none is in
    both."""
    there = np.isfinite(measured) & np.isfinite(simulated)
    z = measured[there]
    y = simulated[there]
    if not len(z):
        raise InputError("theil: no sample is there in both histories")
    square = float(np.mean((z - y) ** 2))
    size = float(np.sqrt(np.mean(z**2)) + np.sqrt(np.mean(y**2)))
    bias = float(z.mean() - y.mean()) ** 2
    variance = float(z.std() - y.std()) ** 2
    parts = [bias, variance, max(square - bias - variance, 0.0)]
    shares = [part / square if square > 0.0 else 0.0 for part in parts]
    return Theil(
        coefficient=float(np.sqrt(square)) / size if size > 0.0 else 0.0,
        bias=shares[0],
        variance=shares[1],
        covariance=shares[2],
        rms=float(np.sqrt(square)),
    )
