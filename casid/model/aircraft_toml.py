"""An aircraft and its TOML file: the tables of the file as fields of `Aircraft`, and back."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from casid.arguments import given, number, numbers_by_name
from casid.errors import InputError
from casid.model.aerodynamics import Aerodynamics
from casid.model.aircraft_file import check_keys, numbers, quoted, subtable, text
from casid.model.airframe import INERTIAS, PRODUCTS, Inertia
from casid.model.daveml import DaveAerodynamics, dave_aerodynamics
from casid.model.effect_value import EffectValue
from casid.model.jsbsim import JsbsimAerodynamics, aerodynamics_of
from casid.model.quantities import in_si
from casid.model.tables import read_tables, written_table

POSITIONS = ("accelerometer", "alpha_vane", "beta_vane")
_SECTIONS = ("aircraft", "reference", "propulsion", "sensors", "trim", "aerodynamics", "effects")
_AERODYNAMICS = (
    "force_axes",
    "relative_uncertainty",
    "derivatives",
    "terms",
    "tables",
    "jsbsim",
    "daveml",
    "held",
    "cm",
)
_LENGTHS = ("moment_length", "rate_length")
_EFFECT_KEYS = (
    "kind",
    "target",
    "term",
    "value",
    "std",
    "unit",
    "records",
    "onset_s",
    "parameters",
    "sentence",
)


def fields_of(data: Mapping[str, Any], file: Path) -> dict[str, Any]:
    """The fields of `Aircraft` that the tables of `file` give. Raises InputError."""
    check_keys(data, _SECTIONS, "top level", ("aircraft", "reference", "aerodynamics"))
    tables = {name: subtable(data, name, "top level") for name in _SECTIONS if name != "effects"}
    general, aerodynamics, sensors = tables["aircraft"], tables["aerodynamics"], tables["sensors"]
    propulsion = tables["propulsion"]
    check_keys(general, ("name", "mass", "inertia", "gravity"), "[aircraft]", ("mass", "inertia"))
    check_keys(propulsion, ("thrust_line_z", "engine_y"), "[propulsion]")
    check_keys(sensors, (*POSITIONS, "noise"), "[sensors]")
    check_keys(aerodynamics, _AERODYNAMICS, "[aerodynamics]")
    if not set(aerodynamics) & {"derivatives", "tables", "jsbsim", "daveml"}:
        raise InputError("[aerodynamics]: 'derivatives' is missing; add it")
    inertia = subtable(general, "inertia", "[aircraft]")
    check_keys(inertia, (*INERTIAS, *PRODUCTS), "[aircraft] inertia", INERTIAS)
    given = {name: general[name] for name in ("gravity",) if name in general}
    given |= propulsion
    given |= {name: sensors[name] for name in POSITIONS if name in sensors}
    given |= {name: aerodynamics[name] for name in ("relative_uncertainty",) if name in aerodynamics}
    terms = subtable(aerodynamics, "terms", "[aerodynamics]")
    return {
        "name": text(general.get("name", file.stem), "[aircraft] name"),
        "mass": in_si(general["mass"], "kg", "[aircraft] mass"),
        "inertia": Inertia(**{k: in_si(v, "kg m2", f"[aircraft] inertia: {k}") for k, v in inertia.items()}),
        **_reference(tables["reference"]),
        **given,
        "noise": subtable(sensors, "noise", "[sensors]"),
        "trim": tables["trim"],
        "force_axes": text(aerodynamics.get("force_axes", "wind"), "[aerodynamics] force_axes"),
        "derivatives": subtable(aerodynamics, "derivatives", "[aerodynamics]"),
        "terms": {name: subtable(terms, name, "[aerodynamics.terms]") for name in terms},
        "tables": read_tables(subtable(aerodynamics, "tables", "[aerodynamics]")),
        "aerodynamics": _own(aerodynamics, file.parent),
        "effects": _effects(data.get("effects", [])),
    }


def _own(table: Mapping[str, Any], folder: Path) -> Aerodynamics | None:
    """The aerodynamics of another simulation's file that [aerodynamics] names, relative to the `folder` of this one."""
    where = "[aerodynamics]"
    named = [key for key in ("jsbsim", "daveml") if key in table]
    if len(named) != 1:
        if named or "held" in table or "cm" in table:
            raise InputError(f'{where}: name one file beside held and cm: jsbsim = "plane.xml" or daveml = "plane.dml"')
        return None
    path = folder / text(table[named[0]], f"{where} {named[0]}")
    held = numbers_by_name(table.get("held", {}), f"{where} held")
    if "daveml" in table:
        return dave_aerodynamics(path, numbers(table.get("cm", (0.0, 0.0, 0.0)), f"{where} cm", 3), held)
    return aerodynamics_of(path, held, text(table.get("force_axes", "wind"), f"{where} force_axes"))


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
    if not isinstance(tables, list) or not all(isinstance(table, dict) for table in tables):
        raise InputError("effects are written as [[effects]] tables, with double brackets")
    effects = []
    for position, table in enumerate(tables, start=1):
        where = f"[[effects]] number {position}"
        check_keys(table, _EFFECT_KEYS, where, ("kind", "value"))
        for key in ("kind", "target", "term", "unit", "sentence"):
            text(table.get(key, ""), f"{where}: {key}")
        if not isinstance(table.get("records", []), list):
            raise InputError(f"{where}: records is {given(table['records'])}; expected a list of names")
        for key in ("onset_s", "parameters"):
            subtable(table, key, where)
        try:
            effects.append(EffectValue(**table))
        except InputError as error:
            raise InputError(f"{where}: {error}") from None
    return tuple(effects)


def sections_of(aircraft: Any) -> Iterable[tuple[str, Mapping[str, Any]]]:
    """(header, table) of the sections of its file, in their order."""
    a = aircraft
    products = () if a.inertia.symmetric else PRODUCTS
    inertia = {name: getattr(a.inertia, name) for name in (*INERTIAS, *products)}
    yield "[aircraft]", {"name": a.name, "mass": a.mass, "inertia": inertia, "gravity": a.gravity}
    moment = {"lateral": a.moment_length_lateral, "pitch": a.moment_length_pitch}
    rate = {"lateral": a.rate_length_lateral, "pitch": a.rate_length_pitch}
    yield "[reference]", {"area": a.area, "moment_length": moment, "rate_length": rate}
    yield "[propulsion]", {"thrust_line_z": a.thrust_line_z, "engine_y": a.engine_y}
    yield "[sensors]", {name: getattr(a, name) for name in POSITIONS}
    optional = (("[sensors.noise]", a.noise), ("[trim]", a.trim))
    yield from ((header, table) for header, table in optional if table)
    general = {"force_axes": a.force_axes, "relative_uncertainty": a.relative_uncertainty}
    yield "[aerodynamics]", general | _written_own(a.aerodynamics)
    if a.derivatives or not a.tables:
        yield "[aerodynamics.derivatives]", a.derivatives
    if a.terms:
        yield "[aerodynamics.terms]", a.terms
    yield from ((f"[aerodynamics.tables.{quoted(one.name)}]", written_table(one)) for one in a.tables)
    for effect in a.effects:
        table = {key: getattr(effect, key) for key in _EFFECT_KEYS}
        yield "[[effects]]", {k: v for k, v in table.items() if k in ("value", "std") or v not in (None, "", (), {})}


def _written_own(aerodynamics: Aerodynamics | None) -> dict[str, Any]:
    if aerodynamics is None:
        return {}
    if isinstance(aerodynamics, JsbsimAerodynamics):
        return {"jsbsim": aerodynamics.path, "held": dict(aerodynamics.held)}
    if isinstance(aerodynamics, DaveAerodynamics):
        return {"daveml": aerodynamics.path, "cm": aerodynamics.cm, "held": dict(aerodynamics.held)}
    raise InputError("its aerodynamics are a Python function, which a file cannot hold; keep the Aircraft in Python")
