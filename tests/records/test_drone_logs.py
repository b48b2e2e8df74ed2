"""Logs of drones, written here by what is public of their formats. Truth: the numbers that were written, in the axes of
each: forward, left and up, turned over into forward, right and down."""

from __future__ import annotations

import io
import struct
import zlib

import numpy as np
import pytest

from casid.errors import InputError
from casid.records import read_record

N = 200
T = 0.02 * np.arange(N)
WAVE = np.sin(T)


def crazyflie(version: int, ending: bytes = b"") -> bytes:
    """A log of two events: rates and motors at 50 Hz, the battery at 5 Hz."""

    def text(name: str) -> bytes:
        return name.encode() + b"\0"

    events = {
        0: ("fast", ("gyro.y(f)", "acc.z(f)", "motor.m1(H)", "stateEstimate.pitch(f)")),
        1: ("slow", ("pm.vbat(f)", "range.up(H)")),
    }
    out = b"\xbc" + struct.pack("<HH", version, len(events))
    for number, (name, variables) in events.items():
        out += (
            struct.pack("<H", number) + text(name) + struct.pack("<H", len(variables)) + b"".join(map(text, variables))
        )
    layout, unit = ("<HI", 1e3) if version == 1 else ("<HQ", 1e6)
    for i, (t, wave) in enumerate(zip(T, WAVE, strict=True)):
        out += struct.pack(layout, 0, round(t * unit)) + struct.pack("<ffHf", 10.0 * wave, 1.0, 30000 + i, 5.0 * wave)
        if i % 10 == 0:
            out += struct.pack(layout, 1, round(t * unit)) + struct.pack("<fH", 3.9, 7)
    out += ending
    return out + struct.pack("<I", zlib.crc32(out))


@pytest.mark.parametrize("version", [1, 2])
@pytest.mark.parametrize("name", ["log00", "log00.bin"])
def test_crazyflie(tmp_path, version, name):
    file = tmp_path / name
    file.write_bytes(crazyflie(version))
    record = read_record(file)
    np.testing.assert_allclose(record.t, T, atol=1e-6)
    np.testing.assert_allclose(record["q"], -np.radians(10.0 * WAVE), atol=1e-6)
    np.testing.assert_allclose(record["az"], -9.80665, rtol=1e-6)
    np.testing.assert_allclose(record["theta"], np.radians(5.0 * WAVE), atol=1e-6)
    np.testing.assert_allclose(record["m1"], 30000.0 + np.arange(N))
    np.testing.assert_allclose(record["battery"][np.isfinite(record["battery"])], 3.9, rtol=1e-6)
    assert "range.up" in record
    file.write_bytes(crazyflie(version, ending=struct.pack("<H", 0))[:-3])  # the power went within an event
    assert len(read_record(file)) >= N - 1


def test_a_damaged_log_of_a_crazyflie_is_one_line(tmp_path):
    whole = crazyflie(2)
    for length in (3, 5, 20, 60):
        (tmp_path / "log01").write_bytes(whole[:length])
        with pytest.raises(InputError) as said:
            read_record(tmp_path / "log01")
        assert "\n" not in str(said.value)


def unsigned(value: int) -> bytes:
    out = b""
    while value > 127:
        out, value = out + bytes([value & 127 | 128]), value >> 7
    return out + bytes([value])


def signed(value: int) -> bytes:
    return unsigned((value << 1) ^ (value >> 63))


def blackbox() -> bytes:
    """A log of whole frames alone: unsigned and signed numbers of variable length, nothing predicted."""
    names = "loopIteration,time,gyroADC[0],gyroADC[1],gyroADC[2],accSmooth[2],motor[0]"
    heads = {
        "Product": "Blackbox flight data recorder by Nicholas Sherlock",
        "Data version": "2",
        "I interval": "1",
        "P interval": "1/1",
        "Field I name": names,
        "Field I signed": "0,0,1,1,1,1,0",
        "Field I predictor": "0,0,0,0,0,0,0",
        "Field I encoding": "1,1,0,0,0,0,1",
        "Field P predictor": "0,0,0,0,0,0,0",
        "Field P encoding": "1,1,0,0,0,0,1",
        "Firmware type": "Cleanflight",
        "Firmware revision": "Betaflight 4.4.0",
        "gyro_scale": "0x3f800000",
        "acc_1G": "2048",
    }
    out = "".join(f"H {key}:{value}\n" for key, value in heads.items()).encode()
    for i, wave in enumerate(WAVE):
        rate = round(100.0 * wave)
        numbers = unsigned(i), unsigned(1_000_000 + 20_000 * i), signed(rate), signed(2 * rate), signed(-rate)
        out += b"I" + b"".join(numbers) + signed(2048) + unsigned(1200 + i)
    return out + b"E\xffEnd of log\0"


@pytest.mark.parametrize("name", ["m.bbl", "m.bfl", "m.log"])
def test_betaflight(tmp_path, name):
    pytest.importorskip("orangebox")
    (tmp_path / name).write_bytes(blackbox())
    record = read_record(tmp_path / name)
    rate = np.round(100.0 * WAVE)
    np.testing.assert_allclose(record.t, T, atol=1e-6)
    for channel, factor in (("p", 1.0), ("q", -2.0), ("r", 1.0)):
        np.testing.assert_allclose(record[channel], np.radians(factor * rate), atol=1e-9)
    np.testing.assert_allclose(record["az"], -9.80665, rtol=1e-9)
    np.testing.assert_allclose(record["m1"], 1200.0 + np.arange(N))


IMU = """std_msgs/Header header
geometry_msgs/Quaternion orientation
geometry_msgs/Vector3 angular_velocity
geometry_msgs/Vector3 linear_acceleration
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
================================================================================
MSG: geometry_msgs/Quaternion
float64 x
float64 y
float64 z
float64 w
================================================================================
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
"""


def ros_bag(**options) -> bytes:
    """A bag of an inertial unit and a voltage. ROS counts yaw from east, so that 0 is a heading of 90 deg; nose up is a
    negative turn about the left."""
    out = io.BytesIO()
    bag = pytest.importorskip("mcap_ros2.writer").Writer(out, **options)
    imu = bag.register_msgdef("sensor_msgs/msg/Imu", IMU)
    volts = bag.register_msgdef("std_msgs/msg/Float64", "float64 data\n")
    for t, wave in zip(T, WAVE, strict=True):
        ns = 1_714_727_662_000_000_000 + round(t * 1e9)
        up = 0.5 * 0.1  # half of a pitch of 0.1 rad, nose up
        message = {
            "header": {"stamp": {"sec": ns // 10**9, "nanosec": ns % 10**9}, "frame_id": "base_link"},
            "orientation": {"x": 0.0, "y": -np.sin(up), "z": 0.0, "w": np.cos(up)},
            "angular_velocity": {"x": wave, "y": 0.5 * wave, "z": -wave},
            "linear_acceleration": {"x": 0.1, "y": 0.2, "z": 9.8},
        }
        bag.write_message("/imu", imu, message, log_time=ns, publish_time=ns)
        bag.write_message("/volts", volts, {"data": 11.1}, log_time=ns, publish_time=ns)
    bag.finish()
    return out.getvalue()


def test_a_ros_bag(tmp_path):
    file = tmp_path / "bag.mcap"
    file.write_bytes(ros_bag())
    record = read_record(file)
    np.testing.assert_allclose(record.t, T, atol=1e-6)
    for channel, expected in (("p", WAVE), ("q", -0.5 * WAVE), ("r", WAVE)):
        np.testing.assert_allclose(record[channel], expected, atol=1e-9)
    for channel, expected in (
        ("ax", 0.1),
        ("ay", -0.2),
        ("az", -9.8),
        ("phi", 0.0),
        ("theta", 0.1),
        ("psi", np.pi / 2),
    ):
        np.testing.assert_allclose(record[channel], expected, atol=1e-9)
    np.testing.assert_allclose(record["/volts.data"], 11.1)


@pytest.mark.parametrize("left", [0.5, 0.99])
def test_a_bag_that_is_cut_off_is_read_to_its_end(tmp_path, left):
    """Of a bag in chunks of 1 kB: the power went, and the summary at its end was never written."""
    whole = ros_bag(chunk_size=1024)
    file = tmp_path / "bag.mcap"
    file.write_bytes(whole[: int(left * len(whole))])
    record = read_record(file)
    assert 0.3 * N < len(record) <= N and any("cut off" in note for note in record.notes)
    np.testing.assert_allclose(record["p"], WAVE[: len(record)], atol=1e-9)
