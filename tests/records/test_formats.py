"""Files as people have them. Truth: the numbers that were written, definitions of units, rotations written out."""

from __future__ import annotations

import gzip
import io
import struct
import time
import tracemalloc
from contextlib import suppress
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import casid as cs
from casid.errors import InputError
from casid.records.clock import seconds_of, stride_of
from casid.records.column_map import ColumnMap
from casid.records.layout import number_of
from casid.records.readers import read_record
from casid.records.table import plain_numbers

N = 200
T = np.arange(N) * 0.02
V = 100.0 + np.sin(T)
DELTA_E = 0.03 * np.cos(3.0 * T)
ROWS = [f"{t:.9g},{v:.9g},{d:.9g}" for t, v, d in zip(T, V, DELTA_E, strict=True)]
PLAIN = "\n".join(["t,V,delta_e", *ROWS]) + "\n"


def check(record, tolerance: float = 1e-7) -> None:
    np.testing.assert_allclose(record.t, T, atol=tolerance)
    np.testing.assert_allclose(record["V"], V, atol=tolerance)
    np.testing.assert_allclose(record["delta_e"], DELTA_E, atol=tolerance)


def indexed() -> str:
    return "\n".join([",t,V,delta_e", *(f"{i},{row}" for i, row in enumerate(ROWS))])


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("semicolons.csv", PLAIN.replace(",", ";")),
        ("decimal_comma.csv", PLAIN.replace(",", ";").replace(".", ",")),
        ("excel_says.csv", "sep=;\n" + PLAIN.replace(",", ";").replace(".", ",")),
        ("tabs.tsv", PLAIN.replace(",", "\t")),
        ("tabs_comma.tsv", PLAIN.replace(",", "\t").replace(".", ",")),
        ("pandas.csv", indexed()),
        ("windows.csv", PLAIN.replace("\n", "\r\n")),
        ("marked.csv", "\ufeff" + PLAIN),
    ],
)
def test_text_as_programs_write_it(tmp_path, name, text):
    file = tmp_path / name
    file.write_bytes(text.encode())
    check(read_record(file))


def test_a_packed_file(tmp_path):
    file = tmp_path / "m1.csv.gz"
    file.write_bytes(gzip.compress(PLAIN.encode()))
    record = read_record(file)
    check(record)
    assert record.name == "m1"
    file.write_bytes(gzip.compress(PLAIN.encode())[:400])
    with pytest.raises(InputError, match="not a whole .gz file"):
        read_record(file)


@pytest.mark.parametrize("head", ["t,V [kt],delta_e [deg]", "t,V (kt),delta_e (deg)", "t,V_kt,delta_e_deg"])
def test_three_spellings_of_a_unit(tmp_path, head):
    """A knot is 1852 m an hour, half a turn is 180 deg."""
    file = tmp_path / "m.csv"
    file.write_text("\n".join([head, *ROWS]))
    record = read_record(file)
    np.testing.assert_allclose(record["V"], V * 1852.0 / 3600.0, rtol=1e-8)
    np.testing.assert_allclose(record["delta_e"], DELTA_E * np.pi / 180.0, atol=1e-9)


def test_a_hint_leads_into_no_trap(tmp_path):
    """A mapped column keeps the unit of its header; a channel is not lost under a name that is none."""
    file = tmp_path / "m.csv"
    file.write_text("\n".join(["t,V (kt),delta_e,alpha", *(f"{row},0.1" for row in ROWS)]))
    for column in ("V (kt)", "V"):
        record = read_record(file, ColumnMap.from_options([f"V={column}"]))
        np.testing.assert_allclose(record["V"], V * 1852.0 / 3600.0, rtol=1e-8)
    with pytest.raises(InputError, match="be lost.*alpha=alfa"):
        read_record(file, ColumnMap.from_options(["alfa=alpha"]))


@pytest.mark.parametrize(("unit", "factor"), [("us", 1e6), ("µs", 1e6), ("ms", 1e3), ("ns", 1e9)])
def test_units_of_time(tmp_path, unit, factor):
    file = tmp_path / "m.csv"
    rows = [f"{t * factor:.12g},{v},{d}" for t, v, d in zip(T, V, DELTA_E, strict=True)]
    file.write_text("\n".join([f"t [{unit}],V,delta_e", *rows]), encoding="utf-8")
    check(read_record(file))


@pytest.mark.parametrize("zone", ["", "Z", "+02:00"])
def test_dates_are_counted_from_the_first(tmp_path, zone):
    began = datetime(2026, 5, 17, 9, 30, 0, 250000)
    stamps = [(began + timedelta(seconds=float(t))).isoformat(timespec="milliseconds") + zone for t in T]
    file = tmp_path / "m.csv"
    file.write_text("\n".join(["t,V,delta_e", *(f"{s},{v},{d}" for s, v, d in zip(stamps, V, DELTA_E, strict=True))]))
    record = read_record(file)
    check(record, 2e-6)
    assert any("counted from its first sample" in note for note in record.notes)


def test_seconds_since_1970(tmp_path):
    file = tmp_path / "m.csv"
    rows = [f"{1.7e9 + t:.6f},{v},{d}" for t, v, d in zip(T, V, DELTA_E, strict=True)]
    file.write_text("\n".join(["t,V,delta_e", *rows]))
    check(read_record(file), 2e-6)


@given(st.datetimes(datetime(1975, 1, 1), datetime(2100, 1, 1)))
def test_a_stamp_is_what_the_library_says(stamp):
    assert seconds_of(stamp.isoformat()) == stamp.replace(tzinfo=UTC).timestamp()


@given(st.text(max_size=30))
def test_other_text_is_no_stamp_or_a_number(text):
    assert seconds_of(text) is None or isinstance(seconds_of(text), float)


def test_an_input_at_half_the_rate_is_joined_by_straight_lines(tmp_path):
    """A straight line is kept exactly; an irregular gap stays an error, a slower output stays as it is."""
    line = 0.01 + 0.002 * T
    rows = zip(T, V, line, strict=True)
    cells = [f"{t},{v if i % 4 == 0 else ''},{d if i % 2 == 0 else ''}" for i, (t, v, d) in enumerate(rows)]
    file = tmp_path / "m.csv"
    file.write_text("\n".join(["t,V,delta_e", *cells]))
    record = read_record(file)
    np.testing.assert_allclose(record["delta_e"][: N - 1], line[: N - 1], atol=1e-12)
    assert np.isnan(record["V"]).sum() == N - N // 4
    assert any("one sample in 2 rows" in note for note in record.notes)
    cells[101] = f"{T[101]},,0.01"
    file.write_text("\n".join(["t,V,delta_e", *cells]))
    with pytest.raises(InputError, match="input is missing"):
        read_record(file)


@pytest.mark.parametrize(
    ("pattern", "stride"), [("xxxxxx", 1), ("x.x.x.", 2), (".x..x..x.", 3), ("x.xx.x", 0), ("x....", 0)]
)
def test_strides(pattern, stride):
    assert stride_of(np.array([1.0 if c == "x" else np.nan for c in pattern])) == stride


@given(st.lists(st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=3, max_size=3), min_size=1))
def test_the_quick_way_reads_the_same_numbers(rows):
    text = "\n".join(",".join(map(repr, row)) for row in rows)
    np.testing.assert_array_equal(plain_numbers(text.encode(), 0, 3, ","), rows)


@pytest.mark.parametrize(
    "text",
    ["1,2\n3,x", "1,2\n3", "1,2\n3,", "1,2\n\n3,4", "1,2\n3,4,5\n6", "1 2,3", "1-2,3", "", "1,2\n3,--4", "1\r2,3"],
)
def test_the_quick_way_leaves_to_the_slow_one_what_is_not_plain(text):
    assert plain_numbers(text.encode(), 0, 2, ",") is None


@pytest.mark.parametrize(
    ("cell", "number"),
    [
        ("-1.5D+02", -150.0),  # Fortran
        ("8,201.4", 8201.4),  # thousands, with decimals by a point
        ("-12,345,678.9", -12345678.9),
        ("8.201.4", 8201.4),  # 8.201,4 after its comma became a point
        ("***", np.nan),  # Fortran, where a number does not fit
        ("", np.nan),
        ("#N/A", np.nan),
        ("1,234", None),  # thousands or decimals: nobody knows
        ("1.2.3", None),
        ("0x1F", None),
        ("1_000", None),
    ],
)
def test_a_number_as_programs_write_it(cell, number):
    read = number_of(cell)
    assert read is None if number is None else read == pytest.approx(number, nan_ok=True)


def test_columns_of_text_that_nobody_needs_are_one_note(tmp_path):
    rows = "\n".join(
        f"{0.02 * i:.2f},{np.sin(0.05 * i):.4f},{0.1 * np.cos(0.05 * i):.4f},AUTO,2024-05-03" for i in range(300)
    )
    path = tmp_path / "m.csv"
    path.write_text("t,q,delta_e,mode,date\n" + rows, encoding="utf-8")
    (note,) = [one for one in read_record(path).notes if "text" in one]
    assert "'mode'" in note and "'date'" in note


def test_capitals_with_a_unit_are_nearly_the_channel(tmp_path):
    """DELTA_E_deg is not taken for a column that nobody knows, for then the record would have no surface."""
    rows = "\n".join(f"{0.02 * i:.2f},{np.sin(0.05 * i):.4f},{5.0 * np.cos(0.05 * i):.4f}" for i in range(300))
    path = tmp_path / "m.csv"
    path.write_text("t,q,DELTA_E_deg\n" + rows, encoding="utf-8")
    with pytest.raises(InputError, match="delta_e"):
        read_record(path)
    record = read_record(path, {"delta_e": "DELTA_E"})
    assert record["delta_e"][0] == pytest.approx(np.radians(5.0))


def test_a_stray_carriage_return_joins_no_digits(tmp_path):
    """Truth: the two ways of reading agree that `1` and `2` with a carriage return between them are not 12."""
    file = tmp_path / "m.csv"
    file.write_bytes(PLAIN.replace("100.", "1\r00.", 1).encode())
    with pytest.raises(InputError, match="line 3"):
        read_record(file)


def test_a_long_file_takes_the_time_and_memory_of_its_numbers(tmp_path):
    """A few times the processor time of numpy's own reader of text; the text, a block of it, and twice the numbers in
    memory. A million rows of 20 columns (195 MB): 3.1 s of processor time and 504 MB in all on a 2.8 GHz Xeon."""
    names = ["t", "V", "delta_e", *(f"x{i}" for i in range(17))]
    table = np.random.default_rng(0).standard_normal((40_000, 20)) * 0.1
    table[:, 0], table[:, 1] = 0.01 * np.arange(len(table)), table[:, 1] + 100.0
    file = tmp_path / "long.csv"
    np.savetxt(file, table, fmt="%.6g", delimiter=",", header=",".join(names), comments="")
    begin = time.process_time()
    plain = np.loadtxt(file, delimiter=",", skiprows=1)
    between = time.process_time()
    record = read_record(file)
    assert time.process_time() - between < 6.0 * (between - begin)
    np.testing.assert_array_equal(record.matrix(names), plain)
    tracemalloc.start()
    read_record(file)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 4.0 * file.stat().st_size + 2.5 * table.nbytes  # all of this file is one block


# -- files of other programs -------------------------------------------------------------------------------------------


def test_hdf5(tmp_path):
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "m.h5", "w") as file:
        group = file.create_group("flight")
        for name, values in {"t": T, "V": V, "delta_e": DELTA_E}.items():
            group[name] = values
    check(read_record(tmp_path / "m.h5"))


def test_matlab_73(tmp_path):
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "m.mat", "w", userblock_size=512) as file:
        for name, values in {"t": T, "V": V, "delta_e": DELTA_E}.items():
            file[name] = values[None, :]
            file[name].attrs["MATLAB_class"] = np.bytes_("double")
        file["logs"] = np.arange(len(T), dtype="u4")[None, :]  # where a timeseries is
        file["logs"].attrs["MATLAB_object_decode"] = np.int32(3)
    raw = bytearray((tmp_path / "m.mat").read_bytes())
    raw[:128] = b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM"
    (tmp_path / "m.mat").write_bytes(raw)
    record = read_record(tmp_path / "m.mat")
    check(record)
    assert set(record.contents.unread) == {"logs"}


def test_a_struct_of_matlab(tmp_path):
    from scipy.io import savemat

    savemat(tmp_path / "m.mat", {"flight": {"t": T, "V": V, "delta_e": DELTA_E}, "comment": "calm"})
    check(read_record(tmp_path / "m.mat"))


def test_excel(tmp_path):
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    book.active.append(["t", "V [kt]", "delta_e"])
    for row in zip(T.tolist(), (V * 3600.0 / 1852.0).tolist(), DELTA_E.tolist(), strict=True):
        book.active.append(row)
    book.save(tmp_path / "m.xlsx")
    check(read_record(tmp_path / "m.xlsx"))


def test_mdf(tmp_path):
    asammdf = pytest.importorskip("asammdf")
    with asammdf.MDF() as file:
        signals = {"V": (V, "m/s"), "delta_e": (DELTA_E, "rad")}
        file.append([asammdf.Signal(v, T, name=name, unit=unit) for name, (v, unit) in signals.items()])
        file.save(tmp_path / "m.mf4")
    check(read_record(tmp_path / "m.mf4"))


def ulog(topics: dict[str, tuple[str, list[tuple[int, tuple[float, ...]]]]]) -> bytes:
    """A PX4 log: the header, then formats, subscriptions and data as its specification says."""
    out = io.BytesIO()
    out.write(b"ULog\x01\x12\x35" + b"\x01" + struct.pack("<Q", 0))

    def message(kind: bytes, content: bytes) -> None:
        out.write(struct.pack("<HB", len(content), kind[0]) + content)

    for name, (fields, _) in topics.items():
        message(b"F", f"{name}:uint64_t timestamp;{fields};".encode())
    for i, name in enumerate(topics):
        message(b"A", struct.pack("<BH", 0, i) + name.encode())
    for i, (_, samples) in enumerate(topics.values()):
        for stamp, values in samples:
            layout = "f" if isinstance(values[0], float) else "B"
            message(b"D", struct.pack("<HQ", i, stamp) + struct.pack(f"<{len(values)}{layout}", *values))
    return out.getvalue()


def test_px4_ulog(tmp_path):
    """Rates at 50 Hz; airspeed at 10 Hz has its own samples and no others; a quarter turn about the nose is 90 deg of
    bank."""
    pytest.importorskip("pyulog")
    fast = [(1_000_000 + 20_000 * i, (0.01 * i, 0.0, 0.0)) for i in range(N)]
    slow = [(1_000_000 + 100_000 * i, (20.0 + 0.1 * i,)) for i in range(N // 5 + 1)]
    turn = [(stamp, (np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0)) for stamp, _ in fast]
    raw = ulog(
        {
            "vehicle_angular_velocity": ("float[3] xyz", fast),
            "airspeed_validated": ("float true_airspeed_m_s", slow),
            "vehicle_attitude": ("float[4] q", turn),
            "vehicle_torque_setpoint": ("float[3] xyz", [(stamp, (0.0, 0.5, 0.0)) for stamp, _ in fast]),
        }
    )
    (tmp_path / "m.ulg").write_bytes(raw)
    record = read_record(tmp_path / "m.ulg", ColumnMap.from_options(["delta_e=delta_e_command:deg*25"]))
    np.testing.assert_allclose(record.t, T, atol=1e-6)
    np.testing.assert_allclose(record["V"][::5], 20.0 + T[::5], atol=1e-5)
    assert np.isfinite(record["V"]).sum() == N // 5
    assert any("throttle is no thrust" in note for note in record.notes)
    np.testing.assert_allclose(record["p"], 0.01 * np.arange(N), atol=1e-6)
    np.testing.assert_allclose(record["phi"], np.pi / 2.0, atol=1e-6)
    np.testing.assert_allclose(record["delta_e"], np.deg2rad(12.5), atol=1e-7)


def old_px4(**changed) -> bytes:
    """Ten seconds of a fixed wing before PX4 1.14, on the ground in the first two: rates at 50 Hz, commands and density
    that begin later and end earlier, a pitot that reads nothing at first."""
    us = [1_000_000 + 20_000 * i for i in range(500)]
    topics = {
        "sensor_combined": (
            "float[3] gyro_rad;float[3] accelerometer_m_s2",
            [(t, (0.01 * i, 0.0, 0.0, 0.0, 0.0, -9.8)) for i, t in enumerate(us)],
        ),
        "actuator_controls_0": ("float[8] control", [(t, (0.1, 0.2, 0.3, 0.4, *[0.0] * 4)) for t in us[5:-5:5]]),
        "airspeed": ("float true_airspeed_m_s", [(t, (-1.5 + 0.5 * k,)) for k, t in enumerate(us[::50])]),
        "vehicle_air_data": ("float rho", [(t, (1.2,)) for t in us[:-20:10]]),
        "vehicle_land_detected": ("bool landed", [(t, (int(k < 2),)) for k, t in enumerate(us[::50])]),
        "vehicle_status": ("uint8_t vehicle_type", [(us[0], (2,)), (us[-1], (2,))]),
    }
    return ulog(topics | changed)


def test_an_old_px4_log_is_cut_to_what_it_has_in_the_air(tmp_path):
    """Truth: the stamps that were written. In the air from 2 s on; density ends at 9.4 s, before the rates."""
    pytest.importorskip("pyulog")
    (tmp_path / "m.ulg").write_bytes(old_px4())
    record = read_record(tmp_path / "m.ulg")
    assert record.t[0] == pytest.approx(2.0) and record.t[-1] == pytest.approx(9.4, abs=0.21)
    np.testing.assert_allclose(record["p"], 0.5 * record.t, atol=1e-5)
    np.testing.assert_allclose(record["delta_e_command"], 0.2, atol=1e-6)
    np.testing.assert_allclose(record["throttle"], 0.4, atol=1e-6)
    np.testing.assert_allclose(record["rho"], 1.2, atol=1e-6)
    assert np.nanmin(record["V"]) > 0.0
    said = " ".join(record.notes)
    assert "a PX4 log of a fixed wing" in said and "the rest is on the ground" in said and "not positive" in said


def test_an_aircraft_that_stays_on_the_ground_is_said_to(tmp_path):
    """Landed throughout: its rows are kept, to be looked at, and nothing can be identified from them."""
    pytest.importorskip("pyulog")
    landed = ("bool landed", [(1_000_000 + 500_000 * k, (1,)) for k in range(20)])
    (tmp_path / "m.ulg").write_bytes(old_px4(vehicle_land_detected=landed))
    found = cs.check(read_record(tmp_path / "m.ulg"))
    assert found.recorded[0].grounded and [one.target for one in found.reported] == ["V"]
    assert not read_record_of(tmp_path, old_px4()).grounded


def read_record_of(folder, raw):
    (folder / "flown.ulg").write_bytes(raw)
    return read_record(folder / "flown.ulg")


def test_a_px4_multirotor_has_motors_and_no_limit_of_aeroplanes(tmp_path):
    pytest.importorskip("pyulog")
    us = [1_000_000 + 20_000 * i for i in range(250)]
    nan = float("nan")
    quick = "float[3] gyro_rad;float[3] accelerometer_m_s2", [(t, (17.0, 0.0, 0.0, 0.0, 0.0, -9.8)) for t in us]
    motors = [(t, (0.4 + 0.001 * i, 0.5, 0.6, nan)) for i, t in enumerate(us)]
    raw = old_px4(
        sensor_combined=quick,
        actuator_motors=("float[4] control", motors),
        vehicle_status=("uint8_t vehicle_type", [(us[0], (1,)), (us[-1], (1,))]),
        vehicle_land_detected=("bool landed", [(us[0], (0,))]),
        battery_status=("float voltage_v", [(t, (11.5,)) for t in us]),
    )
    (tmp_path / "m.ulg").write_bytes(raw)
    record = read_record(tmp_path / "m.ulg")
    np.testing.assert_allclose(record["p"], 17.0)
    np.testing.assert_allclose(record["m1"], np.interp(record.t, 0.02 * np.arange(250), [m[0] for _, m in motors]))
    assert "m4" not in record and "delta_e_command" not in record
    np.testing.assert_allclose(record["battery"][np.isfinite(record["battery"])], 11.5)


FORMATS = {"Q": "Q", "f": "f", "B": "B", "n": "4s", "N": "16s", "Z": "64s", "L": "i", "h": "h", "H": "H", "I": "I"}


def dataflash(messages: dict[str, tuple[str, str, list[tuple]]]) -> bytes:
    """A log of ArduPilot: messages of head A3 95 and a type; FMT, type 128, describes the others.

    `messages`: name -> (formats, names of fields, rows); rows of all messages stand in the order of their first field.
    """
    head = b"\xa3\x95"
    out = io.BytesIO()
    kinds = {name: 129 + i for i, name in enumerate(messages)}
    described = {"FMT": (128, "BBnNZ", "Type,Length,Name,Format,Columns")}
    described |= {name: (kinds[name], formats, fields) for name, (formats, fields, _) in messages.items()}
    for name, (kind, formats, fields) in described.items():
        size = 3 + struct.calcsize("<" + "".join(FORMATS[c] for c in formats))
        out.write(
            head
            + bytes([128])
            + struct.pack("<BB4s16s64s", kind, size, name.encode(), formats.encode(), fields.encode())
        )
    rows = [(row, name) for name, (_, _, some) in messages.items() for row in some]
    for row, name in sorted(rows, key=lambda one: (one[0][0], one[1])):
        layout = "<" + "".join(FORMATS[c] for c in messages[name][0])
        out.write(head + bytes([kinds[name]]) + struct.pack(layout, *row))
    return out.getvalue()


def flown_log(**changed: tuple[str, str, list[tuple]] | None) -> bytes:
    """Ten seconds of a plane at 1000 m: IMU at 50 Hz, airspeed and GPS at 5 Hz, attitude at 25 Hz."""
    us = [int(1e6 + 2e4 * i) for i in range(500)]
    slow = us[::10]
    pressure = 101325.0 * (1.0 - 2.25577e-5 * 1000.0) ** 5.25588
    messages: dict[str, tuple[str, str, list[tuple]] | None] = {
        "IMU": (
            "QBffffff",
            "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ",
            [(t, 0, 0.3 * np.sin(t * 1e-6), 0.01, 0.02, 0.1, 0.2, -9.8) for t in us],
        ),
        "ATT": ("Qfff", "TimeUS,Roll,Pitch,Yaw", [(t, 10.0, 3.0, (350.0 + 5.0 * t * 1e-6) % 360.0) for t in us[::2]]),
        "ARSP": ("QBf", "TimeUS,I,Airspeed", [(t, 0, 20.0) for t in us[::10]]),
        "BARO": ("QBff", "TimeUS,I,Alt,Press", [(t, 0, 12.0, pressure) for t in us[::10]]),
        "GPS": (
            "QBBIHLLfff",
            "TimeUS,I,Status,GMS,GWk,Lat,Lng,Spd,GCrs,VZ",
            [
                (t, 0, 3, 1000 + 200 * i, 2300, 10 * i + 450000000, 80000000, 25.0, 90.0, -1.0)
                for i, t in enumerate(slow)
            ],
        ),
        "XKF2": ("QBff", "TimeUS,C,VWN,VWE", [(t, 0, 1.0, 3.0) for t in us[::10]]),
        "AOA": ("Qff", "TimeUS,AOA,SSA", [(t, 4.0, -1.0) for t in us[::5]]),
        "AETR": ("Qffff", "TimeUS,Ail,Elev,Thr,Rudd", [(t, 450.0, 900.0, 60.0, -450.0) for t in us[::2]]),
        "XXXX": ("QB", "TimeUS,N", [(t, 1) for t in us[::50]]),
    }
    messages |= changed
    return dataflash({name: one for name, one in messages.items() if one is not None})


SURFACES_OF_LOG = ["delta_e=delta_e_command:deg*25", "delta_a=delta_a_command:deg*20"]


def test_ardupilot_log(tmp_path):
    """Truth: what was written, by the layout of DataFlash; true airspeed over indicated is the root of 1.225/1.1116."""
    pytest.importorskip("pymavlink")
    (tmp_path / "m.bin").write_bytes(flown_log())
    record = read_record(tmp_path / "m.bin", ColumnMap.from_options(SURFACES_OF_LOG))
    assert len(record) == 499 and record.t[-1] == pytest.approx(9.96)  # as far as there are commands
    np.testing.assert_allclose(record["p"], 0.3 * np.sin(record.t + 1.0), atol=1e-6)
    np.testing.assert_allclose(record["az"], -9.8, rtol=1e-6)
    np.testing.assert_allclose(record["delta_e"], np.radians(0.2 * 25.0), rtol=1e-6)
    np.testing.assert_allclose(record["delta_a"], np.radians(0.1 * 20.0), rtol=1e-6)
    np.testing.assert_allclose(record["throttle"][:-1], 0.6, rtol=1e-6)
    expected = {
        "altitude": 1000.0,
        "V": 20.0 * np.sqrt(1.225 / 1.11164),
        "v_north": 0.0,
        "v_east": 25.0,
        "v_down": -1.0,
    }
    for name, value in expected.items():
        there = np.isfinite(record[name])
        assert there.sum() == 50  # its own samples, and no others
        np.testing.assert_allclose(record[name][there], value, rtol=2e-4, atol=1e-4)
    there = np.isfinite(record["psi"])
    assert there.sum() == 250
    np.testing.assert_allclose(record["psi"][there], np.radians(355.0 + 5.0 * record.t[there]), atol=1e-5)
    north = record["north"][np.isfinite(record["north"])]
    np.testing.assert_allclose(north[-1] - north[0], 6.371e6 * np.radians(49e-6), rtol=1e-3)
    assert not {"alpha", "beta", "thrust"} & set(record.channels)
    np.testing.assert_allclose(record["alpha_estimate"][100], np.radians(4.0), rtol=1e-6)
    said = " ".join(record.notes)
    for part in (
        "alpha and beta are not measured",
        "kept as alpha_estimate",
        "throttle is no thrust",
        "estimates of the",
    ):
        assert part in said
    assert "lost" not in said and "an ArduPilot log of a plane" in record.notes


def test_an_ardupilot_copter(tmp_path):
    """Pulse widths of 1200 and 1800 us are 0.2 and 0.8 of a motor's range; event 28 is a lift-off, 18 a landing."""
    pytest.importorskip("pymavlink")
    us = [int(1e6 + 2e4 * i) for i in range(500)]
    parameters = {"SERVO1_FUNCTION": 33.0, "SERVO2_FUNCTION": 34.0}
    changed = {
        "AETR": None,
        "ARSP": None,
        "AOA": None,
        "RCOU": ("QHHH", "TimeUS,C1,C2,C3", [(t, 1200, 1800, 1500) for t in us[::2]]),
        "EV": ("QB", "TimeUS,Id", [(us[100], 28), (us[400], 18)]),
        "BAT": ("QBf", "TimeUS,Instance,Volt", [(t, 0, 12.0) for t in us[::5]]),
        "PARM": (
            "QNf",
            "TimeUS,Name,Value",
            [*((0, name.encode(), value) for name, value in parameters.items()), (us[300], b"SERVO1_FUNCTION", 1.0)],
        ),
    }
    (tmp_path / "m.bin").write_bytes(flown_log(**changed))
    record = read_record(tmp_path / "m.bin")
    assert (record.t[0], record.t[-1]) == (pytest.approx(2.0), pytest.approx(7.98))
    np.testing.assert_allclose(record["m1"], 0.2, rtol=1e-9)
    np.testing.assert_allclose(record["m2"], 0.8, rtol=1e-9)
    assert not any(name.endswith("_command") for name in record.channels)
    assert any("SERVO1_FUNCTION is changed from 33 to 1" in note for note in record.notes)
    assert "an ArduPilot log of a multirotor" in record.notes


def test_ardupilot_quaternion_servos_and_no_airspeed(tmp_path):
    """The attitude of a quarter turn about the nose; an elevator by pulses, reversed, half way from trim to its end."""
    pytest.importorskip("pymavlink")
    us = [int(1e6 + 2e4 * i) for i in range(0, 500, 2)]
    half = float(np.sqrt(0.5))
    values = {
        "SERVO2_FUNCTION": 19.0,
        "SERVO2_MIN": 1000.0,
        "SERVO2_TRIM": 1400.0,
        "SERVO2_MAX": 2000.0,
        "SERVO2_REVERSED": 1.0,
    }
    changed = {
        "AETR": None,
        "ARSP": None,
        "AOA": None,
        "XKQ": ("QBffff", "TimeUS,C,Q1,Q2,Q3,Q4", [(t, 0, half, half, 0.0, 0.0) for t in us]),
        "RCOU": ("QHHH", "TimeUS,C1,C2,C3", [(t, 1500, 1700, 1500) for t in us]),
        "PARM": (
            "QNf",
            "TimeUS,Name,Value",
            [(i, name.encode(), value) for i, (name, value) in enumerate(values.items())],
        ),
    }
    (tmp_path / "m.bin").write_bytes(flown_log(**changed))
    record = read_record(tmp_path / "m.bin", ColumnMap.from_options(SURFACES_OF_LOG[:1]))
    np.testing.assert_allclose(record["phi"][np.isfinite(record["phi"])], np.pi / 2.0, atol=1e-6)
    np.testing.assert_allclose(record["delta_e"], np.radians(-0.5 * 25.0), rtol=1e-6)
    assert "V" not in record and any("V is lost" in note for note in record.notes)


LIBRARIES = {"h5": "h5py", "xlsx": "openpyxl", "mf4": "asammdf", "ulg": "pyulog", "bin": "pymavlink.DFReader"}


@pytest.mark.parametrize(("ending", "module"), LIBRARIES.items())
def test_without_its_library_a_format_says_what_to_install(tmp_path, monkeypatch, ending, module):
    monkeypatch.setitem(__import__("sys").modules, module, None)
    (tmp_path / f"m.{ending}").write_bytes(b"")
    with pytest.raises(InputError, match="pip install 'casid"):
        read_record(tmp_path / f"m.{ending}")


@pytest.mark.parametrize("ending", [*LIBRARIES, "csv.gz"])
@settings(max_examples=25)  # each is read in a process of its own; test_mutants.py reads thousands
@given(content=st.binary(max_size=200))
def test_rubbish_is_one_line(tmp_path_factory, ending, content):
    with suppress(ImportError):  # once here, and not in the process of each file
        __import__(LIBRARIES.get(ending, "gzip"))
    file = tmp_path_factory.mktemp("rubbish") / f"m.{ending}"
    file.write_bytes(content)
    with pytest.raises(InputError) as said:
        read_record(file)
    assert "\n" not in str(said.value)
