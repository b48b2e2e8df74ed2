"""Conditions that a flight must meet before a test of a standard proves anything."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from casid.acceptance.manoeuvres import MANOEUVRES, Window
from casid.acceptance.smoothing import Smooth
from casid.acceptance.tolerances import CONFIGURATIONS, StandardTest
from casid.model.aircraft import Aircraft
from casid.records.record import Record
from casid.signals import DEGREE, label_of

# largest distance of a control from its trim [rad]: the tolerances of trim positions in table A2A of 14 CFR Part 60,
# appendix A: elevator 1 deg (2.c.5), aileron 2 deg (2.d.4), rudder 1 deg (2.d.5)
TRIM_TOLERANCE: Mapping[str, float] = {"delta_e": 1.0 * DEGREE, "delta_a": 2.0 * DEGREE, "delta_r": 1.0 * DEGREE}
_STEADY = 2.0 * DEGREE  # rad/s: the tolerance of rates in 2.c.10, 2.d.2 and 2.d.6 of the same table
_SPEED = 0.1  # of the airspeed of the file: lift coefficients then differ by a fifth
_SHORT = 0.05  # s by which a rest may fall short


@dataclass(frozen=True, kw_only=True)
class Condition:
    """Condition that a test asks of the flight, and what the flight has."""

    name: str  # what is asked about, "configuration"
    asked: str  # asked, found: both in words
    found: str
    met: bool | None  # whether it is met; None: the record or the file does not state it
    of_rest: bool = False  # whether it asks how long the inputs rest

    def __str__(self) -> str:
        return f"{self.name}: {self.found}; the test asks for {self.asked}"


def conditions_of(
    test: StandardTest, aircraft: Aircraft, record: Record, smoothed: Mapping[str, Smooth], window: Window
) -> tuple[Condition, ...]:
    """Check configuration and airspeed of the file, and trim, controls and rest of the record."""
    found = [*_configuration(test, aircraft), *_speed(aircraft, record, smoothed, window)]
    how = MANOEUVRES[test.manoeuvre]
    if how.inputs and not how.free:
        before = (record.t >= window.start) & (record.t <= window.begin)
        if before.sum() >= 2:
            found += [*_steady(smoothed, before), *_controls(aircraft, record, before)]
    return (*found, *_rest(test, window))


def configuration_of(aircraft: Aircraft) -> str | None:
    """Find the configuration that the name of an aircraft file states, "cruise" of "Do 328, cruise"; None: none."""
    words = re.sub(r"take[ -]off", "takeoff", aircraft.name.lower())
    return next((one for one in CONFIGURATIONS if re.search(rf"\b{one}\b", words)), None)


def _configuration(test: StandardTest, aircraft: Aircraft) -> Iterator[Condition]:
    if not test.configurations:
        return
    own = configuration_of(aircraft)
    yield Condition(
        name="configuration",
        asked=" or ".join(test.configurations),
        found=f"the file is '{aircraft.name}'" + ("" if own else ", which states no configuration"),
        met=None if own is None else own in test.configurations,
    )


def _speed(aircraft: Aircraft, record: Record, smoothed: Mapping[str, Smooth], window: Window) -> Iterator[Condition]:
    file = aircraft.trim.get("V")
    if file is None or "V" not in smoothed:
        return
    flown = float(np.interp(window.start, record.t, smoothed["V"].curve))
    yield Condition(
        name="airspeed",
        asked=f"the {file:.4g} m/s of the file, within {100.0 * _SPEED:g} %",
        found=f"{flown:.4g} m/s at the start",
        met=abs(flown - file) <= _SPEED * file,
    )


def _steady(smoothed: Mapping[str, Smooth], before: np.ndarray) -> Iterator[Condition]:
    rates = [name for name in ("p", "q", "r") if name in smoothed]
    if not rates:
        return
    peaks = {name: float(np.abs(smoothed[name].curve[before]).max()) for name in rates}
    worst = max(peaks, key=lambda name: peaks[name])
    yield Condition(
        name="steady flight before the input",
        asked=f"rates within {_STEADY / DEGREE:g} deg/s",
        found=f"{label_of(worst)} up to {peaks[worst] / DEGREE:.2g} deg/s",
        met=peaks[worst] <= _STEADY,
    )


def _controls(aircraft: Aircraft, record: Record, before: np.ndarray) -> Iterator[Condition]:
    """Aileron and rudder: an elevator off the trim of the file is a matter of the simulation, not of the flight."""
    for name, own in lateral_trim(aircraft).items():
        if name not in record or not np.isfinite(record[name][before]).all():
            continue
        at = float(np.median(record[name][before]))
        yield Condition(
            name=f"{label_of(name)} before the input",
            asked=f"{own / DEGREE + 0.0:.1f} deg, its trim in the file, within {TRIM_TOLERANCE[name] / DEGREE:g} deg",
            found=f"{round(at / DEGREE, 1) + 0.0:.1f} deg",
            met=abs(at - own) <= TRIM_TOLERANCE[name],
        )


def lateral_trim(aircraft: Aircraft) -> dict[str, float]:
    """Solve for aileron and rudder [rad] that hold the derivatives of a file in straight flight without sideslip."""
    controls = ("delta_a", "delta_r")
    effect = np.array([[aircraft.derivatives.get(f"{c}_{s}", 0.0) for s in controls] for c in ("Cl", "Cn")])
    rest = np.array([aircraft.derivatives.get(f"{c}_0", 0.0) for c in ("Cl", "Cn")])
    if abs(np.linalg.det(effect)) <= 1e-9 * np.abs(effect).max(initial=1e-300) ** 2:
        return dict.fromkeys(controls, 0.0)
    return dict(zip(controls, np.linalg.solve(effect, 0.0 - rest).tolist(), strict=True))


def _rest(test: StandardTest, window: Window) -> Iterator[Condition]:
    if not MANOEUVRES[test.manoeuvre].inputs:  # where in the window it begins is not known
        parts = [("length of the record", window.end - window.start, test.before_s + test.after_s)]
    else:
        parts = [("rest before the manoeuvre", window.begin - window.start, test.before_s)]
        parts.append(("rest after the last movement", window.rest, test.after_s))
    for name, has, wanted in parts:
        met = has >= wanted - _SHORT
        if wanted > 0.0:
            yield Condition(name=name, asked=f"{wanted:g} s", found=f"{has:.1f} s", met=met, of_rest=True)
