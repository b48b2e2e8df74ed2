"""The causes: every way in which reality may differ from the aircraft file, each defined once."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from casid.model import operators
from casid.model.effect import Effect, Series, Values, cause
from casid.model.path import OUTPUTS, SignalPath, evaluate
from casid.model.vocabulary import SENSOR_GROUPS
from casid.signals import SURFACES, unit_of

_RATE_WITH_DERIVATIVE = {"p": ("p", "pdot"), "q": ("q", "qdot"), "r": ("r", "rdot")}

# -- aerodynamics ------------------------------------------------------------------------------------------------------


@cause("aero_term", ())
def aero_term(coefficient: str, term: str) -> Effect:
    def change(path: SignalPath, value: Any) -> None:
        path.coefficient[coefficient] += value * evaluate(term, path)

    return Effect(kind="aero_term", target=coefficient, term=term, station="coefficients", change=change)


@cause("unsteady_aero", ())
def unsteady_aero(coefficient: str) -> Effect:
    rate = "betadot" if coefficient in ("CY", "Cl", "Cn") else "alphadot"

    def change(path: SignalPath, value: Any) -> None:
        path.coefficient[coefficient] += value * path.regressor[rate]

    return Effect(kind="unsteady_aero", target=coefficient, station="coefficients", change=change, limit=60.0)


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
    return _surface_operator("actuator_lag", surface, (0.03, 0.06, 0.12, 0.25), operators.lag, 0.01, 1.0)


@cause("input_delay", SURFACES)
def input_delay(surface: str) -> Effect:
    return _surface_operator("input_delay", surface, (0.02, 0.05, 0.1, 0.2), operators.delay, 0.01, 0.5)


@cause("rate_limit", SURFACES)
def rate_limit(surface: str) -> Effect:
    sizes = np.array([3.0, 5.0, 8.0, 12.0, 20.0]) * _DEG
    return _surface_operator("rate_limit", surface, sizes, operators.rate_limit, 0.0, 60.0 * _DEG)


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

    return Effect(kind="effectiveness_change", target=surface, timed=True, series=series, meaningful=0.03, limit=1.5)


@cause("configuration_change", ())
def configuration_change(coefficients: str) -> Effect:
    names = coefficients.split("+")

    def series(t: np.ndarray, known: Series, values: Values) -> dict[str, np.ndarray]:
        moved = operators.transition(t, values["onset"], values.get("duration", 0.0))
        return {f"d{name}": values["value" if name == names[0] else name] * moved for name in names}

    return Effect(
        kind="configuration_change",
        target=coefficients,
        timed=True,
        grid=tuple({"duration": v} for v in (0.1, 2.0, 5.0)),
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
    return Effect(kind="sensor_bias", target=channel, station="sensors", change=change, meaningful=_BIAS_MATTERS[unit])


@cause("sensor_scale", OUTPUTS)
def sensor_scale(channel: str) -> Effect:
    def change(path: SignalPath, value: Any) -> None:
        for name in group_channels(channel):
            path.output[name] *= 1.0 + value

    return Effect(kind="sensor_scale", target=channel, station="sensors", change=change, meaningful=0.01, limit=0.6)


def _reading_operator(kind: str, target: str, operate: Callable) -> Effect:
    def output(t: np.ndarray, readings: Series, values: Values) -> dict[str, np.ndarray]:
        return {c: operate(t, readings[c], values["value"]) for c in group_channels(target) if c in readings}

    sizes = tuple({"value": v} for v in (0.02, 0.05, 0.1, 0.2))
    return Effect(kind=kind, target=target, linear=False, grid=sizes, output=output, meaningful=0.01, limit=1.0)


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
    return Effect(kind="structural_mode", target=channel, grid=grid, output=output)


@cause("vane_position", ("alpha", "beta"))
def vane_position(channel: str) -> Effect:
    def change(path: SignalPath, value: Any) -> None:
        path.sensor_position[f"{channel}_vane"][0] += value

    return Effect(kind="vane_position", target=channel, station="wind", change=change, meaningful=0.3, limit=30.0)


@cause("accelerometer_position", ("x", "y", "z"))
def accelerometer_position(axis: str) -> Effect:
    def change(path: SignalPath, value: Any) -> None:
        path.sensor_position["accelerometer"]["xyz".index(axis)] += value

    return Effect(kind="accelerometer_position", target=axis, station="wind", change=change, meaningful=0.1, limit=20.0)


# -- mass, propulsion --------------------------------------------------------------------------------------------------


@cause("cg_offset", ("x", "y", "z"))
def cg_offset(axis: str) -> Effect:
    def change(path: SignalPath, value: Any) -> None:
        path.cg["xyz".index(axis)] += value

    return Effect(kind="cg_offset", target=axis, station="wind", change=change, meaningful=0.02, limit=3.0)


@cause("mass", ("",))
def mass(target: str = "") -> Effect:
    def change(path: SignalPath, value: Any) -> None:
        path.mass += value

    return Effect(kind="mass", target="", station="mass", change=change)


@cause("inertia", ("Ixx", "Iyy", "Izz", "Ixz"))
def inertia(component: str) -> Effect:
    def change(path: SignalPath, value: Any) -> None:
        path.inertia[component] += value

    return Effect(kind="inertia", target=component, station="mass", change=change)


@cause("thrust_asymmetry", ("",))
def thrust_asymmetry(target: str = "") -> Effect:
    def change(path: SignalPath, value: Any) -> None:
        path.moment[2] -= value * path.surface["thrust"]

    return Effect(kind="thrust_asymmetry", target="", station="moments", change=change, meaningful=0.05, limit=20.0)


@cause("thrust_line", ("",))
def thrust_line(target: str = "") -> Effect:
    def change(path: SignalPath, value: Any) -> None:
        path.moment[1] += value * path.surface["thrust"]

    return Effect(kind="thrust_line", target="", station="moments", change=change, meaningful=0.05, limit=10.0)


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

    return Effect(kind="wind_shear", target=axis, timed=True, series=series, meaningful=0.05, limit=5.0)


@cause("turbulence", ("",))
def turbulence(target: str = "") -> Effect:
    return Effect(kind="turbulence", target=target, linear=False, grid=(), meaningful=0.1, limit=20.0)
