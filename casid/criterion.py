"""Numbers that decide something, with unit, meaning and evidence, and groups of such numbers.

A group is a frozen keyword-only dataclass whose fields are made by `number` or are other groups. A criterion is read as
`criteria.significance.search`, listed by `listed`, and set from a file by `overridden`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields, is_dataclass, replace
from typing import Any, TypeVar

from casid.errors import InputError, unknown

Group = TypeVar("Group")
Value = int | float | tuple[float, ...]


def number(value: Value, meaning: str, evidence: str = "chosen", *, unit: str = "", signed: bool = False) -> Any:
    """A field of a group: its default (a tuple: tried one after the other), what it decides in terms of the glossary,
    and the evidence: "derived: ..." from probability or physics, "measured: ..." on data, or "chosen". `unit` is empty
    for counts and ratios; `signed` allows values at or below zero."""
    return field(default=value, metadata={"meaning": meaning, "evidence": evidence, "unit": unit, "signed": signed})


@dataclass(frozen=True, kw_only=True)
class Criterion:
    """One number as a row of a table; `name` includes its groups, as "significance.search"."""

    name: str
    value: Value
    unit: str
    meaning: str
    evidence: str


def listed(group: object, within: str = "") -> Iterator[Criterion]:
    """All numbers of a group and of its groups, in the order of their definition."""
    for one in fields(group):  # pyright: ignore[reportArgumentType]
        name = within + one.name
        value = getattr(group, one.name)
        if is_dataclass(value):
            yield from listed(value, f"{name}.")
        else:
            said = {key: one.metadata[key] for key in ("unit", "meaning", "evidence")}
            yield Criterion(name=name, value=value, **said)


def overridden(group: Group, table: Mapping[str, Any], where: str = "") -> Group:
    """The group with other values from a nested table, {"significance": {"search": 60.0}}; `where` is named in errors.
    Raises InputError for a name that does not exist, and for a value of another kind."""
    return _overridden(group, table, "", [one.name for one in listed(group)], f"{where}: " if where else "")


def _overridden(group: Group, table: Mapping[str, Any], within: str, names: list[str], where: str) -> Group:
    """The group with other values; `within` is the name of the group, and `names` are all names of criteria."""
    changed: dict[str, Any] = {}
    metadata = {one.name: one.metadata for one in fields(group)}  # pyright: ignore[reportArgumentType]
    for key, value in table.items():
        name = within + key
        if key not in metadata:
            raise unknown("criterion", _first_number(name, value), names, where.removesuffix(": "))
        before = getattr(group, key)
        if not is_dataclass(before):
            changed[key] = _checked(name, value, before, metadata[key]["signed"], where)
        elif isinstance(value, Mapping):
            changed[key] = _overridden(before, value, f"{name}.", names, where)
        else:
            first = next(listed(before)).name
            raise InputError(f"{where}'{name}' is a group of criteria, got {value!r}; expected e.g. {name}.{first}")
    return replace(group, **changed) if changed else group  # pyright: ignore[reportArgumentType]


def _first_number(name: str, value: Any) -> str:
    """Full name of the first number below an unknown name; a near name is easier to find for it."""
    while isinstance(value, Mapping) and value:
        key, value = next(iter(value.items()))
        name = f"{name}.{key}"
    return name


def _checked(name: str, value: Any, before: Value, signed: bool, where: str) -> Value:
    """The value, if it is of the same kind as `before`; an integer is accepted for a number."""
    if isinstance(before, tuple):
        if not isinstance(value, (list, tuple)) or len(value) != len(before):
            raise InputError(
                f"{where}criterion '{name}' is {len(before)} numbers, got {value!r}; expected {before}-like"
            )
        return tuple(float(_checked(name, one, old, signed, where)) for one, old in zip(value, before, strict=True))  # pyright: ignore
    is_number = isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)
    if isinstance(before, int):
        if not is_number or value != int(value) or value < 1:
            raise InputError(f"{where}criterion '{name}' is a count, got {value!r}; expected a whole number above 0")
        return int(value)
    if not is_number or (value <= 0.0 and not signed):
        kind = "a number" if signed else "a number above 0"
        raise InputError(f"{where}criterion '{name}' is {value!r}; expected {kind}")
    return float(value)


def in_time(group: Group, factor: float) -> Group:
    """The group with all its times, which are in seconds, multiplied by a factor."""
    changed: dict[str, Any] = {}
    for one in fields(group):  # pyright: ignore[reportArgumentType]
        value = getattr(group, one.name)
        if is_dataclass(value):
            changed[one.name] = in_time(value, factor)
        elif one.metadata.get("unit") == "s":
            changed[one.name] = tuple(factor * v for v in value) if isinstance(value, tuple) else factor * value
    return replace(group, **changed)  # pyright: ignore[reportArgumentType]
