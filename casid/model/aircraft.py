"""The aircraft file: mass, geometry, instruments, a-priori aerodynamics, and the effects that extend them. No dynamics.

SI units and radians throughout; body axes x forward, y right, z down, from the centre of gravity.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from casid.errors import InputError, unknown
from casid.model.aircraft_file import (
    check_keys,
    number,
    number_table,
    numbers,
    shown,
    subtable,
    text,
    toml_text,
)
from casid.model.terms import derivative_name, derivative_term, parse_term
from casid.model.vocabulary import KINDS, check_effect, effect_unit
from casid.records.toml_file import read_toml
from casid.signals import CHANNELS

AXES_COEFFICIENTS: Mapping[str, tuple[str, ...]] = {
    "wind": ("CL", "CD", "CY", "Cl", "Cm", "Cn"),
    "body": ("CX", "CZ", "CY", "Cl", "Cm", "Cn"),
}
_SECTIONS = ("aircraft", "reference", "propulsion", "sensors", "trim", "aerodynamics", "effects")
_TRIM = ("V", "altitude", "rho", "alpha", "theta", "delta_e", "delta_a", "delta_r", "thrust", "gravity")
_POSITIVE_TRIM = ("V", "rho", "gravity")
_INERTIAS = ("Ixx", "Iyy", "Izz", "Ixz")
_LENGTHS = ("moment_length", "rate_length")
_POSITIONS = ("accelerometer", "alpha_vane", "beta_vane")
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
_ORIGIN = (0.0, 0.0, 0.0)


@dataclass(frozen=True, kw_only=True)
class Inertia:
    """Inertia tensor [kg m2]: [[Ixx, 0, -Ixz], [0, Iyy, 0], [-Ixz, 0, Izz]]. InputError unless positive definite."""

    Ixx: float
    Iyy: float
    Izz: float
    Ixz: float

    def __post_init__(self) -> None:
        for name in _INERTIAS:
            value = number(getattr(self, name), f"inertia: '{name}'", positive=name != "Ixz")
            object.__setattr__(self, name, value)
        limit = math.sqrt(self.Ixx) * math.sqrt(self.Izz)
        if abs(self.Ixz) >= limit:
            raise InputError(
                f"inertia: the tensor is not positive definite, 'Ixz' must stay within +-sqrt(Ixx Izz) = {limit:.5g}, "
                f"got {self.Ixz:.5g}"
            )

    @property
    def notes(self) -> tuple[str, ...]:
        """What no rigid body can have: a principal moment above the sum of the other two. Empty when all is well."""
        mean, spread = (self.Ixx + self.Izz) / 2, math.hypot((self.Ixx - self.Izz) / 2, self.Ixz)
        principal = sorted((mean - spread, mean + spread, self.Iyy))
        if principal[2] <= (principal[0] + principal[1]) * (1.0 + 1e-12):
            return ()
        a, b, c = principal
        return (f"inertia: no rigid body has principal moments {a:.4g}, {b:.4g}, {c:.4g}: one exceeds the other two",)


@dataclass(frozen=True, kw_only=True)
class EffectValue:
    """A known effect and its size: one `[[effects]]` table.

    target      "" for a kind that has none
    term        canonical name of the monomial, for a kind that needs one; else None
    value       in `unit` (SI), which is filled in from the vocabulary; meaning and sign: `vocabulary.KINDS`
    std         1-sigma of the value; 0 when it is exact
    records     names of the records concerned; empty: all
    onset_s     record name -> interval [s] in which the effect sets in; None: always there
    parameters  further named numbers, e.g. a frequency, or the steps of further coefficients
    Raises InputError when kind, target, term and unit do not fit together.
    """

    kind: str
    target: str = ""
    term: str | None = None
    value: float
    std: float = 0.0
    unit: str = ""
    records: tuple[str, ...] = ()
    onset_s: Mapping[str, tuple[float, float]] | None = None
    parameters: Mapping[str, float] = field(default_factory=dict)
    sentence: str = ""

    def __post_init__(self) -> None:
        where = f"effect '{self.kind}'"
        if isinstance(self.records, str):
            raise InputError(f"{where}: records must be a list of names, got {shown(self.records)}")
        check_effect(self.kind, self.target, self.term)
        unit = effect_unit(self.kind, self.target, self.term)
        if self.unit not in ("", unit):
            raise InputError(f"{where}: unit {shown(self.unit)} does not fit; expected '{unit}', a value in SI")
        values = {
            "target": self.target or "",
            "term": parse_term(self.term).name if self.term else None,
            "value": number(self.value, f"{where}: value"),
            "std": number(self.std, f"{where}: std", non_negative=True),
            "unit": unit,
            "records": tuple(text(name, f"{where}: a name in records") for name in self.records),
            "onset_s": self._onsets(where),
            "parameters": number_table(self.parameters, f"{where}: parameters"),
        }
        for name, value in values.items():
            object.__setattr__(self, name, value)

    def _onsets(self, where: str) -> dict[str, tuple[float, float]] | None:
        if not self.onset_s:
            return None
        onsets = {}
        for record, interval in self.onset_s.items():
            if self.records and record not in self.records:
                raise unknown("record", record, self.records, f"{where}: onset_s")
            low, high = numbers(interval, f"{where}: onset_s of '{record}'", 2)
            if low > high:
                raise InputError(f"{where}: onset_s of '{record}' runs backwards, [{low}, {high}]; earliest time first")
            onsets[record] = (low, high)
        return onsets


@dataclass(frozen=True, kw_only=True)
class Aircraft:
    """An aircraft file. Tables are plain dicts behind read-only types, so that an Aircraft travels between processes.

    moment_length_*  [m] C = moment / (qbar area length)
    rate_length_*    [m] p* = p lateral / V, q* = q pitch / V, r* = r lateral / V
    thrust_line_z    [m] of the thrust line, down positive; engine_y [m] of each engine, right positive
    accelerometer, alpha_vane, beta_vane   positions (x, y, z) [m]
    noise            1-sigma per channel, SI; absent: estimated
    trim             V, altitude, rho, alpha, theta, surfaces, thrust, gravity, SI; what is known of them
    force_axes       "wind": CL CD CY, "body": CX CZ CY
    relative_uncertainty   a-priori 1-sigma of derivatives as a fraction; 0: no prior
    derivatives      a-priori values by name, `Cm_alpha`, `CL_0`, per rad
    terms            coefficient -> canonical monomial -> value, e.g. {"Cm": {"alpha^2": 0.4}}
    Raises InputError for everything that cannot be.
    """

    name: str
    mass: float
    inertia: Inertia
    gravity: float = 9.80665
    area: float
    moment_length_lateral: float
    moment_length_pitch: float
    rate_length_lateral: float
    rate_length_pitch: float
    thrust_line_z: float = 0.0
    engine_y: tuple[float, ...] = ()
    accelerometer: tuple[float, ...] = _ORIGIN
    alpha_vane: tuple[float, ...] = _ORIGIN
    beta_vane: tuple[float, ...] = _ORIGIN
    noise: Mapping[str, float] = field(default_factory=dict)
    trim: Mapping[str, float] = field(default_factory=dict)
    force_axes: str = "wind"
    relative_uncertainty: float = 0.0
    derivatives: Mapping[str, float]
    terms: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    effects: tuple[EffectValue, ...] = ()

    def __post_init__(self) -> None:
        lengths = ("moment_length_lateral", "moment_length_pitch", "rate_length_lateral", "rate_length_pitch")
        values: dict[str, Any] = {
            name: number(getattr(self, name), f"'{name}'", positive=True)
            for name in ("mass", "gravity", "area", *lengths)
        }
        values["thrust_line_z"] = number(self.thrust_line_z, "'thrust_line_z'")
        values["engine_y"] = numbers(self.engine_y, "'engine_y'")
        for name in _POSITIONS:
            values[name] = numbers(getattr(self, name), f"'{name}'", 3)
        values["relative_uncertainty"] = number(self.relative_uncertainty, "'relative_uncertainty'", non_negative=True)
        values["noise"] = _checked(self.noise, [c for c in CHANNELS if c != "t"], "noise", "channel", CHANNELS)
        values["trim"] = _checked(self.trim, _TRIM, "trim", "key", _POSITIVE_TRIM)
        if self.force_axes not in AXES_COEFFICIENTS:
            raise unknown("force_axes", str(self.force_axes), AXES_COEFFICIENTS)
        values["derivatives"] = self._checked_derivatives()
        values["terms"] = self._checked_terms(values["derivatives"])
        values["effects"] = tuple(self.effects)
        for effect in values["effects"]:
            if KINDS[effect.kind].of_coefficients:
                for coefficient in KINDS[effect.kind].parts(effect.target):
                    self._check_coefficient(coefficient, f"effect '{effect.kind}'")
        for name, value in values.items():
            object.__setattr__(self, name, value)

    def _check_coefficient(self, coefficient: str, where: str) -> None:
        valid = AXES_COEFFICIENTS[self.force_axes]
        if coefficient in valid:
            return
        other = "body" if self.force_axes == "wind" else "wind"
        if coefficient in AXES_COEFFICIENTS[other]:
            raise InputError(
                f'{where}: \'{coefficient}\' belongs to force_axes = "{other}", but they are "{self.force_axes}" '
                f"with {', '.join(valid)}; change one of the two"
            )
        raise unknown("coefficient", coefficient, valid, where)

    def _checked_derivatives(self) -> dict[str, float]:
        if not self.derivatives:
            raise InputError("'derivatives' is empty; give at least one, like Cm_alpha = -1.2")
        derivatives = number_table(self.derivatives, "derivatives")
        for name in derivatives:
            coefficient, term = derivative_term(name, "derivatives")
            self._check_coefficient(coefficient, f"derivatives: '{name}'")
            if term.degree > 1:
                raise InputError(
                    f"derivatives: '{name}' is not linear; write it under terms as {coefficient} = "
                    f'{{ "{term.name}" = {derivatives[name]} }}'
                )
        return derivatives

    def _checked_terms(self, derivatives: Mapping[str, float]) -> dict[str, dict[str, float]]:
        terms: dict[str, dict[str, float]] = {}
        for coefficient, given in self.terms.items():
            self._check_coefficient(coefficient, "terms")
            table = terms.setdefault(coefficient, {})
            for spelled, value in number_table(given, f"terms: '{coefficient}'").items():
                term = parse_term(spelled, f"terms: '{coefficient}'")
                name = derivative_name(coefficient, term)
                if term.name in table or name in derivatives:
                    raise InputError(f"terms: '{coefficient}': '{spelled}' stands twice, as {name}; remove one")
                table[term.name] = value
        return terms

    @property
    def coefficients(self) -> tuple[str, ...]:
        """The six coefficients of the force axes."""
        return AXES_COEFFICIENTS[self.force_axes]

    def with_derivatives(self, derivatives: Mapping[str, float]) -> Aircraft:
        """The same aircraft with derivatives replaced or added."""
        return replace(self, derivatives={**self.derivatives, **derivatives})

    def with_terms(self, terms: Mapping[str, Mapping[str, float]]) -> Aircraft:
        """The same aircraft with terms replaced or added, coefficient -> monomial -> value."""
        merged = {coefficient: dict(table) for coefficient, table in self.terms.items()}
        for coefficient, table in terms.items():
            canonical = {parse_term(name, f"terms: '{coefficient}'").name: value for name, value in table.items()}
            merged[coefficient] = {**merged.get(coefficient, {}), **canonical}
        return replace(self, terms=merged)

    def with_effects(self, effects: Iterable[EffectValue]) -> Aircraft:
        """The same aircraft with effects added to those that it has."""
        return replace(self, effects=(*self.effects, *effects))

    @classmethod
    def read(cls, path: str | Path) -> Aircraft:
        """The aircraft of a TOML file; raises InputError that names file, section, key and the nearest valid name."""
        data = read_toml(path)
        try:
            return _from_tables(data, Path(path).stem)
        except InputError as error:
            raise InputError(f"{path}: {error}") from None

    def write(self, path: str | Path) -> None:
        """Write a TOML file from which `read` makes an equal Aircraft; raises InputError when it cannot be written."""
        content = toml_text(_sections(self))
        try:
            Path(path).write_text(content, encoding="utf-8", newline="\n")
        except (OSError, UnicodeEncodeError) as error:
            raise InputError(f"{path}: cannot be written: {error}") from None


def _checked(
    table: Mapping[str, float], valid: Iterable[str], section: str, what: str, positive: Iterable[str]
) -> dict[str, float]:
    pool, above_zero = tuple(valid), tuple(positive)
    for key in table:
        if key not in pool:
            raise unknown(what, key, pool, section)
    return {key: number(v, f"{section}: '{key}'", positive=key in above_zero) for key, v in table.items()}


def _from_tables(data: Mapping[str, Any], stem: str) -> Aircraft:
    check_keys(data, _SECTIONS, "top level", ("aircraft", "reference", "aerodynamics"))
    tables = {name: subtable(data, name, "top level") for name in _SECTIONS if name != "effects"}
    general, aerodynamics, sensors = tables["aircraft"], tables["aerodynamics"], tables["sensors"]
    propulsion = tables["propulsion"]
    check_keys(general, ("name", "mass", "inertia", "gravity"), "[aircraft]", ("mass", "inertia"))
    check_keys(propulsion, ("thrust_line_z", "engine_y"), "[propulsion]")
    check_keys(sensors, (*_POSITIONS, "noise"), "[sensors]")
    allowed = ("force_axes", "relative_uncertainty", "derivatives", "terms")
    check_keys(aerodynamics, allowed, "[aerodynamics]", ("derivatives",))
    inertia = subtable(general, "inertia", "[aircraft]")
    check_keys(inertia, _INERTIAS, "[aircraft] inertia", _INERTIAS)
    given = {name: general[name] for name in ("gravity",) if name in general}
    given |= propulsion
    given |= {name: sensors[name] for name in _POSITIONS if name in sensors}
    given |= {name: aerodynamics[name] for name in ("relative_uncertainty",) if name in aerodynamics}
    terms = subtable(aerodynamics, "terms", "[aerodynamics]")
    return Aircraft(
        name=text(general.get("name", stem), "[aircraft] name"),
        mass=general["mass"],
        inertia=Inertia(**inertia),
        **_reference(tables["reference"]),
        **given,
        noise=subtable(sensors, "noise", "[sensors]"),
        trim=tables["trim"],
        force_axes=text(aerodynamics.get("force_axes", "wind"), "[aerodynamics] force_axes"),
        derivatives=subtable(aerodynamics, "derivatives", "[aerodynamics]"),
        terms={name: subtable(terms, name, "[aerodynamics.terms]") for name in terms},
        effects=_effects(data.get("effects", [])),
    )


def _reference(table: Mapping[str, Any]) -> dict[str, Any]:
    check_keys(table, ("area", *_LENGTHS, "span", "chord"), "[reference]", ("area",))
    values: dict[str, Any] = {"area": table["area"]}
    for length, share in (("moment_length", 1.0), ("rate_length", 0.5)):
        given = subtable(table, length, "[reference]")
        check_keys(given, ("lateral", "pitch"), f"[reference] {length}")
        for direction, full in (("lateral", "span"), ("pitch", "chord")):
            if direction in given:
                values[f"{length}_{direction}"] = given[direction]
            elif full in table:
                values[f"{length}_{direction}"] = share * number(table[full], f"[reference] {full}", positive=True)
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
            raise InputError(f"{where}: records must be a list of names, got {shown(table['records'])}")
        for key in ("onset_s", "parameters"):
            subtable(table, key, where)
        try:
            effects.append(EffectValue(**table))
        except InputError as error:
            raise InputError(f"{where}: {error}") from None
    return tuple(effects)


def _sections(aircraft: Aircraft) -> Iterable[tuple[str, Mapping[str, Any]]]:
    a = aircraft
    inertia = {name: getattr(a.inertia, name) for name in _INERTIAS}
    yield "[aircraft]", {"name": a.name, "mass": a.mass, "inertia": inertia, "gravity": a.gravity}
    moment = {"lateral": a.moment_length_lateral, "pitch": a.moment_length_pitch}
    rate = {"lateral": a.rate_length_lateral, "pitch": a.rate_length_pitch}
    yield "[reference]", {"area": a.area, "moment_length": moment, "rate_length": rate}
    yield "[propulsion]", {"thrust_line_z": a.thrust_line_z, "engine_y": a.engine_y}
    yield "[sensors]", {name: getattr(a, name) for name in _POSITIONS}
    optional = (("[sensors.noise]", a.noise), ("[trim]", a.trim))
    yield from ((header, table) for header, table in optional if table)
    yield "[aerodynamics]", {"force_axes": a.force_axes, "relative_uncertainty": a.relative_uncertainty}
    yield "[aerodynamics.derivatives]", a.derivatives
    if a.terms:
        yield "[aerodynamics.terms]", a.terms
    for effect in a.effects:
        table = {key: getattr(effect, key) for key in _EFFECT_KEYS}
        yield "[[effects]]", {k: v for k, v in table.items() if k in ("value", "std") or v not in (None, "", (), {})}
