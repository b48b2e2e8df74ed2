"""PX4 logs (ULog) of any age: fixed wings, multirotors and VTOL.

Topics and fields as in the uORB messages of PX4 1.8 to 1.16; a channel has several sources, since topics were renamed:
`actuator_controls_0` became `vehicle_torque_setpoint` (1.14), `sensor_combined` feeds `vehicle_acceleration`.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from casid.errors import InputError
from casid.records.foreign import library, loaded
from casid.records.log import Series, attitude, first_of, lost, of_log
from casid.records.table import RawTable

Topics = Mapping[tuple[str, int], Mapping[str, Any]]  # name and instance -> field -> samples


def _xyz(field: str) -> tuple[str, str, str]:
    return f"{field}[0]", f"{field}[1]", f"{field}[2]"


# channels -> the topics that have them, with their fields
_SOURCES: Mapping[tuple[str, ...], tuple[tuple[str, tuple[str, ...]], ...]] = {
    ("p", "q", "r"): (("vehicle_angular_velocity", _xyz("xyz")), ("sensor_combined", _xyz("gyro_rad"))),
    ("pdot", "qdot", "rdot"): (
        ("vehicle_angular_velocity", _xyz("xyz_derivative")),
        ("vehicle_angular_acceleration", _xyz("xyz")),
    ),
    ("ax", "ay", "az"): (("vehicle_acceleration", _xyz("xyz")), ("sensor_combined", _xyz("accelerometer_m_s2"))),
    ("V",): (("airspeed_validated", ("true_airspeed_m_s",)), ("airspeed", ("true_airspeed_m_s",))),
    ("altitude",): (
        ("vehicle_air_data", ("baro_alt_meter",)),
        ("sensor_baro", ("altitude",)),
        ("vehicle_global_position", ("alt",)),
    ),
    ("rho",): (("vehicle_air_data", ("rho",)),),
    ("v_north", "v_east", "v_down"): (("vehicle_local_position", ("vx", "vy", "vz")),),
    ("north", "east"): (("vehicle_local_position", ("x", "y")),),
    ("wind_north", "wind_east"): (
        ("wind", ("windspeed_north", "windspeed_east")),
        ("wind_estimate", ("windspeed_north", "windspeed_east")),
    ),
    ("battery",): (("battery_status", ("voltage_v",)),),
}
_COMMANDS = ("delta_a_command", "delta_e_command", "delta_r_command")
_OF_WINGS = ("vehicle_torque_setpoint", "vehicle_thrust_setpoint")  # whose second one is the wing of a VTOL
_OTHERS = ("vehicle_attitude", "vehicle_status", "vehicle_land_detected", "actuator_motors", "actuator_outputs")
_OTHERS += ("actuator_controls_0", "actuator_controls_1", *_OF_WINGS)
_ROTARY_WING = 1  # vehicle_status.vehicle_type
_MOTORS = 12
_PULSE = 800.0  # us: an output above is a pulse width


def read_ulog(path: Path, variable: str | None, time: str) -> RawTable:
    """Table of a PX4 ULog on the clock of its rates; needs the extra `ulog`. Surfaces are normalised commands
    ``delta_e_command``, which a map with the throw makes surfaces: ``--map delta_e=delta_e_command:deg*-25``. Motors
    are ``m1``, ``m2`` ...."""
    pyulog = library("pyulog", path, "ulog")

    def load() -> Any:
        with path.open("rb") as file:
            log = pyulog.ULog(file)
        return {(topic.name, topic.multi_id): topic.data for topic in log.data_list}

    topics: Any = loaded(path, load)
    series, notes = of_topics(topics)
    if not {"p", "phi", "V", *_COMMANDS} & series.keys():
        held = ", ".join(sorted({name for name, _ in topics})[:8])
        raise InputError(f"{path}: no topic of an aircraft's motion is in the log; it holds {held or 'nothing'}")
    return of_log(path, series, flying(topics), notes, of_no_channel(topics))


def of_no_channel(topics: Topics) -> dict[str, str]:
    """Topics of which no channel is made, with the reason."""
    used = {topic for sources in _SOURCES.values() for topic, _ in sources} | set(_OTHERS)
    others = sorted({name for name, _ in topics} - used)
    more = sorted(f"{name}[{number}]" for name, number in topics if name in used and number and name not in _OF_WINGS)
    made = dict.fromkeys(others, "no channel is made of this topic")
    return made | dict.fromkeys(more, "of another unit than the first")


def of_topics(topics: Topics) -> tuple[dict[str, Series], tuple[str, ...]]:
    """Channels of the topics of PX4, and remarks on them."""
    kind = _kind(topics)
    series: dict[str, Series] = {}
    for channels, sources in _SOURCES.items():
        series |= first_of(_fields(topics, topic, channels, fields) for topic, fields in sources)
    series |= _attitude(topics)
    notes = (f"a PX4 log of a {kind}",)
    if kind != "multirotor":
        series |= _surfaces(topics, instance=1 if kind == "VTOL" else 0)
    if kind != "fixed wing":
        series |= _motors(topics, kind)
    return series, (*notes, *lost(series))


def _kind(topics: Topics) -> str:
    """Return the kind of aircraft: "fixed wing", "multirotor" or "VTOL"."""
    status = topics.get(("vehicle_status", 0), {})
    if np.any(status.get("is_vtol", 0)):
        return "VTOL"
    if "vehicle_type" in status:
        return "multirotor" if np.median(status["vehicle_type"]) == _ROTARY_WING else "fixed wing"
    if "is_rotary_wing" in status:
        return "multirotor" if np.median(status["is_rotary_wing"]) else "fixed wing"
    return "multirotor" if ("actuator_motors", 0) in topics and ("actuator_servos", 0) not in topics else "fixed wing"


def _stamps(data: Mapping[str, Any]) -> np.ndarray:
    """Times [s] at which a topic was sampled, or published where it has no such time."""
    published = np.asarray(data["timestamp"], float) * 1e-6
    sampled = np.asarray(data.get("timestamp_sample", data["timestamp"]), float) * 1e-6
    return np.where(np.abs(sampled - published) < 1.0, sampled, published)


def _fields(
    topics: Topics, topic: str, channels: tuple[str, ...], fields: tuple[str, ...], instance: int = 0
) -> dict[str, Series] | None:
    """Channels that are fields of one topic, None where it lacks one."""
    data = topics.get((topic, instance), {})
    if not all(field in data for field in fields):
        return None
    stamps = _stamps(data)
    found = {name: np.asarray(data[field], float) for name, field in zip(channels, fields, strict=True)}
    if not all(np.isfinite(values).any() for values in found.values()):
        return None
    return {name: (stamps, values) for name, values in found.items()}


def _attitude(topics: Topics) -> dict[str, Series]:
    read = _fields(topics, "vehicle_attitude", ("w", "x", "y", "z"), tuple(f"q[{i}]" for i in range(4)))
    if read is None:
        return {}
    return attitude(read["w"][0], np.stack([values for _, values in read.values()], axis=1))


def _surfaces(topics: Topics, instance: int) -> dict[str, Series]:
    """Commands of roll, pitch and yaw from -1 to 1, and the throttle; `instance` 1 is the wing of a VTOL."""
    old = f"actuator_controls_{instance}"
    turns = (
        _fields(topics, "vehicle_torque_setpoint", _COMMANDS, _xyz("xyz"), instance),
        _fields(topics, old, _COMMANDS, _xyz("control")),
    )
    pushes = (
        _fields(topics, "vehicle_thrust_setpoint", ("throttle",), ("xyz[0]",), instance),
        _fields(topics, old, ("throttle",), ("control[3]",)),
    )
    return first_of(turns) | first_of(pushes)


def _motors(topics: Topics, kind: str) -> dict[str, Series]:
    """Commands of the motors from 0 to 1; of older logs what went out to them, as pulse widths [us]. Outputs that may
    be servos as well are called by their number."""
    for topic, field in (("actuator_motors", "control"), ("actuator_outputs", "output")):
        data = topics.get((topic, 0), {})
        if not data:
            continue
        stamps = _stamps(data)
        found = {}
        both = topic == "actuator_outputs" and kind == "VTOL"  # motors and servos alike
        for i in range(_MOTORS):
            values = np.asarray(data.get(f"{field}[{i}]", np.nan), float)
            moves = values.ndim and np.nanmax(values, initial=-np.inf) > np.nanmin(values, initial=np.inf)
            if moves and (field == "control" or np.nanmax(values) > _PULSE):
                found[f"output_{i + 1}" if both else f"m{i + 1}"] = stamps, values
        if found:
            return found
    return {}


def flying(topics: Topics) -> Series | None:
    """Read when the aircraft is in the air, by the autopilot's land detector."""
    data = topics.get(("vehicle_land_detected", 0), {})
    if "landed" not in data:
        return None
    return np.asarray(data["timestamp"], float) * 1e-6, ~np.asarray(data["landed"], bool)
