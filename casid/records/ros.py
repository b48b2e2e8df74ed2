"""Bags of ROS, and the channels in them: inertial units, odometry, actuators, and PX4's own topics.

Bags of ROS 2 in MCAP are read by the library mcap, those of ROS 1 (.bag) and of ROS 2 in SQLite (.db3) by rosbags.
ROS has body axes forward, left and up, and earth axes east, north and up (REP 103); what is known is turned into those
of casid. Numbers of other messages keep the name of their topic and field, for a column map.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np

from casid.errors import InputError
from casid.records.foreign import library, loaded
from casid.records.log import Series, attitude, lost, of_log
from casid.records.px4 import flying, of_no_channel, of_topics
from casid.records.table import RawTable

MAGIC = b"\x89MCAP0\r\n"
MAGIC_1 = b"#ROSBAG V2.0"  # of ROS 1
# of a message; of an array in it; of all that is kept
_DEPTH = 4
_ELEMENTS = 16
_COLUMNS = 400
_IMU = "sensor_msgs/msg/Imu"
_ODOMETRY = "nav_msgs/msg/Odometry"
_ACTUATORS = "actuator_msgs/msg/Actuators"
# channel -> (field, factor)
_BODY = {"p": ("angular_velocity.x", 1.0), "q": ("angular_velocity.y", -1.0), "r": ("angular_velocity.z", -1.0)}
_BODY |= {"ax": ("linear_acceleration.x", 1.0), "ay": ("linear_acceleration.y", -1.0)}
_BODY |= {"az": ("linear_acceleration.z", -1.0)}
_PLACE = {"north": ("pose.pose.position.y", 1.0), "east": ("pose.pose.position.x", 1.0)}
_PLACE |= {"altitude": ("pose.pose.position.z", 1.0)}
_POSE = "geometry_msgs/msg/PoseStamped"
_KNOWN = {_IMU: _BODY, _ODOMETRY: _PLACE, _POSE: {c: (f.removeprefix("pose."), k) for c, (f, k) in _PLACE.items()}}
_TURNED = {_IMU: "orientation", _ODOMETRY: "pose.pose.orientation", _POSE: "pose.orientation"}


def read_mcap(path: Path, variable: str | None, time: str) -> RawTable:
    """Table of a ROS 2 bag on the clock of its rates; needs the extra `ros`."""
    readers = library("mcap.reader", path, "ros")
    decoders = library("mcap_ros2.decoder", path, "ros")

    def load() -> tuple[dict[str, Any], tuple[str, ...]]:
        with path.open("rb") as file:
            for make in (readers.make_reader, readers.NonSeekingReader):  # the second one needs no summary at the end
                file.seek(0)
                try:
                    read = make(file, decoder_factories=[decoders.DecoderFactory()])
                    messages = read.iter_decoded_messages(log_time_order=False)
                    topics, fault = _messages((c.topic, s.name, m.log_time, one) for s, c, m, one in messages)
                except Exception as error:  # its head is damaged, or there is no summary
                    topics = {}
                    fault = error
                if fault is None:
                    return topics, ("a ROS 2 bag",)
        if not topics:
            raise fault
        return topics, ("a ROS 2 bag", "the bag is cut off or damaged: what comes after that is left out")

    return table_of_topics(path, *loaded(path, load), {})


def read_ros_bag(path: Path, variable: str | None, time: str) -> RawTable:
    """Table of a bag on the clock of its rates; needs the extra `rosbags`. Messages of ROS 2 whose definition the bag
    does not hold are those of its latest distribution."""
    highlevel = library("rosbags.highlevel", path, "rosbags")
    typesys = library("rosbags.typesys", path, "rosbags")

    def load() -> tuple[dict[str, Any], tuple[str, ...], dict[str, str]]:
        unread: dict[str, str] = {}
        with path.open("rb") as file:
            first = file.read(len(MAGIC_1))
        store = typesys.get_typestore(typesys.Stores.LATEST)
        with highlevel.AnyReader([path], default_typestore=store) as reader:
            topics, fault = _messages(_deserialised(reader, unread))
        if fault is not None and not topics:
            raise fault
        notes = ("a ROS 1 bag" if first == MAGIC_1 else "a ROS 2 bag",)
        damaged = ("the bag is damaged: what comes after that is left out",) if fault is not None else ()
        return topics, notes + damaged, unread

    topics, notes, unread = loaded(path, load)
    if not topics:
        said = ", ".join(f"{topic} ({why})" for topic, why in unread.items())
        raise InputError(f"{path}: no message is read; the bag has {said or 'nothing'}")
    return table_of_topics(path, topics, notes, unread)


def table_of_topics(
    path: Path, topics: Mapping[str, tuple[str, list[dict[str, float]]]], notes: tuple[str, ...], unread: dict[str, str]
) -> RawTable:
    """Table of topics, each with its kind and the numbers of its messages; `unread` are topics that are not read."""
    for _, rows in topics.values():
        rows.sort(key=itemgetter("log_time"))
    of_px4 = {(topic.rsplit("/", 1)[-1], 0): _columns(rows) for topic, (kind, rows) in topics.items() if _is_px4(kind)}
    of_px4 = {key: one for key, one in of_px4.items() if "timestamp" in one}
    series, said = of_topics(of_px4) if of_px4 else ({}, ())
    notes = (*said, *notes[1:]) if of_px4 else notes
    how = dict[str, str]()
    for topic, (kind, rows) in topics.items():
        found = {} if _is_px4(kind) else _of_messages(topic, kind, _columns(rows), series)
        if not found and not _is_px4(kind):
            unread[topic] = f"no numbers in {kind}"
        own = [name for name in found if not name.startswith(f"{topic}.")]
        how |= dict.fromkeys(own, f"of {topic}, {kind}")
        if kind in _KNOWN and found and not own:
            notes = (*notes, f"{topic} keeps its own names, as another topic has its channels; a map may take them")
        series |= found
    if not series:
        raise InputError(f"{path}: no message with numbers; the bag has {', '.join(topics) or 'nothing'}")
    notes = notes if of_px4 else (*notes, *lost(series))
    unread |= of_no_channel(of_px4) if of_px4 else {}
    unread |= dict.fromkeys(list(series)[_COLUMNS:], f"beyond the first {_COLUMNS} columns")
    return of_log(path, dict(list(series.items())[:_COLUMNS]), flying(of_px4), notes, unread, how)


def _deserialised(reader: Any, unread: dict[str, str]) -> Iterator[tuple[str, str, int, Any]]:
    """Topic, kind, stamp [ns] and message of all that rosbags reads; a topic of which it cannot read one is `unread`
    from there on."""
    for connection, stamp, raw in reader.messages():
        if connection.topic in unread:
            continue
        try:
            message = reader.deserialize(raw, connection.msgtype)
        except Exception as error:  # of the library, whatever the damage makes of it
            undefined = isinstance(error, KeyError)
            why = ", which the bag does not define" if undefined else f": {type(error).__name__}"
            unread[connection.topic] = f"a message of {connection.msgtype}{why}"
            continue
        yield connection.topic, connection.msgtype, stamp, message


def _messages(read: Iterable[tuple[str, str, int, Any]]) -> tuple[dict[str, Any], Exception | None]:
    """Topic -> its kind and the numbers of its messages, up to a fault of the bag, and that fault; of topic, kind,
    stamp [ns] and message of each."""
    topics: dict[str, Any] = {}
    try:
        for topic, kind, stamp, message in read:
            rows = topics.setdefault(topic, (kind, []))[1]
            rows.append({"log_time": stamp * 1e-9, **dict(numbers_of(message))})
    except Exception as error:  # of the library, whatever the damage makes of it
        return topics, error
    return topics, None


def _is_px4(kind: str) -> bool:
    return kind.startswith("px4_msgs/")


def numbers_of(message: Any, name: str = "", depth: int = 0) -> Iterator[tuple[str, float]]:
    """Numbers of a message by the name of their field, `angular_velocity.x`, `control[0]`."""
    if isinstance(message, (bool, int, float)):
        yield name, float(message)
    elif isinstance(message, (list, tuple, np.ndarray)) and 0 < len(message) <= _ELEMENTS:
        for i, one in enumerate(message):
            yield from numbers_of(one, f"{name}[{i}]", depth + 1)
    elif depth < _DEPTH:
        named = [one.name for one in fields(message)] if is_dataclass(message) else getattr(message, "__slots__", ())
        for field in named:
            inner = f"{name}.{field}" if name else field
            yield from numbers_of(getattr(message, field), inner, depth + 1)


def _columns(rows: list[dict[str, float]]) -> dict[str, np.ndarray]:
    """Fields of all messages of a topic, those that every message has."""
    names = [name for name in rows[0] if all(name in row for row in rows)]
    return {name: np.array([row[name] for row in rows]) for name in names}


def _stamps(columns: Mapping[str, np.ndarray]) -> np.ndarray:
    """Times [s] of the header of a message, or of its record."""
    seconds = columns.get("header.stamp.sec")
    if seconds is None or not seconds.any():
        return columns["log_time"]
    return seconds + 1e-9 * columns.get("header.stamp.nanosec", np.zeros(len(seconds)))


def _of_messages(
    topic: str, kind: str, columns: dict[str, np.ndarray], taken: Mapping[str, Series]
) -> dict[str, Series]:
    """Channels of the messages of a topic, and their other numbers by topic and field."""
    stamps = _stamps(columns)
    found = dict[str, Series]()
    for channel, (field, factor) in _KNOWN.get(kind, {}).items():
        if field in columns and channel not in taken:
            found[channel] = stamps, factor * columns.pop(field)
    turned = [f"{_TURNED.get(kind, '')}.{axis}" for axis in "wxyz"]
    if "phi" not in taken and all(name in columns for name in turned):
        angles = attitude(stamps, np.stack([columns.pop(name) for name in turned], axis=1))
        if angles["phi"][0].size:
            t, psi = angles["psi"]
            found |= {"phi": angles["phi"], "theta": (t, -angles["theta"][1]), "psi": (t, 0.5 * np.pi - psi)}
    if kind == _ACTUATORS:
        names = [name for name in columns if name.startswith("velocity[")]
        found |= {f"m{i + 1}": (stamps, columns.pop(name)) for i, name in enumerate(names)}
    skipped = ("header.", "log_time", "timestamp")
    rest = {f"{topic}.{name}": (stamps, one) for name, one in columns.items() if not name.startswith(skipped)}
    return found | {name: one for name, one in rest.items() if "covariance" not in name}
