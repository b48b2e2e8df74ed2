"""The catalogue: every way in which reality may differ from the aircraft file, each defined once.

A cause is one `@cause` function that returns an `Effect`: an extra piece at one station of the signal path. It enters
in one of three ways, and simulation, estimation, screening, extension of the aircraft file and the generator of hidden
effects all use the same definition:

change   symbolic: it changes the path at `station`; its value is a parameter of the model, 0 = absent
series   a time history at a disturbance station of the path, computed from the record (a lagged surface, a gust)
output   an operator on what an instrument reads (delay, lag)
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from itertools import combinations_with_replacement
from typing import Any

import numpy as np

from casid.model import operators
from casid.model.aircraft import Aircraft, EffectValue
from casid.model.path import OUTPUTS, SignalPath, aerodynamic_parameters, coefficient_names, evaluate
from casid.model.terms import parse_term
from casid.model.vocabulary import SENSOR_GROUPS, effect_unit
from casid.signals import SURFACES, unit_of

Values = Mapping[str, float]
Series = Mapping[str, np.ndarray]
_RATE_WITH_DERIVATIVE = {"p": ("p", "pdot"), "q": ("q", "qdot"), "r": ("r", "rdot")}


@dataclass(frozen=True, kw_only=True)
class Effect:
    """One cause at one target.

    linear       the value is an amplitude that enters linearly at its null 0, so a score gives its size;
                 otherwise (lag, dead zone) sizes of `grid` are tried
    grid         values of the further parameters (and of "value" when not linear) that a screening tries
    timed        it begins at an onset [s] of its own in every record concerned
    meaningful   the smallest size that matters to an engineer, in `unit` (None: judged by its part of a coefficient)
    limit        the largest plausible size, in `unit`
    """

    kind: str
    target: str
    term: str | None = None
    linear: bool = True
    grid: tuple[Mapping[str, float], ...] = ({},)
    timed: bool = False
    meaningful: float | None = None
    limit: float = np.inf
    station: str | None = None
    change: Callable[[SignalPath, Any], None] | None = None
    series: Callable[[np.ndarray, Series, Values], dict[str, np.ndarray]] | None = None
    output: Callable[[np.ndarray, Series, Values], dict[str, np.ndarray]] | None = None

    @property
    def name(self) -> str:
        """Name of its parameter in a model and in tables, e.g. "actuator_lag(delta_e)"."""
        inside = self.target + (f":{self.term}" if self.term else "")
        return f"{self.kind}({inside})" if inside else self.kind

    @property
    def unit(self) -> str:
        """SI unit of the value."""
        return effect_unit(self.kind, self.target, self.term)

    @property
    def key(self) -> tuple[str, str, str | None]:
        return self.kind, self.target, self.term


CAUSES: dict[str, Callable[..., Effect]] = {}
_TARGETS: dict[str, tuple[str, ...]] = {}


def cause(kind: str, targets: Iterable[str]) -> Callable[[Callable[..., Effect]], Callable[..., Effect]]:
    """Register a cause: the decorated function makes its Effect for a target (and a term)."""

    def register(make: Callable[..., Effect]) -> Callable[..., Effect]:
        CAUSES[kind] = make
        _TARGETS[kind] = tuple(targets)
        return make

    return register


def effect_of(value: EffectValue) -> Effect:
    """The Effect that an `[[effects]]` entry of an aircraft file speaks of."""
    return CAUSES[value.kind](value.target or "", value.term) if value.term else CAUSES[value.kind](value.target or "")


# -- aerodynamics ------------------------------------------------------------------------------------------------------


@cause("aero_term", ())
def aero_term(coefficient: str, term: str) -> Effect:
    def change(path: SignalPath, value: Any) -> None:
        path.coefficient[coefficient] += value * evaluate(term, path)

    return Effect(
        kind="aero_term",
        target=coefficient,
        term=term,
        station="coefficients",
        change=change,
    )


@cause("unsteady_aero", ())
def unsteady_aero(coefficient: str) -> Effect:
    rate = "betadot" if coefficient in ("CY", "Cl", "Cn") else "alphadot"

    def change(path: SignalPath, value: Any) -> None:
        path.coefficient[coefficient] += value * path.regressor[rate]

    return Effect(
        kind="unsteady_aero",
        target=coefficient,
        station="coefficients",
        change=change,
        limit=60.0,
    )


# -- between the recorded command and the surface ----------------------------------------------------------------------


def _surface_operator(
    kind: str, surface: str, sizes: Iterable[float], operate: Callable, meaningful: float, limit: float
) -> Effect:
    def series(t: np.ndarray, known: Series, values: Values) -> dict[str, np.ndarray]:
        recorded = known[surface]
        return {f"d_{surface}": operate(t, recorded, values["value"]) - recorded}

    return Effect(
        kind=kind,
        target=surface,
        linear=False,
        grid=tuple({"value": v} for v in sizes),
        series=series,
        meaningful=meaningful,
        limit=limit,
    )


_DEG = np.pi / 180.0


@cause("actuator_lag", SURFACES)
def actuator_lag(surface: str) -> Effect:
    return _surface_operator(
        "actuator_lag",
        surface,
        (0.03, 0.06, 0.12, 0.25),
        operators.lag,
        0.01,
        1.0,
    )


@cause("input_delay", SURFACES)
def input_delay(surface: str) -> Effect:
    return _surface_operator(
        "input_delay",
        surface,
        (0.02, 0.05, 0.1, 0.2),
        operators.delay,
        0.01,
        0.5,
    )


@cause("rate_limit", SURFACES)
def rate_limit(surface: str) -> Effect:
    sizes = np.array([3.0, 5.0, 8.0, 12.0, 20.0]) * _DEG
    return _surface_operator(
        "rate_limit",
        surface,
        sizes,
        operators.rate_limit,
        0.0,
        60.0 * _DEG,
    )


@cause("dead_zone", SURFACES)
def dead_zone(surface: str) -> Effect:
    return _surface_operator(
        "dead_zone",
        surface,
        np.array([0.2, 0.4, 0.8, 1.5]) * _DEG,
        lambda t, y, width: operators.dead_zone(y, width, float(np.median(y))),
        0.1 * _DEG,
        5.0 * _DEG,
    )


@cause("backlash", SURFACES)
def backlash(surface: str) -> Effect:
    return _surface_operator(
        "backlash",
        surface,
        np.array([0.2, 0.4, 0.8, 1.5]) * _DEG,
        lambda t, y, width: operators.backlash(y, width),
        0.1 * _DEG,
        5.0 * _DEG,
    )


@cause("effectiveness_change", (*SURFACES, "thrust"))
def effectiveness_change(surface: str) -> Effect:
    def series(t: np.ndarray, known: Series, values: Values) -> dict[str, np.ndarray]:
        return {f"d_{surface}": values["value"] * operators.step(t, values["onset"]) * known[surface]}

    return Effect(
        kind="effectiveness_change",
        target=surface,
        timed=True,
        series=series,
        meaningful=0.03,
        limit=1.5,
    )


@cause("configuration_change", ())
def configuration_change(coefficients: str) -> Effect:
    names = coefficients.split("+")

    def series(t: np.ndarray, known: Series, values: Values) -> dict[str, np.ndarray]:
        switched = operators.step(t, values["onset"])
        return {f"d{name}": values["value" if name == names[0] else name] * switched for name in names}

    return Effect(
        kind="configuration_change",
        target=coefficients,
        timed=True,
        series=series,
    )


# -- instruments -------------------------------------------------------------------------------------------------------


def group_channels(target: str) -> tuple[str, ...]:
    """Channels that share one instrument fault: a channel, a rate with its derivative, or the inertial unit."""
    return SENSOR_GROUPS.get(target) or _RATE_WITH_DERIVATIVE.get(target, (target,))


_BIAS_MATTERS = {
    "m/s": 0.2,
    "rad": 0.1 * _DEG,
    "rad/s": 0.03 * _DEG,
    "m/s2": 0.03,
    "rad/s2": 0.1 * _DEG,
}


@cause("sensor_bias", OUTPUTS)
def sensor_bias(channel: str) -> Effect:
    def change(path: SignalPath, value: Any) -> None:
        path.output[channel] += value

    unit = unit_of(channel)
    return Effect(
        kind="sensor_bias",
        target=channel,
        station="sensors",
        change=change,
        meaningful=_BIAS_MATTERS[unit],
    )


@cause("sensor_scale", OUTPUTS)
def sensor_scale(channel: str) -> Effect:
    def change(path: SignalPath, value: Any) -> None:
        for name in group_channels(channel):
            path.output[name] *= 1.0 + value

    return Effect(
        kind="sensor_scale",
        target=channel,
        station="sensors",
        change=change,
        meaningful=0.01,
        limit=0.6,
    )


def _reading_operator(kind: str, target: str, operate: Callable) -> Effect:
    def output(t: np.ndarray, readings: Series, values: Values) -> dict[str, np.ndarray]:
        return {c: operate(t, readings[c], values["value"]) for c in group_channels(target) if c in readings}

    sizes = tuple({"value": v} for v in (0.02, 0.05, 0.1, 0.2))
    return Effect(
        kind=kind,
        target=target,
        linear=False,
        grid=sizes,
        output=output,
        meaningful=0.01,
        limit=1.0,
    )


@cause("sensor_delay", ("inertial", *OUTPUTS))
def sensor_delay(target: str) -> Effect:
    return _reading_operator("sensor_delay", target, operators.delay)


@cause("sensor_lag", ("inertial", *OUTPUTS))
def sensor_lag(target: str) -> Effect:
    return _reading_operator("sensor_lag", target, operators.lag)


@cause("structural_mode", ("q", "az", "p", "r", "ay"))
def structural_mode(channel: str) -> Effect:
    drive = {"q": "delta_e", "az": "delta_e", "p": "delta_a", "r": "delta_r", "ay": "delta_r"}[channel]

    def output(t: np.ndarray, readings: Series, values: Values) -> dict[str, np.ndarray]:
        ringing = operators.mode(t, readings[drive], values["frequency_hz"])
        return {channel: readings[channel] + values["value"] * ringing}

    grid = tuple({"frequency_hz": f} for f in (1.5, 2.0, 2.5, 3.0, 3.5, 4.0, 5.0, 6.0, 8.0))
    return Effect(
        kind="structural_mode",
        target=channel,
        grid=grid,
        output=output,
    )


@cause("vane_position", ("alpha", "beta"))
def vane_position(channel: str) -> Effect:
    def change(path: SignalPath, value: Any) -> None:
        path.sensor_position[f"{channel}_vane"][0] += value

    return Effect(
        kind="vane_position",
        target=channel,
        station="wind",
        change=change,
        meaningful=0.3,
        limit=30.0,
    )


@cause("accelerometer_position", ("x", "y", "z"))
def accelerometer_position(axis: str) -> Effect:
    def change(path: SignalPath, value: Any) -> None:
        path.sensor_position["accelerometer"]["xyz".index(axis)] += value

    return Effect(
        kind="accelerometer_position",
        target=axis,
        station="wind",
        change=change,
        meaningful=0.1,
        limit=20.0,
    )


# -- mass, propulsion --------------------------------------------------------------------------------------------------


@cause("cg_offset", ("x", "y", "z"))
def cg_offset(axis: str) -> Effect:
    def change(path: SignalPath, value: Any) -> None:
        path.cg["xyz".index(axis)] += value

    return Effect(
        kind="cg_offset",
        target=axis,
        station="wind",
        change=change,
        meaningful=0.02,
        limit=3.0,
    )


@cause("mass", ("",))
def mass(target: str = "") -> Effect:
    def change(path: SignalPath, value: Any) -> None:
        path.mass += value

    return Effect(kind="mass", target="", station="mass", change=change)


@cause("inertia", ("Ixx", "Iyy", "Izz", "Ixz"))
def inertia(component: str) -> Effect:
    def change(path: SignalPath, value: Any) -> None:
        path.inertia[component] += value

    return Effect(
        kind="inertia",
        target=component,
        station="mass",
        change=change,
    )


@cause("thrust_asymmetry", ("",))
def thrust_asymmetry(target: str = "") -> Effect:
    def change(path: SignalPath, value: Any) -> None:
        path.moment[2] -= value * path.surface["thrust"]

    return Effect(
        kind="thrust_asymmetry",
        target="",
        station="moments",
        change=change,
        meaningful=0.05,
        limit=20.0,
    )


@cause("thrust_line", ("",))
def thrust_line(target: str = "") -> Effect:
    def change(path: SignalPath, value: Any) -> None:
        path.moment[1] += value * path.surface["thrust"]

    return Effect(
        kind="thrust_line",
        target="",
        station="moments",
        change=change,
        meaningful=0.05,
        limit=10.0,
    )


# -- moving air --------------------------------------------------------------------------------------------------------


@cause("gust", ("x", "y", "z"))
def gust(axis: str) -> Effect:
    def series(t: np.ndarray, known: Series, values: Values) -> dict[str, np.ndarray]:
        return {f"wind_{axis}": values["value"] * operators.one_minus_cosine(t, values["onset"], values["length"])}

    return Effect(
        kind="gust",
        target=axis,
        timed=True,
        grid=tuple({"length": v} for v in (0.8, 1.6, 3.2)),
        series=series,
        meaningful=0.5,
        limit=40.0,
    )


@cause("wind_shear", ("x", "y", "z"))
def wind_shear(axis: str) -> Effect:
    def series(t: np.ndarray, known: Series, values: Values) -> dict[str, np.ndarray]:
        return {f"wind_{axis}": values["value"] * operators.ramp(t, values["onset"])}

    return Effect(
        kind="wind_shear",
        target=axis,
        timed=True,
        series=series,
        meaningful=0.05,
        limit=5.0,
    )


@cause("turbulence", ("",))
def turbulence(target: str = "") -> Effect:
    return Effect(
        kind="turbulence",
        target=target,
        linear=False,
        grid=(),
        meaningful=0.1,
        limit=20.0,
    )


# -- the catalogue of an aircraft --------------------------------------------------------------------------------------

_VARIABLES = ("alpha", "beta", "p", "q", "r", *SURFACES)


def aero_candidates(aircraft: Aircraft) -> list[Effect]:
    """Every polynomial and cross term of second and third order, every first-order term and Mach, on the six
    coefficients, that the aircraft file does not have."""
    present = {(c, term) for c, _, term in aerodynamic_parameters(aircraft)}
    terms = [*_VARIABLES, "mach"]
    for degree in (2, 3):
        terms += [parse_term("*".join(v)).name for v in combinations_with_replacement(_VARIABLES, degree)]
    coefficients = coefficient_names(aircraft.force_axes)
    return [aero_term(c, term) for c in coefficients for term in terms if (c, term) not in present]


def catalogue(aircraft: Aircraft, outputs: Iterable[str]) -> list[Effect]:
    """Every effect that makes sense for this aircraft and these measured outputs, turbulence apart."""
    measured = set(outputs)
    present = {(c, term) for c, _, term in aerodynamic_parameters(aircraft)}
    found = aero_candidates(aircraft)
    for coefficient in coefficient_names(aircraft.force_axes):
        rate = "betadot" if coefficient in ("CY", "Cl", "Cn") else "alphadot"
        if (coefficient, rate) not in present:
            found.append(unsteady_aero(coefficient))
    for kind, targets in _TARGETS.items():
        for target in targets:
            if kind.startswith("sensor_") or kind == "structural_mode":
                derivative_with_rate = target.endswith("dot") and target[:-3] in measured and kind != "sensor_bias"
                if (target not in measured and target != "inertial") or derivative_with_rate:
                    continue
            if kind == "vane_position" and target not in measured:
                continue
            if kind == "accelerometer_position" and not measured & {"ax", "ay", "az"}:
                continue
            if kind != "turbulence":
                found.append(CAUSES[kind](target))
    return found
