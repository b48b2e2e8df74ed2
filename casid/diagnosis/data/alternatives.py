"""The alternatives to a record as it stands: a sign, a unit, a swap, the unit of time."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from casid.diagnosis.data.reading import Reading
from casid.diagnosis.numerics import ALIKE
from casid.signals import SURFACES, unit_of

_DEG = float(np.pi / 180.0)
# unit that a column may be in though it is read as SI: SI over number
_UNITS: Mapping[str, Mapping[str, float]] = {
    "rad": {"deg": _DEG},
    "rad/s": {"deg/s": _DEG},
    "rad/s2": {"deg/s2": _DEG},
    "m/s": {"kt": 1852.0 / 3600.0, "ft/s": 0.3048, "km/h": 1.0 / 3.6},
    "m/s2": {"g": 9.80665, "ft/s2": 0.3048},
    "m": {"ft": 0.3048, "km": 1000.0},
    "kg/m3": {"slug/ft3": 515.3788184},
    "N": {"kN": 1000.0, "lbf": 4.4482216152605},
    "s": {"ms": 1e-3, "min": 60.0},
}
GROUPS: Mapping[str, tuple[str, ...]] = {
    "p+q+r": ("p", "q", "r"),
    "ax+ay+az": ("ax", "ay", "az"),
    "pdot+qdot+rdot": ("pdot", "qdot", "rdot"),
    "phi+theta+psi": ("phi", "theta", "psi"),
    "phi+theta": ("phi", "theta"),
    "alpha+beta": ("alpha", "beta"),
    "+".join(SURFACES): SURFACES,
}
_SIGNED = ("alpha", "beta", "p", "q", "r", "phi", "theta", "psi", "ax", "ay", "az", "pdot", "qdot", "rdot", *SURFACES)
_SWAPPED = (
    *combinations(("p", "q", "r"), 2),
    *combinations(("phi", "theta", "psi"), 2),
    *combinations(("ax", "ay", "az"), 2),
    *combinations(("pdot", "qdot", "rdot"), 2),
    *combinations(SURFACES, 2),
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
    found += [_swap(a, b) for a, b in _SWAPPED if {a, b} <= there]
    times = {f"{unit}": factor for unit, factor in _UNITS["s"].items()}
    found += [_time(factor, unit) for unit, factor in times.items()]
    own = [one for one in stretched if all(abs(np.log(one / factor)) > ALIKE for factor in times.values())]
    return [*found, *(_time(one, None) for one in own)]


def _sign(name: str) -> Alternative:
    return Alternative(kind="data_sign", target=name, reading=Reading(factor={name: -1.0}), value=-1.0)


def _units(label: str, members: tuple[str, ...]) -> list[Alternative]:
    """In another unit than SI; or in SI though the header says that other unit."""
    found = []
    for unit, factor in _UNITS.get(unit_of(members[0]), {}).items():
        for value, said in ((factor, unit), (1.0 / factor, f"SI, not in {unit}")):
            reading = Reading(factor=dict.fromkeys(members, value))
            found.append(Alternative(kind="data_unit", target=label, reading=reading, value=value, unit=said))
    return found


def _swap(a: str, b: str) -> Alternative:
    return Alternative(kind="data_swap", target=f"{a}+{b}", reading=Reading(source={a: b, b: a}))


def _time(factor: float, unit: str | None) -> Alternative:
    return Alternative(kind="data_unit", target="t", reading=Reading(time=factor), value=factor, unit=unit)
