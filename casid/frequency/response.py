"""Frequency responses of flights: gain, phase, coherence and random error, from records and several window lengths."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from casid.above import ask_above
from casid.arguments import names, number, require
from casid.errors import InputError, check_known
from casid.frames import Rows, brief
from casid.frequency.transform import Spectra, Stretch, check_band, spectra, stretches
from casid.keeping import plain, save
from casid.records.given import given_records
from casid.records.record import Record
from casid.signals import unit_of

if TYPE_CHECKING:
    from pandas import DataFrame

USABLE = 0.6  # coherence: Tischler and Remple, Aircraft and Rotorcraft System Identification, 2nd ed. (2012)
# in a window, below which it contains nothing: the main lobe of Hann's window reaches down to zero there
_PERIODS = 2.0
_FULL = 4.0  # periods in a window, from which it has its full weight beside a longer one
_COUNT = 100  # frequencies of a response
_WINDOWS = 5  # lengths, of which the longest is half a stretch
_SHORTEST = 0.25  # of the longest window
_SAMPLES_PER_PERIOD = 10  # at the highest frequency
_CHANCE = 0.05  # of two unrelated channels to be taken for related ones
_FEWEST = 1.5  # independent averages, below which a coherence means nothing
_SURE = 1e-6  # random error that weighs no more than a smaller one

_SHOWN = 15  # frequencies of a response as text
# column -> head and form of its numbers
_HEADS = {
    "omega": ("rad/s", ".3f"),
    "gain_db": ("dB", ".2f"),
    "phase_deg": ("deg", ".1f"),
    "coherence": ("coherence", ".3f"),
    "multiple_coherence": ("multiple", ".3f"),
    "random_error": ("random error", ".3f"),
    "averages": ("averages", ".1f"),
    "input_spectrum": ("input", ".3g"),
    "output_spectrum": ("output", ".3g"),
}


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class FrequencyResponse:
    """Response of an output to an input, by frequency.

    Attributes
    ----------
    input, output
        Names of the channels.
    other_inputs
        Inputs whose part in both was taken off before.
    omega
        (frequencies,) [rad/s].
    response
        (frequencies,) output over input, complex, in SI units.
    coherence
        (frequencies,) part of the output's power that is linear in the input; with other inputs the partial coherence.
    multiple_coherence
        (frequencies,) part of the output's power that is linear in all inputs together.
    random_error
        (frequencies,) standard deviation of the gain over the gain, and of the phase in rad.
    averages
        (frequencies,) independent windows behind it, less the other inputs.
    input_spectrum, output_spectrum
        (frequencies,) one-sided densities over omega, without the part of the other inputs.
    windows
        Length of each window [s] -> number of independent averages.
    records
        Names of the records.

    Examples
    --------
    After the example of `define_model`:

    >>> t = 0.02 * np.arange(3000)
    >>> sweep = cs.Record(name="sweep", t=t, channels={"u": np.sin(0.4 * t + 0.06 * t**2)})
    >>> flown = cs.simulate(lag, sweep, [0.0]).as_record("flown")
    >>> flight = cs.frequency_response([flown], "u", "y")
    >>> band = (flight.omega > 1.0) & (flight.omega < 5.0)
    >>> bool(np.all(flight.coherence[band] > 0.9))
    True
    """

    input: str
    output: str
    other_inputs: tuple[str, ...]
    omega: np.ndarray
    response: np.ndarray
    coherence: np.ndarray
    multiple_coherence: np.ndarray
    random_error: np.ndarray
    averages: np.ndarray
    input_spectrum: np.ndarray
    output_spectrum: np.ndarray
    windows: dict[float, float]
    records: tuple[str, ...]

    @cached_property
    def by_chance(self) -> np.ndarray:
        """(frequencies,) coherence that unrelated channels exceed in one case of twenty: 1 - 0.05^(1 / (n - 1)) of n
        averages, high for few of them."""
        return 1.0 - _CHANCE ** (1.0 / np.maximum(self.averages - 1.0, _SURE))

    @cached_property
    def usable(self) -> np.ndarray:
        """(frequencies,) whether the coherence is at least 0.6, and more than what comes about by chance."""
        return self.coherence >= np.maximum(USABLE, self.by_chance)

    @cached_property
    def gain_db(self) -> np.ndarray:
        """(frequencies,) 20 log10 of the gain in SI units."""
        return gain_db(self.response)

    @cached_property
    def phase_deg(self) -> np.ndarray:
        """(frequencies,) phase [deg], without jumps by 360 deg from one usable frequency to the next."""
        return phase_deg(self.response, self.usable)

    def plot(self) -> Any:
        """Gain, phase and coherence as a matplotlib figure, which pyplot has; low coherence is grey."""
        return ask_above("FrequencyResponse.plot", self)

    def to_frame(self) -> DataFrame:
        """A pandas data frame, a row for each frequency; needs the extra `pandas`."""
        return self.rows().frame()

    def rows(self, most: int | None = None) -> Rows:
        """A row for each frequency, or for so many, evenly spaced."""
        count = len(self.omega)
        chosen = np.unique(np.linspace(0, count - 1, min(count, most or count)).round().astype(int))
        columns = [*self.columns().values(), np.where(self.usable, "", "not usable")]
        return Rows(
            heads={**dict(_HEADS.values()), "": ""},
            keys={**{head: key for key, (head, _) in _HEADS.items()}, "": "usable"},
            rows=[tuple(column[k].item() for column in columns) for k in chosen],
        )

    def columns(self) -> dict[str, np.ndarray]:
        """Name -> (frequencies,): what tables have."""
        return {name: getattr(self, name) for name in _HEADS}

    def to_dict(self) -> dict[str, Any]:
        """The content of response.json: plain numbers, lists and texts; a number that does not exist is None."""
        return {
            "schema": "casid.response/1",
            **plain(self, "input output other_inputs"),
            "unit": f"({unit_of(self.output)})/({unit_of(self.input)})",
            "records": list(self.records),
            "windows": [{"seconds": length, "averages": count} for length, count in self.windows.items()],
            **plain(self.columns()),
        }

    def save(self, path: str | Path) -> None:
        """Write it whole into a file, for `casid.load`; see `casid.keeping` for what that is good for."""
        save(self, path)

    __repr__ = brief

    def __str__(self) -> str:
        given = f", given {', '.join(self.other_inputs)}" if self.other_inputs else ""
        lengths = ", ".join(f"{length:.3g} s ({count:.1f})" for length, count in self.windows.items())
        head = f"{self.output} to {self.input}{given}: {', '.join(self.records)}"
        return f"{head}\nwindows (independent averages): {lengths}\n{self.rows(_SHOWN).text()}"


def frequency_response(
    records: Record | str | Path | Sequence[Record | str | Path],
    input: str,
    output: str,
    *,
    other_inputs: Sequence[str] = (),
    omega: np.ndarray | Sequence[float] | None = None,
    band: tuple[float, float] | None = None,
    windows: Sequence[float] | None = None,
    overlap: float = 0.8,
) -> FrequencyResponse:
    """Response of an output to an input, estimated from flight records.

    Each window length gives auto- and cross-spectra, averaged over overlapping windows in all records. The spectra of
    all lengths are averaged with the weights of the composite window, so that long windows serve low frequencies and
    short ones the high ones. Parts of other inputs, such as a rudder that moves with the aileron, are taken off.

    Parameters
    ----------
    records
        Flight records, one alone, or names of files.
    input, output
        Channels.
    other_inputs
        Channels that move with the input and act on the output, too.
    omega
        (frequencies,) [rad/s]; default: 100 from two periods in the longest window to ten samples in a period, evenly
        by ratio.
    band
        Lowest and highest frequency [rad/s], in place of `omega`: 100 between them, evenly by ratio.
    windows
        Lengths [s]; default: five, from half of the longest record to an eighth.
    overlap
        Part of a window that the next one shares with it, from 0 to 0.95.

    Returns
    -------
    FrequencyResponse
        The H1 estimate: noise of the output does not bias it, noise of the input makes the gain too small.

    Raises
    ------
    InputError
        For a channel that is missing or does not move, a window that no record holds, or that holds fewer than two
        periods of the lowest frequency, and too few windows.

    References
    ----------
    Bendat and Piersol, Random Data, 4th ed. (2010), ch. 7 and 9; Tischler and Remple, Aircraft and Rotorcraft System
    Identification, 2nd ed. (2012), on windows, conditioning and composite windows. The composite here is the weighted
    mean of the spectra, from which their optimisation starts.

    Examples
    --------
    >>> import numpy as np, casid as cs
    >>> t = 0.02 * np.arange(3000)
    >>> u = np.random.default_rng(0).standard_normal(3000)
    >>> record = cs.Record.from_arrays("m1", t, {"u": u, "y": -2.0 * u})
    >>> found = cs.frequency_response(record, "u", "y")
    >>> bool(np.allclose(found.gain_db, 20.0 * np.log10(2.0)))
    True
    """
    channels = (input, output, *names(other_inputs, "frequency_response: other_inputs"))
    if len(set(channels)) < len(channels):
        raise InputError(f"frequency_response: {', '.join(channels)}: expected different channels")
    require(overlap, (int, float), "frequency_response: overlap", "a number like 0.8")
    if not 0.0 <= overlap <= 0.95:
        raise InputError(f"frequency_response: overlap is {overlap:g}; expected 0 to 0.95")
    flown = given_records(records, "frequency_response", own=channels)
    if band is not None:
        if omega is not None:
            raise InputError("frequency_response: omega and band are given; give one of them")
        omega = _between(band)
    wanted = None if omega is None else _wanted(omega)
    highest = _highest(flown, channels) if wanted is None else float(wanted.max())
    parts = [part for record in flown for part in stretches(record, channels, highest)]
    lengths = _lengths(parts, windows, channels, highest)
    grid = _grid(wanted, lengths[0], highest)
    every = [spectra(parts, channels, grid, length, overlap) for length in lengths]
    _check_motion(every[0])
    try:
        return _composite(every, [record.name for record in flown])
    except np.linalg.LinAlgError:
        raise InputError(
            f"frequency_response: the inputs {', '.join((input, *channels[2:]))} move in proportion to each other in "
            "these records, so that their parts cannot be told apart; leave one out"
        ) from None


def gain_db(response: np.ndarray) -> np.ndarray:
    """(frequencies,) 20 log10 of the gain of a complex response."""
    with np.errstate(divide="ignore"):
        return 20.0 * np.log10(np.abs(response))


def phase_deg(response: np.ndarray, usable: np.ndarray | None = None) -> np.ndarray:
    """(frequencies,) phase [deg] without jumps by 360 deg between usable frequencies; each other one is as near as
    possible to the usable one below it."""
    angle = np.angle(response)
    there = np.flatnonzero(usable) if usable is not None and usable.any() else np.arange(len(angle))
    smooth = angle.copy()
    smooth[there] = np.unwrap(angle[there])
    before = there[np.maximum(np.searchsorted(there, np.arange(len(angle)), side="right") - 1, 0)]
    near = smooth[before]
    return np.degrees(smooth + 2.0 * np.pi * np.round((near - smooth) / (2.0 * np.pi)))


def random_error(coherence: np.ndarray, averages: float | np.ndarray) -> np.ndarray:
    """Standard deviation of the gain over the gain: sqrt(1 - c) / sqrt(2 n c) for a coherence c and n averages (Bendat
    and Piersol, table 9.6)."""
    with np.errstate(divide="ignore"):
        return np.sqrt((1.0 - coherence) / (2.0 * averages * coherence))


def _composite(every: Sequence[Spectra], records: Sequence[str]) -> FrequencyResponse:
    """The response by the spectra of all window lengths, weighted by their random errors to the power -4."""
    input, output, *others = every[0].channels
    omega = every[0].omega
    periods = np.array([one.window for one in every])[:, None] * omega / (2.0 * np.pi)
    share = np.clip((periods - _PERIODS) / (_FULL - _PERIODS), 0.0, 1.0)  # a window comes in without a jump
    share[0] = 1.0
    errors = np.array([random_error(_coherence(_conditioned(one.matrix)), one.averages - len(others)) for one in every])
    errors = np.clip(errors, _SURE, 1.0 / _SURE)
    weights = share * (errors / errors.min(axis=0)) ** -4.0
    weights /= weights.sum(axis=0)
    matrix = np.einsum("wf,wfij->fij", weights, np.array([one.matrix for one in every]))
    averages = weights.T @ np.array([one.averages for one in every]) - len(others)
    own = _conditioned(matrix)
    coherence = _coherence(own)
    input_power, output_power = (np.real(own[:, k, k]) for k in range(2))
    return FrequencyResponse(
        input=input,
        output=output,
        other_inputs=tuple(others),
        omega=omega,
        response=own[:, 0, 1] / input_power,
        coherence=coherence,
        multiple_coherence=_multiple(matrix),
        random_error=random_error(coherence, averages),
        averages=averages,
        input_spectrum=input_power,
        output_spectrum=output_power,
        windows={one.window: one.averages for one in every},
        records=tuple(records),
    )


def _conditioned(matrix: np.ndarray) -> np.ndarray:
    """(frequencies, 2, 2) spectra of the first two channels without the part that is linear in the others."""
    two = matrix[:, :2, :2]
    across = matrix[:, :2, 2:]
    others = matrix[:, 2:, 2:]
    return two - across @ np.linalg.solve(others, matrix[:, 2:, :2]) if others.shape[1] else two


def _coherence(two: np.ndarray) -> np.ndarray:
    return _part_of(np.real(two[:, 0, 0]) * np.real(two[:, 1, 1]), np.abs(two[:, 0, 1]) ** 2)


def _multiple(matrix: np.ndarray) -> np.ndarray:
    """(frequencies,) part of the second channel's power, the output's, that is linear in all others together."""
    inputs = [k for k in range(matrix.shape[1]) if k != 1]
    across = matrix[:, inputs, 1:2]
    explained = across.conj().transpose(0, 2, 1) @ np.linalg.solve(matrix[:, inputs][:, :, inputs], across)
    return _part_of(np.real(matrix[:, 1, 1]), np.real(explained[:, 0, 0]))


def _part_of(power: np.ndarray, explained: np.ndarray) -> np.ndarray:
    return np.clip(explained / np.where(power > 0.0, power, np.inf), 0.0, 1.0)


def _between(band: tuple[float, float]) -> np.ndarray:
    low, high = check_band(band, "frequency_response")
    return np.geomspace(number(low, "frequency_response: the low end of band", positive=True), high, _COUNT)


def _wanted(omega: np.ndarray | Sequence[float]) -> np.ndarray:
    found = np.asarray(omega, dtype=float)
    if found.ndim != 1 or len(found) < 2 or not (found > 0.0).all() or not (np.diff(found) > 0.0).all():
        raise InputError("frequency_response: omega has to be at least two positive, increasing frequencies in rad/s")
    return found


def _highest(records: Sequence[Record], channels: Sequence[str]) -> float:
    """The frequency [rad/s] with ten samples in a period, of the record with the slowest samples."""
    intervals = []
    for record in records:
        check_known("channel", channels, record.channels, f"record '{record.name}'")
        t = record.t[np.isfinite(record.matrix(channels)).all(axis=1)]
        intervals += [float(np.median(np.diff(t)))] if len(t) > 1 else []
    if not intervals:
        raise InputError(f"frequency_response: no record has samples of {', '.join(channels)} at the same time")
    return 2.0 * np.pi / _SAMPLES_PER_PERIOD / max(intervals)


def _lengths(
    parts: Sequence[Stretch], windows: Sequence[float] | None, channels: Sequence[str], highest: float
) -> list[float]:
    """Window lengths [s], longest first."""
    if not parts:
        raise InputError(
            f"frequency_response: {', '.join(channels)} have no two samples in a row that are close enough for "
            f"{highest:.3g} rad/s; lower the highest frequency"
        )
    if windows is None:
        longest = 0.5 * max(part.duration for part in parts)
        return [round(float(one), 6) for one in np.geomspace(longest, _SHORTEST * longest, _WINDOWS)]
    found = [number(one, "frequency_response: windows", positive=True) for one in windows]
    if not found:
        raise InputError("frequency_response: windows is empty; expected lengths in s, like [20, 10, 5]")
    return sorted(set(found), reverse=True)


def _grid(wanted: np.ndarray | None, longest: float, highest: float) -> np.ndarray:
    """The wanted frequencies, or all that the longest window [s] holds. Raises InputError where it is too short."""
    lowest = _PERIODS * 2.0 * np.pi / longest
    if wanted is None and lowest >= highest:
        raise InputError(
            f"frequency_response: the longest window, {longest:.3g} s, is too short for any frequency up to "
            f"{highest:.3g} rad/s; expected longer records or windows"
        )
    if wanted is not None and wanted.min() < lowest * (1.0 - 1e-9):
        raise InputError(
            f"frequency_response: {wanted.min():g} rad/s has fewer than two periods in the longest window, "
            f"{longest:g} s; begin at {lowest:.3g} rad/s, or give longer windows"
        )
    return np.geomspace(lowest, highest, _COUNT) if wanted is None else wanted


def _check_motion(longest: Spectra) -> None:
    """Raise InputError for a channel that rests, or for too few windows; shorter windows are more."""
    fewest = _FEWEST + len(longest.channels) - 2
    if longest.averages < fewest:
        raise InputError(
            f"frequency_response: windows of {longest.window:.3g} s give {longest.averages:.2g} independent averages; "
            f"expected at least {fewest:g}: give shorter windows or more records"
        )
    for k, name in enumerate(longest.channels):
        if not (np.real(longest.matrix[:, k, k]) > 0.0).any():
            raise InputError(f"frequency_response: '{name}' does not move in these records")
