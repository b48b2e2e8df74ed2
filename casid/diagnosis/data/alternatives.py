"""The alternatives to a record as it stands: a sign, a unit, a swap, the unit of time."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, combinations

from casid.diagnosis.data.reading import Reading
from casid.signals import SURFACES, si_factor, unit_of

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
_SIGNED = ("alpha", "beta", "p", "q", "r", "phi", "theta", "psi", "ax", "ay", "az", "pdot", "qdot", "rdot", *SURFACES)


def _pairs(group: tuple[str, ...]) -> Iterable[tuple[str, str]]:
    return combinations(group, 2)


_SWAPPED = (
    *chain(*map(_pairs, (GROUPS["p+q+r"], GROUPS["phi+theta+psi"], GROUPS["ax+ay+az"], GROUPS["pdot+qdot+rdot"]))),
    *_pairs(SURFACES),
    ("alpha", "beta"),
    ("alpha", "theta"),
    ("beta", "phi"),
)


@dataclass(frozen=True, kw_only=True)
class Alternative:
    """One other way to read records, in the vocabulary: kind, target (`a+b` of a swap), factor to SI, unit."""

    kind: str
    target: str
    reading: Reading
    value: float | None = None
    unit: str | None = None

    @property
    def channels(self) -> frozenset[str]:
        """What it takes otherwise; "t" when it is the time."""
        return self.reading.channels | ({"t"} if self.reading.time != 1.0 else set())


def alternatives(channels: Iterable[str], stretched: Sequence[float] = ()) -> list[Alternative]:
    """All alternatives for records that have these channels; `stretched`: factors of time that rates ask for."""
    there = set(channels)
    found = [_sign(name) for name in _SIGNED if name in there]
    for name in sorted(there):
        found += _units(name, (name,))
    for label, members in GROUPS.items():
        if there.issuperset(members):
            found += _units(label, members)
        elif members in INSTRUMENTS and len(some := tuple(name for name in members if name in there)) > 1:
            found += _units("+".join(some), some)
    found += [_swap(a, b) for a, b in _SWAPPED if {a, b} <= there]
    found += [_time(factor, unit) for unit, factor in TIMES.items()]
    return [*found, *(_time(factor, None) for factor in stretched)]


def _sign(name: str) -> Alternative:
    return Alternative(kind="data_sign", target=name, reading=Reading(factor={name: -1.0}), value=-1.0)


def _units(label: str, members: tuple[str, ...]) -> list[Alternative]:
    """In another unit than SI; or in SI though the header says that other unit."""
    found = []
    for unit in _UNITS.get(unit_of(members[0]), ()):
        factor = si_factor(unit, members[0])
        for value, said in ((factor, unit), (1.0 / factor, f"SI, not in {unit}")):
            reading = Reading(factor=dict.fromkeys(members, value))
            found.append(Alternative(kind="data_unit", target=label, reading=reading, value=value, unit=said))
    return found


def _swap(a: str, b: str) -> Alternative:
    return Alternative(kind="data_swap", target=f"{a}+{b}", reading=Reading(source={a: b, b: a}))


def _time(factor: float, unit: str | None) -> Alternative:
    return Alternative(kind="data_unit", target="t", reading=Reading(time=factor), value=factor, unit=unit)
