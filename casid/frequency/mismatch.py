"""Measure how far a model's frequency response is from that of flight: in dB and deg, as one cost, and in an
envelope."""

from __future__ import annotations

import csv
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from casid.above import ask_above
from casid.arguments import a_path, one_line
from casid.errors import InputError
from casid.frames import Rows, brief
from casid.frequency.model_response import LinearModel
from casid.frequency.response import FrequencyResponse, gain_db, phase_deg
from casid.frequency.transform import check_band
from casid.keeping import plain
from casid.records.limits import read_text_of

# Cost of Tischler and Remple, Aircraft and Rotorcraft System Identification, 2nd ed. (2012): 20 points, weights of dB
# and of deg, which make an error of 1 dB as large as one of 7.57 deg, and the weight of the coherence.
_POINTS = 20
PER_DB2 = 1.0
PER_DEG2 = 0.01745
_COLUMNS = ("omega", "gain_low_db", "gain_high_db", "phase_low_deg", "phase_high_deg")

ResponseFunction = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class MismatchEnvelope:
    """Bounds of the mismatch, model less flight, over frequency; between the rows they run linearly over log omega.

    Such as the envelopes of maximum unnoticeable added dynamics (MUAD), from a table of the user's standard.

    Attributes
    ----------
    omega
        (rows,) [rad/s], increasing.
    gain_low_db, gain_high_db
        (rows,) bounds of the gain [dB].
    phase_low_deg, phase_high_deg
        (rows,) bounds of the phase [deg].
    name
        For figures.

    Raises
    ------
    InputError
        For frequencies that do not increase, and bounds that cross.

    Examples
    --------
    >>> import casid as cs
    >>> envelope = cs.MismatchEnvelope(
    ...     omega=[0.5, 10.0], gain_low_db=[-3.0, -6.0], gain_high_db=[3.0, 6.0],
    ...     phase_low_deg=[-20.0, -40.0], phase_high_deg=[20.0, 40.0],
    ... )
    >>> envelope.bounds([0.5])["gain_low_db"]
    array([-3.])
    """

    omega: np.ndarray
    gain_low_db: np.ndarray
    gain_high_db: np.ndarray
    phase_low_deg: np.ndarray
    phase_high_deg: np.ndarray
    name: str = "envelope"

    def __post_init__(self) -> None:
        where = f"envelope '{one_line(self.name, 'MismatchEnvelope: name')}'"
        for name in _COLUMNS:
            try:
                column = np.asarray(getattr(self, name), dtype=float)
            except (TypeError, ValueError, OverflowError):
                raise InputError(f"{where}: {name} has values that are no numbers") from None
            if column.ndim != 1 or len(column) < 2 or column.shape != np.shape(self.omega):
                raise InputError(f"{where}: {name} has the shape {column.shape}; expected one number per frequency")
            if not np.isfinite(column).all():
                raise InputError(f"{where}: {name} has values that are no finite numbers")
            object.__setattr__(self, name, column)
        if not (self.omega > 0.0).all() or not (np.diff(self.omega) > 0.0).all():
            raise InputError(f"{where}: omega does not increase; expected positive, increasing frequencies in rad/s")
        for what, unit in (("gain", "db"), ("phase", "deg")):
            crossed = getattr(self, f"{what}_low_{unit}") >= getattr(self, f"{what}_high_{unit}")
            if crossed.any():
                at = float(self.omega[int(np.argmax(crossed))])
                raise InputError(f"{where}: the lower bound of the {what} is not below the upper one at {at:g} rad/s")

    @classmethod
    def read(cls, path: str | Path) -> MismatchEnvelope:
        """The envelope of a CSV file with the columns omega, gain_low_db, gain_high_db, phase_low_deg, phase_high_deg.

        Raises
        ------
        InputError
            For a file that cannot be read, and a column that is missing.
        """
        file = a_path(path, "MismatchEnvelope.read")
        try:
            lines = read_text_of(file).splitlines()
            rows = list(csv.DictReader(line for line in lines if not line.startswith("#")))
        except csv.Error as error:
            raise InputError(f"{file}: cannot be read: {error}") from None
        for name in _COLUMNS:
            if not rows or name not in rows[0]:
                raise InputError(f"{file}: no column '{name}'; expected the columns {', '.join(_COLUMNS)}")
        try:
            columns = {name: np.array([float(row[name]) for row in rows]) for name in _COLUMNS}
        except (TypeError, ValueError):
            raise InputError(f"{file}: a row has fewer numbers than columns, or a text; expected numbers") from None
        return cls(**columns, name=file.stem)

    def bounds(self, omega: np.ndarray) -> dict[str, np.ndarray]:
        """Name of each bound -> (frequencies,) its value at omega (frequencies,) [rad/s]; NaN outside the table."""
        at = np.log(omega)
        table = np.log(self.omega)
        return {n: np.interp(at, table, getattr(self, n), left=np.nan, right=np.nan) for n in _COLUMNS[1:]}

    __repr__ = brief


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Mismatch:
    """A model's response less that of flight.

    Attributes
    ----------
    response
        (frequencies,) that of the model, complex, at the frequencies of the flight's.
    gain_db, phase_deg
        (frequencies,) model less flight, the phase from -180 to 180 deg.
    cost
        J of Tischler and Remple over the band: 0 is perfect. Their guidelines are J of at most 100 for an acceptable
        model, and of at most 50 for one that is nearly indistinguishable from flight.
    within
        (frequencies,) whether both are within the envelope; None without one.
    judged
        (frequencies,) where coherence, band and envelope allow to judge.

    Examples
    --------
    After the example of `compare_responses`:

    >>> compared.mismatches["slow"].cost > 100.0
    True
    """

    response: np.ndarray
    gain_db: np.ndarray
    phase_deg: np.ndarray
    cost: float
    within: np.ndarray | None
    judged: np.ndarray

    @property
    def passed(self) -> bool | None:
        """Return True if it is within the envelope wherever it is judged; None without an envelope, or where it has
        none."""
        if self.within is None or not self.judged.any():
            return None
        return bool(self.within[self.judged].all())

    __repr__ = brief


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class ResponseComparison:
    """Models against the response of flight.

    Attributes
    ----------
    flight
        What was estimated from records.
    mismatches
        Name of a model -> its mismatch.
    band
        Lowest and highest frequency [rad/s] of the cost.
    envelope
        Bounds of the mismatch, or None.

    Examples
    --------
    After the example of `compare_responses`:

    >>> compared.band, compared.mismatches["good"].cost < 50.0
    ((1.0, 5.0), True)
    """

    flight: FrequencyResponse
    mismatches: dict[str, Mismatch]
    band: tuple[float, float]
    envelope: MismatchEnvelope | None

    def plot(self) -> Any:
        """Gain, phase, coherence and mismatch as a matplotlib figure, which pyplot has."""
        return ask_above("ResponseComparison.plot", self)

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers, lists and texts."""
        models = {
            label: plain(one, "cost mismatch_db=gain_db mismatch_deg=phase_deg judged within passed")
            | {"gain_db": plain(gain_db(one.response)), "phase_deg": plain(phase_deg(one.response))}
            for label, one in self.mismatches.items()
        }
        envelope = None if self.envelope is None else self.envelope.name
        return {"flight": self.flight.to_dict(), "band": list(self.band), "envelope": envelope, "models": models}

    __repr__ = brief

    def __str__(self) -> str:
        low, high = self.band
        head = f"{self.flight.output} to {self.flight.input}, {low:.3g} to {high:.3g} rad/s: r.m.s. mismatch and cost"
        return f"{head}\n{self.rows().text()}"

    def rows(self) -> Rows:
        """A row for each model: r.m.s. mismatch in gain and phase, cost, and whether it is within the envelope."""
        low, high = self.band
        used = self.flight.usable & (self.flight.omega >= low) & (self.flight.omega <= high)
        rows = []
        for label, one in self.mismatches.items():
            db, deg = (float(np.sqrt(np.mean(values[used] ** 2))) for values in (one.gain_db, one.phase_deg))
            verdict = {None: "", True: "within the envelope", False: "outside the envelope"}[one.passed]
            rows.append((label, db, deg, one.cost, verdict))
        heads = {"model": "", "dB": ".2f", "deg": ".1f", "cost J": ".1f", "": ""}
        return Rows(heads=heads, rows=rows, keys={"": "envelope"})


def compare_responses(
    flight: FrequencyResponse,
    models: Mapping[str, LinearModel | ResponseFunction],
    *,
    band: tuple[float, float] | None = None,
    envelope: MismatchEnvelope | str | Path | None = None,
) -> ResponseComparison:
    """Compare models with the frequency response of flight.

    Parameters
    ----------
    flight
        From `frequency_response`.
    models
        Label -> a model from `linear_model`, which has the flight's input and output; or a function that takes
        frequencies (rad/s) and gives the complex response, in SI units.
    band
        Lowest and highest frequency [rad/s] of the cost; default: where the coherence is at least 0.6, from the first
        such frequency to the last.
    envelope
        Bounds of the mismatch, or the CSV file of one.

    Returns
    -------
    ResponseComparison
        Print it for a table; `plot()` draws it.

    Raises
    ------
    InputError
        For a band without usable frequencies, and a model without the input or output.

    Notes
    -----
    The cost is J = 20/n sum over n = 20 frequencies, evenly by ratio, of W (dB**2 + 0.01745 deg**2), with the weight W
    = (1.58 (1 - exp(-coherence)))**2 (Tischler and Remple, Aircraft and Rotorcraft System Identification, 2nd ed.).

    Examples
    --------
    After the example of `FrequencyResponse`:

    >>> models = {"good": cs.linear_model(lag, {}), "slow": cs.linear_model(lag, {}, values={"T": 1.0})}
    >>> compared = cs.compare_responses(flight, models, band=(1.0, 5.0))
    >>> compared.mismatches["slow"].cost > 50.0 * compared.mismatches["good"].cost
    True
    """
    if not isinstance(models, Mapping) or not models:
        raise InputError("compare_responses: models is no table of models; write {'as given': cs.linear_model(...)}")
    low, high = _band(flight, band)
    bounds = MismatchEnvelope.read(envelope) if isinstance(envelope, str | Path) else envelope
    points = np.geomspace(low, high, _POINTS)
    found = {}
    for label, model in models.items():
        respond = _function(model, flight)
        response = respond(flight.omega)
        found[label] = _mismatch(flight, response, _cost(flight, points, respond(points)), (low, high), bounds)
    return ResponseComparison(flight=flight, mismatches=found, band=(low, high), envelope=bounds)


def _function(model: LinearModel | ResponseFunction, flight: FrequencyResponse) -> ResponseFunction:
    if isinstance(model, LinearModel):
        return lambda omega: model.response(flight.input, flight.output, omega)
    if not callable(model):
        raise InputError("compare_responses: expected models from cs.linear_model(...), or functions of omega")
    return lambda omega: np.asarray(model(omega), dtype=complex)


def _mismatch(
    flight: FrequencyResponse,
    response: np.ndarray,
    cost: float,
    band: tuple[float, float],
    envelope: MismatchEnvelope | None,
) -> Mismatch:
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = response / flight.response
    db = gain_db(ratio)
    deg = np.degrees(np.angle(ratio))
    judged = flight.usable & (flight.omega >= band[0] * (1.0 - 1e-9)) & (flight.omega <= band[1] * (1.0 + 1e-9))
    within = None
    if envelope is not None:
        b = envelope.bounds(flight.omega)
        judged = judged & np.isfinite(b["gain_low_db"])
        within = (b["gain_low_db"] <= db) & (db <= b["gain_high_db"])
        within &= (b["phase_low_deg"] <= deg) & (deg <= b["phase_high_deg"])
    return Mismatch(response=response, gain_db=db, phase_deg=deg, cost=cost, within=within, judged=judged)


def _cost(flight: FrequencyResponse, omega: np.ndarray, response: np.ndarray) -> float:
    """J at these points; flight is interpolated between its frequencies, linearly over log omega."""
    at = np.log(omega)
    known = np.log(flight.omega)
    db = gain_db(response) - np.interp(at, known, flight.gain_db)
    deg = np.degrees(np.angle(response)) - np.interp(at, known, flight.phase_deg)
    deg = (deg + 180.0) % 360.0 - 180.0
    weight = coherence_weight(np.interp(at, known, flight.coherence))
    return float(20.0 / len(omega) * np.sum(weight * (PER_DB2 * db**2 + PER_DEG2 * deg**2)))


def coherence_weight(coherence: np.ndarray) -> np.ndarray:
    """Weight of a frequency in the cost J by its coherence."""
    return (1.58 * (1.0 - np.exp(-coherence))) ** 2


def _band(flight: FrequencyResponse, band: tuple[float, float] | None) -> tuple[float, float]:
    usable = flight.omega[flight.usable]
    if not len(usable):
        raise InputError(
            f"compare_responses: the coherence of {flight.output} with {flight.input} is {flight.coherence.max():.2f} "
            "at most; expected 0.6 or more somewhere, to compare there"
        )
    if band is None:
        return float(usable[0]), float(usable[-1])
    low, high = check_band(band, "compare_responses")
    first = float(flight.omega[0])
    last = float(flight.omega[-1])
    if not first * (1.0 - 1e-9) <= low < high <= last * (1.0 + 1e-9):
        raise InputError(
            f"compare_responses: band is {low:g} to {high:g} rad/s; expected a part of {first:.4g} to {last:.4g} rad/s "
            "(flight)"
        )
    return low, high
