"""What does a frequency response of flight cost beside scipy.signal.csd, and how near is it to the truth?

Question     What do composite windows cost and gain over averaged spectra of one window length?
Set-up       Three records of 26 s at 50 Hz: a short period with a delay of 0.1 s, driven by noise up to 4 Hz, and white
             noise of a tenth of the output's standard deviation on top. `frequency_response` takes five window lengths
             at 100 frequencies; scipy.signal.csd gives input and cross-spectra of the three records, for each of the
             five lengths alone, with the same taper and overlap, at the frequencies of its transform. Error: r.m.s. of
             the response over the true one, less 1, in 40 draws, over the frequencies from 1 to 20 rad/s that are those
             of scipy's transform with the longest window. Seconds: the least of the repetitions, processor time.
Expectation  Less than 0.1 s, and an error as low as that of the best single length, which nobody knows before.

    python benchmarks/bench_response.py [--repeats 40] [--json FILE]
"""

from __future__ import annotations

from casid.cli.start import run_script

from typing import Any

import numpy as np
from scipy import signal

import casid as cs
from problems.bench.table import parser, processor_seconds_of, publish

DT, COUNT, RECORDS, DELAY = 0.02, 1301, 3, 0.1
BEFORE = 500  # samples that are flown before a record begins
NUMERATOR, DENOMINATOR = [-8.0, -6.0], [1.0, 2.4, 9.0]
WINDOWS = np.geomspace(13.0, 13.0 / 4.0, 5)
BAND, OVERLAP = (1.0, 20.0), 0.8


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--repeats", type=int, default=40, help="draws, of which the fastest counts")
    given = options.parse_args()
    rng = np.random.default_rng(0)
    draws = [[_record(f"m{k}", rng) for k in range(RECORDS)] for _ in range(given.repeats)]
    grid = 2.0 * np.pi / WINDOWS[0] * np.arange(2, 42)
    found = [_composite(records, grid) for records in draws]
    rows = [
        _row("casid, five window lengths", found, processor_seconds_of(lambda: _composite(draws[0]), given.repeats))
    ]
    for window in WINDOWS:
        alone = [_by_scipy(records, window) for records in draws]
        seconds = processor_seconds_of(lambda w=window: _by_scipy(draws[0], w), given.repeats)
        rows.append(_row(f"scipy.signal.csd, {window:.2f} s", alone, seconds))
    together = sum(row["seconds"] for row in rows[1:])
    for row in rows:
        row["times all of csd"] = row["seconds"] / together
    publish(rows, given.json)


def _record(name: str, rng: np.random.Generator) -> cs.Record:
    """Noise up to 4 Hz, and what the short period makes of it."""
    t, before = DT * np.arange(COUNT + BEFORE), BEFORE
    u = np.asarray(signal.sosfilt(signal.butter(4, 4.0, fs=1.0 / DT, output="sos"), rng.standard_normal(len(t))))
    y = signal.lsim((NUMERATOR, DENOMINATOR), np.interp(t - DELAY, t, u), t)[1]
    y = y + 0.1 * y.std() * rng.standard_normal(len(t))
    return cs.Record(name=name, t=t[before:] - t[before], channels={"u": u[before:], "y": y[before:]})


def _composite(records: list[cs.Record], omega: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    found = cs.frequency_response(records, "u", "y", omega=omega)
    return found.omega, found.response


def _by_scipy(records: list[cs.Record], window: float) -> tuple[np.ndarray, np.ndarray]:
    """Averaged over the records: input spectrum and cross-spectrum of one window length."""
    count = round(window / DT)
    given: dict[str, Any] = {"fs": 1.0 / DT, "nperseg": count, "noverlap": count - round(count * (1.0 - OVERLAP))}
    cross = sum(signal.csd(r["u"], r["y"], **given)[1] for r in records)
    frequency, first = signal.csd(records[0]["u"], records[0]["u"], **given)
    power = first + sum(signal.csd(r["u"], r["u"], **given)[1] for r in records[1:])
    return 2.0 * np.pi * frequency, cross / power


def _row(name: str, draws: list[tuple[np.ndarray, np.ndarray]], seconds: list[float]) -> dict[str, Any]:
    errors = []
    for omega, response in draws:
        inside = (omega >= BAND[0]) & (omega <= BAND[1])
        s = 1j * omega[inside]
        truth = np.polyval(NUMERATOR, s) / np.polyval(DENOMINATOR, s) * np.exp(-DELAY * s)
        errors.append(np.abs(response[inside] / truth - 1.0))
    return {
        "estimate": name,
        "error": float(np.sqrt(np.mean(np.concatenate(errors) ** 2))),
        "worst": float(np.mean([error.max() for error in errors])),
        "seconds": min(seconds),
    }


if __name__ == "__main__":
    run_script(main)
