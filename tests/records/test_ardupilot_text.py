"""ArduPilot's logs as text, and telemetry of MAVLink written by pymavlink. Truth: the numbers that were written."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

import casid as cs
from casid.errors import InputError

N = 250
T = 0.02 * np.arange(N)
WAVE = 0.1 * np.sin(T)
BEGAN = 1_714_727_662_000_000  # us since 1970
TEXT = """FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns
FMT, 129, 31, IMU, QBffffff, TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ
FMT, 130, 21, ATT, Qccccc, TimeUS,DesRoll,Roll,DesPitch,Pitch,Yaw
FMT, 131, 31, RCOU, QHHHH, TimeUS,C1,C2,C3,C4
FMT, 132, 31, PARM, QNf, TimeUS,Name,Value
FMT, 133, 31, RATE, Qf, TimeUS,RDes
PARM, 1, SERVO2_FUNCTION, 19
"""


def dataflash_text() -> bytes:
    rows = []
    for t, wave in zip(T, WAVE, strict=True):
        us = round(1e6 + 1e6 * t)
        for unit, factor in ((0, 1.0), (1, 7.0)):
            rows.append(f"IMU, {us}, {unit}, {factor * wave:.6f}, 0.05, 0.01, 0.2, 0.0, -9.8")
        rows += [f"ATT, {us}, 0.00, {100.0 * wave:.4f}, 0, 3.0, 90.0", f"RATE, {us}, 1.0"]
        rows.append(f"RCOU, {us}, 1500, {1500 + round(1000.0 * wave)}, {1600 + round(100.0 * wave)}, 1500")
    return (TEXT + "\n".join(rows) + "\n").encode()


def test_a_dataflash_log_as_text(tmp_path: Path) -> None:
    """Its numbers are in their units, as `mavlogdump` writes them; an elevator by pulses goes from 1100 to 1900 us."""
    pytest.importorskip("pymavlink")
    (tmp_path / "m.log").write_bytes(dataflash_text())
    record = cs.read_record(tmp_path / "m.log")
    np.testing.assert_allclose(record.t, T, atol=1e-6)
    np.testing.assert_allclose(record["p"], WAVE, atol=1e-6)
    np.testing.assert_allclose(record["phi"], np.radians(100.0 * WAVE), atol=1e-5)
    np.testing.assert_allclose(record["delta_e_command"], np.round(1000.0 * WAVE) / 400.0)
    np.testing.assert_allclose(record["output_3"], 1600.0 + np.round(100.0 * WAVE))
    assert record.contents.unread == {
        "IMU[1]": "of another unit than the first",
        "RATE": "no channel is made of this message",
    }


def telemetry(autopilot: int = 3, imu: str = "raw") -> bytes:
    """What a ground station received: of system 1 the aircraft, of system 255 itself."""
    dialect = pytest.importorskip("pymavlink.dialects.v20.ardupilotmega")
    plane, station = dialect.MAVLink(None, srcSystem=1, srcComponent=1), dialect.MAVLink(None, srcSystem=255)
    out = bytearray()

    def send(link: object, message: object, us: int) -> None:
        out.extend(struct.pack(">Q", us) + message.pack(link))  # pyright: ignore[reportAttributeAccessIssue]

    send(plane, dialect.MAVLink_param_value_message(b"SERVO2_FUNCTION", 19.0, 9, 1, 0), BEGAN)
    for i, (t, wave) in enumerate(zip(T, WAVE, strict=True)):
        ms, us = 5000 + round(1e3 * t), BEGAN + round(1e6 * t) + (700 if i % 2 else 0)  # it arrives unevenly
        send(plane, dialect.MAVLink_heartbeat_message(1, autopilot, 0, 0, 4, 3), us)
        send(station, dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3), us)
        send(plane, dialect.MAVLink_attitude_message(ms, wave, 0.05, 1.0, 2.0 * wave, 0.0, 0.0), us)
        mg = (10, 0, -1000, round(1000.0 * wave), 50, 0, 0, 0, 0)
        if imu == "raw":
            send(plane, dialect.MAVLink_raw_imu_message(1000 * ms, *mg), us)
        send(plane, dialect.MAVLink_global_position_int_message(ms, 450000000, 80000000, 0, 0, 300, 400, -100, 0), us)
        send(
            plane,
            dialect.MAVLink_servo_output_raw_message(1000 * ms, 0, 1500, 1500 + round(1000.0 * wave), *[0] * 6),
            us,
        )
    return bytes(out)


@pytest.mark.parametrize(("autopilot", "imu"), [(3, "raw"), (12, "raw"), (3, "none")])
def test_a_telemetry_log(tmp_path: Path, autopilot: int, imu: str) -> None:
    """ArduPilot sends thousandths of g and rad/s as RAW_IMU; of another autopilot these have no unit, and the rates are
    those of the attitude."""
    (tmp_path / "m.tlog").write_bytes(telemetry(autopilot, imu))
    record = cs.read_record(tmp_path / "m.tlog")
    known = imu == "raw" and autopilot == 3
    np.testing.assert_allclose(record.t, T, atol=1e-5)
    np.testing.assert_allclose(record["p"], np.round(1e3 * WAVE) / 1e3 if known else 2.0 * WAVE, atol=1e-6)
    np.testing.assert_allclose(record["phi"][np.isfinite(record["phi"])], WAVE, atol=1e-6)
    assert np.isfinite(record["phi"]).sum() == N
    np.testing.assert_allclose(record["v_north"], 3.0)
    np.testing.assert_allclose(record["v_east"], 4.0)
    np.testing.assert_allclose(record["v_down"], -1.0)
    np.testing.assert_allclose(record["delta_e_command"], np.round(1000.0 * WAVE) / 400.0)
    assert ("az" in record) == known
    assert ("RAW_IMU" in record.contents.unread) == (imu == "raw" and not known)
    assert "system 255" in record.contents.unread


@pytest.mark.parametrize("content", [b"", b"\xfd" * 400, bytes(range(256)) * 20])
def test_what_is_no_telemetry_is_one_line(tmp_path: Path, content: bytes) -> None:
    pytest.importorskip("pymavlink")
    (tmp_path / "m.tlog").write_bytes(content)
    with pytest.raises(InputError, match="m.tlog"):
        cs.read_record(tmp_path / "m.tlog")
