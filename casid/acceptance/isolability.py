"""Isolability before flight: which causes a manoeuvre and its channels can detect and separate.

The aircraft file flies the manoeuvre from level flight. Every cause of the catalogue has a response m there, whitened
by the noise of the channels, from which all that fitted derivatives, offsets and initial states can imitate is
projected off. A cause of size s shows as a normal variable of mean a = s |m| and variance 1.

Fitted in the place of a cause, another one whose response makes an angle of cosine r explains more than the true one
with the probability Phi(u) Phi(-v) + Phi(-u) Phi(v), u = a sqrt((1 + r) / 2), v = a sqrt((1 - r) / 2): the two drops of
the deviance are squares of correlated normal variables, whose difference is a product of independent ones. For causes
that look the same, r = 1, it is one half.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from pathlib import Path
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np
from scipy.special import ndtr, ndtri

from casid.above import ask_above
from casid.acceptance.rehearsal import Rehearsal, further_manoeuvres, rehearsed
from casid.arguments import names, numbers_by_name, require
from casid.design.level_flight import TYPICAL_NOISE
from casid.diagnosis.criteria import Criteria
from casid.diagnosis.evidence.detectable import sigmas_shown
from casid.diagnosis.evidence.evidence import weigh
from casid.diagnosis.evidence.fingerprints import responses
from casid.diagnosis.evidence.size import meaningful_share
from casid.diagnosis.flight.evaluation import FlightFit, scaled_inverse
from casid.diagnosis.flight.fit import fit
from casid.diagnosis.flight.flight import prepare
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.flight.subject import Subject
from casid.errors import InputError, check_known, unknown
from casid.frames import brief
from casid.keeping import plain
from casid.model.aircraft import Aircraft, given_aircraft
from casid.model.dynamics import aircraft_model
from casid.model.effect import Effect
from casid.model.flown_records import axes_of
from casid.native.threads import single_threaded
from casid.records.given import given_records
from casid.records.record import Record
from casid.signals import SURFACES

_POWER = 0.9  # of the smallest size that is stated
_ALIKE = 0.05  # probability of confusion from which two causes are one set
# of the aerodynamic terms that a file may lack, those that are looked at unless others are asked for
_TERMS = ("CL:alpha^2", "CD:alpha^2", "CX:alpha^2", "CZ:alpha^2", "Cm:alpha^2", "C[Yln]:alpha[*]beta")
_DEFAULT = tuple(f"aero_term({term})" for term in _TERMS)
_Row = tuple[Effect, Mapping[str, float], float | None]  # an effect, its values, and its onset


@dataclass(frozen=True, kw_only=True)
class IsolableCause:
    """Size from which a manoeuvre detects a cause, and the causes that it is confused with."""

    in_json: ClassVar[str] = "matters smallest unit detection told confusion"

    name: str  # as in tables, `actuator_lag(delta_e)`
    unit: str
    matters: float  # smallest size that matters to an engineer, in `unit`
    smallest: float  # smallest size that is detected with a probability of 90 %; infinite where derivatives imitate it
    detection: float  # probability that it is detected at the size that matters
    # rival -> probability that it explains the data better than this cause, which is there at the size that matters; of
    # the rivals above 1 %, the most alike first
    confusion: Mapping[str, float]

    @property
    def told(self) -> float:
        """Probability that it is detected at the size that matters and not taken for the rival most like it."""
        return self.detection * (1.0 - max(self.confusion.values(), default=0.0))


@dataclass(frozen=True, kw_only=True)
class Addition:
    """A further channel or manoeuvre, and the mean probability with which a cause would be rightly named with it."""

    kind: str
    what: str
    told: float


@dataclass(frozen=True, eq=False, kw_only=True)
class Isolability:
    """Result of `isolability`: which causes some manoeuvres can detect and separate.

    Attributes
    ----------
    causes
        Name -> IsolableCause.
    confusion
        (causes, causes) probability that the cause of the column is taken for that of the row; the diagonal is zero.
    channels
        Measured channel -> 1-sigma of its noise.
    additions
        Further channels and manoeuvres, the one that would add most first.
    left_out
        Causes that are not judged: they have no size to judge by, or the manoeuvre does not excite them.

    Examples
    --------
    >>> import casid as cs
    >>> demo = "casid/cli/demo/"
    >>> found = cs.isolability(demo + "aircraft.toml", [demo + "m1.csv"], causes=["actuator_lag(*)"], suggest=False)
    >>> found.confusion.shape == (len(found.causes), len(found.causes))
    True
    """

    aircraft: str
    manoeuvres: tuple[str, ...]
    channels: Mapping[str, float]
    causes: Mapping[str, IsolableCause]
    confusion: np.ndarray
    additions: tuple[Addition, ...]
    left_out: tuple[str, ...]

    __repr__ = brief

    @property
    def told(self) -> float:
        """Mean over the causes of the probability that one is rightly named at the size that matters."""
        return float(np.mean([one.told for one in self.causes.values()]))

    @property
    def sets(self) -> list[tuple[str, ...]]:
        """Causes that are detected at the size that matters more often than not, in sets that are confused with a
        probability of 5 % or more."""
        seen = [name for name, one in self.causes.items() if one.detection > 0.5]
        found: list[set[str]] = []
        for name in seen:
            own = {name, *(r for r, p in self.causes[name].confusion.items() if p >= _ALIKE and r in seen)}
            apart = [one for one in found if not one & own]
            found = [*apart, set.union(own, *(one for one in found if one & own))]
        return [tuple(name for name in seen if name in one) for one in found]

    def plot(self) -> Any:
        """The matrix of confusion, a matplotlib figure."""
        return ask_above("Isolability.plot", self)

    def __str__(self) -> str:
        return ask_above("Isolability.__str__", self)

    def to_dict(self) -> dict[str, Any]:
        """The content of isolability.json; an infinite size is None."""
        told = plain(self, "aircraft manoeuvres channels told causes sets additions left_out")
        return {"schema": "casid.isolability/1", **told}


@single_threaded()
def isolability(
    aircraft: Aircraft | str | Path,
    manoeuvres: Sequence[Record | str | Path],
    *,
    channels: Iterable[str] | None = None,
    noise: Mapping[str, float] = MappingProxyType({}),
    causes: Iterable[str | Effect] | str | None = None,
    suggest: bool = True,
    criteria: Criteria | None = None,
) -> Isolability:
    """Predict which causes manoeuvres and channels can detect and separate, before they are flown.

    The aircraft flies every manoeuvre from level flight at the [trim] of its file; of the records the times, the
    surfaces and the thrust are taken, as changes from their first samples.

    Parameters
    ----------
    aircraft
        The aircraft, or the name of its file.
    manoeuvres
        Records of the inputs, or names of files.
    channels
        What is measured; by default V, flow angles, rates, attitude and specific forces.
    noise
        Channel -> 1-sigma (SI); by default that of the file, and ordinary flight-test instruments where it gives none.
    causes
        Globs of names, like ``"sensor_*"`` or ``"aero_term(Cm:*)"``, or own effects. By default all of the catalogue
        but the aerodynamic terms, of which only the lowest are taken.
    suggest
        Also look for the channel and the manoeuvre that would add most.
    criteria
        By which a diagnosis decides what it sees and what matters.

    Returns
    -------
    Isolability
        Detection and confusion of every cause, and the channels and manoeuvres that would help.

    Raises
    ------
    InputError
        For an unknown channel, a file without trim, causes that are none, and a manoeuvre that cannot be flown.

    Examples
    --------
    >>> import casid as cs
    >>> demo = "casid/cli/demo/"
    >>> found = cs.isolability(demo + "aircraft.toml", [demo + "m1.csv"], causes=["actuator_lag(*)"], suggest=False)
    >>> found.causes["actuator_lag(delta_e)"].detection > 0.99
    True
    """
    file = given_aircraft(aircraft, "isolability")
    records = given_records(manoeuvres, "isolability")
    criteria = require(criteria or Criteria(), Criteria, "isolability: criteria", "Criteria(...)")
    if not records:
        raise InputError("isolability: no manoeuvre is given; expected records of the surfaces")
    axes = axes_of(records)
    sigma = _noise(file, axes, channels, numbers_by_name(noise, "isolability: noise"))
    flown = rehearsed(file, records, axes)
    flight = _flight(flown, sigma, criteria)
    effects, left_out = _wanted(flight, causes)
    # an input is as noisy in a further manoeuvre as it is found to be in the given ones
    of_inputs = {name.removeprefix("d_"): s for name, s in flight.noise().inputs.items()}
    flown = replace(flown, aircraft=replace(flown.aircraft, noise={**flown.aircraft.noise, **of_inputs}))
    found = _judged(flown, sigma, effects, criteria)
    if not found.causes:
        raise InputError("isolability: none of the causes has a size that matters here; ask for others with causes")
    additions = _additions(flown, sigma, effects, criteria) if suggest else ()
    by_use = tuple(sorted(additions, key=lambda one: -one.told))
    return replace(found, additions=by_use, left_out=(*left_out, *found.left_out))


def confusion(a: np.ndarray, cosine: np.ndarray) -> np.ndarray:
    """Probability that a cause which shows by `a` 1-sigmas is explained better by one whose response makes an angle of
    that cosine with its own."""
    size = np.abs(cosine)
    u, v = (a * np.sqrt(np.maximum(0.5 * (1.0 + sign * size), 0.0)) for sign in (1.0, -1.0))
    return ndtr(u) * ndtr(-v) + ndtr(-u) * ndtr(v)


def _noise(
    aircraft: Aircraft, axes: str, channels: Iterable[str] | None, stated: Mapping[str, float]
) -> dict[str, float]:
    """Measured channel -> 1-sigma."""
    valid = aircraft_model(aircraft, axes=axes, effects=()).outputs
    chosen = [name for name in TYPICAL_NOISE if name in valid] if channels is None else names(channels, "channels")
    check_known("channel", stated, valid, "isolability: noise")
    sigma = {}
    for name in chosen:
        check_known("channel", (name,), valid, "isolability")
        found = stated.get(name) or aircraft.noise.get(name) or TYPICAL_NOISE.get(name)
        if not found:
            raise InputError(f"isolability: nothing is known of the noise of {name}; give noise={{'{name}': ...}}")
        sigma[name] = float(found)
    return sigma


def _flight(flown: Rehearsal, sigma: Mapping[str, float], criteria: Criteria) -> Subject:
    """The rehearsed records as a flight with these channels alone."""
    records = [record.without(*(name for name in flown.outputs if name not in sigma)) for record in flown.records]
    of_inputs = {name: s for name, s in flown.aircraft.noise.items() if name in (*SURFACES, "thrust")}
    aircraft = replace(flown.aircraft, noise=of_inputs | dict(sigma))
    return replace(prepare(aircraft, records, criteria, flown.axes), doubted=())


def _wanted(flight: Subject, causes: Iterable[str | Effect] | str | None) -> tuple[list[Effect], tuple[str, ...]]:
    """Effects to be judged, and names of those of the catalogue without a size to judge by."""
    every = flight.effects
    if causes is None:
        chosen = [e for e in every if e.regressor is None or any(fnmatchcase(e.name, g) for g in _DEFAULT)]
    else:
        chosen: list[Effect] = []
        for one in [causes] if isinstance(causes, str) else causes:
            require(one, (str, Effect), "isolability: one of the causes", "'sensor_*' or an Effect")
            glob = str(one).replace("[", "[[]")
            found = [one] if isinstance(one, Effect) else [e for e in every if fnmatchcase(e.name, glob)]
            if not found:
                raise unknown("cause", str(one), [e.name for e in every], "isolability: causes")
            chosen += [e for e in found if e.name not in {c.name for c in chosen}]
    sized = [e for e in chosen if not e.members and (e.linear or e.smallest_that_matters(flight.aircraft))]
    return sized, tuple(e.name for e in chosen if e not in sized)


def _fitted(flown: Rehearsal, sigma: Mapping[str, float], criteria: Criteria) -> FlightFit:
    """The file as it is, along the rehearsed motion: that of a fit of all channels, and not the one that few of them
    determine (an airspeed and an angle of attack do not determine the sideslip by which the side force is
    linearised)."""
    every = {name: s for name in flown.outputs if (s := flown.aircraft.noise.get(name) or TYPICAL_NOISE.get(name))}
    whole = _flight(flown, {**every, **sigma}, criteria)
    moving = fit(whole, [], whole.noise())
    if set(every) <= set(sigma):
        return moving
    flight = _flight(flown, sigma, criteria)
    return fit(flight, [], flight.noise(), replace(moving, flight=flight), anew=True)


def _judged(flown: Rehearsal, sigma: Mapping[str, float], effects: Sequence[Effect], criteria: Criteria) -> Isolability:
    """The effects at the sizes that matter, in a flight of the file as it is."""
    return _Shown.of(_fitted(flown, sigma, criteria), effects).judged(range(len(flown.records)))


@dataclass(frozen=True, eq=False, kw_only=True)
class _Shown:
    """Responses to causes in each of R records of a fit. In a part of the records they are sums, for which no record
    is flown again."""

    fitted: FlightFit
    rows: tuple[_Row, ...]
    grams: np.ndarray  # (R, n, n) products of the whitened responses
    cross: np.ndarray  # (R, k, n) their products with the sensitivities to the fitted parameters

    @classmethod
    def of(cls, fitted: FlightFit, effects: Sequence[Effect]) -> _Shown:
        evidence = weigh(fitted, discrepancy=False)
        rows = tuple(_row(fitted, effect) for effect in effects)
        grams = []
        cross = []
        for r in range(len(fitted.batch.names)):  # one at a time: the responses to all causes are large
            own = replace(evidence, fit=fitted.of_records(slice(r, r + 1)))
            white = responses(own, rows)
            flat = white.reshape(-1, len(rows))
            grams.append(flat.T @ flat)
            cross.append(own.products(white)[0])
        return cls(fitted=fitted, rows=rows, grams=np.stack(grams), cross=np.stack(cross))

    def judged(self, records: Sequence[int]) -> Isolability:
        """The effects in some of the records, at the sizes that matter there."""
        some = list(records)
        sums = weigh(self.fitted, discrepancy=False).sums
        of_some = self.fitted if len(some) == len(self.grams) else self.fitted.of_records(some)
        sizes = np.array([_size(of_some, row) for row in self.rows])
        sized = np.flatnonzero(np.isfinite(sizes) & (sizes > 0.0))
        gram, cross = (each[some].sum(axis=0)[..., sized] for each in (self.grams, self.cross))
        gram = gram[sized]
        kinds = [self.rows[i][0] for i in sized]
        covariance = scaled_inverse(sums.grams[some].sum(axis=0) + np.diag(self.fitted.prior_weight))
        left = gram - cross.T @ covariance @ cross
        length = sigmas_shown(np.diag(left), np.diag(gram), self.fitted.criteria)
        inverse = np.divide(1.0, length, out=np.zeros_like(length), where=length > 0.0)
        # the response of an effect that is not linear is that to the whole of it
        shows = length * np.where([e.linear for e in kinds], sizes[sized], 1.0)
        table = confusion(shows[:, None], np.clip(left * inverse[:, None] * inverse, -1.0, 1.0))
        table[:, shows == 0.0] = 0.0  # what does not show at all explains nothing
        np.fill_diagonal(table, 0.0)
        flight = self.fitted.flight
        return Isolability(
            aircraft=flight.aircraft.name,
            manoeuvres=tuple(flight.records[r].name for r in some),
            channels={name: flight.aircraft.noise[name] for name in flight.outputs},
            causes={e.name: self._cause(i, kinds, sizes[sized], shows, table) for i, e in enumerate(kinds)},
            confusion=table,
            additions=(),
            left_out=tuple(row[0].name for i, row in enumerate(self.rows) if i not in sized),
        )

    def _cause(
        self, i: int, kinds: Sequence[Effect], matters: np.ndarray, shows: np.ndarray, table: np.ndarray
    ) -> IsolableCause:
        """One of the causes: (n,) sizes that matter, 1-sigmas that they show by then, and (n, n) their confusion."""
        enough = self.fitted.criteria.significance.detectable
        rivals = {kinds[j].name: float(table[i, j]) for j in np.argsort(-table[i], kind="stable")}
        return IsolableCause(
            name=kinds[i].name,
            unit=kinds[i].unit,
            matters=float(matters[i]),
            smallest=float(matters[i] * enough / shows[i]) if shows[i] > 0.0 else float("inf"),
            detection=float(ndtr(shows[i] - (enough - ndtri(_POWER)))),
            confusion={rival: p for rival, p in rivals.items() if p > 0.01},
        )


def _row(fitted: FlightFit, effect: Effect) -> _Row:
    """The effect with typical further values, an event in the middle of every record."""
    onset = 0.5 * min(record.duration for record in fitted.flight.records) if effect.timed else None
    values = dict(effect.further.grid[len(effect.further.grid) // 2]) if effect.further.grid else {}
    if not effect.linear:
        values["value"] = float(fitted.flight.smallest_that_matters(effect) or 0.0)
    return effect, values, onset


def _size(fitted: FlightFit, row: _Row) -> float:
    """The size that matters: the effect's own, or that of a share of what varies along a fit."""
    effect, values, onset = row
    smallest = fitted.flight.smallest_that_matters(effect)
    if effect.linear and not smallest:
        onsets = {r.name: r.t[0] + (onset or 0.0) for r in fitted.flight.records} if effect.timed else {}
        share = meaningful_share(fitted, Attached(effect=effect, values={**values, "value": 1.0}, onsets=onsets))
        return 1.0 / share if share > 0.0 else np.inf
    return float(smallest or 0.0)


def _additions(
    flown: Rehearsal, sigma: Mapping[str, float], effects: Sequence[Effect], criteria: Criteria
) -> Iterator[Addition]:
    """Further channels and manoeuvres, with what they add."""
    for name in flown.outputs:
        more = flown.aircraft.noise.get(name) or TYPICAL_NOISE.get(name)
        if name not in sigma and more:
            judged = _judged(flown, {**sigma, name: more}, effects, criteria)
            yield Addition(kind="channel", what=name, told=judged.told)
    if further := further_manoeuvres(flown):  # all flown at once, each of them judged beside the given ones
        given = range(len(flown.records))
        records = (*flown.records, *further)
        shown = _Shown.of(_fitted(replace(flown, records=records), sigma, criteria), effects)
        for i, one in enumerate(further, len(given)):
            yield Addition(kind="manoeuvre", what=one.name, told=shown.judged([*given, i]).told)
