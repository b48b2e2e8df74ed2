"""Compatibility check: flight-path reconstruction with errors of the instruments.

Angular rates, accelerations, attitudes and air data of a rigid body are related by kinematics alone. The reconstruction
(`kinematics.reconstruct`) is of the records as `check` corrects them, and leaves all forces and moments free. It
estimates the motion, the biases of all instruments, and those errors of scale, delay and position that the data
require. R. V. Jategaonkar, Flight Vehicle System Identification, 2nd ed. (2015), chapter 10; V. Klein and E. A.
Morelli, Aircraft System Identification (2006), chapter 10.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from scipy import special

from casid.data_check.check import check
from casid.data_check.reading import Finding
from casid.diagnosis.criteria import Criteria
from casid.diagnosis.evidence.evidence import Evidence, deviation, weigh
from casid.diagnosis.evidence.screening import Candidate, screen
from casid.diagnosis.evidence.size import without_and_with
from casid.diagnosis.flight.evaluation import FlightFit
from casid.diagnosis.flight.flight import prepare
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.flight.subject import Subject
from casid.diagnosis.gates import is_possible
from casid.diagnosis.kinematics import kinematics
from casid.diagnosis.kinematics.kinematics import NEEDED
from casid.diagnosis.kinematics.turbulence import Turbulence, gusts, still_air, turbulence
from casid.errors import InputError
from casid.frames import Rows
from casid.keeping import by_fields, plain
from casid.model.aircraft import Aircraft, Inertia, given_aircraft
from casid.model.causes.instruments import sensor_bias
from casid.model.vocabulary import effect_title
from casid.native.threads import single_threaded
from casid.records.given import given_records, require_flight
from casid.records.record import Record, require_channels
from casid.signals import SURFACES, for_a_person, label_of

_TRIED = ("sensor_scale", "sensor_delay", "vane_position", "accelerometer_position")
# Angular accelerations are often computed from the rates. A constant error of heading has no effect. An airspeed error
# acts only through the ratio of accelerations to airspeed, which noise biases towards small values.
_NO_BIAS = ("pdot", "qdot", "rdot", "psi", "V")


@dataclass(frozen=True, kw_only=True)
class InstrumentError:
    """An instrument error, estimated from the kinematics.

    Attributes
    ----------
    kind, target
        "sensor_bias", "sensor_scale", "sensor_delay", "vane_position" or "accelerometer_position", and the channel, or
        the group of channels that share the error.
    value, std
        Estimate and its standard deviation, corrected for coloured residuals, in `unit`; signs as measured minus true.
    allowed
        Limit of good flight-test instrumentation, in `unit`.
    sigmas
        Standard deviations from zero above which the error is clear.
    largest
        Largest plausible size, in `unit`; nothing larger passes, however uncertain it is.
    rivals
        Names of other errors that explain the same readings.

    Examples
    --------
    >>> import casid as cs
    >>> found = cs.compatibility(cs.read_records("flight/m*.csv"))  # doctest: +SKIP
    >>> [(one.kind, one.target, one.value, one.std) for one in found.errors]  # doctest: +SKIP
    """

    in_json: ClassVar[str] = "kind target value=stated std unit allowed identifiable passed rivals"

    kind: str
    target: str
    value: float
    std: float
    unit: str
    allowed: float
    sigmas: float
    largest: float = np.inf
    rivals: tuple[str, ...] = ()

    @property
    def identifiable(self) -> bool:
        """Return True if the records determine the error to within what is allowed.

        Biases are always estimated, and they are correlated if the manoeuvres do not separate them. Other errors are
        estimated only if the data require them.
        """
        return self.kind != "sensor_bias" or self.std <= self.allowed

    @property
    def passed(self) -> bool:
        """Return True if the error is within what is allowed, or not significant and of a plausible size."""
        return abs(self.value) <= min(max(self.allowed, self.sigmas * self.std), self.largest)

    @property
    def stated(self) -> float | None:
        """The value; None if it is larger than an instrument can have and the records do not determine it."""
        return self.value if self.identifiable or abs(self.value) <= self.largest else None

    @property
    def sentence(self) -> str:
        """The error in words, with angles in degrees."""
        factor, unit = for_a_person(self.unit)
        others = f" (or {' or '.join(self.rivals[:3])})" if self.rivals else ""
        shown = "" if unit == "1" else f" {unit}"
        size = (
            "not determined" if self.stated is None else f"{factor * self.stated:.3g} +- {factor * self.std:.2g}{shown}"
        )
        loose = "" if self.identifiable else "; these manoeuvres do not separate it from other errors"
        title = effect_title(self.kind, self.target, None)
        return f"{title}{others}: {size}; {factor * self.allowed:.2g}{shown} is allowed{loose}."

    @property
    def note(self) -> str:
        """The remark at the end of its row in the table."""
        return ("" if self.identifiable else "  not identifiable") + ("" if self.passed else "  failed")

    to_dict = by_fields


@dataclass(frozen=True, eq=False, kw_only=True)
class Compatibility:
    """Result of a compatibility check.

    Attributes
    ----------
    records
        The records that were checked, as the check of the data corrected them.
    axes
        The scope of the check.
    data
        What the check of the data found.
    remarks
        What does not fit each other by that check and is no fault of one channel: an indicated airspeed, for example.
    errors
        Biases of all instruments except airspeed, heading and angular accelerations, and the other errors that the
        data require; failed ones first.
    left
        Channel -> r.m.s. difference of measured and reconstructed, over the noise of the channel.
    noise
        Channel -> noise 1-sigma in SI.
    moving_air
        r.m.s. velocity [m/s] of turbulence, 0 in calm air.
    wind
        Steady wind from the velocity over ground; None if that is not recorded.
    measured, reconstructed
        Record -> (N, channels) in the order of `left`; the reconstruction includes the instrument errors.
    not_judged
        What these records leave open.
    most_left
        Limit of `left` for a pass.
    followed
        Whether the reconstruction follows the records; otherwise there are no `errors` and no `wind`.

    Examples
    --------
    >>> import casid as cs
    >>> found = cs.compatibility(cs.read_records("flight/m*.csv"))  # doctest: +SKIP
    >>> found.passed, found.left["q"]  # doctest: +SKIP
    """

    records: tuple[Record, ...]
    axes: str
    errors: tuple[InstrumentError, ...]
    left: dict[str, float]
    noise: dict[str, float]
    moving_air: float
    wind: SteadyWind | None
    measured: dict[str, np.ndarray]
    reconstructed: dict[str, np.ndarray]
    not_judged: tuple[str, ...] = ()
    data: tuple[Finding, ...] = ()
    remarks: tuple[str, ...] = ()
    most_left: float = np.inf
    followed: bool = True

    @property
    def failed(self) -> tuple[InstrumentError, ...]:
        """Errors that are larger than allowed, and significant or of an impossible size."""
        return tuple(one for one in self.errors if not one.passed)

    @property
    def against(self) -> tuple[str, ...]:
        """All that contradicts the measurements, in words: faults of the data, errors, what is left above noise."""
        high = [f"{label_of(n)} {x:.2g}" for n, x in self.left.items() if x > self.most_left]
        left = [f"More than noise is left between measured and reconstructed, times the noise: {', '.join(high)}."]
        left = left if high else []
        if not self.followed:
            left += ["The reconstruction does not follow these records, so no error and no wind is stated."]
        errors = (one.sentence for one in self.failed)
        return (*(one.sentence for one in self.data), *self.remarks, *errors, *left)

    @property
    def passed(self) -> bool:
        """Return True if the measurements are compatible."""
        return not self.against

    def to_dict(self) -> dict[str, Any]:
        """The content of compatibility.json."""
        return {
            "schema": "casid.compatibility/1",
            "records": [record.name for record in self.records],
            **plain(self, "axes passed data remarks errors moving_air wind not_judged"),
            "channels": {name: {"left": self.left[name], "noise": self.noise[name]} for name in self.left},
        }

    def rows(self) -> Rows:
        """Errors of the instruments as rows, in the units that people read."""
        rows = []
        for one in self.errors:
            factor, unit = for_a_person(one.unit)
            value = None if one.stated is None else factor * one.stated
            name = f"{one.kind}({one.target})"
            rows.append((name, value, factor * one.std, factor * one.allowed, unit, one.note.lstrip(", ;")))
        heads = {"error": "", "value": ".3g", "1-sigma": ".2g", "allowed": ".2g", "unit": "", "": ""}
        return Rows(heads=heads, rows=rows, keys={"": "note"})

    def __str__(self) -> str:
        lines = [f"- {one}" for one in self.against] or [
            "The measurements are compatible: no error of an instrument is clear and larger than allowed."
        ]
        if self.errors:
            lines += ["", self.rows().text()]
        lines += ["", "left over noise: " + ", ".join(f"{name} {value:.2g}" for name, value in self.left.items())]
        if self.moving_air:
            lines.append(f"The air moves with {self.moving_air:.2g} m/s r.m.s.; errors are estimated together with it.")
        if self.wind is not None:
            lines.append(self.wind.sentence)
        return "\n".join([*lines, *(f"Not judged: {one}." for one in self.not_judged)])


@single_threaded()
def compatibility(
    records: Sequence[Record | str | Path] | Record | str | Path,
    aircraft: Aircraft | str | Path | None = None,
    *,
    axes: str | None = None,
    criteria: Criteria | None = None,
) -> Compatibility:
    """Check by rigid-body kinematics whether measurements agree, and estimate the errors of their instruments.

    Parameters
    ----------
    records
        Records with the same instruments, or names of files. They need accelerations, angular rates and airspeed, at
        least in the plane that `axes` names.
    aircraft
        Provides the positions and the noise of the instruments. Nothing else of it is used.
    axes
        "full", "longitudinal" or "lateral"; by default the largest scope that the channels allow.
    criteria
        Thresholds; by default those of `Criteria()`.

    Returns
    -------
    Compatibility
        Instrument errors with their standard deviations, the remaining difference of each channel, and the wind.

    Raises
    ------
    InputError
        For records without the channels that the kinematics need.

    Examples
    --------
    >>> found = casid.compatibility(["m1.csv", "m2.csv"])  # doctest: +SKIP
    >>> found.passed, [one.sentence for one in found.failed]  # doctest: +SKIP
    """
    given = given_records(records, "compatibility")
    if not given:
        raise InputError("no record was given; expected at least one")
    require_flight(given, "compatibility")
    by = criteria or Criteria()
    checked = check(given, criteria=by.data)
    given = checked.records
    plane = _nominal(given, None if aircraft is None else given_aircraft(aircraft, "compatibility"))
    stepped = {one.target for one in checked.findings if one.kind == "data_steps"}
    plane = replace(plane, noise=dict(plane.noise) | {name: _step_sigma(given, name) for name in stepped})
    flight = _flight(given, plane, axes, by)
    biased = [Attached(effect=sensor_bias(o), values={"value": 0.0}) for o in flight.outputs if o not in _NO_BIAS]
    # Between its steps a channel is wrong, too: a scale or a delay that it asks for is that of its filter.
    tried = () if stepped else _TRIED
    found, rivals = _with_errors(flight, kinematics.again(kinematics.reconstruct(flight), biased), tried)
    air = _moving_air(flight, found.fit) if _fails(found, rivals) else still_air(flight)
    hidden: list[str] = []
    if air.named:
        found, rivals = _with_errors(
            flight, _in_moving_air(flight, biased, air), tried, partial(_stands_out, air, hidden)
        )
    errors = sorted(_errors(found, rivals), key=lambda one: one.passed)
    names = tuple(flight.outputs)
    measured = {r.name: r.matrix(names) for r in flight.records}
    reconstructed = {r.name: found.fit.read[: len(r), j] for j, r in enumerate(flight.records)}
    rest = np.concatenate([measured[name] - reconstructed[name] for name in measured])
    left = dict(zip(names, map(float, np.sqrt(np.nanmean(rest**2, axis=0)) / list(flight.sigma.values())), strict=True))
    followed = found.fit.converged or max(left.values()) <= by.parts.twice
    return Compatibility(
        records=given,
        axes=flight.axes,
        errors=tuple(errors) if followed else (),
        left=left,
        noise=dict(flight.sigma),
        moving_air=air.sigma if air.named else 0.0,
        wind=steady_wind(given, found.fit) if followed and left["V"] <= by.parts.twice else None,
        measured=measured,
        reconstructed=reconstructed,
        not_judged=(*_not_judged(given, flight, errors), *_by_steps(stepped), *_by_air(hidden)),
        data=checked.findings,
        remarks=checked.remarks,
        most_left=by.parts.twice,
        followed=followed,
    )


def _step_sigma(records: Sequence[Record], name: str) -> float:
    """1-sigma of a channel that is corrected in steps: the r.m.s. of its second differences, in SI."""
    series = [record[name][np.isfinite(record[name])] for record in records if name in record]
    return float(np.sqrt(np.mean(np.concatenate([np.diff(values, 2) for values in series]) ** 2)))


def _flight(records: Sequence[Record], plane: Aircraft, axes: str | None, criteria: Criteria) -> Subject:
    """The flight of the records without thrust and aerodynamics."""
    able = [name for name, needed in NEEDED.items() if all(c in record for record in records for c in (*needed, "V"))]
    if axes is None and not able:
        for record in records:
            require_channels(record, (*NEEDED["longitudinal"], "V"), "the check of compatibility")
    axes = axes or (able[0] if able else "longitudinal")
    if axes not in NEEDED:
        raise InputError(f"compatibility: axes is '{axes}'; expected one of {', '.join(NEEDED)}")
    for record in records:
        require_channels(record, (*NEEDED[axes], "V"), f"the check of compatibility ({axes})")
    bare = [record.without("thrust", *(s for s in SURFACES)) for record in records]
    still = [one.with_channels(**{s: np.zeros(len(one)) for s in SURFACES}) for one in bare]
    dense = [one if "rho" in one else one.with_channels(rho=np.ones(len(one))) for one in still]
    needed = criteria.numerics.samples_per_cycle
    share = needed / max(map(len, dense))
    noise = replace(criteria.noise, present=min(share, criteria.noise.present))
    flight = prepare(plane, dense, replace(criteria, noise=noise), axes)
    if "V" not in flight.outputs:
        read, record = max((int(np.isfinite(record["V"]).sum()), record.name) for record in records)
        raise InputError(
            f"record '{record}': airspeed V has {read} readings, too few to reconstruct motion, or does not change; "
            f"expected {needed:.0f} or more; log it at a higher rate, or give longer records"
        )
    if not kinematics.available(flight):
        raise InputError("compatibility: accelerations or rates of rotation do not move in these records")
    return flight


def _nominal(records: Sequence[Record], aircraft: Aircraft | None) -> Aircraft:
    """An aircraft of arbitrary size; mass and inertia do not matter if forces and moments are free."""
    for record in records:
        require_channels(record, ("V",), "the check of compatibility")
    speed = float(np.nanmedian(np.concatenate([record["V"] for record in records])))
    given = (
        {}
        if aircraft is None
        else {
            "accelerometer": aircraft.accelerometer,
            "alpha_vane": aircraft.alpha_vane,
            "beta_vane": aircraft.beta_vane,
            "noise": aircraft.noise,
        }
    )
    return Aircraft(
        name="any aircraft",
        mass=1000.0,
        inertia=Inertia(Ixx=1000.0, Iyy=1500.0, Izz=2000.0, Ixz=0.0),
        area=10.0,
        moment_length_lateral=10.0,
        moment_length_pitch=1.0,
        rate_length_lateral=5.0,
        rate_length_pitch=0.5,
        force_axes="body",
        derivatives={"CZ_0": 0.0},
        trim={"V": speed, "thrust": 0.0},
        **given,
    )


def _moving_air(flight: Subject, calm: FlightFit) -> Turbulence:
    """The turbulence beside a reconstruction in calm air; none where no motion in moving air agrees with the
    readings."""
    try:
        return turbulence(flight, calm)
    except InputError:
        return still_air(flight)


def _in_moving_air(flight: Subject, biased: Sequence[Attached], air: Turbulence) -> FlightFit:
    """The reconstruction in turbulence, with biases of the instruments."""
    moving = gusts(flight, air.sigma, length=air.length)
    return kinematics.again(kinematics.reconstruct(flight, moving=moving), biased)


Separate = Callable[[Evidence, Attached], bool]


def _with_errors(
    flight: Subject, found: FlightFit, tried: Sequence[str], separate: Separate = lambda evidence, one: True
) -> tuple[Evidence, dict[str, tuple[str, ...]]]:
    """The reconstruction with the further errors that the data require and `separate`, added one at a time, and their
    alternatives."""
    rivals: dict[str, tuple[str, ...]] = {}
    evidence = weigh(found, discrepancy=False)
    for _ in range(flight.criteria.numerics.fit.repeats):
        taken = {one.effect.key for one in found.attached}
        able = [e for e in flight.effects if e.kind in tried and e.key not in taken]
        ranked = [one for one in screen(evidence, able) if is_possible(one.attached) and one.net > 0.0]
        better = _first_that_holds(evidence, ranked[: flight.criteria.numerics.naming.trials], separate)
        if better is None:
            break
        evidence, leader = better
        found = evidence.fit
        near = [one for one in ranked if one is not leader and one.net > leader.net - flight.criteria.data.alone]
        rivals[leader.name] = tuple(one.name for one in near)
    return evidence, rivals


def _first_that_holds(
    evidence: Evidence, ranked: Sequence[Candidate], separate: Separate
) -> tuple[Evidence, Candidate] | None:
    """The reconstruction with the first candidate that is significant and larger than allowed once it is fitted."""
    for one in ranked:
        try:
            again = kinematics.again(evidence.fit, [*evidence.fit.attached, one.attached])
        except InputError:  # no motion agrees with the readings then
            continue
        now = weigh(again, discrepancy=False)
        last = again.attached[-1]
        if evidence.deviance > now.deviance and not _error(now, last, ()).passed and separate(now, last):
            return now, one
    return None


def _stands_out(air: Turbulence, hidden: list[str], evidence: Evidence, one: Attached) -> bool:
    """Tell whether an error of air data is more of its reading than the moving air is; the others go to `hidden`.

    The aircraft answers gusts, in closed loop or by itself, so that air that moves is correlated with the motion. Up to
    its own r.m.s. it reads like any error that is proportional to the motion.
    """
    fit = evidence.fit
    speed = kinematics.typical_speed(evidence.fit.flight)
    moved = {"V": air.sigma, "alpha": air.sigma / speed, "beta": air.sigma / speed}
    channels = [name for name in one.effect.reads if name in moved and name in fit.model.outputs]
    plain, seen = without_and_with(fit, one)
    change = (seen - plain)[fit.batch.live]
    own = {name: float(np.std(change[:, fit.model.outputs.index(name)])) for name in channels}
    if not channels or any(own[name] > moved[name] for name in channels):
        return True
    hidden.append(effect_title(*one.effect.key))
    return False


def _fails(evidence: Evidence, rivals: dict[str, tuple[str, ...]]) -> bool:
    """Return True if any error fails."""
    return any(not one.passed for one in _errors(evidence, rivals))


def _errors(evidence: Evidence, rivals: dict[str, tuple[str, ...]]) -> list[InstrumentError]:
    """The errors of all instruments in a reconstruction."""
    return [_error(evidence, one, rivals.get(one.name, ())) for one in evidence.fit.attached]


def _error(evidence: Evidence, one: Attached, rivals: tuple[str, ...]) -> InstrumentError:
    """One effect of a reconstruction as an instrument error."""
    fit = evidence.fit
    slot = next(
        s.name for s in fit.slots if s.name == one.name or (s.attached is not None and fit.attached[s.attached] is one)
    )
    allowed = fit.flight.smallest_that_matters(one.effect) or 0.0
    # With this number of possible errors, one set of healthy instruments in a hundred fails.
    chance = 0.01 / (2.0 * len([e for e in fit.flight.effects if e.kind in (*_TRIED, "sensor_bias")]))
    return InstrumentError(
        kind=one.effect.kind,
        target=one.effect.target,
        value=one.values["value"],
        std=deviation(evidence, slot),
        unit=one.effect.unit,
        allowed=float(allowed),
        sigmas=float(-special.ndtri(chance)),
        largest=one.effect.size.limit,
        rivals=rivals,
    )


def _not_judged(records: Sequence[Record], flight: Subject, errors: Sequence[InstrumentError]) -> tuple[str, ...]:
    """List what these records leave open, in words."""
    wanted = {"alpha": "vane of incidence", "beta": "vane of sideslip", "phi": "bank angle", "theta": "pitch angle"}
    plane = {"longitudinal": ("beta", "phi"), "lateral": ("alpha", "theta")}.get(flight.axes, ())
    missing = [
        f"{label}, which is not recorded"
        for name, label in wanted.items()
        if name not in flight.outputs and name not in plane
    ]
    over_ground = all("v_north" in record for record in records)
    always = ("constant errors of airspeed and heading, which do not show in kinematics",)
    loose = [one.target for one in errors if not one.identifiable]
    biases = [f"biases of {', '.join(loose)}, which these manoeuvres do not separate from others"] if loose else []
    return (*missing, *biases, *always, *(() if over_ground else ("steady wind, without velocity over ground",)))


def _by_steps(stepped: Collection[str]) -> tuple[str, ...]:
    """Describe what channels that are corrected in steps leave open."""
    names = ", ".join(label_of(name) for name in sorted(stepped))
    return (f"scales, delays and places of instruments: {names} are corrected in steps",) if stepped else ()


def _by_air(hidden: Collection[str]) -> tuple[str, ...]:
    """Describe what the motion of the air leaves open."""
    names = ", ".join(dict.fromkeys(hidden))
    return (f"{names}: less of its reading than the moving air, to which the aircraft answers",) if names else ()


GROUND = ("v_north", "v_east")


@dataclass(frozen=True, kw_only=True)
class SteadyWind:
    """Steady wind over all records, as the direction to which it blows.

    Attributes
    ----------
    north, east
        Velocity [m/s].
    north_std, east_std
        Standard deviations [m/s], from the means of the fifths of every record.
    varies
        r.m.s. [m/s] of the difference between the wind over time and its mean.

    Examples
    --------
    >>> import casid as cs
    >>> wind = cs.compatibility("autopilot.bin").wind  # doctest: +SKIP
    >>> wind.north, wind.north_std  # doctest: +SKIP
    """

    north: float
    east: float
    north_std: float
    east_std: float
    varies: float

    @property
    def sentence(self) -> str:
        """The wind in words."""
        speed = np.hypot(self.north, self.east)
        towards = np.degrees(np.arctan2(self.east, self.north)) % 360.0
        return (
            f"Steady wind {speed:.2g} m/s towards {towards:.0f} deg: north {self.north:.3g} +- {self.north_std:.2g}, "
            f"east {self.east:.3g} +- {self.east_std:.2g} m/s; {self.varies:.2g} m/s r.m.s. are left."
        )

    to_dict = by_fields


def steady_wind(records: Sequence[Record], found: FlightFit) -> SteadyWind | None:
    """Steady wind: velocity over ground less the reconstructed velocity through the air.

    The result is None if the velocity over ground or the heading is not recorded.
    """
    blocks = []
    rest = []
    for j, record in enumerate(records):
        if not all(name in record for name in (*GROUND, "psi")):
            return None
        air = _through_the_air(record, found, j)
        wind = np.stack([record[name] for name in GROUND], axis=1) - air
        known = wind[np.isfinite(wind).all(axis=1)]
        if len(known) == 0:
            return None
        blocks += [part.mean(axis=0) for part in np.array_split(known, 5) if len(part)]
        rest.append(known)
    means = np.stack(blocks)
    every = np.concatenate(rest)
    north, east = (float(value) for value in every.mean(axis=0))
    north_std, east_std = (float(value) for value in means.std(axis=0, ddof=1) / np.sqrt(len(means)))
    varies = float(np.sqrt(np.mean(np.sum((every - every.mean(axis=0)) ** 2, axis=1))))
    return SteadyWind(north=north, east=east, north_std=north_std, east_std=east_std, varies=varies)


def _through_the_air(record: Record, found: FlightFit, j: int) -> np.ndarray:
    """(N, 2) Velocity through the air towards north and east [m/s].

    Motion that is not reconstructed is taken from the record, or is zero; so is an angle of flow without its vane.
    """
    states = found.model.states
    outputs = found.model.outputs

    def series(name: str) -> np.ndarray:
        if name in states:
            return found.motion.X[: len(record), j, states.index(name)]
        return record[name] if name in record else np.zeros(len(record))

    u, v, w = (series(name) for name in "uvw")
    speed = np.sqrt(u**2 + v**2 + w**2)
    # Without a vane a velocity across the fuselage drifts with the bias of its accelerometer, which is not determined.
    v = v * ("beta" in outputs)
    w = w * ("alpha" in outputs)
    u = np.sqrt(speed**2 - v**2 - w**2)
    phi, theta, psi = (series(name) for name in ("phi", "theta", "psi"))
    ahead = np.cos(theta) * u + np.sin(theta) * (np.sin(phi) * v + np.cos(phi) * w)
    across = np.cos(phi) * v - np.sin(phi) * w
    return np.stack(
        [np.cos(psi) * ahead - np.sin(psi) * across, np.sin(psi) * ahead + np.cos(psi) * across],
        axis=1,
    )
