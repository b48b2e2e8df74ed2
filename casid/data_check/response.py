"""Response of the aircraft to its surfaces, compared with the derivatives of the file: sign, unit and swap of channels.

The measured coefficients of force and moment are regressed on the motion, with the file's derivatives as prior. An
explanation that needs derivatives far from the file has a lower likelihood, whether records or file are at fault. Flow
angles may read a part of each other, as those of healthy vanes do.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from itertools import chain, combinations
from operator import add

import numpy as np

from casid.data_check.criteria import DataCriteria
from casid.data_check.reading import FORCES, Read, Reading
from casid.data_check.regression import Parts, Row, Squares, log_evidence, squares_of, together
from casid.model.aircraft import Aircraft
from casid.model.airframe import unsymmetric_moment
from casid.model.causes.instruments import accelerometer_position
from casid.model.dynamics import standard_density
from casid.model.path import GROUND, aerodynamic_parameters, speed_of_sound
from casid.model.terms import derivative_term, parse_term
from casid.model.usual_derivatives import USUAL_DERIVATIVES, missing_derivatives
from casid.records.record import Record
from casid.signals import GRAVITY, SURFACES, same_unit, si_factor, unit_of

_FORCES: Mapping[str, str] = {"CX": "ax", "CY": "ay", "CZ": "az"}
_OF_LIFT: Mapping[str, str] = {"CD": "ax", "CY": "ay", "CL": "az"}  # along body axes at small angles, less than zero


def answers(record: Record, aircraft: Aircraft) -> dict[str, np.ndarray]:
    """Acceleration -> (N,) immediate effect of the recorded surfaces [SI]; empty if airspeed or density is unknown."""
    pressure = _pressure(record, aircraft)
    if pressure is None:
        return {}
    qS = pressure * aircraft.area
    force = {name: 0.0 * qS for name in _FORCES.values()}
    sides = _FORCES if aircraft.force_axes == "body" else _OF_LIFT
    for coefficient, channel in sides.items():
        sign = 1.0 if coefficient in _FORCES else -1.0
        force[channel] = sign * qS * _by_surfaces(record, aircraft, coefficient) / aircraft.mass
    lengths = (aircraft.moment_length_lateral, aircraft.moment_length_pitch, aircraft.moment_length_lateral)
    moments = [
        qS * length * _by_surfaces(record, aircraft, c) for c, length in zip(("Cl", "Cm", "Cn"), lengths, strict=True)
    ]
    accelerations = np.linalg.solve(aircraft.inertia.tensor, np.stack(moments))
    turning = dict(zip(("pdot", "qdot", "rdot"), accelerations, strict=True))
    found = {name: series for name, series in (force | turning).items() if name in record}
    return {name: series for name, series in found.items() if np.isfinite(series).all()}


def _by_surfaces(record: Record, aircraft: Aircraft, coefficient: str) -> np.ndarray:
    """(N,) part of a coefficient by the deflections."""
    derivatives = aircraft.derivatives
    parts = [derivatives.get(f"{coefficient}_{s}", 0.0) * record[s] for s in SURFACES if s in record]
    return np.sum(parts, axis=0) if parts else np.zeros(len(record))


def _pressure(record: Record, aircraft: Aircraft) -> np.ndarray | None:
    """(N,) dynamic pressure [Pa] by what is recorded, or else by the trim."""
    V = _filled(record, "V", aircraft.trim.get("V"))
    rho = _filled(record, "rho", None)
    for otherwise in (None, aircraft.trim.get("altitude")):
        altitude = _filled(record, "altitude", otherwise)
        if rho is None and altitude is not None:
            rho = standard_density(altitude)
        rho = rho if rho is not None else _filled(record, "rho", aircraft.trim.get("rho"))
    return None if V is None or rho is None else 0.5 * rho * V**2


def _filled(record: Record, name: str, otherwise: float | None) -> np.ndarray | None:
    """(N,) a channel with straight lines across missing samples, or a constant."""
    if name in record and (there := np.isfinite(record[name])).any():
        return np.interp(record.t, record.t[there], record[name][there])
    return None if otherwise is None else np.full(len(record), otherwise)


# SI unit -> units that a column may be in though it is read as SI
_UNITS: Mapping[str, tuple[str, ...]] = {
    "rad": ("deg",),
    "rad/s": ("deg/s",),
    "rad/s2": ("deg/s2",),
    "m/s": ("kt", "ft/s", "km/h"),
    "m/s2": ("g", "ft/s2"),
    "m": ("ft", "km"),
    "kg/m3": ("slug/ft3",),
    "N": ("kN", "lbf"),
}
TIMES = {unit: si_factor(unit, "t") for unit in ("ms", "min")}  # the same of time, with s over number
GROUPS: Mapping[str, tuple[str, ...]] = {
    "p+q+r": ("p", "q", "r"),
    "ax+ay+az": ("ax", "ay", "az"),
    "pdot+qdot+rdot": ("pdot", "qdot", "rdot"),
    "phi+theta+psi": ("phi", "theta", "psi"),
    "phi+theta": ("phi", "theta"),
    "alpha+beta": ("alpha", "beta"),
    "+".join(SURFACES): SURFACES,
}
INSTRUMENTS = tuple(GROUPS[name] for name in ("p+q+r", "ax+ay+az", "pdot+qdot+rdot"))  # axes of one instrument
_SIGNED = (
    *("alpha", "beta", "p", "q", "r", "phi", "theta", "ax", "ay", "az", "pdot", "qdot", "rdot", "north", "east"),
    *GROUND,
    *SURFACES,
)


def _pairs(group: tuple[str, ...]) -> Iterable[tuple[str, str]]:
    return combinations(group, 2)


_SWAPPED = (
    *chain(*map(_pairs, (GROUPS["p+q+r"], GROUPS["phi+theta+psi"], GROUPS["ax+ay+az"], GROUPS["pdot+qdot+rdot"]))),
    *_pairs(SURFACES),
    ("alpha", "beta"),
    ("alpha", "theta"),
    ("beta", "phi"),
    GROUND[:2],
    ("north", "east"),
)


@dataclass(frozen=True, kw_only=True)
class Alternative:
    """One other way to read records, in the vocabulary: kind, target (`a+b` of a swap), factor to SI, unit."""

    kind: str
    target: str
    reading: Reading
    value: float | None = None
    unit: str | None = None
    term: str | None = None

    @property
    def channels(self) -> frozenset[str]:
        """Channels that it reads otherwise; "t" when it is the time."""
        return self.reading.channels | ({"t"} if self.reading.time != 1.0 else set())

    def possible(self, stated: str) -> bool:
        """Return True if a channel with a stated unit may be so: numbers in that unit were SI, or those in SI in
        another."""
        if self.kind != "data_unit" or self.unit is None:
            return True
        other = self.unit.removeprefix(_NOT_IN)
        return (
            bool(same_unit(stated, other))
            if other != self.unit
            else si_factor(stated, self.target.split("+")[0]) == 1.0
        )


_NOT_IN = "SI, not in "


def alternatives(channels: Iterable[str], stretched: Sequence[float] = ()) -> list[Alternative]:
    """All alternatives for records that have these channels; `stretched`: factors of time that rates ask for."""
    there = set(channels)
    found = [_sign(name) for name in _SIGNED if name in there]
    found += [_WITHOUT_GRAVITY] if "az" in there else []
    for name in sorted(there):
        found += _units(name, (name,))
    for label, members in GROUPS.items():
        if there.issuperset(members):
            found += _units(label, members)
        elif members in INSTRUMENTS and len(some := tuple(name for name in members if name in there)) > 1:
            found += _units("+".join(some), some)
    found += [_swap(a, b) for a, b in _SWAPPED if {a, b} <= there]
    if {"north", "east", *GROUND[:2]} <= there:
        found.append(_swap("north", "east", *GROUND[:2]))
    found += [_time(factor, unit) for unit, factor in TIMES.items()]
    return [*found, *(_time(factor, None) for factor in stretched)]


def _sign(name: str) -> Alternative:
    return Alternative(kind="data_sign", target=name, reading=Reading(factor={name: -1.0}), value=-1.0)


_WITHOUT_GRAVITY = Alternative(kind="data_gravity", target="az", reading=Reading(offset={"az": -GRAVITY}))


def _units(label: str, members: tuple[str, ...]) -> list[Alternative]:
    """List the alternatives of another unit than SI, and of SI where the header states that other unit."""
    found = []
    for unit in _UNITS.get(unit_of(members[0]), ()):
        factor = si_factor(unit, members[0])
        for value, said in ((factor, unit), (1.0 / factor, f"{_NOT_IN}{unit}")):
            reading = Reading(factor=dict.fromkeys(members, value))
            found.append(Alternative(kind="data_unit", target=label, reading=reading, value=value, unit=said))
    return found


def accelerometer(axis: str, value: float) -> Alternative:
    """The accelerometer at a distance [m] from the c.g. along an axis: an error that a diagnosis corrects."""
    x, y, z = (value * float(axis == one) for one in "xyz")
    return Alternative(
        kind=accelerometer_position(axis).kind, target=axis, reading=Reading(place=(x, y, z)), value=value, unit="m"
    )


def _swap(*names: str) -> Alternative:
    """One or more pairs of channels, each interchanged."""
    source = {}
    for a, b in zip(names[::2], names[1::2], strict=True):
        source |= {a: b, b: a}
    return Alternative(kind="data_swap", target="+".join(names), reading=Reading(source=source))


def _time(factor: float, unit: str | None) -> Alternative:
    return Alternative(kind="data_unit", target="t", reading=Reading(time=factor), value=factor, unit=unit)


_NEEDED: Mapping[str, tuple[str, ...]] = {
    "Cl": ("p",),
    "Cm": ("q",),
    "Cn": ("r",),
    "CY": ("ay",),
    "CL": ("az", "ax", "alpha"),
    "CZ": ("az",),
}
_FORCE_ROWS = ("CY", "CL", "CZ")
_MOTION = ("alpha", "beta", "p", "q", "r")
_ANGLES = ("alpha", "beta", *SURFACES)
_UNSTEADY = ("alphadot", "betadot")
_READ_TOO: Mapping[str, str] = {"alpha": "beta", "beta": "alpha"}  # a flow angle's vane reads a part of the other


class Response:
    """The response that an aircraft file predicts, compared with records."""

    def __init__(self, aircraft: Aircraft, criteria: DataCriteria, stated: Aircraft | None = None) -> None:
        """`stated`: the file whose values were added up to those of `aircraft`, which have their errors."""
        self._aircraft = aircraft
        self._criteria = criteria
        self._rows = _rows(aircraft, criteria, stated or aircraft)

    def gains(self, records: Sequence[Read], able: Sequence[Alternative]) -> list[tuple[Alternative, list[float]]]:
        """Log likelihood ratio in every record of the alternatives for surfaces, beside those of the file's signs.
        Records share the derivatives: an alternative, also an error of sign in the file, is judged in the set of
        records that gains most. It gains nothing where the file as it stands is then farther from the record: in
        turbulence a pilot's answers are coherent with the air, and derivatives far from the file explain either."""
        there = {n for c in records for n in (*_MOTION, *SURFACES) if c.has(n)}
        plain = [self._parts(record, Reading(), there) for record in records]
        noise = self._noise(plain)
        if not noise:
            return []
        found = []
        for alternative in able:
            other = [self._parts(record, alternative.reading, there) for record in records]
            floor = {c: min(noise[c], sigma) for c, sigma in self._noise(other).items()}
            for j in range(len(records)):
                one = [*plain[:j], other[j], *plain[j + 1 :]]
                floor = {c: min(floor[c], sigma) for c, sigma in self._noise(one).items()}
            gained = self._in_records(plain, other, floor)
            nearer = [self._off(o, floor) <= self._off(p, floor) for o, p in zip(other, plain, strict=True)]
            found.append((alternative, [g if n else min(g, 0.0) for g, n in zip(gained, nearer, strict=True)]))
        return [*found, *self._file_signs(plain, noise)]

    def of_forces(self, readings: Sequence[Sequence[Read]], exchanged: bool = False) -> list[float]:
        """Log marginal likelihood of the file's forces under every reading of the records, up to what all share.

        Readings of the same forces have one noise, the least. Where forces are `exchanged`, one reading takes for a
        force along z what another takes for one along y: each has the noise that it leaves, along every axis."""
        there = {n for c in readings[0] for n in (*_MOTION, *SURFACES) if c.has(n)}
        parts = [[self._parts(record, Reading(), there) for record in records] for records in readings]
        noises = [self._noise(one) for one in parts]
        shared = [c for c in _FORCE_ROWS if all(c in noise for noise in noises)]
        if not exchanged:
            least = {c: min(noise[c] for noise in noises) for c in shared}
            return [self._evidence(one, least) for one in parts]
        found = []
        for records, one, noise in zip(readings, parts, noises, strict=True):
            density = sum(together(one, c).samples * float(np.log(noise[c])) for c in shared)
            density += sum(_unexplained(record, shared) for record in records)
            found.append(self._evidence(one, {c: noise[c] for c in shared}) - density)
        return found

    def likelihood(self, records: Sequence[Read]) -> float:
        """Log marginal likelihood of the file's derivatives, as far as the records determine them, with the noise that
        is left, and of the mean pitching moment. What no derivatives explain is taken off: a missing jump, or a thrust
        line, is no evidence for them."""
        plain = self._plain(records)
        noise = self._noise(plain)
        sums = {c: together(plain, c) for c in noise}
        unexplained = sum(0.5 * s.samples * s.left / noise[c] ** 2 for c, s in sums.items())
        return self._evidence(plain, noise, self._criteria.fair) + unexplained + self._balance(sums.get("Cm"))

    def likeliest(self, records: Sequence[Read]) -> float:
        """The same likelihood of a file that has the derivatives of these records."""
        plain = self._plain(records)
        noise = self._noise(plain)
        sums = {c: together(plain, c) for c in noise}
        found = 0.0
        for c, s in sums.items():
            row = self._rows[c]
            count = len(self._rows[c].prior)
            free = np.linalg.pinv(s.XX[:count, :count], rcond=1e-10, hermitian=True) @ s.Xy[:count]
            own = replace(row, prior=free, sizes=np.maximum(np.abs(free), 1e-12))
            found += log_evidence(s, own, noise[c], self._criteria, self._criteria.fair)
            found += 0.5 * s.samples * s.left / noise[c] ** 2
        return found

    def _plain(self, records: Sequence[Read]) -> list[Parts]:
        """Sums of every record as it is read."""
        there = {n for c in records for n in (*_MOTION, *SURFACES) if c.has(n)}
        return [self._parts(record, Reading(), there) for record in records]

    def _balance(self, total: Squares | None) -> float:
        """Log likelihood of the mean pitching moment that the file leaves, by errors of its values, of the angles and
        of the moment at zero."""
        by = self._criteria
        if total is None or "Cm_0" not in self._aircraft.derivatives:
            return 0.0
        row = self._rows["Cm"]
        zero = self._aircraft.derivatives["Cm_0"]
        slopes = row.prior
        means = total.X[: len(row.prior)] / total.samples
        left = total.y / total.samples - zero - float(slopes @ means)
        angles = [by.angle * value for value, term in zip(slopes, row.terms, strict=True) if term in _ANGLES]
        spread = float(np.linalg.norm([by.balance, by.rough * zero, *by.rough * slopes * means, *angles]))
        return max(-0.5 * (left / spread) ** 2, by.impossible)

    def axial(self, records: Sequence[Read]) -> float:
        """Log marginal likelihood of the file's derivatives by what varies along the body x axis."""
        total = self._along(records)
        if total is None:
            return 0.0
        noise = float(np.sqrt(max(total.left, self._criteria.fair**2 * total.yy / total.samples)))
        values = self._along_x()
        row = Row(
            names=tuple(name for name, *_ in values),
            terms=tuple(term for _, term, *_ in values),
            prior=np.array([value for *_, value in values]),
            errors=(("curved", self._lift_slope()),),
            sizes=np.abs([value for *_, value in values]),
        )
        found = log_evidence(total, row, noise, self._criteria, self._criteria.fair)
        return found - total.samples * float(np.log(noise))  # of other axes by its own noise

    def left_along_x(self, records: Sequence[Read]) -> tuple[float, float]:
        """Return what the derivatives of the file leave of the force along the body x axis, and what varies of it: sums
        of squares."""
        total = self._along(records)
        if total is None:
            return 0.0, 0.0
        values = np.array([*(value for *_, value in self._along_x()), 0.0])
        return float(total.yy - 2.0 * values @ total.Xy + values @ total.XX @ values), total.yy

    def _along(self, records: Sequence[Read]) -> Squares | None:
        """The sums of all records along the body x axis."""
        sums = [one for one in map(self._axial, records) if one is not None]
        return reduce(add, sums) if sums else None

    def _lift_slope(self) -> float:
        """Size of what a force along x has by alpha^2, which files often lack: lift times the angle."""
        plane = self._aircraft
        return max(abs(_value(plane, c, f"{c}_alpha", "alpha")) for c in ("CL", "CZ"))

    def _along_x(self) -> list[tuple[str, str, str, float]]:
        """Name, term, coefficient and value of the derivatives that make a force along x."""
        plane = self._aircraft
        along = ("CL", "CD") if plane.force_axes == "wind" else ("CX",)
        listed = ((c, n, t, _value(plane, c, n, t)) for c, n, t in aerodynamic_parameters(plane))
        return [(n, t, c, v) for c, n, t, v in listed if c in along and v != 0.0 and not any(u in t for u in _UNSTEADY)]

    def _axial(self, c: Read) -> Squares | None:
        """Sums of a record, of the coefficient along x without thrust; None where it does not have it."""
        if not c.has("V", "rho", "ax", "thrust", "alpha"):
            return None
        plane = self._aircraft
        regressors = _regressors(c, plane, Reading(), self._criteria)
        alpha = c.value("alpha")
        values = self._along_x()
        turned = {"CL": np.sin(alpha), "CD": -np.cos(alpha), "CX": np.ones(len(alpha))}
        columns = [turned[k] * parse_term(t).evaluate(regressors) for _, t, k, _ in values]
        columns.append((alpha - alpha.mean()) ** 2)
        y = (plane.mass * c.made("ax", plane.mass) - c.value("thrust")) / _pressure_area(c, plane)
        every = max(1, round(len(alpha) / c.independent))
        entering = {n for _, t, *_ in values for n in parse_term(t).variables}
        return squares_of(y, np.stack(columns, axis=1), np.flatnonzero(c.known("V", "ax", "alpha", *entering))[::every])

    def opposite(self, records: Sequence[Read]) -> Iterator[tuple[str, float, float, float]]:
        """Derivatives by the motion whose sign the records contradict: name, value of the file, value with all
        derivatives free, and its 1-sigma."""
        parts = self._plain(records)
        for coefficient, noise in self._noise(parts).items():
            row = self._rows[coefficient]
            squares = together(parts, coefficient)
            known = np.append(np.zeros(len(row.prior)), [spread**-2 for _, spread in row.errors])
            covariance = np.linalg.pinv(squares.XX / noise**2 + np.diag(known), rcond=1e-12, hermitian=True)
            free = covariance @ squares.Xy / noise**2
            std = np.sqrt(np.diag(covariance))
            part = np.abs(free) * np.sqrt(np.diag(squares.XX) / squares.yy)
            std = np.hypot(std, self._by_vanes(row))
            for i, (name, term) in enumerate(zip(row.names, row.terms, strict=True)):
                sure = -free[i] * np.sign(row.prior[i]) > self._criteria.sure * std[i]
                if term in _MOTION and sure and part[i] > self._criteria.rough:
                    yield name, float(row.prior[i]), float(free[i]), float(std[i])

    def _by_vanes(self, row: Row) -> np.ndarray:
        """(columns,) what vanes away from the c.g., which sense rotation, add to the derivatives by rates."""
        by = self._criteria
        plane = self._aircraft
        slopes = dict(zip(row.terms, np.abs(row.prior), strict=True))
        pitch, yaw = (slopes.get(angle, 0.0) * by.usual_span for angle in ("alpha", "beta"))
        roll = max(slopes.get(angle, 0.0) for angle in ("alpha", "beta")) * by.fair * by.usual_span
        arms = {"q": pitch / plane.rate_length_pitch}
        arms |= {name: one / plane.rate_length_lateral for name, one in (("p", roll), ("r", yaw))}
        return np.array([arms.get(term, 0.0) for term in row.all_terms])

    def _in_records(self, plain: Sequence[Parts], other: Sequence[Parts], noise: Mapping[str, float]) -> list[float]:
        """Gain of other parts in the set of records that gains most, shared among them: all, or grown one by one."""
        base = self._evidence(plain, noise)

        def gain(chosen: Sequence[int]) -> float:
            return self._evidence([other[j] if j in chosen else plain[j] for j in range(count)], noise) - base

        count = len(plain)
        best = list(range(count))
        most = gain(range(count))
        grown: list[int] = []
        reached = 0.0
        for _ in range(count - 1):
            trials = {j: gain([*grown, j]) for j in range(count) if j not in grown}
            j = max(trials, key=lambda one: trials[one])
            if trials[j] <= reached:
                break
            grown = [*grown, j]
            reached = trials[j]
        if reached > most:
            best = grown
            most = reached
        return [most / len(best) if j in best else min(-most, 0.0) for j in range(count)]

    def _file_signs(self, plain: Sequence[Parts], noise: Mapping[str, float]) -> list[tuple[Alternative, list[float]]]:
        found = []
        for coefficient, sigma in noise.items():
            row = self._rows[coefficient]
            squares = together(plain, coefficient)
            base = log_evidence(squares, row, sigma, self._criteria)
            for i, (name, term) in enumerate(zip(row.names, row.terms, strict=True)):
                if term in SURFACES:
                    flipped = replace(row, prior=np.where(np.arange(len(row.prior)) == i, -row.prior, row.prior))
                    gain = log_evidence(squares, flipped, sigma, self._criteria) - base
                    gain = gain if squares.off(flipped.about) <= squares.off(row.about) else min(gain, 0.0)
                    alternative = Alternative(kind="file_sign", target=name, reading=Reading())
                    found.append((alternative, [gain / len(plain)] * len(plain)))
        return found

    def _parts(self, record: Read, reading: Reading, there: Collection[str]) -> dict[str, Squares]:
        """Coefficient -> sums over a record, of the coefficients that it can determine. What other records have and it
        has not must not enter there, nor any motion that is not measured: a rudder makes sideslip, and what that does
        would be taken for the rudder's."""
        if not record.has("V", "rho"):
            return {}
        regressors = _regressors(record, self._aircraft, reading, self._criteria)
        measured = _measured(record, self._aircraft)
        every = max(1, round(len(record.value("V")) / record.independent))
        found = {}
        for coefficient, row in self._rows.items():
            entering = {n for term in row.terms for n in parse_term(term).variables}
            if not record.has(*_NEEDED[coefficient], *(entering & {*there, *_MOTION})):
                continue
            at = np.flatnonzero(record.known("V", *_NEEDED[coefficient], *entering))[::every]
            if (sums := squares_of(measured[coefficient], row.columns(regressors), at)) is not None:
                found[coefficient] = sums
        return found

    def _noise(self, parts: Sequence[Parts]) -> dict[str, float]:
        """1-sigma of what is left with free derivatives."""
        known = {c for one in parts for c in one}
        sums = {c: together(parts, c) for c in known}
        return {c: float(np.sqrt(max(s.left, self._criteria.fair**2 * s.yy / s.samples))) for c, s in sums.items()}

    def _off(self, parts: Parts, noise: Mapping[str, float]) -> float:
        """Sum of squares that the values of the file leave of a record, in units of the noise."""
        return sum(s.off(self._rows[c].about) / noise[c] ** 2 for c, s in parts.items() if c in noise)

    def _evidence(self, parts: Sequence[Parts], noise: Mapping[str, float], minor: float = 0.0) -> float:
        return sum(
            log_evidence(together(parts, c), self._rows[c], sigma, self._criteria, minor) for c, sigma in noise.items()
        )


def _unexplained(c: Read, rows: Collection[str]) -> float:
    """Minus log likelihood of the forces along axes of which a file has no row, as they vary."""
    explained = {_FORCES.get(row, "az") for row in rows}
    found = 0.0
    for name in (name for name in FORCES if name not in explained and c.has(name)):
        values = c.value(name)[c.known(name)]
        if len(values) > 1:
            found += c.independent * float(np.log(max(float(np.std(values)), 1e-9)))
    return found


def _rows(aircraft: Aircraft, criteria: DataCriteria, stated: Aircraft) -> dict[str, Row]:
    """Coefficient -> its derivatives and terms in the file."""
    table: dict[str, list[tuple[str, str, float, float]]] = {}
    doubted = max(1.0, stated.relative_uncertainty / criteria.rough)  # a file that is worse than usual states it
    for coefficient, name, term in aerodynamic_parameters(aircraft):
        value, given = (_value(one, coefficient, name, term) for one in (aircraft, stated))
        size = max(abs(value), abs(given))
        if coefficient in _NEEDED and term != "0" and not any(u in term for u in _UNSTEADY) and size != 0.0:
            table.setdefault(coefficient, []).append((name, term, value, size))
    for name in missing_derivatives(stated):  # they may be as large as those of other aircraft are
        coefficient, term = derivative_term(name)
        if coefficient in table:
            table[coefficient].append((name, term.name, 0.0, USUAL_DERIVATIVES[name] / (doubted * criteria.rough)))
    return {
        coefficient: Row(
            names=tuple(name for name, *_ in rows),
            terms=tuple(term for _, term, *_ in rows),
            prior=np.array([value for _, _, value, _ in rows]),
            errors=tuple(_errors(coefficient, {term: value for _, term, value, _ in rows}, criteria)),
            sizes=doubted * np.array([size for *_, size in rows]),
        )
        for coefficient, rows in table.items()
    }


def _value(aircraft: Aircraft, coefficient: str, name: str, term: str) -> float:
    """A derivative or a term of a file, 0 where it has none."""
    return aircraft.derivatives.get(name, aircraft.terms.get(coefficient, {}).get(term, 0.0))


def _errors(coefficient: str, slopes: Mapping[str, float], criteria: DataCriteria) -> Iterator[tuple[str, float]]:
    """Yield the terms that healthy instruments add to a coefficient with these slopes, each with its spread."""
    for angle, other in _READ_TOO.items():
        if slopes.get(angle) and other not in slopes:
            yield other, criteria.fair * abs(slopes[angle])
    for surface in SURFACES:
        if slopes.get(surface):
            yield f"{surface} rate", criteria.late * abs(slopes[surface])
    if coefficient in _FORCE_ROWS:
        yield from ((f"{coefficient} lever {axis}", 1.0) for axis in "xyz")


def _pressure_area(c: Read, aircraft: Aircraft) -> np.ndarray:
    """(N,) dynamic pressure times area [N]."""
    return 0.5 * np.maximum(c.value("rho"), 1e-3) * np.maximum(c.value("V"), 1.0) ** 2 * aircraft.area


def _regressors(c: Read, aircraft: Aircraft, reading: Reading, criteria: DataCriteria) -> dict[str, np.ndarray]:
    V = np.maximum(c.value("V"), 1.0)
    surfaces = {s: reading.factor.get(s, 1.0) * c.value(reading.source.get(s, s)) for s in SURFACES}
    rates = {
        f"{s} rate": reading.factor.get(s, 1.0) * c.rate(source)
        for s in SURFACES
        if c.has(source := reading.source.get(s, s))
    }
    place = criteria.fair * aircraft.moment_length_lateral
    alpha = c.value("alpha")
    levers = place * c.levers() * aircraft.mass / _pressure_area(c, aircraft)
    across = {"CY": levers[:, 1], "CZ": levers[:, 2], "CL": np.sin(alpha) * levers[:, 0] - np.cos(alpha) * levers[:, 2]}
    found = {
        "alpha": alpha,
        "beta": c.value("beta"),
        "p": c.value("p") * aircraft.rate_length_lateral / V,
        "q": c.value("q") * aircraft.rate_length_pitch / V,
        "r": c.value("r") * aircraft.rate_length_lateral / V,
        **surfaces,
        **dict.fromkeys((f"{s} rate" for s in SURFACES), np.zeros(len(alpha))),
        **rates,
        **{
            f"{name} lever {axis}": each
            for name, three in across.items()
            for axis, each in zip("xyz", three, strict=True)
        },
        "mach": V / np.asarray(speed_of_sound(np.maximum(c.value("rho"), 1e-3)), dtype=float).reshape(-1),
        "Tc": c.value("thrust") / (0.5 * np.maximum(c.value("rho"), 1e-3) * V**2 * aircraft.area),
    }
    trimmed = aircraft.trim.get("V", float(V.mean()))
    return found | {"V": (V - trimmed) / trimmed}


def _measured(c: Read, aircraft: Aircraft) -> dict[str, np.ndarray]:
    """(N,) coefficients that the motion determines."""
    p, q, r = (c.value(name) for name in "pqr")
    pdot, qdot, rdot = (c.rate(name) if c.has(name) else np.zeros(len(p)) for name in "pqr")
    inertia = aircraft.inertia
    Ixx = inertia.Ixx
    Iyy = inertia.Iyy
    Izz = inertia.Izz
    Ixz = inertia.Ixz
    qS = _pressure_area(c, aircraft)
    roll = Ixx * pdot - Ixz * rdot + (Izz - Iyy) * q * r - Ixz * p * q
    pitch = Iyy * qdot + (Ixx - Izz) * p * r + Ixz * (p**2 - r**2)
    yaw = Izz * rdot - Ixz * pdot + (Iyy - Ixx) * p * q + Ixz * q * r
    if not inertia.symmetric:
        more = unsymmetric_moment({"Ixy": inertia.Ixy, "Iyz": inertia.Iyz}, (p, q, r), (pdot, qdot, rdot))
        roll = roll + more[0]
        pitch = pitch + more[1]
        yaw = yaw + more[2]
    alpha = c.value("alpha")
    m = aircraft.mass
    x, y, z = (m * c.made(name, m) / qS for name in FORCES)
    turned = c.pulled()[1]
    return {
        "Cl": (roll - turned[0]) / (qS * aircraft.moment_length_lateral),
        "Cm": (pitch - turned[1] - aircraft.thrust_line_z * c.value("thrust")) / (qS * aircraft.moment_length_pitch),
        "Cn": (yaw - turned[2]) / (qS * aircraft.moment_length_lateral),
        "CY": y,
        "CL": np.sin(alpha) * x - np.cos(alpha) * z,
        "CZ": z,
    }
