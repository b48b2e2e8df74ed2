"""DAVE-ML files: an aircraft from one of aerodynamics and one of mass properties, and the first corrected by flight.

Names, units and axes are those of the standard (ANSI/AIAA S-119). Surfaces have the signs of the file.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any, ClassVar

import casadi as ca
import numpy as np

from casid.arguments import number
from casid.errors import InputError, check_known
from casid.formats.daveml.functions import DaveFile, Values, dave_file
from casid.formats.file_tables import FileTable, Tried, blanked, comment, holding, said, with_numbers
from casid.formats.jsbsim.aircraft import on_top
from casid.model.airframe import Inertia
from casid.model.effect_value import EffectValue
from casid.model.tables import Table
from casid.records.limits import of_file, read_text_of
from casid.signals import DEGREE, FOOT, POUND, SLUG

# unit of a file -> its size in SI and radians
_UNITS: dict[str, float] = dict.fromkeys(("nd", "m", "m2", "m_s", "rad", "rad_s", "kg", "kgm2"), 1.0)
_UNITS |= {"ft": FOOT, "ft2": FOOT**2, "ft_s": FOOT, "deg": DEGREE, "deg_s": DEGREE}
_UNITS |= {"slug": SLUG, "lbm": POUND, "slugft2": SLUG * FOOT**2}
# input of the standard -> (quantities of `Aircraft.aerodynamics`, rate lengths) -> SI
_INPUTS: Mapping[str, Callable[[Any, Any], Any]] = {
    "trueAirspeed": lambda s, own: s.airspeed,
    "mach": lambda s, own: s.mach,
    "angleOfAttack": lambda s, own: s.alpha,
    "angleOfSideslip": lambda s, own: s.beta,
    "bodyAngularRate_Roll": lambda s, own: s.p * s.airspeed / own.lateral,
    "bodyAngularRate_Pitch": lambda s, own: s.q * s.airspeed / own.pitch,
    "bodyAngularRate_Yaw": lambda s, own: s.r * s.airspeed / own.lateral,
    "elevatorDeflection": lambda s, own: s.delta_e,
    "aileronDeflection": lambda s, own: s.delta_a,
    "rudderDeflection": lambda s, own: s.delta_r,
}
_FORCES = tuple(f"aeroBodyForceCoefficient_{axis}" for axis in "XYZ")
_MOMENTS = tuple(f"aeroBodyMomentCoefficient_{axis}" for axis in ("Roll", "Pitch", "Yaw"))
_ARM = tuple(f"bodyPositionOfCmWrtMrc_{axis}" for axis in "XYZ")
_INERTIA = {"Ixx": "bodyMomentOfInertia_Roll", "Iyy": "bodyMomentOfInertia_Pitch", "Izz": "bodyMomentOfInertia_Yaw"}
_INERTIA |= {"Ixz": "bodyProductOfInertia_ZX"}


@dataclass(frozen=True, kw_only=True)
class DaveAerodynamics:
    """Aerodynamics of a DAVE-ML file."""

    format: ClassVar[str] = "daveml"

    # path, text: the file;  held  pairs of varID and value, in the unit of the file, of inputs that no record has
    path: str
    text: str = field(repr=False)
    cm: tuple[float, float, float]  # centre of mass [m] from the moment reference centre of the file, body axes
    lateral: float  # lateral, pitch: rate lengths [m];  span, chord  [m] of its coefficients
    pitch: float
    held: tuple[tuple[str, float], ...] = ()

    def __call__(self, s: Any) -> dict[str, Any]:
        """Body-axes coefficients about the centre of mass. Raises InputError."""
        return self._coefficients(s)[0]

    def section(self) -> dict[str, Any]:
        """Keys and values of [aerodynamics] from which these aerodynamics are read again."""
        return {"daveml": self.path, "cm": self.cm, "held": dict(self.held)}

    @property
    def notes(self) -> tuple[str, ...]:
        """None: all inputs of the file are recorded or held by the user."""
        return ()

    @cached_property
    def _tried(self) -> Tried:
        functions = dave_file(self.text).functions()

        def look_up(s: Any, marks: ca.SX) -> tuple[dict[str, Any], Values]:
            return self._coefficients(s, dict(zip(functions, ca.vertsplit(marks), strict=True)))

        return Tried(list(functions.values()), look_up)

    @property
    def tables(self) -> tuple[Table, ...]:
        """The tables of the file that are over regressors, and enter a coefficient as they are or times a term."""
        return tuple(one.table for one in self._tried.tables)

    def of_table(self, one: Table, s: Mapping[str, Any]) -> dict[str, Any]:
        """Coefficient -> by how much it grows with the values of one of `tables`, as a part of its own coefficient:
        forces have moments about the centre of mass. Expressions in the quantities of `Aircraft.aerodynamics`."""
        return self._tried.of_table(one, s)

    def rewritten(self, text: str, terms: Mapping[str, Mapping[str, float]], effects: Sequence[EffectValue]) -> str:
        """The `text` of the file, its tables corrected; see `mended_text`."""
        return mended_text(text, self._tried.tables, effects, terms)

    def __getstate__(self) -> dict[str, Any]:
        return {f.name: getattr(self, f.name) for f in fields(self)}  # what is cached is found again

    def _coefficients(self, s: Any, added: Mapping[str, Any] = MappingProxyType({})) -> tuple[dict[str, Any], Values]:
        file = dave_file(self.text)
        given: dict[str, Any] = dict(self.held)
        for varid, name in file.named.items():
            if varid in file.inputs and varid not in given:
                if name not in _INPUTS:
                    raise InputError(
                        f"{self.path}: input '{name}' is in no record; hold it: held = {{\"{varid}\": 0.0}}"
                    )
                given[varid] = ca.SX(_INPUTS[name](s, self)) / _unit(file, varid)
        with of_file(self.path):
            look = file.values({name: ca.SX(value) for name, value in given.items()}, added)
            fx, fy, fz, roll, pitch, yaw = (look(file.varid(name)) for name in (*_FORCES, *_MOMENTS))
        b = 2.0 * self.lateral
        c = 2.0 * self.pitch
        x, y, z = self.cm
        return {
            "CX": fx,
            "CY": fy,
            "CZ": fz,
            "Cl": roll - (y * fz - z * fy) / b,
            "Cm": pitch - (z * fx - x * fz) / c,
            "Cn": yaw - (x * fy - y * fx) / b,
        }, look


def fields_of_daveml(aerodynamics: str | Path, inertia: str | Path, held: Mapping[str, float]) -> dict[str, Any]:
    """Fields of `Aircraft`, with zero increments for derivatives. Raises InputError for what cannot be read."""
    mass = _read(inertia)
    with of_file(inertia):
        given = {v: number(held[v], f"held: '{v}'") for v in mass.inputs if v in held}
        look = mass.values({name: ca.SX(value) for name, value in given.items()})
        tensor = {name: _si(mass, look, standard) for name, standard in _INERTIA.items()}
        weight = _si(mass, look, "totalMass")
        cm = tuple(_si(mass, look, name) for name in _ARM)
    own = dave_aerodynamics(aerodynamics, cm, {name: value for name, value in held.items() if name not in given})
    file = dave_file(own.text)
    return {
        "name": Path(aerodynamics).stem,
        "mass": weight,
        "inertia": Inertia(**tensor),
        "area": _si(file, file.values({}), "referenceWingArea"),
        **on_top(2.0 * own.lateral, 2.0 * own.pitch, {"CL": "CZ", "CD": "CX"}),
        "force_axes": "body",
        "aerodynamics": own,
    }


def dave_aerodynamics(
    path: str | Path, cm: tuple[float, ...], held: Mapping[str, float] = MappingProxyType({})
) -> DaveAerodynamics:
    """The aerodynamics of a file, moments about a centre of mass [m] from its reference. Raises InputError."""
    file = _read(path)
    check_known("input", held, file.inputs, f"{path}: held")
    if len(cm) != 3:
        raise InputError(f"{path}: the centre of mass must be three numbers, got {len(cm)}")
    with of_file(path):
        look = file.values({})
        span, chord = (_si(file, look, name) for name in ("referenceWingSpan", "referenceWingChord"))
    return DaveAerodynamics(
        path=str(Path(path).resolve()),
        text=read_text_of(Path(path)),
        cm=(cm[0], cm[1], cm[2]),
        lateral=span / 2.0,
        pitch=chord / 2.0,
        held=tuple(sorted((name, number(value, f"held: '{name}'")) for name, value in held.items())),
    )


def _read(path: str | Path) -> DaveFile:
    text = read_text_of(Path(path))
    with of_file(path):
        return dave_file(text)


def _unit(file: DaveFile, varid: str) -> float:
    check_known(f"unit of '{varid}'", (file.units[varid],), _UNITS)
    return _UNITS[file.units[varid]]


def _si(file: DaveFile, look: Values, name: str) -> float:
    """A constant of the file in SI."""
    varid = file.varid(name)
    return float(ca.evalf(ca.SX(look(varid)))) * _unit(file, varid)


_FUNCTION = re.compile(r"<((?:\w+:)?function)\b[^>]*>(.*?)</\1\s*>", re.DOTALL)
_REFERENCE = re.compile(r"<(?:\w+:)?griddedTableRef\b[^>]*\bgtID\s*=\s*[\"']([^\"']*)[\"']")
_DATA = re.compile(r"<((?:\w+:)?dataTable)\b[^>]*>(.*?)</\1\s*>", re.DOTALL)
_END = re.compile(r"</(?:\w+:)?DAVEfunc\s*>")


def mended_text(
    text: str, tables: Sequence[FileTable], effects: Sequence[EffectValue], terms: Mapping[str, Mapping[str, float]]
) -> str:
    """The text of a file with wrong stretches of its tables corrected in place; `terms`, coefficient -> monomial
    -> value, no table of it can have."""
    left: list[str] = []
    for effect in effects:
        held = None if effect.records or effect.onset_s else holding(tables, effect)
        if held is None:
            left.append(said(effect, "has no place in a table of a DAVE-ML file"))
        else:
            text = _with_changed_table(text, held, held.share(effect.term or "0") * (effect.value / held.gain))
    left += [f"{c}: {value:.6g} times {term}" for c, row in terms.items() for term, value in row.items() if value]
    if left:
        end = list(_END.finditer(blanked(text)))[-1].start()
        text = text[:end] + comment(left) + text[end:]
    dave_file(text)
    return text


def _with_changed_table(text: str, one: FileTable, change: np.ndarray) -> str:
    varid = list(dave_file(text).functions())[one.index]
    blank = blanked(text)
    gives = re.compile(rf"<(?:\w+:)?dependentVarRef\b[^>]*\bvarID\s*=\s*[\"']{re.escape(varid)}[\"']")
    region = next(found for found in _FUNCTION.finditer(blank) if gives.search(found[2]))
    data = _DATA.search(blank, *region.span(2))
    if data is None and (reference := _REFERENCE.search(region[2])) is not None:
        named = re.compile(rf"<(?:\w+:)?griddedTableDef\b[^>]*\bgtID\s*=\s*[\"']{re.escape(reference[1])}[\"']")
        data = next((_DATA.search(blank, found.end()) for found in named.finditer(blank)), None)
    if data is None:
        raise InputError(f"table '{one.table.name}' has no dataTable")
    spans = [(data.start(2) + n.start(), data.start(2) + n.end()) for n in re.finditer(r"[^\s,]+", data[2])]
    return with_numbers(text, [(span, float(by)) for span, by in zip(spans, change.ravel(), strict=True) if by])
