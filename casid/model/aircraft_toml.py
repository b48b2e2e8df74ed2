"""An aircraft and its TOML file: units, the tables of the file as fields of `Aircraft`, and back with its comments."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable, Mapping, MutableMapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import tomlkit

from casid.above import ask_above
from casid.arguments import given, number, numbers_by_name
from casid.errors import InputError, check_known, nearest
from casid.model.aerodynamics import Aerodynamics, FileAerodynamics
from casid.model.aircraft_file import check_keys, numbered, numbers, quoted, subtable, text
from casid.model.airframe import INERTIAS, POSITIONS, PRODUCTS, Inertia
from casid.model.effect_value import EffectValue
from casid.model.rotors import read_rotors, written_rotors
from casid.model.tables import read_tables, written_table
from casid.model.terms import parse_term
from casid.records.limits import beside, of_file
from casid.signals import FOOT, POUND, SLUG, TONNE

INCH = FOOT / 12.0
# SI unit -> unit -> SI over number
UNITS: Mapping[str, Mapping[str, float]] = {
    "kg": {"kg": 1.0, "lb": POUND, "lbm": POUND, "slug": SLUG, "t": TONNE},
    "kg m2": {"kg m2": 1.0, "slug ft2": SLUG * FOOT**2, "lb ft2": POUND * FOOT**2, "lbm ft2": POUND * FOOT**2},
    "m": {"m": 1.0, "ft": FOOT, "in": INCH},
    "m2": {"m2": 1.0, "ft2": FOOT**2},
}
_NUMBER_AND_UNIT = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,3})?)\s*([A-Za-z].*?)\s*", re.ASCII)
_SPELLINGS = {"^": "", "**": "", "²": "2", "*": " ", "-": " ", "·": " ", "lbs": "lb", "slugs": "slug"}


def in_si(value: Any, si: str, what: str) -> Any:
    """A number of a file, which `what` names, in the unit `si` ("kg", "kg m2", "m" or "m2"): of a text with a unit its
    value, all else as it is. Raises InputError for a text that is no number with a unit of that quantity."""
    if not isinstance(value, str):
        return value
    number, unit = _parts(value)
    known = UNITS[si]
    if number is None or unit not in known:
        near = nearest(unit, known) if unit else None
        hint = f"did you mean '{near}'?" if near else f"expected a number, or one with a unit: {', '.join(known)}"
        raise InputError(f"{what} is the text '{value:.40}'; {hint}")
    return number * known[unit]


def as_written(value: float, like: str) -> str | None:
    """A number in SI as text in the unit of another text, and that text itself where it is the same number; None where
    the other is no number with a unit."""
    number, unit = _parts(like)
    factor = next((table[unit] for table in UNITS.values() if unit in table), None)
    if number is None or factor is None:
        return None
    return like if number * factor == value else f"{value / factor!r} {unit}"


def _parts(text: str) -> tuple[float | None, str]:
    """Number and unit of a text, spelled as in `UNITS`."""
    match = _NUMBER_AND_UNIT.fullmatch(text)
    if not match:
        return None, ""
    unit = match[2]
    for written, meant in _SPELLINGS.items():
        unit = unit.replace(written, meant)
    return float(match[1]), " ".join(unit.split())


def with_comments_of(original: str, content: str) -> str:
    """The TOML text `content`, written into the layout of `original`: keys of both keep place and comment, new ones
    come at the end of their table, those that `content` lacks are taken away."""
    document = tomlkit.parse(original)
    _merge(document, tomllib.loads(content))
    return tomlkit.dumps(document)


def _merge(table: MutableMapping[str, Any], wanted: Mapping[str, Any]) -> None:
    for key in [key for key in table if key not in wanted]:
        del table[key]
    for key, value in wanted.items():
        present = table.get(key)
        if isinstance(present, MutableMapping) and isinstance(value, Mapping):
            _merge(present, value)
        elif key not in table or _plain(present) != value:
            table[key] = _in_its_unit(_plain(present), value)


def _in_its_unit(present: Any, value: Any) -> Any:
    """A new value; a number as text in the unit of the file, "6000 lb"."""
    if isinstance(present, str) and isinstance(value, float):
        return as_written(value, present) or value
    return value


def _plain(value: Any) -> Any:
    return value.unwrap() if hasattr(value, "unwrap") else value


_SECTIONS = ("aircraft", "reference", "propulsion", "sensors", "trim", "aerodynamics", "rotors", "effects")
_OWN = ("jsbsim", "daveml")  # keys that name the file of another simulator
_PARTS = ("derivatives", "terms", "tables", "std")
_AERODYNAMICS = ("force_axes", "relative_uncertainty", *_PARTS, *_OWN, "held", "cm")
_LENGTHS = ("moment_length", "rate_length")
_EFFECT_KEYS = tuple(one.name for one in fields(EffectValue))


def fields_of(data: Mapping[str, Any], file: Path) -> dict[str, Any]:
    """The fields of `Aircraft` that the tables of `file` give. Raises InputError."""
    winged = "aerodynamics" in data or "rotors" not in data
    check_keys(data, _SECTIONS, "top level", ("aircraft", *(("reference", "aerodynamics") if winged else ())))
    tables = {name: subtable(data, name, "top level") for name in _SECTIONS if name != "effects"}
    general = tables["aircraft"]
    aerodynamics = tables["aerodynamics"]
    sensors = tables["sensors"]
    propulsion = tables["propulsion"]
    check_keys(general, ("name", "mass", "inertia", "gravity"), "[aircraft]", ("mass", "inertia"))
    check_keys(propulsion, ("thrust_line_z", "engine_y"), "[propulsion]")
    check_keys(sensors, (*POSITIONS, "noise"), "[sensors]")
    check_keys(aerodynamics, _AERODYNAMICS, "[aerodynamics]")
    if winged and not set(aerodynamics) & {"derivatives", "tables", *_OWN}:
        raise InputError("[aerodynamics]: 'derivatives' is missing; add it")
    inertia = subtable(general, "inertia", "[aircraft]")
    check_keys(inertia, (*INERTIAS, *PRODUCTS), "[aircraft] inertia", INERTIAS)
    as_they_are = ("gravity", *POSITIONS, "relative_uncertainty")
    given = {name: value for name, value in (general | sensors | aerodynamics).items() if name in as_they_are}
    derivatives, terms, look_ups, std = (subtable(aerodynamics, name, "[aerodynamics]") for name in _PARTS)
    terms = {name: subtable(terms, name, "[aerodynamics.terms]") for name in terms}
    look_ups = read_tables(look_ups)
    named = {f"{c}_{parse_term(one, 'terms').name}" for c, row in terms.items() for one in row}
    check_keys(std, (*derivatives, *named, *(name for one in look_ups for name in one.knots)), "[aerodynamics.std]")
    return {
        "name": text(general.get("name", file.stem), "[aircraft] name"),
        "mass": in_si(general["mass"], "kg", "[aircraft] mass"),
        "inertia": Inertia(**{k: in_si(v, "kg m2", f"[aircraft] inertia: {k}") for k, v in inertia.items()}),
        **(_reference(tables["reference"]) if winged or "reference" in data else {}),
        **propulsion,
        **given,
        "noise": subtable(sensors, "noise", "[sensors]"),
        "trim": tables["trim"],
        "force_axes": _force_axes(aerodynamics.get("force_axes", "wind"), "[aerodynamics]"),
        "derivatives": derivatives,
        "terms": terms,
        "tables": look_ups,
        "std": std,
        "aerodynamics": _own(aerodynamics, file.parent),
        "rotors": read_rotors(tables["rotors"]),
        "effects": _effects(data.get("effects", [])),
    }


def _own(table: Mapping[str, Any], folder: Path) -> Aerodynamics | None:
    """The aerodynamics of another simulation's file that [aerodynamics] names, relative to the `folder` of this one."""
    where = "[aerodynamics]"
    named = [key for key in _OWN if key in table]
    if len(named) != 1:
        if named or "held" in table or "cm" in table:
            raise InputError(f'{where}: name one file beside held and cm: jsbsim = "plane.xml" or daveml = "plane.dml"')
        return None
    path = beside(folder, text(table[named[0]], f"{where} {named[0]}"), f"{where} {named[0]}")
    held = numbers_by_name(table.get("held", {}), f"{where} held")
    if "daveml" in table:
        cm = numbers(table.get("cm", (0.0, 0.0, 0.0)), f"{where} cm", 3)
        return ask_above("read_aerodynamics: daveml", path, cm, held)
    return ask_above("read_aerodynamics: jsbsim", path, held, _force_axes(table.get("force_axes", "wind"), where))


def _force_axes(axes: Any, where: str) -> str:
    """The axes of the coefficients of a file, which are not accelerations."""
    check_known("force_axes", (text(axes, f"{where} force_axes"),), ("wind", "body"), where)
    return axes


def _reference(table: Mapping[str, Any]) -> dict[str, Any]:
    check_keys(table, ("area", *_LENGTHS, "span", "chord"), "[reference]", ("area",))
    values: dict[str, Any] = {"area": in_si(table["area"], "m2", "[reference] area")}
    for length, share in (("moment_length", 1.0), ("rate_length", 0.5)):
        given = subtable(table, length, "[reference]")
        check_keys(given, ("lateral", "pitch"), f"[reference] {length}")
        for direction, full in (("lateral", "span"), ("pitch", "chord")):
            if direction in given:
                values[f"{length}_{direction}"] = in_si(given[direction], "m", f"[reference] {length}: {direction}")
            elif full in table:
                whole = in_si(table[full], "m", f"[reference] {full}")
                values[f"{length}_{direction}"] = share * number(whole, f"[reference] {full}", positive=True)
            else:
                raise InputError(f"[reference]: give {length} = {{ {direction} = ... }} or '{full}', in m")
    return values


def _effects(tables: Any) -> tuple[EffectValue, ...]:
    effects = []
    for where, table in numbered(tables, "effects"):
        check_keys(table, _EFFECT_KEYS, where, ("kind", "value"))
        for key in ("kind", "target", "term", "unit", "sentence"):
            text(table.get(key, ""), f"{where}: {key}")
        if not isinstance(table.get("records", []), list):
            raise InputError(f"{where}: records is {given(table['records'])}; expected a list of names")
        for key in ("onset_s", "parameters"):
            subtable(table, key, where)
        with of_file(where):
            effects.append(EffectValue(**table))
    return tuple(effects)


def sections_of(aircraft: Any, named: str = "") -> Iterable[tuple[str, Mapping[str, Any]]]:
    """(header, table) of the sections of its file, in their order; `named` is the file of its aerodynamics there."""
    a = aircraft
    products = () if a.inertia.symmetric else PRODUCTS
    inertia = {name: getattr(a.inertia, name) for name in (*INERTIAS, *products)}
    yield "[aircraft]", {"name": a.name, "mass": a.mass, "inertia": inertia, "gravity": a.gravity}
    if a.winged:
        moment = {"lateral": a.moment_length_lateral, "pitch": a.moment_length_pitch}
        rate = {"lateral": a.rate_length_lateral, "pitch": a.rate_length_pitch}
        yield "[reference]", {"area": a.area, "moment_length": moment, "rate_length": rate}
        yield "[propulsion]", {"thrust_line_z": a.thrust_line_z, "engine_y": a.engine_y}
    yield "[sensors]", {name: getattr(a, name) for name in POSITIONS}
    optional = (("[sensors.noise]", a.noise), ("[trim]", a.trim))
    yield from ((header, table) for header, table in optional if table)
    if a.rotors is not None:
        yield from written_rotors(a.rotors)
    if a.winged:
        general = {"force_axes": _force_axes(a.force_axes, a.name), "relative_uncertainty": a.relative_uncertainty}
        yield "[aerodynamics]", general | _written_own(a.aerodynamics, named)
    if a.derivatives or (a.winged and not a.tables):
        yield "[aerodynamics.derivatives]", a.derivatives
    if a.terms:
        yield "[aerodynamics.terms]", a.terms
    if a.std:
        yield "[aerodynamics.std]", a.std
    yield from ((f"[aerodynamics.tables.{quoted(one.name)}]", written_table(one)) for one in a.tables)
    for effect in a.effects:
        table = {key: getattr(effect, key) for key in _EFFECT_KEYS}
        yield "[[effects]]", {k: v for k, v in table.items() if k in ("value", "std") or v not in (None, "", (), {})}


def _written_own(aerodynamics: Aerodynamics | None, named: str) -> dict[str, Any]:
    if aerodynamics is None:
        return {}
    if isinstance(aerodynamics, FileAerodynamics):
        return aerodynamics.section() | {aerodynamics.format: named}
    raise InputError("its aerodynamics are a Python function, which a file cannot hold; keep the Aircraft in Python")
