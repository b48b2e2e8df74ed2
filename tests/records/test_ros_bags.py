"""Bags of ROS 1 and ROS 2, written by the library rosbags. Truth: the numbers that were written, turned by REP 103."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import casid as cs
from casid.errors import InputError

N = 200
T = 0.02 * np.arange(N)
WAVE = np.sin(T)
BEGAN = 1_714_727_662_000_000_000  # ns since 1970
VOLTS = "battery_msgs/msg/Volts"


def bag(folder: Path, ending: str) -> Path:
    """A bag of an inertial unit at 50 Hz, a motion capture at 25 Hz, text, and a message of a type of its own."""
    typesys = pytest.importorskip("rosbags.typesys")
    store = typesys.get_typestore(typesys.Stores.ROS1_NOETIC if ending == ".bag" else typesys.Stores.ROS2_HUMBLE)
    store.register(typesys.get_types_from_msg("float64 data\nstring cell", VOLTS))
    kind = store.types
    if ending == ".bag":
        path = folder / "m.bag"
        writer = pytest.importorskip("rosbags.rosbag1").Writer(path)
    else:
        path = folder / "m" / "m.db3"
        writer = pytest.importorskip("rosbags.rosbag2").Writer(folder / "m", version=9)

    def header(ns: int) -> Any:
        stamp = kind["builtin_interfaces/msg/Time"](sec=ns // 10**9, nanosec=ns % 10**9)
        extra = {"seq": 0} if ending == ".bag" else {}
        return kind["std_msgs/msg/Header"](stamp=stamp, frame_id="base_link", **extra)

    def vector(x: float, y: float, z: float, of: str = "Vector3") -> Any:
        return kind[f"geometry_msgs/msg/{of}"](x=x, y=y, z=z)

    up = 0.05  # half of a pitch of 0.1 rad, nose up: a negative turn about the left
    turn = kind["geometry_msgs/msg/Quaternion"](x=0.0, y=-float(np.sin(up)), z=0.0, w=float(np.cos(up)))
    nine = np.zeros(9)
    with writer:
        names = {"/imu": "sensor_msgs/msg/Imu", "/vrpn/pose": "geometry_msgs/msg/PoseStamped", "/volts": VOLTS}
        names |= {"/said": "std_msgs/msg/String", "/second": "sensor_msgs/msg/Imu"}
        topics = {topic: writer.add_connection(topic, of, typestore=store) for topic, of in names.items()}
        write = store.serialize_ros1 if ending == ".bag" else store.serialize_cdr
        for i, (t, wave) in enumerate(zip(T.tolist(), WAVE.tolist(), strict=True)):
            ns = BEGAN + round(t * 1e9)
            rates, force = vector(wave, 0.5 * wave, -wave), vector(0.1, 0.2, 9.8)
            imu = kind[names["/imu"]](header(ns), turn, nine, rates, nine, force, nine)
            pose = kind["geometry_msgs/msg/Pose"](position=vector(2.0, 3.0 + wave, 4.0, "Point"), orientation=turn)
            messages = {
                "/imu": imu,
                "/second": imu,
                "/volts": kind[VOLTS](data=11.1, cell="a"),
                "/said": kind[names["/said"]]("go"),
            }
            messages |= {"/vrpn/pose": kind[names["/vrpn/pose"]](header(ns), pose)} if i % 2 == 0 else {}
            for topic, message in messages.items():
                writer.write(topics[topic], ns, write(message, names[topic]))
    return path


@pytest.mark.parametrize("ending", [".bag", ".db3"])
def test_a_bag(tmp_path: Path, ending: str) -> None:
    record = cs.read_record(bag(tmp_path, ending))
    np.testing.assert_allclose(record.t, T, atol=1e-6)
    for channel, expected in {"p": WAVE, "q": -0.5 * WAVE, "r": WAVE, "ax": 0.1, "ay": -0.2, "az": -9.8}.items():
        np.testing.assert_allclose(record[channel], expected, atol=1e-9)
    for channel, expected in {"phi": 0.0, "theta": 0.1, "psi": np.pi / 2}.items():
        np.testing.assert_allclose(record[channel], expected, atol=1e-9)
    there = np.isfinite(record["north"])
    assert there.sum() == N / 2  # its own samples, and no others
    np.testing.assert_allclose(record["north"][there], 3.0 + WAVE[there], atol=1e-9)
    np.testing.assert_allclose(record["east"][there], 2.0)
    np.testing.assert_allclose(record["/volts.data"], 11.1)
    assert "of /imu, sensor_msgs/msg/Imu" in record.contents.read["p"]
    np.testing.assert_allclose(record["/second.angular_velocity.x"], WAVE, atol=1e-9)
    assert any("/second keeps its own names" in note for note in record.notes)
    assert record.contents.unread == {"/said": "no numbers in std_msgs/msg/String"}


def test_a_message_of_an_unknown_type_is_named(tmp_path: Path) -> None:
    """Bags of ROS 2 before Iron hold no definitions."""
    path = bag(tmp_path, ".db3")
    with closing(sqlite3.connect(path)) as content:
        content.execute("DROP TABLE message_definitions")
        content.execute("UPDATE schema SET schema_version = 3")
        content.commit()
    record = cs.read_record(path)
    assert VOLTS in record.contents.unread["/volts"] and "p" in record


@pytest.mark.parametrize("ending", [".bag", ".db3"])
@pytest.mark.parametrize("kept", [0.0, 0.02, 0.5, 0.99])
def test_a_bag_that_is_cut_off_is_read_or_one_line(tmp_path: Path, ending: str, kept: float) -> None:
    path = bag(tmp_path, ending)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(kept * len(whole))])
    try:
        record = cs.read_record(path)
    except InputError as error:
        assert "\n" not in str(error) and "m." in str(error)
    else:
        np.testing.assert_allclose(record["p"], WAVE[: len(record)], atol=1e-9)
