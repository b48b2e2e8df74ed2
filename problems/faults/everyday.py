"""The faults that a flight-test engineer meets every week, in data and in files, in one short flight of the Do 328.

Every row says what is right of a whole diagnosis: the fault is named, in its set, or refused at the right reading, and
nothing else is named. "adequate" is right of none.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from casid.diagnosis.result import Diagnosis
from casid.errors import CasidError
from casid.model.aircraft import Aircraft
from casid.model.effect_value import EffectValue
from casid.records.record import Record
from casid.signals import SURFACES
from problems.blind.sets import fly_set
from problems.faults.fault import DataFault, with_fault
from problems.faults.score import score_causes

_DEG = float(np.pi / 180.0)
_CASE, _SEED = "clean-1", 7  # 25 Hz and the noise of usual instruments
ONE, ALL = ("m1",), ("m1", "m2", "m3")
Flown = tuple[Aircraft, tuple[Record, ...]]


@dataclass(frozen=True, eq=False, kw_only=True)
class Row:
    """One fault: `fault` of the data, or a `change` of file and records, with what of the diagnosis is `right`, or
    what an error must say that refuses it."""

    name: str
    fault: DataFault | None = None
    change: Callable[[Flown], Flown] = lambda flown: flown
    right: Callable[[Diagnosis], bool] = lambda found: False
    refusal: str = ""

    def fly(self) -> Flown:
        """Aircraft file and records with the fault."""
        aircraft, records = self.change(healthy())
        return aircraft, tuple(with_fault(self.fault, records, seed=5))

    def outcome(self, found: Diagnosis) -> str:
        """One of `score.OUTCOMES`."""
        if self.fault is not None:
            return score_causes(self.fault, found.data, found.causes, found.verdict, self.fault)
        return "found" if self.right(found) else "wrong"

    def refused(self, error: CasidError) -> str:
        """The same of an error."""
        return "refused" if self.refusal and self.refusal in str(error) else "wrong"


@cache
def healthy() -> Flown:
    """Three records of 22 s at 25 Hz, and a file that is 10 to 30 % off."""
    flown = fly_set("do328", _CASE, _SEED)
    return flown.aircraft, flown.records[: len(ALL)]


def _stretches(*records: str, seconds: float = 0.5) -> dict[str, tuple[tuple[float, float], ...]]:
    starts = (2.3, 5.1, 8.9, 11.2, 14.6, 17.8)
    return {name: tuple((start, start + seconds) for start in starts) for name in records}


def _doubled(flown: Flown) -> Flown:
    aircraft, records = flown
    wrong = {name: 2.0 * aircraft.derivatives[name] for name in _DOUBLED}
    return aircraft.with_derivatives(wrong), records


_DOUBLED = ("Cm_delta_e", "Cl_p", "Cn_beta")


def _no_elevator(flown: Flown) -> Flown:
    """The elevator is wrong in the file, and the records do not have it."""
    aircraft, records = flown
    wrong = aircraft.with_derivatives({"Cm_delta_e": -aircraft.derivatives["Cm_delta_e"]})
    return wrong, tuple(record.without("delta_e") for record in records)


def _sign(target: str, records: tuple[str, ...]) -> DataFault:
    return DataFault(kind="data_sign", target=target, records=records, value=-1.0)


def _unit(target: str, value: float, unit: str) -> DataFault:
    return DataFault(kind="data_unit", target=target, records=ALL, value=value, unit=unit)


def _whole(kind: str, target: str, value: float, term: str | None = None) -> DataFault:
    return DataFault(kind=kind, target=target, records=ALL, value=value, term=term)


def _only_values(found: Diagnosis) -> bool:
    """The three doubled derivatives stand against flight, and no cause is named."""
    against = {one.parameter for one in found.contradicted}
    return found.verdict == "values wrong" and set(_DOUBLED) <= against and not found.causes


def _longitudinal_open(found: Diagnosis) -> bool:
    told = [one.what for one in found.not_judged]
    return "longitudinal motion" in told and "longitudinal motion" in found.sentence and not found.causes


def _row(name: str, fault: DataFault) -> Row:
    return Row(name=name, fault=fault)


def _file(name: str, parameter: str, change: Callable[[Aircraft], Aircraft], refusal: str = "") -> Row:
    """A number of the file in another unit: it is told, first of all, and no cause is named."""

    def told(found: Diagnosis) -> bool:
        first = found.contradicted[0] if found.contradicted else None
        return first is not None and first.impossible and first.parameter == parameter and not found.causes

    return Row(name=name, change=lambda flown: (change(flown[0]), flown[1]), right=told, refusal=refusal)


def _everywhere(name: str, factor: float) -> Callable[[Flown], Flown]:
    """A channel and its entry in [trim] in another unit."""

    def change(flown: Flown) -> Flown:
        aircraft, records = flown
        trim = {**aircraft.trim, name: aircraft.trim[name] / factor}
        return replace(aircraft, trim=trim), tuple(r.with_channels(**{name: r[name] / factor}) for r in records)

    return change


def _still(flown: Flown) -> Flown:
    aircraft, records = flown
    return aircraft, tuple(r.with_channels(**{s: np.full(len(r), r[s][0]) for s in SURFACES}) for r in records)


def _unit_and_trim(name: str) -> Callable[[Diagnosis], bool]:
    """The record was corrected, and the entry of [trim] told."""
    return lambda found: (
        [(one.kind, one.target, one.handled) for one in found.data] == [("data_unit", name, "corrected")]
        and found.contradicted[0].parameter == f"trim {name}"
        and not found.causes
    )


def _per_degree(aircraft: Aircraft) -> Aircraft:
    per_angle = {n: v for n, v in aircraft.derivatives.items() if n.split("_", 1)[1] in ("alpha", "beta", *SURFACES)}
    return aircraft.with_derivatives({name: _DEG * value for name, value in per_angle.items()})


def _izz(aircraft: Aircraft) -> Aircraft:
    """Beyond the triangle inequality."""
    inertia = aircraft.inertia
    return replace(aircraft, inertia=replace(inertia, Izz=1.5 * (inertia.Ixx + inertia.Iyy)))


def _izz_told(found: Diagnosis) -> bool:
    sets = [{(c.kind, c.target), *((o["kind"], o["target"]) for o in c.indistinguishable_from)} for c in found.causes]
    against = [one.parameter for one in found.contradicted if one.impossible]
    return against == ["inertia"] and len(sets) == 1 and ("inertia", "Izz") in sets[0]


_LAG = EffectValue(kind="actuator_lag", target="delta_e", value=-1.0)
_ELSEWHERE = EffectValue(kind="sensor_bias", target="q", value=0.01, records=("zz",))


_FROZEN = DataFault(kind="data_stuck", target="beta", records=ONE, intervals={"m1": ((-1.0, 99.0),)})
_HELD = DataFault(kind="data_dropout", target="V+alpha+beta", records=ALL, intervals=_stretches(*ALL))

ROWS: tuple[Row, ...] = (
    Row(name="nothing", right=lambda found: not (found.data or found.causes)),
    _row("elevator reversed in a record", _sign("delta_e", ONE)),
    _row("elevator reversed in all", _sign("delta_e", ALL)),
    _row("aileron reversed in all", _sign("delta_a", ALL)),
    Row(name="Cm_delta_e, Cl_p, Cn_beta of the file doubled", change=_doubled, right=_only_values),
    Row(name="no delta_e, Cm_delta_e of the file reversed", change=_no_elevator, right=_longitudinal_open),
    _row("V, alpha, beta hold 0.5 s", _HELD),
    _row("inertial unit tilted by 4 deg about y", _whole("sensor_misalignment", "inertial", 4.0 * _DEG, "y")),
    _row("inertial unit tilted by 4 deg about x", _whole("sensor_misalignment", "inertial", 4.0 * _DEG, "x")),
    _row("airspeed error grows with alpha", _whole("position_error", "V", 40.0, "alpha")),
    _row("V in kt", _unit("V", 1852.0 / 3600.0, "kt")),
    _row("accelerations in g", _unit("ax+ay+az", 9.80665, "g")),
    _row("alpha and beta swapped", DataFault(kind="data_swap", target="alpha+beta", records=ALL)),
    _row("aileron and rudder swapped", DataFault(kind="data_swap", target="delta_a+delta_r", records=ALL)),
    _row("time / 5", _unit("t", 5.0, "stretched")),
    _row("time in ms", _unit("t", 1e-3, "ms")),
    _row("q in deg/s", _unit("q", _DEG, "deg/s")),
    _row("p, q, r in deg/s", _unit("p+q+r", _DEG, "deg/s")),
    _row("q reversed", _sign("q", ALL)),
    _row("ay reversed", _sign("ay", ALL)),
    _row("az reversed", _sign("az", ALL)),
    _row("1 % outliers in az", _whole("data_spikes", "az", 0.01)),
    _row("q clipped", DataFault(kind="data_clipped", target="q", records=ALL, value=0.5)),
    _row("beta clipped", DataFault(kind="data_clipped", target="beta", records=ONE, value=0.5)),
    _row("beta frozen in a record", _FROZEN),
    _row("thrust 25 % low", _whole("thrust_scale", "thrust", -0.25)),
    _row("surfaces 0.12 s late", _whole("sensor_delay", "surfaces", 0.12)),
    _row("-999 for want of ax", _whole("data_spikes", "ax", 0.01, "code")),
    Row(
        name="no surface moves",
        change=_still,
        right=lambda found: found.verdict == "data at fault" and "No surface moves" in found.sentence,
        refusal="No surface moves",
    ),
    _file("mass in lb", "mass", lambda a: replace(a, mass=a.mass / 0.45359237)),
    _file("mass in t", "mass", lambda a: replace(a, mass=a.mass / 1000.0), refusal="mass is in t"),
    _file("area in ft2", "area", lambda a: replace(a, area=a.area / 0.3048**2)),
    _file("derivatives per degree", "derivatives", _per_degree),
    _file("gravity of the Moon", "gravity", lambda a: replace(a, gravity=1.62)),
    _file("a lag of -1 s", "actuator_lag(delta_e)", lambda a: a.with_effects([_LAG])),
    Row(name="rho in slug/ft3, also in [trim]", change=_everywhere("rho", 515.3788184), right=_unit_and_trim("rho")),
    Row(name="thrust in kN, also in [trim]", change=_everywhere("thrust", 1000.0), right=_unit_and_trim("thrust")),
    Row(name="Izz of no rigid body", change=lambda flown: (_izz(flown[0]), flown[1]), right=_izz_told),
    Row(
        name="an effect of a record that is not there",
        change=lambda flown: (flown[0].with_effects([_ELSEWHERE]), flown[1]),
        right=lambda found: "sensor_bias(q) of the file" in [one.what for one in found.not_judged] and not found.causes,
    ),
)
