"""The aircraft file: mass, geometry, instruments, a-priori aerodynamics, and the effects that extend them. No dynamics.

SI units and radians throughout; body axes x forward, y right, z down, from the centre of gravity.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

from casid.above import ask_above
from casid.arguments import Kind, a_path, given, is_path, number, numbers_by_name, one_line, require, sequence, table_of
from casid.errors import InputError, check_known, unknown
from casid.frames import brief
from casid.keeping import whole_file
from casid.model.aerodynamics import FileAerodynamics
from casid.model.aircraft_file import numbers, toml_text
from casid.model.aircraft_toml import fields_of, sections_of, with_comments_of
from casid.model.airframe import AXES_COEFFICIENTS, POSITIONS, Airframe, Inertia
from casid.model.effect import KINDS
from casid.model.effect_value import EffectValue
from casid.model.rotors import ALL, Rotors
from casid.model.tables import Table
from casid.model.terms import derivative_name, derivative_term, parse_term
from casid.model.vocabulary import check_effect
from casid.records.limits import of_file, read_toml
from casid.signals import CHANNELS

_TRIM = ("V", "altitude", "rho", "alpha", "theta", "delta_e", "delta_a", "delta_r", "thrust", "gravity")
_POSITIVE_TRIM = ("V", "rho", "gravity")
_FILES = {".xml": "jsbsim", ".dml": "daveml"}  # ending of another simulator's file -> its format


@dataclass(frozen=True, kw_only=True)
class Aircraft(Airframe):
    """An aircraft file. Tables are plain dicts behind read-only types, so that an Aircraft travels between processes.

    Attributes
    ----------
    name, mass, inertia, gravity, area
        What it is called, and its mass [kg], inertia, gravity [m/s2] and wing area [m2]. Area and lengths may be left
        out where there are rotors and no aerodynamics.
    moment_length_lateral, moment_length_pitch
        Lengths of the moment coefficients [m]: C = moment / (qbar area length).
    rate_length_lateral, rate_length_pitch
        Lengths of the dimensionless rates [m]: p = p lateral / V, q = q pitch / V, r = r lateral / V.
    thrust_line_z
        Of the thrust line [m], down positive.
    engine_y
        Of each engine [m], right positive.
    accelerometer, alpha_vane, beta_vane
        Positions (x, y, z) [m].
    noise
        1-sigma per channel, SI; absent: estimated.
    trim
        V, altitude, rho, alpha, theta, surfaces, thrust, gravity, SI; what is known of them.
    force_axes
        "wind": CL CD CY, "body": CX CZ CY; "accelerations": these and the moments are accelerations [m/s2] and
        [rad/s2] in body axes that do not follow the airspeed, without thrust, of a motion of which nothing is known.
    relative_uncertainty
        A-priori 1-sigma of derivatives as a fraction; 0: no prior.
    derivatives
        A-priori values by name, `Cm_alpha`, `CL_0`, per rad.
    terms
        Coefficient -> canonical monomial -> value, e.g. {"Cm": {"alpha^2": 0.4}}.
    tables
        Look-ups that are added to coefficients, see `table`.
    std
        1-sigma of estimated derivatives, terms and values of free tables by name, `Cm_alpha`, `Cm_alpha^2`. `modes` and
        exports write it in place of `relative_uncertainty`; fits do not take it as a prior.
    aerodynamics
        A function of a namespace of regressors (`alpha`, `q`, `delta_e`, ... as in `terms`; `airspeed` [m/s], `qbar`
        [Pa], `rho`, `thrust` [N]) that returns CasADi expressions of coefficients by name. Derivatives, terms and
        tables are added to what it returns.
    rotors
        The rotors, beside a wing (VTOL) or alone (multirotor).

    Raises
    ------
    InputError
        For everything that cannot be.

    Examples
    --------
    >>> import casid as cs
    >>> aircraft = cs.Aircraft.read("casid/cli/demo/aircraft.toml")
    >>> aircraft.mass, aircraft.derivatives["Cm_alpha"]
    (14469.6, -2.14)
    """

    effects: tuple[EffectValue, ...] = ()

    __repr__ = brief

    def __post_init__(self) -> None:
        lengths = ("moment_length_lateral", "moment_length_pitch", "rate_length_lateral", "rate_length_pitch")
        if self.rotors is not None:
            require(self.rotors, Rotors, "'rotors'", "cs.Rotors(each=[cs.Rotor(...), ...])")
        values: dict[str, Any] = {"name": one_line(self.name, "'name'")}
        require(self.inertia, Inertia, "'inertia'", "cs.Inertia(Ixx=..., Iyy=..., Izz=..., Ixz=...)")
        table_of(self.derivatives, "derivatives", "{'Cm_alpha': -1.2}")
        table_of(self.terms, "terms", "{'Cm': {'alpha^2': 0.4}}")
        sequence(self.tables, "tables", "[cs.table(...)]")
        unused = [name for name in ("area", *lengths) if not self.winged and getattr(self, name) is math.nan]
        values |= {
            name: 1.0 if name in unused else number(getattr(self, name), f"'{name}'", positive=True)
            for name in ("mass", "gravity", "area", *lengths)
        }
        values["thrust_line_z"] = number(self.thrust_line_z, "'thrust_line_z'")
        values["engine_y"] = numbers(self.engine_y, "'engine_y'")
        for name in POSITIONS:
            values[name] = numbers(getattr(self, name), f"'{name}'", 3)
        values["relative_uncertainty"] = number(self.relative_uncertainty, "'relative_uncertainty'", least=0.0)
        values["noise"] = _checked(self.noise, [c for c in CHANNELS if c != "t"], "noise", "channel", CHANNELS)
        values["trim"] = _checked(self.trim, _TRIM, "trim", "key", _POSITIVE_TRIM)
        if one_line(self.force_axes, "'force_axes'") not in AXES_COEFFICIENTS:
            raise unknown("force_axes", self.force_axes, AXES_COEFFICIENTS)
        if not (self.aerodynamics is None or callable(self.aerodynamics)):
            raise InputError(f"'aerodynamics' is {given(self.aerodynamics)}; expected a function of the regressors")
        values["tables"] = self._checked_tables()
        values["derivatives"] = self._checked_derivatives(values["tables"])
        values["terms"] = self._checked_terms(values["derivatives"])
        std = table_of(self.std, "std", "{'Cm_alpha': 0.1}")
        values["std"] = {name: number(one, f"std: '{name}'", least=0.0) for name, one in std.items()}
        values["effects"] = _several(self.effects, EffectValue, "effects", "[cs.EffectValue(kind=..., value=...)]")
        for effect in values["effects"]:
            kind = KINDS[effect.kind]
            where = f"effect '{effect.kind}'"
            if kind.of_coefficients:
                for coefficient in kind.parts(effect.target):
                    self._check_coefficient(coefficient, where)
            elif kind.of_rotors and effect.target not in kind.targets:
                own = self.rotors.names if self.rotors else ()
                check_known("rotor", kind.parts(effect.target), (*own, ALL), where)
            elif kind.place != "aircraft":
                check_effect(effect.kind, effect.target, effect.term)
        for name, value in values.items():
            object.__setattr__(self, name, value)

    def _check_coefficient(self, coefficient: str, where: str) -> None:
        valid = self.coefficients
        if coefficient in valid:
            return
        other = "body" if self.force_axes == "wind" else "wind"
        if coefficient in AXES_COEFFICIENTS[other]:
            raise InputError(
                f'{where}: \'{coefficient}\' belongs to force_axes = "{other}", but they are "{self.force_axes}" '
                f"with {', '.join(valid)}; change one of the two"
            )
        raise unknown("coefficient", coefficient, valid, where)

    def _checked_derivatives(self, tables: tuple[Table, ...]) -> dict[str, float]:
        if self.rotors is not None and not self.winged:
            return {}
        derivatives = numbers_by_name(self.derivatives, "derivatives")
        if not (derivatives or tables or self.aerodynamics):
            raise InputError("'derivatives' is empty; give at least one, like Cm_alpha = -1.2")
        for name in derivatives:
            coefficient, term = derivative_term(name, "derivatives")
            self._check_coefficient(coefficient, f"derivatives: '{name}'")
            if not term.linear:
                raise InputError(
                    f"derivatives: '{name}' is not linear; write it under terms as {coefficient} = "
                    f'{{ "{term.name}" = {derivatives[name]} }}'
                )
        return derivatives

    def _checked_terms(self, derivatives: Mapping[str, float]) -> dict[str, dict[str, float]]:
        terms: dict[str, dict[str, float]] = {}
        for coefficient, row in table_of(self.terms, "terms", "{'Cm': {'alpha^2': 0.4}}").items():
            self._check_coefficient(coefficient, "terms")
            table = terms.setdefault(coefficient, {})
            for spelled, value in numbers_by_name(row, f"terms: '{coefficient}'").items():
                term = parse_term(spelled, f"terms: '{coefficient}'")
                name = derivative_name(coefficient, term)
                if term.name in table or name in derivatives:
                    raise InputError(f"terms: '{coefficient}': '{spelled}' stands twice, as {name}; remove one")
                table[term.name] = value
        return terms

    def _checked_tables(self) -> tuple[Table, ...]:
        tables = _several(self.tables, Table, "tables", "[cs.table(...)]")
        names = [one.name for one in tables]
        for one in tables:
            self._check_coefficient(one.coefficient, f"table '{one.name}'")
            if names.count(one.name) > 1:
                raise InputError(f"table '{one.name}' stands twice; give each a name of its own")
        return tables

    @property
    def notes(self) -> tuple[str, ...]:
        """List remarks: an impossible inertia, and what the file of another simulator leaves out."""
        own = self.aerodynamics.notes if isinstance(self.aerodynamics, FileAerodynamics) else ()
        return (*self.inertia.notes, *own)

    @property
    def knots(self) -> dict[str, str]:
        """Name of each value of a free table -> its coefficient."""
        return {name: one.coefficient for one in self.tables if one.free for name in one.knots}

    def with_derivatives(self, derivatives: Mapping[str, float]) -> Aircraft:
        """The same aircraft with derivatives [per rad] replaced or added, name -> value."""
        return replace(self, derivatives={**self.derivatives, **derivatives})

    def with_terms(self, terms: Mapping[str, Mapping[str, float]]) -> Aircraft:
        """The same aircraft with terms replaced or added, like ``{"Cm": {"alpha^2": 0.4}}``."""
        merged = {coefficient: dict(table) for coefficient, table in self.terms.items()}
        for coefficient, table in terms.items():
            canonical = {parse_term(name, f"terms: '{coefficient}'").name: value for name, value in table.items()}
            merged[coefficient] = {**merged.get(coefficient, {}), **canonical}
        return replace(self, terms=merged)

    def with_effects(self, effects: Iterable[EffectValue]) -> Aircraft:
        """The same aircraft with effects added to those that it has."""
        return replace(self, effects=(*self.effects, *effects))

    @classmethod
    def from_jsbsim(cls, path: str | Path, held: Mapping[str, float] = MappingProxyType({})) -> Aircraft:
        """The aircraft of a JSBSim file: its metrics, mass balance and aerodynamics, as they are.

        Parameters
        ----------
        path : path
            The XML of the aircraft, `<fdm_config>`.
        held : mapping of str to float
            Values of properties, in JSBSim's units, that the recorded surfaces do not decide: `fcs/flap-pos-deg`, ...
            Without it they are what the file sets, or 0; gear is up where it can be retracted.

        Returns
        -------
        Aircraft
            With derivatives of zero, increments on top of what the file has. Recorded surfaces replace the control
            system (delta_a is the left aileron, the right one its negative), recorded thrust for the engines;
            `notes` lists what is held and left out.

        Raises
        ------
        InputError
            For a function or property that cannot be had without JSBSim.
        """
        return cls(**ask_above("Aircraft.from_jsbsim", path, held))

    @classmethod
    def from_daveml(
        cls, aerodynamics: str | Path, inertia: str | Path, held: Mapping[str, float] = MappingProxyType({})
    ) -> Aircraft:
        """The aircraft of two DAVE-ML files (ANSI/AIAA S-119): its aerodynamics, and its mass properties.

        Parameters
        ----------
        aerodynamics, inertia : path
            The files; variables are known by the names of the standard.
        held : mapping of str to float
            Values of inputs that no record has, by varID, in the units of the file.

        Returns
        -------
        Aircraft
            In body axes, with derivatives of zero, increments on top of what the file has. Surfaces have the signs that
            the file gives them; moments are about the centre of mass.

        Raises
        ------
        InputError
            For what cannot be read, an unknown unit, or an input that no record has and that is not held.
        """
        return cls(**ask_above("Aircraft.from_daveml", aerodynamics, inertia, held))

    @classmethod
    def read(cls, path: str | Path) -> Aircraft:
        """The aircraft of a TOML file, or of JSBSim's XML; raises InputError that names file, section, key and the
        nearest valid name.

        Parameters
        ----------
        path
            Name of the file, ``.toml`` or ``.xml``.
        """
        if a_path(path, "Aircraft.read").suffix.lower() == ".xml":
            return cls.from_jsbsim(path)
        data = read_toml(path)
        with of_file(path):
            return cls(**fields_of(data, Path(path)))

    def write(self, path: str | Path, *, like: str | Path | None = None) -> None:
        """Write a TOML file from which `read` makes an equal Aircraft. The aerodynamics of another simulation's file
        are copied beside it, unless they lie there or below.

        Under a name that ends in .xml an aircraft of a JSBSim file is written as that file again: derivatives and
        terms as further functions, effects as parts. Wrong stretches of its tables are corrected in place.
        What such a file cannot hold is a comment of it. Under one in .dml the aerodynamics of a DAVE-ML file are
        written likewise, with its tables corrected.

        Parameters
        ----------
        path
            The file to write.
        like
            An aircraft file whose comments, layout and order the new one keeps, such as the one that was read.

        Raises
        ------
        InputError
            When `path` cannot be written or `like` cannot be read.
        """
        suffix = a_path(path, "Aircraft.write").suffix.lower()
        content = (
            self._as_own_file(path) if suffix in _FILES else toml_text(sections_of(self, self._beside(Path(path))))
        )
        if like is not None:
            read_toml(like)  # its faults in words
            content = with_comments_of(Path(like).read_text(encoding="utf-8"), content)
        try:
            with whole_file(path) as temporary:
                temporary.write_text(content, encoding="utf-8", newline="\n")
        except UnicodeEncodeError as error:
            raise InputError(f"{path}: cannot be written: {error}") from None

    def _beside(self, path: Path) -> str:
        """Name the file of its aerodynamics as the one at `path` names it, and copy it there from elsewhere."""
        own = self.aerodynamics
        folder = path.parent.resolve()
        if not isinstance(own, FileAerodynamics):
            return ""
        source = Path(own.path)
        if source.is_relative_to(folder):
            return source.relative_to(folder).as_posix()
        copy = folder / source.name
        if copy.exists() and not (copy.is_file() and copy.read_text(encoding="utf-8") == own.text):
            copy = folder / f"{path.stem}-{source.name}"
        with whole_file(copy) as temporary:
            temporary.write_text(own.text, encoding="utf-8", newline="\n")
        return copy.name

    def _as_own_file(self, path: str | Path) -> str:
        own = self.aerodynamics
        wanted = _FILES[Path(path).suffix.lower()]
        if not isinstance(own, FileAerodynamics) or own.format != wanted or self.tables:
            raise InputError(
                f"{path}: only an aircraft of a JSBSim file is written as .xml, of a DAVE-ML file as .dml, and neither "
                "with further tables; use .toml"
            )
        terms = {c: dict(row) for c, row in self.terms.items()}
        for name, value in self.derivatives.items():
            coefficient, term = derivative_term(name)
            terms.setdefault(coefficient, {})[term.name] = value
        try:
            with of_file(own.path):
                return own.rewritten(Path(own.path).read_text(encoding="utf-8"), terms, self.effects)
        except OSError as error:
            raise InputError(f"{own.path}: cannot be read again: {error.strerror}") from None


def _checked(
    table: Mapping[str, float], valid: Iterable[str], section: str, what: str, positive: Iterable[str]
) -> dict[str, float]:
    pool = tuple(valid)
    above_zero = tuple(positive)
    check_known(
        what, table_of(table, section, "{'alpha': 0.0035}" if what == "channel" else "{'V': 60.0}"), pool, section
    )
    return {key: number(v, f"{section}: '{key}'", positive=key in above_zero) for key, v in table.items()}


def _several(value: Any, kind: type[Kind], what: str, write: str) -> tuple[Kind, ...]:
    """Return `value` as values of one kind; InputError for anything else."""
    return tuple(require(one, kind, f"a member of {what}", write) for one in sequence(value, what, write))


def given_aircraft(value: Any, where: str) -> Aircraft:
    """An aircraft, or that of a file; InputError for anything else."""
    if isinstance(value, Aircraft):
        return value
    if is_path(value):
        return Aircraft.read(value)
    raise InputError(f"{where}: aircraft is {given(value)}; expected a cs.Aircraft or the name of its file")
