"""The alternatives compete: how much better does each explain what channels must have to do with each other?"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from operator import itemgetter

import numpy as np
import scipy

from casid.data_check.axes import frames
from casid.data_check.criteria import DataCriteria
from casid.data_check.file_meaning import (
    POINTS_APART,
    FileMeaning,
    ForceAxes,
    MomentPoint,
    StabilityAxes,
    other_meanings,
)
from casid.data_check.levels import level_terms, trimmed_density
from casid.data_check.reading import AS_RECORDED, FORCES, OF_THE_FILE, Read, Reading, Smooth, smooth
from casid.data_check.relations import RELATIONS, Relation, agreement
from casid.data_check.response import INSTRUMENTS, TIMES, Alternative, Response, accelerometer, alternatives
from casid.model.aircraft import Aircraft
from casid.model.causes.instruments import accelerometer_position
from casid.model.plausible import lift_in_trim, moment_in_trim
from casid.records.record import Record
from casid.signals import FLIGHT_LIMITS, GRAVITY, RADIAN_LIMITS, SURFACES

_TURNED = frozenset(("data_sign", "data_swap", "axes"))
INSTRUMENT_ERRORS = (accelerometer_position("x").kind,)
_FARTHEST = 3.0  # 1-sigmas of the place of an accelerometer

Term = Callable[[Read], float | None]
Gains = list[tuple[Alternative, list[float]]]  # of every alternative, in every record


@dataclass(frozen=True, eq=False, kw_only=True)
class Weighed:
    """An alternative that the data prefer."""

    alternative: Alternative
    records: tuple[str, ...]  # that have it
    log_odds: float  # posterior, against the records as given
    rivals: tuple[Alternative, ...]  # other explanations that these data cannot separate from it
    refused: bool = False  # whether another kind of fault concerns the same channel, so that neither is corrected

    @property
    def alone(self) -> bool:
        return not self.rivals


class Weighing:
    """Records under readings, and the gain of every alternative to them."""

    def __init__(
        self,
        records: Sequence[Record],
        aircraft: Aircraft | None,
        criteria: DataCriteria,
        as_read: frozenset[str] = frozenset(),
    ) -> None:
        """`as_read`: channels that are trusted as they were recorded."""
        self._believed = as_read
        self._criteria = criteria
        self._aircraft = aircraft
        self._gravity = aircraft.gravity if aircraft is not None else GRAVITY
        density = trimmed_density(aircraft) if aircraft is not None else None
        span = aircraft.moment_length_lateral if aircraft is not None else criteria.usual_span
        self._place = criteria.fair * span  # 1-sigma, along each axis
        self._quick = [smooth(record, criteria.quick, criteria, density) for record in records]
        self._slow = [smooth(record, criteria.slow, criteria, density) for record in records]
        self.names = [record.name for record in records]
        stated = [record.stated for record in records]
        self._stated = {n: one[n] for one in stated for n in one if all(other.get(n) == one[n] for other in stated)}
        self.readings: list[Reading] = [AS_RECORDED for _ in records]  # as the data prefer them
        self.trusted: list[Reading] = [AS_RECORDED for _ in records]  # with nothing that has a rival
        self.meanings: list[FileMeaning] = []  # of numbers of the file, when flight shows them
        self._terms = self._all_terms()
        self._present: dict[tuple[int, int], tuple[float, float]] = {}
        self._response = Response(aircraft, criteria) if aircraft is not None else None

    def _all_terms(self) -> list[tuple[frozenset[str], bool, Term]]:
        """(channels that enter, seen slowly, log likelihood)."""

        def of(relation: Relation) -> Term:
            def term(read: Read) -> float | None:
                found = agreement(relation, read, self._gravity, self._criteria)
                return found.log_likelihood if found is not None else None

            return term

        dynamic = [(frozenset((*r.uses, "t")), r.slow, of(r)) for r in RELATIONS]
        levels = level_terms(self._aircraft, self._gravity, self._criteria)
        # density comes from the altitude where it is not recorded itself
        wide = ((uses | {"altitude"} if "rho" in uses else uses, term) for uses, term in levels)
        return [*dynamic, *((uses, False, term) for uses, term in wide)]

    def _read(self, j: int, slow: bool, reading: Reading) -> Read:
        return Read((self._slow if slow else self._quick)[j], reading)

    def found(self) -> list[Weighed]:
        """The faults that the records show, most telling first, other axes before any channel; each is corrected before
        the next is sought. Where an error of an instrument, which a diagnosis corrects, explains the records better,
        the next fault is sought beside it."""
        found: list[Weighed] = []
        for _ in range(self._criteria.steps):
            gains = [self._gains(a) for a in self._outputs()]
            best = self._best(gains)
            if best is not None:
                gains += [self._gains(a) for a in self._frames() if a.target == "body"]
                best = self._best(gains)
            if best is not None and best.alternative.channels & {*FORCES, "V", "alpha", "beta"}:
                gains += [self._gains(a) for a in self._places()]
                best = _beside(self._best(self._by_the_file([*gains])), self._best(gains))
            if best is None:
                break
            told = self._or_else_the_record(best, INSTRUMENT_ERRORS)
            if told is not None:
                found.append(told)
            self._take(best)
        if self._response is not None:
            self._find_surfaces(found)
        return self._one_kind_each(found)

    def _one_kind_each(self, found: Sequence[Weighed]) -> list[Weighed]:
        """The faults, with those refused that would correct one channel of a record in more than one way, or that were
        found with another correction that is not made. A column that needs two corrections is more likely to be
        another thing, or records that were joined."""
        judged = [
            replace(one, refused=any(_clash(one, b) and (b.alone or j < i) for j, b in enumerate(found) if j != i))
            for i, one in enumerate(found)
        ]
        doubted = {name for one in judged if _of_motion(one) and (one.refused or not one.alone) for name in one.records}
        judged = [
            replace(one, refused=True) if not _of_motion(one) and doubted & {*one.records} else one for one in judged
        ]
        self.meanings = [] if doubted else self.meanings
        self.trusted = [AS_RECORDED for _ in self.names]
        for one in judged:
            for j, name in enumerate(self.names):
                if one.alone and not one.refused and name in one.records:
                    self.trusted[j] = self.trusted[j].then(one.alternative.reading)
        return judged

    def _find_surfaces(self, found: list[Weighed]) -> None:
        """Find faults of surfaces by the response, or else another unit of the file."""
        settled: set[str] = set()
        gains, (odds, meanings) = self._response_gains(), self._meanings()
        for _ in SURFACES:
            best = self._best([(a, g) for a, g in gains if not _surfaces_of(a) & settled])
            if best is None or (meanings and odds > best.log_odds):
                self.meanings = meanings
                return
            settled |= _surfaces_of(best.alternative)
            best = self._or_else_the_record(best, OF_THE_FILE)
            if best is not None:
                found.append(best)
                self._take(best)
                gains, (odds, meanings) = self._response_gains(), self._meanings()

    def _meanings(self) -> tuple[float, list[FileMeaning]]:
        """Other meanings of the file with which flight would agree, the most probable one first, with those that it
        cannot be separated from, and its log odds; none when the file is kept. Of several points of the moments the
        best one is returned, with the odds of them all."""
        if self._aircraft is None or self._response is None:
            return 0.0, []
        by = self._criteria
        reads = self._all_read(AS_RECORDED, ())
        as_it_stands = self._response.likelihood(reads)
        odds: dict[str, list[tuple[float, FileMeaning]]] = {}
        for meaning in other_meanings(self._aircraft, _mean_alpha(reads)):
            kind = meaning.said
            prior = by.fault
            if isinstance(meaning, MomentPoint):
                kind = meaning.parameter
                prior += float(scipy.stats.norm.logpdf(meaning.chords, scale=by.rough)) + math.log(POINTS_APART)
            gain = self._gain_of(meaning, self._aircraft, as_it_stands, reads)
            odds.setdefault(kind, []).append((gain + prior, meaning))
        each = [(float(np.logaddexp.reduce([o for o, _ in some])), some) for some in odds.values()]
        ranked = sorted(((together, max(some, key=itemgetter(0))[1]) for together, some in each), key=itemgetter(0))
        best, first = ranked[-1]
        if best < by.against or not self._agrees(first, self._aircraft, self._response, reads):
            return best, []
        return best, [one for o, one in reversed(ranked) if o > best - by.alone]

    def _agrees(self, meaning: FileMeaning, given: Aircraft, as_given: Response, reads: Sequence[Read]) -> bool:
        """Return True if another meaning of a file brings it most of the way to the records: a file that is wrong all
        over is less wrong in many a unit. Along other axes it leaves less than half of what the file as given leaves,
        and of what varies."""
        meant = Response(meaning.corrected(given), self._criteria)
        if isinstance(meaning, ForceAxes):
            (as_it_stands, varies), (left, _) = as_given.left_along_x(reads), meant.left_along_x(reads)
            return left < 0.5 * min(as_it_stands, varies)
        off, left = (one.likeliest(reads) - one.likelihood(reads) for one in (as_given, meant))
        return left < max(0.5 * off, self._criteria.said)

    def _gain_of(self, meaning: FileMeaning, given: Aircraft, as_it_stands: float, reads: Sequence[Read]) -> float:
        """Log likelihood ratio of another meaning of a file, whose likelihood `as_it_stands` is known: of its
        derivatives, its trim, and the moment that is left. Along other axes forces have another noise, and only what
        varies along x compares."""
        meant = meaning.corrected(given)
        gain = self._in_trim(meant) - self._in_trim(given)
        if isinstance(meaning, ForceAxes):
            axial, axial_as_given = (Response(one, self._criteria).axial(reads) for one in (meant, given))
            return gain + axial - axial_as_given
        turned = isinstance(meaning, (MomentPoint, StabilityAxes))
        response = Response(meant, self._criteria, given if turned else None)
        return gain + response.likelihood(reads) - as_it_stands

    def _in_trim(self, aircraft: Aircraft) -> float:
        """Log likelihood of lift and pitching moment in the trim of a file, where they are the weight and nothing."""
        ratio = lift_in_trim(aircraft)
        moment = moment_in_trim(aircraft)
        found = 0.0 if moment is None else -0.5 * (moment / self._criteria.balance) ** 2
        if ratio is not None and ratio <= 0.0:
            return self._criteria.impossible
        found -= 0.0 if ratio is None else 0.5 * (math.log(ratio) / self._criteria.fair) ** 2
        return max(found, self._criteria.impossible)

    def _or_else_the_record(self, best: Weighed, elsewhere: Collection[str]) -> Weighed | None:
        """Return the fault of the records that explains what an error of a kind from `elsewhere` explains; the error
        itself if its kind is not from there, and None where no fault does."""
        if best.alternative.kind not in elsewhere:
            return best
        faults = [one for one in best.rivals if one.kind not in elsewhere]
        if not faults:
            return None
        rivals = (best.alternative, *(one for one in best.rivals if one is not faults[0]))
        return replace(best, alternative=faults[0], rivals=rivals)

    def _take(self, best: Weighed) -> None:
        self._present.clear()
        for j, name in enumerate(self.names):
            if name in best.records:
                self.readings[j] = self.readings[j].then(best.alternative.reading)

    def _outputs(self) -> list[Alternative]:
        channels = {name for one in self._quick for name in one.values}
        earth = [a for a in self._frames() if a.target == "earth"]
        able = [*self._able(channels, self._stretched()), *earth]
        return [a for a in able if not a.channels & {*SURFACES, *self._believed}]

    def _able(self, channels: Collection[str], stretched: Sequence[float] = ()) -> list[Alternative]:
        """Alternatives for these channels, with values that an aircraft has. Where a unit is stated, that one alone may
        be wrong; any other as well where no aircraft has the values as they are read."""
        found = [a for a in alternatives(channels, stretched) if self._flies(a)]
        believed = {n: unit for n, unit in self._stated.items() if self._largest(n) <= _most(n)}
        return [a for a in found if all(a.possible(believed[n]) for n in a.reading.factor if n in believed)]

    def _largest(self, name: str) -> float:
        """The largest absolute value of a channel as recorded."""
        read = [one.values[name] for one in self._quick if name in one.values]
        return max((float(np.nanmax(np.abs(values), initial=0.0)) for values in read), default=0.0)

    def _flies(self, alternative: Alternative) -> bool:
        """Return True if no channel that becomes larger, or that is read in the place of another, leaves the limits of
        readers and models, and no record becomes shorter than what gravity and drag take to show."""
        longest = max((one.duration for one in self._quick), default=0.0)
        if alternative.reading.time * longest < self._criteria.slow <= longest:
            return False
        factor = alternative.reading.factor
        source = alternative.reading.source
        changed = {*source, *(name for name, by in factor.items() if abs(by) > 1.0)}
        return all(abs(factor.get(n, 1.0)) * self._largest(source.get(n, n)) <= _most(n) for n in changed)

    def _frames(self) -> list[Alternative]:
        """Other axes, as long as none were found."""
        channels = {name for one in self._quick for name in one.values}
        turned = any(reading.factor for reading in self.readings)
        return [] if turned else [a for a in frames(channels) if not a.channels & self._believed]

    def _by_the_file(self, gains: Gains) -> Gains:
        """The gains, of those that concern accelerometers also by the forces that the file predicts; these are shared
        among the records that have the fault."""
        if self._response is None:
            return gains
        able = [i for i, (a, g) in enumerate(gains) if _of_forces_alone(a) and self._total(a, g) > 0.0]
        for exchanged in (False, True):
            some = [i for i in able if bool({*gains[i][0].reading.source} & {*FORCES}) == exchanged]
            concerned = [self._concerned(*gains[i]) for i in some]
            other = [self._all_read(gains[i][0].reading, names) for i, names in zip(some, concerned, strict=True)]
            as_read, *said = self._response.of_forces([self._all_read(AS_RECORDED, ()), *other], exchanged)
            for i, names, one in zip(some, concerned, said, strict=True):
                more = (one - as_read) / max(len(names), 1)
                alternative, each = gains[i]
                gains[i] = alternative, [g + more * (n in names) for n, g in zip(self.names, each, strict=True)]
        return gains

    def _all_read(self, other: Reading, names: Collection[str]) -> list[Read]:
        """All records as they are read now, some of them with another reading."""
        pairs = zip(self.names, self.readings, strict=True)
        return [self._read(j, False, r.then(other) if n in names else r) for j, (n, r) in enumerate(pairs)]

    def _places(self) -> list[Alternative]:
        """The accelerometer away from the c.g. along each axis, by as much as explains the records best."""
        if not any(name in one for one in self._quick for name in FORCES):
            return []
        found = []
        for axis in "xyz":

            def off(sigmas: float, axis: str = axis) -> float:
                one = accelerometer(axis, sigmas * self._place)
                return -sum(self._gains(one)[1]) - self._prior(one)

            best = float(np.ravel(scipy.optimize.fminbound(off, -_FARTHEST, _FARTHEST, xtol=0.05))[0])
            found.append(accelerometer(axis, best * self._place))
        return found

    def _stretched(self) -> list[float]:
        """The factors on time that make rates of rotation equal to the gyros, of all records or of some; no units."""
        each = [self._stretches(j) for j in range(len(self.names))]
        found: list[float] = []
        near = self._criteria.fair
        for factors in (list(chain(*each)), *each):
            factor = self._agreed(factors)
            if factor is not None and all(abs(math.log(factor / other)) > near for other in found):
                found.append(factor)
        return [one for one in found if all(abs(math.log(one / unit)) > near for unit in TIMES.values())]

    def _stretches(self, j: int) -> list[float]:
        """Logarithm of the factor that every relation of rotation asks for in a record."""
        factors = []
        for relation in RELATIONS[:6]:
            read = self._read(j, relation.slow, self.readings[j])
            seen = agreement(relation, read, self._gravity, self._criteria)
            if seen is None or seen.both <= 0.0:
                continue
            if 1.0 - seen.both**2 / (seen.left * seen.right) < self._criteria.resolved:
                factors.append(0.5 * float(np.log(seen.left / seen.right)))
        return factors

    def _agreed(self, factors: Sequence[float]) -> float | None:
        """The factor that most relations agree on."""
        if len(factors) < 2:
            return None
        middle = float(np.median(factors))
        spread = float(np.median(np.abs(np.subtract(factors, np.median(factors)))))
        far = abs(middle) > np.log(self._criteria.own_scale)
        return float(np.exp(middle)) if far and spread < self._criteria.fair else None

    def _gains(self, alternative: Alternative) -> tuple[Alternative, list[float]]:
        """Log likelihood ratio of an alternative in every record."""
        concerned = [(i, slow, term) for i, (uses, slow, term) in enumerate(self._terms) if uses & alternative.channels]
        gains = []
        for j in range(len(self.names)):
            here = [(slow, term, *self._as_read(i, j)) for i, slow, term in concerned]
            gains.append(self._gain(j, alternative, here) if _there(self._quick[j], alternative) else 0.0)
        return alternative, gains

    def _as_read(self, i: int, j: int) -> tuple[float, float]:
        """Log likelihood of a term in a record as it is read now, and what any reading could add to it."""
        if (i, j) not in self._present:
            uses, slow, term = self._terms[i]
            read = self._read(j, slow, self.readings[j])
            now = term(read)
            most = -0.5 * read.independent * math.log(self._criteria.close) if i < len(RELATIONS) else 0.0
            self._present[i, j] = (0.0, 0.0) if now is None else (now, most - now)
        return self._present[i, j]

    def _gain(self, j: int, alternative: Alternative, terms: Sequence[tuple[bool, Term, float, float]]) -> float:
        """Log likelihood ratio in one record; of a hopeless alternative, a bound of it."""
        other = self.readings[j].then(alternative.reading)
        gain = 0.0
        hope = sum(room for *_, room in terms)
        for slow, term, now, room in terms:
            hope -= room
            gain += (term(self._read(j, slow, other)) or 0.0) - now
            if gain + hope < -self._criteria.against:
                return gain + hope
        return gain

    def _response_gains(self) -> list[tuple[Alternative, list[float]]]:
        assert self._response is not None
        reads = self._all_read(AS_RECORDED, ())
        channels = {name for one in self._quick for name in one.values}
        able = [a for a in self._able(channels) if a.channels and a.channels <= {*SURFACES} - self._believed]
        able = [a for a in able if self._are_deflections(a)]
        return self._response.gains(reads, able)

    def _are_deflections(self, alternative: Alternative) -> bool:
        """Return True if every surface that moves still deflects enough to excite something, as it is read then."""
        for name, factor in alternative.reading.factor.items():
            ranges = [np.ptp(self._quick[j].values[name]) for j in range(len(self.names)) if name in self._quick[j]]
            moved = abs(factor) * max(ranges, default=0.0)
            if 0.0 < moved <= self._criteria.smallest_deflection:
                return False
        return True

    def _best(self, gains: Sequence[tuple[Alternative, list[float]]]) -> Weighed | None:
        """The alternative with the largest posterior odds, in the records that do not contradict it."""
        scored = sorted(
            (
                (self._total(a, per_record) + self._prior(a), a, self._concerned(a, per_record))
                for a, per_record in gains
            ),
            key=lambda row: -row[0],
        )
        if not scored or scored[0][0] + self._criteria.fault < self._criteria.said:
            return None
        top, alternative, records = scored[0]
        near = self._criteria.fair
        rivals = tuple(
            a for total, a, _ in scored[1:] if total > top - self._criteria.alone and not _same(a, alternative, near)
        )
        return Weighed(alternative=alternative, records=records, log_odds=top + self._criteria.fault, rivals=rivals)

    def _prior(self, alternative: Alternative) -> float:
        """Log prior odds beside those of any fault: one axis of an instrument is rarely in a unit of its own, and
        accelerometers are mounted where there is room."""
        if alternative.kind in INSTRUMENT_ERRORS:
            return -self._criteria.fault - 0.5 * float(np.sum(np.square(alternative.reading.place))) / self._place**2
        if alternative.kind == "data_gravity":
            return self._criteria.fault
        names = alternative.reading.factor.keys()
        group = next((members for members in INSTRUMENTS if names < set(members)), ())
        there = {name for record in self._quick for name in group if name in record}
        return self._criteria.fault if alternative.kind == "data_unit" and len(there) > len(names) else 0.0

    def _total(self, alternative: Alternative, gains: Sequence[float]) -> float:
        """Gain in all records, or in some of them, of which there are many choices. An instrument stays in place."""
        if alternative.kind in INSTRUMENT_ERRORS or min(gains) > -self._criteria.against:
            return sum(gains)
        return sum(g for g in gains if g > 0.0) - math.log(max(2.0 ** len(gains) - 2.0, 1.0))

    def _concerned(self, alternative: Alternative, gains: Sequence[float]) -> tuple[str, ...]:
        everywhere = alternative.kind in INSTRUMENT_ERRORS or min(gains) > -self._criteria.against
        return tuple(n for n, g in zip(self.names, gains, strict=True) if everywhere or g > self._criteria.against)


def _beside(best: Weighed | None, by_motion: Weighed | None) -> Weighed | None:
    """The best alternative, with the error of an instrument that physics without aerodynamics puts first among its
    rivals: derivatives of a file are known too poorly to settle that. Where other records are well, these know them."""
    if best is None or by_motion is None or by_motion.alternative.kind not in INSTRUMENT_ERRORS:
        return best
    if best.records != by_motion.records:
        return best
    first = by_motion.alternative
    told = best.alternative == first or first in best.rivals
    return best if told else replace(best, rivals=(*best.rivals, first))


def _mean_alpha(reads: Sequence[Read]) -> float:
    """Mean angle of attack [rad] of all records; 0 where none has it."""
    means = [float(np.mean(c.value("alpha")[at])) for c in reads if c.has("alpha") and (at := c.known("alpha")).any()]
    return float(np.mean(means)) if means else 0.0


def _of_forces_alone(alternative: Alternative) -> bool:
    """Return True if it reads accelerations otherwise, by as much: their likelihoods compare."""
    sizes = {abs(factor) for factor in alternative.reading.factor.values()}
    return bool(alternative.channels & {*FORCES}) and sizes <= {1.0}


def _of_motion(one: Weighed) -> bool:
    """Return True if a fault concerns the motion, and not surfaces or the file alone."""
    return bool(one.alternative.channels - {*SURFACES})


def _clash(one: Weighed, other: Weighed) -> bool:
    """Return True if two faults of different kinds concern one channel of a record, or two turn or exchange channels of
    the motion: that is other axes, which are not corrected channel by channel."""
    a = one.alternative
    b = other.alternative
    if not set(one.records) & set(other.records):
        return False
    turned = {a.kind, b.kind} <= _TURNED and _of_motion(one) and _of_motion(other)
    return turned or bool(a.channels & b.channels) and a.kind != b.kind


def _surfaces_of(alternative: Alternative) -> set[str]:
    """Surfaces that an alternative concerns, be it of the records or of the file."""
    if alternative.kind in OF_THE_FILE:
        return {surface for surface in SURFACES if alternative.target.endswith(surface)}
    return set(alternative.channels)


def _most(name: str) -> float:
    """The largest value of a channel that an aircraft has; infinite of others."""
    return RADIAN_LIMITS.get(name, FLIGHT_LIMITS.get(name, np.inf))


def _there(record: Smooth, alternative: Alternative) -> bool:
    return all(name in record for name in alternative.reading.channels)


def _same(one: Alternative, other: Alternative, near: float) -> bool:
    """Return True if two alternatives read the same channels by factors whose logarithms are `near`."""
    if one.kind != other.kind or one.reading.source or other.reading.source:
        return False
    a = one.reading.factor
    b = other.reading.factor
    if one.reading.time != 1.0 or other.reading.time != 1.0:
        return abs(np.log(one.reading.time / other.reading.time)) < near
    return a.keys() == b.keys() and all(a[n] * b[n] > 0.0 and abs(np.log(a[n] / b[n])) < near for n in a)


def described(alternative: Alternative) -> str:
    """An alternative in a few words."""
    if alternative.kind == "data_swap":
        return f"{alternative.target.replace('+', ' and ')} interchanged"
    if alternative.kind in OF_THE_FILE:
        return f"{alternative.target} of the aircraft file has the wrong sign"
    if alternative.kind == "data_sign":
        return f"{alternative.target} reversed"
    if alternative.kind == "data_gravity":
        return f"{alternative.target} without gravity"
    if alternative.kind == "axes":
        return f"{alternative.target} axes {alternative.term}"
    if alternative.kind in INSTRUMENT_ERRORS:
        return f"the accelerometer {alternative.value:.2g} m from the c.g. along {alternative.target}"
    return f"{alternative.target.replace('+', ', ')} in {alternative.unit or 'another unit'}"


def with_readings(record: Record, reading: Reading) -> Record:
    """The record as a reading takes it."""
    if reading == AS_RECORDED:
        return record
    changed = {
        name: reading.of(name, record[reading.source.get(name, name)])
        for name in reading.channels
        if reading.source.get(name, name) in record
    }
    if not reading.gravity:
        phi, theta = (changed.get(name, record[name]) for name in ("phi", "theta"))
        changed = {name: reading.felt(name, values, phi, theta) for name, values in changed.items()}
    t = record.t * reading.time if reading.time != 1.0 else record.t
    return replace(record.with_channels(**changed), t=t)
