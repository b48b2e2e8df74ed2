"""Scope of a diagnosis: the axes and channels that the records support, and what is therefore not judged."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import casadi as ca
import numpy as np

from casid.data_check.criteria import DataCriteria
from casid.diagnosis.criteria import Criteria, PartCriteria
from casid.diagnosis.flight.flight import prepare, resting
from casid.diagnosis.flight.subject import Subject
from casid.diagnosis.given.contradicted import Contradiction, FlightValue, contradicted
from casid.diagnosis.given.factors import Factor, borne_out, common_factors
from casid.diagnosis.kinematics.kinematics import NEEDED
from casid.errors import InputError, unknown
from casid.model.aircraft import Aircraft
from casid.model.dynamics import MOVING, aircraft_model, flight_inputs, has_aerodynamics, moved_coefficients
from casid.model.flown_records import axes_of
from casid.model.linearised import given_slopes
from casid.model.measured_force import force_inputs
from casid.model.plausible import Doubt
from casid.model.system import Model
from casid.model.terms import derivative_term
from casid.model.vocabulary import effect_title
from casid.records.record import Record

# what a person looks for: angular accelerations and altitude are extras
_EXPECTED: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "full": ("V", "alpha", "beta", "p", "q", "r", "phi", "theta", "psi", "ax", "ay", "az"),
        "longitudinal": ("V", "alpha", "q", "theta", "ax", "az"),
        "lateral": ("beta", "p", "r", "phi", "psi", "ay"),
    }
)
_WIND: Mapping[str, str] = MappingProxyType({"V": "x", "alpha": "z", "beta": "y"})


@dataclass(frozen=True, kw_only=True)
class NotJudged:
    """Something that was not judged, `what`, and `because` of which missing channel, surface or excitation."""

    what: str
    because: str


def _varies(series: np.ndarray) -> bool:
    return np.unique(series[np.isfinite(series)]).size > 1


def left_open(flight: Subject, given: Sequence[Record], values: Mapping[str, FlightValue]) -> Iterator[NotJudged]:
    """List what stays open in the axes of a flight: instruments, moving air, and numbers of the file.

    given    the records as they were read
    values   value in flight of every number of the file
    """
    absent = [name for name in _EXPECTED[flight.axes] if not any(name in record for record in given)]
    unused = [name for name in _EXPECTED[flight.axes] if name not in (*flight.outputs, *absent)]
    rare = [name for name in unused if any(_varies(r[name]) for r in given if name in r)]
    constant = [name for name in unused if name not in rare]
    reasons = (absent, "no channel {}"), (constant, "{} does not move"), (rare, "{} is read too rarely")
    for names, reason in reasons:
        if names:
            because = reason.format(_all_of(names))
            air = "".join(f", moving air along {_WIND[name]}" for name in names if name in _WIND)
            yield NotJudged(what=f"the instruments of {_all_of(names)}{air}", because=because)
    needed = [name for name in NEEDED[flight.axes] if name not in flight.outputs]
    if needed:
        yield NotJudged(what="instruments by kinematics alone", because=f"they take {_all_of(needed)} too")
    for surface in resting(flight.records):
        if any(surface in record for record in given):
            yield NotJudged(what=f"derivatives by {surface}", because=f"{surface} stands still")
    undetermined = [name for name in flight.aircraft.derivatives if name in values and not values[name].determined]
    if undetermined:
        yield NotJudged(
            what=", ".join(undetermined),
            because="not identifiable: these records determine them less well than the file",
        )


def out_of_sight(flight: Subject, detectable: Mapping[str, float]) -> Iterator[NotJudged]:
    """List what the fitted records cannot show: instrument and thrust faults whose smallest `detectable` size exceeds
    the largest plausible one, and channels whose noise could not be measured."""
    beyond = [
        effect_title(*effect.key)
        for effect in flight.effects
        if (effect.of_an_instrument or effect.station == "surface")
        and detectable.get(effect.name, 0.0) > effect.size.limit
    ]
    if beyond:
        yield NotJudged(what=_all_of(beyond), because="not identifiable: the derivatives absorb any plausible size")
    if flight.noise_by_fit:
        because = "their noise cannot be measured, so their residuals count as noise"
        yield NotJudged(what=f"anything smaller than the residuals of {_all_of(flight.doubted)}", because=because)


def of_other_records(aircraft: Aircraft, records: Sequence[str]) -> Iterator[NotJudged]:
    """Effects of a file that belong to records of other names than these."""
    for effect in aircraft.effects:
        named = effect.records or tuple(effect.onset_s or ())
        if named and not set(named) & set(records):
            title = f"{effect.kind}({effect.target}) of the file" if effect.target else f"{effect.kind} of the file"
            yield NotJudged(what=title, because=f"it belongs to {_all_of(named)}, and no record has this name")


def _all_of(names: Sequence[str]) -> str:
    return f"{', '.join(names[:-1])} and {names[-1]}" if len(names) > 1 else "".join(names)


_SURFACES: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {"longitudinal": ("delta_e",), "lateral": ("delta_a", "delta_r")}
)
_FLOW_ANGLE: Mapping[str, str] = MappingProxyType({"longitudinal": "alpha", "lateral": "beta"})
_RATES: Mapping[str, tuple[str, ...]] = MappingProxyType({"longitudinal": ("q",), "lateral": ("p", "r")})
_OTHER: Mapping[str, str] = MappingProxyType({"longitudinal": "lateral", "lateral": "longitudinal"})


@dataclass(frozen=True, kw_only=True)
class Axes:
    """The scope, "full", "longitudinal" or "lateral", and what it leaves open."""

    name: str
    not_judged: tuple[NotJudged, ...] = ()


def axes_that_tell(
    records: Sequence[Record],
    wanted: str | None = None,
    criteria: PartCriteria | None = None,
    aircraft: Aircraft | None = None,
) -> Axes:
    """The axes that the records can support, or those that are `wanted`.

    If surfaces and flow angle of an axis move little compared with the other axis, couplings and turbulence contribute
    as much to its motion as its surfaces do, and the axis is left out. An axis without aerodynamics in the `aircraft`
    file is left out as well.

    Raises InputError for unknown axes, and if no surface drives the model.
    """
    if wanted is not None and wanted not in MOVING:
        raise unknown("axes", wanted, MOVING)
    fed = axes_of(records)
    still = (criteria or PartCriteria()).quarter
    if wanted is not None:
        left_out = _motions(_OTHER.get(wanted), f"{wanted} axes were asked for")
        if wanted in _OTHER and fed == "full" and (share := _share(records, wanted, _OTHER[wanted])) < still:
            what = f"what moves the {wanted} motion"
            because = _rests(records, wanted, share)
            left_out = (*left_out, NotJudged(what=what, because=f"{because}: small couplings make as much of it"))
        return Axes(name=wanted, not_judged=left_out)
    if fed != "full":
        missing = [s for s in _SURFACES[_OTHER[fed]] if not all(s in record for record in records)]
        return Axes(name=fed, not_judged=_motions(_OTHER[fed], f"no channel {' and '.join(missing)}"))
    for absent, modelled in _OTHER.items():
        if aircraft is not None and has_aerodynamics(aircraft, modelled) and not has_aerodynamics(aircraft, absent):
            coefficients = ", ".join(moved_coefficients(aircraft, absent))
            return Axes(name=modelled, not_judged=_motions(absent, f"the aircraft file has nothing of {coefficients}"))
    for still_axes, moving in _OTHER.items():
        share = _share(records, still_axes, moving)
        if share < still:
            return Axes(name=moving, not_judged=_motions(still_axes, _rests(records, still_axes, share)))
    return Axes(name="full")


def _rests(records: Sequence[Record], resting: str, share: float) -> str:
    """The reason for leaving out an axis that moves too little."""
    angles = all(any(name in record for record in records) for name in _FLOW_ANGLE.values())
    who = [*_SURFACES[resting], *((_FLOW_ANGLE[resting],) if angles else _RATES[resting])]
    return f"{' and '.join(who)} move {100.0 * share:.0f} % of what the {_OTHER[resting]} ones do"


def _motions(axis: str | None, because: str) -> tuple[NotJudged, ...]:
    return (NotJudged(what=f"{axis} motion", because=because),) if axis else ()


def _share(records: Sequence[Record], resting: str, moving: str) -> float:
    """Motion of an axis over that of the other: surfaces or flow angles, whichever is larger; rates if a flow angle is
    not measured. Infinite if these are not measured either, or if the other axis does not move.
    """
    surfaces, angles, rates = (
        [max(_excursion(records, name) for name in names[axis]) for axis in (resting, moving)]
        for names in (_SURFACES, {axis: (name,) for axis, name in _FLOW_ANGLE.items()}, _RATES)
    )
    motion = angles if np.all(np.isfinite(angles)) else rates
    if not (surfaces[1] > 0.0 and motion[1] > 0.0 and np.isfinite(motion[0])):
        return np.inf
    return max(surfaces[0] / surfaces[1], motion[0] / motion[1])


def _excursion(records: Sequence[Record], name: str) -> float:
    """Largest excursion from the median of a record; NaN where no record has the channel."""
    found = [record[name] for record in records if name in record and np.isfinite(record[name]).any()]
    return max((float(np.nanmax(np.abs(x - np.nanmedian(x)))) for x in found), default=float("nan"))


@dataclass(frozen=True, eq=False, kw_only=True)
class Powered:
    """Records that have a thrust."""

    records: tuple[Record, ...]  # with a replacement for a thrust that was not recorded;  lost  what that leaves open
    lost: tuple[NotJudged, ...] = ()
    unknown: tuple[str, ...] = ()  # the replaced thrust, and the coefficient that is as unknown as its history


def with_thrust(aircraft: Aircraft, records: Sequence[Record], axes: str, nodes: float) -> Powered:
    """The records with a thrust where neither they nor [trim] have one.

    For longitudinal motion the thrust of each record balances drag and acceleration: a constant, or a history with a
    node every `nodes` seconds if the record requires one. A moving throttle does not give the thrust, and the thrust of
    [trim] does not apply to such a record. Lateral motion does not depend on it.
    """
    trimmed = "thrust" in aircraft.trim
    bare = [r for r in records if "thrust" not in r and not (trimmed and (axes == "lateral" or not _throttled(r)))]
    if not bare:
        return Powered(records=tuple(records))
    why = "no channel thrust" if trimmed else "no channel thrust and none in [trim]"
    stands = {r.name: np.zeros(len(r)) if axes == "lateral" else _balance(aircraft, r, nodes) for r in bare}
    found = tuple(r.with_channels(thrust=stands[r.name]) if r.name in stands else r for r in records)
    if axes == "lateral":
        lost = NotJudged(what="asymmetric thrust", because=why)
        unknown = ("thrust",)
    elif any(np.ptp(series) > 0.0 for series in stands.values()):
        because = f"{why}: a time history that balances the drag of the file stands for it"
        lost = NotJudged(what="thrust, its line, and drag", because=because)
        unknown = ("thrust", derivative_term(drag_level(aircraft))[0])
    else:
        because = f"{why}: a constant that balances the drag of the file stands for it"
        lost = NotJudged(what="thrust, its line, and the level of drag", because=because)
        unknown = ("thrust",)
    return Powered(records=found, lost=(lost,), unknown=unknown)


def _throttled(record: Record) -> bool:
    """Return True if a throttle moves in a record."""
    throttle = record["throttle"] if "throttle" in record else np.zeros(1)
    return bool(np.isfinite(throttle).any()) and float(np.nanmax(throttle)) > float(np.nanmin(throttle))


def drag_level(aircraft: Aircraft) -> str:
    """The derivative that cannot be separated from a constant thrust."""
    return "CD_0" if aircraft.force_axes == "wind" else "CX_0"


def or_thrust(aircraft: Aircraft, one: Contradiction, records: Sequence[Record], by: DataCriteria) -> Contradiction:
    """A contradicted level of drag with its alternative: a wrong scale of a steady thrust has the same effect. Other
    contradictions stay as they are.
    """
    steady = [r for r in records if "thrust" in r and np.ptp(r["thrust"]) < by.fair * abs(np.mean(r["thrust"]))]
    pressures = [_pressure(record) for record in steady]
    if one.parameter != drag_level(aircraft) or not steady or len(steady) < len(records) or None in pressures:
        return one
    sign = 1.0 if one.parameter == "CD_0" else -1.0
    less = sign * (one.given - one.flight) * aircraft.area * float(np.mean([p for p in pressures if p is not None]))
    recorded = float(np.mean([np.mean(record["thrust"]) for record in steady]))
    if recorded <= 0.0 or recorded + less <= 0.0:
        return one
    percent = 100.0 * (recorded / (recorded + less) - 1.0)
    way = "low" if percent < 0.0 else "high"
    other = (
        f"or else the recorded thrust is {abs(percent):.0f} % too {way}: a steady thrust does not tell the two apart"
    )
    return replace(one, sentence=f"{one.sentence.removesuffix('.')}; {other}.")


def _pressure(record: Record) -> float | None:
    """Mean dynamic pressure [Pa]; None where airspeed or density is not recorded."""
    if "V" not in record or "rho" not in record:
        return None
    return 0.5 * float(np.nanmean(record["rho"]) * np.nanmean(record["V"]) ** 2)


def _balance(aircraft: Aircraft, record: Record, nodes: float) -> np.ndarray:
    """(N,) thrust [N] that the longitudinal specific force takes beside the drag of the file; the force is that of the
    path of flight where no accelerometer measures it.

    Beside the history, the drag of the file may be wrong along angle of attack, pitch rate and elevator. A history is
    demanded where the Bayesian information criterion prefers it to a constant, with as many samples as the correlation
    of what the history leaves is worth.
    """
    unpowered = flight_inputs(aircraft, record.with_channels(thrust=np.zeros(len(record))), "longitudinal")
    pull = force_inputs([record])
    model = aircraft_model(aircraft, axes="longitudinal", outputs=("ax",), effects=(), known=pull)
    X = model.guess(unpowered)
    U = unpowered.matrix(model.inputs)
    ax = ca.Function("ax", [model.x, model.u], [ca.substitute(model.h, ca.vertcat(model.p, model.w), _known(model))])
    dragged = ax.map(len(record))(X.T, U.T).full()[0]
    state = dict(zip(model.states, X.T, strict=True))
    acting = dict(zip(model.inputs, U.T, strict=True))
    measured = record["ax"] if "ax" in record else _along_the_path(aircraft, unpowered, state)
    needed = aircraft.mass * (measured - dragged)
    level = np.full(len(record), float(np.nanmean(needed)))
    alpha = np.arctan2(state["w"], state["u"])
    pressure = state["u"] ** 2 + state["w"] ** 2
    wrong = pressure * np.stack([alpha, alpha**2, state["q"], acting["delta_e"]])
    history = _history(record.t, needed, wrong, nodes)
    return level if history is None else level + history


def _history(t: np.ndarray, needed: np.ndarray, wrong: np.ndarray, nodes: float) -> np.ndarray | None:
    """(N,) history about its mean that `needed` requires in addition to `wrong` terms (terms, N); None if a constant is
    enough.
    """
    known = np.isfinite(needed)
    grid = np.linspace(t[0], t[-1], max(2, round((t[-1] - t[0]) / nodes) + 1))
    hats = np.stack([np.interp(t, grid, one) for one in np.eye(len(grid))], axis=1)
    spread = np.maximum(np.ptp(wrong, axis=1), 1e-300)
    errors = ((wrong - wrong.mean(axis=1, keepdims=True)) / spread[:, None]).T
    constant = np.column_stack([np.ones(len(t)), errors])
    free = np.column_stack([hats, errors])
    if known.sum() <= free.shape[1]:
        return None
    by_constant, by_history = (np.linalg.lstsq(A[known], needed[known], rcond=None)[0] for A in (constant, free))
    left = needed[known] - free[known] @ by_history
    before, after = (float(np.mean(x**2)) for x in (needed[known] - constant[known] @ by_constant, left))
    alike = max(float(np.mean(left[1:] * left[:-1])) / max(after, 1e-300), 0.0)
    samples = known.sum() * (1.0 - alike) / (1.0 + alike)
    if samples * np.log(before / max(after, 1e-300)) < (len(grid) - 1) * np.log(max(samples, 1.0)):
        return None
    history = hats @ np.linalg.lstsq(hats[known], needed[known], rcond=None)[0]
    return history - float(np.mean(history[known]))


def _known(model: Model) -> ca.DM:
    return ca.vertcat(model.nominal_vector(), np.zeros(len(model.disturbances)))


def _along_the_path(aircraft: Aircraft, record: Record, state: Mapping[str, np.ndarray]) -> np.ndarray:
    """(N,) longitudinal specific force [m/s2] of the measured motion."""
    u, w, q, theta = (state[name] for name in ("u", "w", "q", "theta"))
    return np.gradient(u, record.t) + q * w - record["r"] * record["v"] + aircraft.gravity * np.sin(theta)


Split = tuple[Sequence[Record], Sequence[Record]]  # fitted and held-out records


@dataclass(frozen=True, eq=False, kw_only=True)
class Scope:
    """The flight in its scope, and the held-out records prepared like it.

    given  the fitted records as they were read; `lost` what is outside the scope
    """

    flight: Subject
    held: tuple[Record, ...]
    given: tuple[Record, ...]
    lost: tuple[NotJudged, ...]

    def ready(self, recorded: Split) -> Split:
        """Records before they were corrected, prepared like these."""
        nodes = self.flight.criteria.numerics.missing_input.times[0]
        fitted, held = (with_thrust(self.flight.aircraft, some, self.flight.axes, nodes).records for some in recorded)
        return fitted, held

    def not_judged(self, values: Mapping[str, FlightValue]) -> tuple[NotJudged, ...]:
        """All that stays open, with `values` as flight has them."""
        names = [record.name for record in (*self.given, *self.held)]
        return (*self.lost, *left_open(self.flight, self.given, values), *of_other_records(self.flight.aircraft, names))

    def contradicted(self, aircraft: Aircraft, values: Mapping[str, FlightValue]) -> tuple[Contradiction, ...]:
        """Numbers of an aircraft file that are inconsistent with these records."""
        slopes = self._slopes(aircraft)
        found = contradicted(aircraft, self._open(aircraft, values), self.flight.criteria, slopes)
        return tuple(or_thrust(aircraft, one, self.flight.records, self.flight.criteria.data) for one in found)

    def factors(self, aircraft: Aircraft, values: Mapping[str, FlightValue]) -> tuple[Factor, ...]:
        """The factors that groups of derivatives of an aircraft file have in common."""
        return common_factors(aircraft, self._open(aircraft, values), self.flight.criteria, self._slopes(aircraft))

    def borne_out(
        self, doubts: Sequence[Doubt], aircraft: Aircraft, values: Mapping[str, FlightValue]
    ) -> tuple[Doubt, ...]:
        """The doubts about an aircraft file without those about a unit that these records refute."""
        return borne_out(doubts, aircraft, self._open(aircraft, values), self.flight.criteria, self._slopes(aircraft))

    def _open(self, aircraft: Aircraft, values: Mapping[str, FlightValue]) -> dict[str, FlightValue]:
        """The values without the level of drag where the thrust is unknown, and without drag where its history is."""
        unknown = self.flight.unknown
        closed = {drag_level(aircraft)} if "thrust" in unknown else set()
        closed |= {name for name in values if name.partition("_")[0] in unknown}
        return {name: one for name, one in values.items() if name not in closed}

    def _slopes(self, aircraft: Aircraft) -> dict[str, float]:
        return given_slopes(aircraft, self.given)


def scope_of(aircraft: Aircraft, records: Split, criteria: Criteria, axes: str | None) -> Scope:
    """The flight of (fitted, held-out) records in the axes that they support, or that were asked for.

    Raises InputError for unknown axes, and for records that cannot feed them.
    """
    fitted, held = records
    judged = axes_that_tell(fitted, axes, criteria.parts, aircraft)
    nodes = criteria.numerics.missing_input.times[0]
    powered = with_thrust(aircraft, fitted, judged.name, nodes)
    unseen = with_thrust(aircraft, held, judged.name, nodes).records
    flight = prepare(aircraft, powered.records, criteria, judged.name, average=True)
    flight.elsewhere({}, unseen)  # what they lack is reported before the work begins
    flight = replace(flight, unknown=powered.unknown)
    return Scope(flight=flight, held=unseen, given=tuple(fitted), lost=(*judged.not_judged, *powered.lost))


def split(
    records: Sequence[Record], hold_out: Sequence[Record], criteria: PartCriteria
) -> tuple[list[Record], list[Record]]:
    """Split the records into those that are fitted and those that are held out.

    Without `hold_out` the last of several records is held out. Of a single record its last third is held out, or the
    part that the `criteria` set.

    raises  InputError if there is no record, or if two records have the same name
    """
    if not records:
        raise InputError("no record to diagnose")
    names = [r.name for r in (*records, *hold_out)]
    twice = sorted({n for n in names if names.count(n) > 1})
    if twice:
        raise InputError(f"two records are named '{twice[0]}'; names must differ")
    for held in hold_out:
        if twin := repeated(held, records):
            raise InputError(
                f"held-out record '{held.name}' has the samples of '{twin}', which is fitted; hold out another record, "
                "or none"
            )
    if hold_out:
        return list(records), list(hold_out)
    if len(records) > 1:
        return list(records[:-1]), [records[-1]]
    only = records[0]
    cut = only.t[0] + criteria.most * only.duration
    part = "last third" if criteria == PartCriteria() else "last part"
    return [only.between(-np.inf, cut)], [only.between(cut, np.inf, name=f"{only.name}, {part}")]


def repeated(held: Record, fitted: Sequence[Record]) -> str:
    """The name of a fitted record whose samples a held-out record repeats; empty if it is new.

    Records are compared by the channels that both have, and half of the samples decide: two flights do not have so many
    samples in common to the last digit. Samples that repeat their predecessor do not count.
    """
    for record in fitted:
        shared = sorted(set(held.channels) & set(record.channels))
        mine, theirs = ({row.tobytes() for row in _moving(one, shared)} for one in (held, record))
        if len(mine & theirs) > 0.5 * len(mine):
            return record.name
    return ""


def part_of_a_fitted_record(held: Sequence[Record], fitted: Sequence[Record]) -> str:
    """Why held-out records are no flights of their own: they are parts of a fitted one; empty if they are."""
    names = {record.name for record in fitted}
    parts = [record.name for record in held if record.name.rpartition(", ")[0] in names]
    return f"{parts[0]} is a part of the one record that there is" if parts else ""


def _moving(record: Record, names: Sequence[str]) -> np.ndarray:
    """(samples, channels) The samples that differ from their predecessors."""
    rows = np.column_stack([record[name] for name in names]) if names else np.zeros((1, 0))
    return rows[1:][(rows[1:] != rows[:-1]).any(axis=1)]
