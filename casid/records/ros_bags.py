"""Bags of ROS 1 (.bag) and of ROS 2 in SQLite (.db3), by the library rosbags; the channels are those of `ros`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from casid.errors import InputError
from casid.records.foreign import library, loaded
from casid.records.ros import numbers_of, table_of_topics
from casid.records.table import RawTable

MAGIC = b"#ROSBAG V2.0"


def read_ros_bag(path: Path, variable: str | None, time: str) -> RawTable:
    """Table of a bag on the clock of its rates; needs the extra `rosbags`. Messages of ROS 2 whose definition the bag
    does not hold are those of its latest distribution."""
    highlevel = library("rosbags.highlevel", path, "rosbags")
    typesys = library("rosbags.typesys", path, "rosbags")

    def load() -> tuple[dict[str, Any], tuple[str, ...], dict[str, str]]:
        topics: dict[str, Any] = {}
        unread: dict[str, str] = {}
        notes = ("a ROS 1 bag" if path.read_bytes()[: len(MAGIC)] == MAGIC else "a ROS 2 bag",)
        store = typesys.get_typestore(typesys.Stores.LATEST)
        with highlevel.AnyReader([path], default_typestore=store) as reader:
            try:
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
                    rows = topics.setdefault(connection.topic, (connection.msgtype, []))[1]
                    rows.append({"log_time": stamp * 1e-9, **dict(numbers_of(message))})
            except Exception:  # the same, where it looks for the next message
                if not topics:
                    raise
                notes = (*notes, "the bag is damaged: what comes after that is left out")
        return topics, notes, unread

    topics, notes, unread = loaded(path, load)
    if not topics:
        said = ", ".join(f"{topic} ({why})" for topic, why in unread.items())
        raise InputError(f"{path}: no message is read; the bag has {said or 'nothing'}")
    return table_of_topics(path, topics, notes, unread)
