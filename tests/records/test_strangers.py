"""Files of strangers: what is written comes back equal, or it is refused, or left out, by its name.

`CASID_TABLES=5000` draws that many tables of random names, types, units and nesting.
Truth: the numbers that were written, in the units that were written, converted by their definitions.
"""

from __future__ import annotations

import os
import warnings
import zipfile
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io
import scipy.sparse
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import casid as cs
from casid.errors import InputError
from casid.records.column_map import ColumnMap
from casid.records.map_file import suggested_map
from casid.records.readers import read_table

EXAMPLES = int(os.environ.get("CASID_TABLES", "120"))
N = 80
T = 0.05 * np.arange(N)
WAVE = 0.02 + 0.01 * np.sin(3.0 * T)
KNOT = 1852.0 / 3600.0
DEGREE = np.pi / 180.0
# channel -> units and what one of them is in SI
UNITS = {
    "q": {"": 1.0, "rad/s": 1.0, "deg/s": DEGREE},
    "alpha": {"": 1.0, "deg": DEGREE, "mrad": 1e-3},
    "delta_e": {"": 1.0, "deg": DEGREE},
    "V": {"": 1.0, "kt": KNOT, "ft/s": 0.3048, "km/h": 1.0 / 3.6},
    "altitude": {"": 1.0, "ft": 0.3048},
    "flap_lever": {"": 1.0},
    "mode": {"": 1.0},
}
SIZES = {"V": 50.0, "altitude": 1000.0}
NUMBERS = ("f8", "f4", "i4", "scaled", "filled")
KINDS = (*NUMBERS, "complex", "text", "one", "short", "sparse", "objects", "decimal")
# what a format can hold
HOLDS: dict[str, tuple[str, ...]] = {
    "npz": ("f8", "f4", "i4", "complex", "text", "one", "short"),
    "mat": ("f8", "f4", "i4", "complex", "text", "one", "short", "sparse", "objects"),
    "h5": ("f8", "f4", "i4", "scaled", "filled", "complex", "text", "one", "short"),
    "parquet": ("f8", "f4", "i4", "scaled", "filled", "text", "decimal"),
    "xlsx": ("f8", "text"),
    "csv": ("f8", "text"),
}
STATES_UNITS = ("h5", "parquet")  # beside the numbers; the others in a header
NESTS = {"h5": "/", "mat": ".", "parquet": "."}


@dataclass(frozen=True, kw_only=True)
class Written:
    """A column as it is written."""

    name: str
    kind: str
    unit: str
    group: str
    phase: float

    @property
    def si(self) -> np.ndarray:
        """(N,) in SI, as it has to come back."""
        values = np.round(self.raw * 1000.0) if self.kind == "i4" else self.raw
        values = np.round(values, 9) if self.kind == "decimal" else values
        values = values.astype(np.float32).astype(float) if self.kind == "f4" else values
        values = np.where(np.arange(N) % 7 == 3, np.nan, values) if self.kind == "filled" else values
        return UNITS.get(self.name, {"": 1.0})[self.unit] * values

    @property
    def raw(self) -> np.ndarray:
        """(N,) in the unit of the file."""
        size = SIZES.get(self.name, 1.0) / UNITS.get(self.name, {"": 1.0})[self.unit]
        return size * (WAVE + self.phase) / (1e4 if self.kind == "i4" and self.name not in SIZES else 1.0)

    def path(self, between: str) -> str:
        return f"{self.group}{between}{self.name}" if self.group else self.name


def stored(one: Written) -> tuple[Any, dict[str, Any]]:
    """What a file holds of a column, and its attributes."""
    attributes: dict[str, Any] = {"units": one.unit} if one.unit else {}
    raw = one.raw
    simple = {"f8": raw, "f4": raw.astype(np.float32), "i4": np.round(raw * 1000.0).astype(np.int32)}
    other = {"complex": raw + 1e-9j, "text": np.array(["up"] * N), "one": raw[:1], "short": raw[:-9]}
    other |= {"sparse": scipy.sparse.csc_matrix(raw), "decimal": [Decimal(f"{v:.9f}") for v in raw.tolist()]}
    if one.kind == "objects":
        cell = np.empty(N, dtype=object)
        cell[:] = raw.tolist()
        return cell, attributes
    if one.kind == "scaled":  # numbers of the file = (value - 3) / 0.25
        return (raw - 3.0) / 0.25, attributes | {"scale_factor": 0.25, "add_offset": 3.0}
    if one.kind == "filled":
        return np.where(np.arange(N) % 7 == 3, -777.0, raw), attributes | {"_FillValue": -777.0}
    return (simple | other)[one.kind], attributes


def write(path: Path, columns: list[Written]) -> None:
    """A file of the time and the columns, by the library of its format."""
    ending = path.suffix[1:]
    held = [(one, *stored(one)) for one in columns]
    if ending == "npz":
        np.savez(path, t=T, **{header(one): value for one, value, _ in held})
    elif ending == "mat":
        content: dict[str, Any] = {"t": T}
        for one, value, _ in held:
            content.setdefault(one.group, {})[one.name] = value if one.group else None
            if not one.group:
                content[one.name] = value
        content.pop("", None)
        scipy.io.savemat(path, content)
    elif ending == "h5":
        with pytest.importorskip("h5py").File(path, "w") as file:
            file["t"] = T
            for one, value, attributes in held:
                value = value.astype("S") if one.kind == "text" else value
                file[one.path("/")] = value
                file[one.path("/")].attrs.update(attributes)
    elif ending == "parquet":
        arrow = pytest.importorskip("pyarrow")
        names = ["t", *dict.fromkeys(one.group or one.name for one, _, _ in held)]
        fields, arrays = [arrow.field("t", arrow.float64())], [arrow.array(T)]
        for name in names[1:]:
            parts = [
                (one, arrow.array(value), attributes)
                for one, value, attributes in held
                if (one.group or one.name) == name
            ]
            inner = [
                arrow.field(one.name, array.type, metadata={k: str(v) for k, v in attributes.items()})
                for one, array, attributes in parts
            ]
            group = bool(parts[0][0].group)
            made = (
                arrow.StructArray.from_arrays([array for _, array, _ in parts], fields=inner) if group else parts[0][1]
            )
            fields.append(arrow.field(name, made.type) if group else inner[0])
            arrays.append(made)
        pytest.importorskip("pyarrow.parquet").write_table(
            arrow.Table.from_arrays(arrays, schema=arrow.schema(fields)), path
        )
    else:
        rows = [
            ["t", *(header(one) for one, _, _ in held)],
            *([t.item(), *(v[i].item() for _, v, _ in held)] for i, t in enumerate(T)),
        ]
        if ending == "csv":
            path.write_text("\n".join(",".join(map(str, row)) for row in rows), encoding="utf-8")
        else:
            book = pytest.importorskip("openpyxl").Workbook()
            for row in rows:
                book.active.append(row)
            book.save(path)


def header(one: Written) -> str:
    return f"{one.name} [{one.unit}]" if one.unit else one.name


ANY_NAME = st.from_regex(r"[A-Za-z][A-Za-z0-9]{1,6}(_[a-z0-9]{1,4})?", fullmatch=True)


@st.composite
def tables(draw: st.DrawFn) -> tuple[str, list[Written]]:
    ending = draw(st.sampled_from(sorted(HOLDS)))
    found: list[Written] = []
    for number in range(draw(st.integers(1, 6))):
        name = draw(st.sampled_from(sorted(UNITS)) | ANY_NAME)
        # a field of MATLAB cannot hold a unit in its name
        units = sorted(UNITS[name]) if name in UNITS and ending != "mat" else [""]
        group = draw(st.sampled_from(["", "air", "raw"])) if ending in NESTS else ""
        one = Written(
            name=name,
            kind=draw(st.sampled_from(HOLDS[ending])),
            unit=draw(st.sampled_from(units)),
            group=group,
            phase=0.001 * number,
        )
        if one.path(".") not in [other.path(".") for other in found] and one.group not in [o.name for o in found]:
            found.append(one)
    return ending, found


@given(table=tables())
@settings(max_examples=EXAMPLES, derandomize=EXAMPLES == 120, deadline=None, suppress_health_check=list(HealthCheck))
def test_a_table_comes_back_equal_or_is_refused_by_name(
    table: tuple[str, list[Written]], tmp_path_factory: pytest.TempPathFactory
) -> None:
    ending, columns = table
    path = tmp_path_factory.mktemp("table") / f"m.{ending}"
    write(path, columns)
    unreadable = {one.name for one in columns if one.kind not in (*NUMBERS, "decimal")}
    twice = {one.name for one in columns if sum(one.name == other.name for other in columns) > 1}
    gaps = {one.name for one in columns if one.kind == "filled" and one.name == "delta_e"}
    slips = {one.name for one in columns if one.name not in UNITS}  # which may be nearly the name of a channel
    try:
        record = cs.read_record(path)
    except InputError as error:
        assert any(name in str(error) for name in unreadable | twice | gaps | slips), error
        return
    for one in columns:
        where = place(ending, one)
        found = [name for name, said in record.contents.read.items() if said.startswith(f"column '{where}'")]
        if record.contents.unread.get(where, "").startswith("the same as"):
            np.testing.assert_allclose(record[one.name], one.si, rtol=1e-12)
        elif one.kind in (*NUMBERS, "decimal"):
            np.testing.assert_allclose(record[found[0]], one.si, rtol=1e-12)
        else:
            assert not found and record.contents.unread[where]


def place(ending: str, one: Written) -> str:
    """Where a column stands, as messages name it."""
    if ending in NESTS:
        return f"{'/' if ending == 'h5' else ''}{one.path(NESTS[ending])}"
    return header(one)


def hdf5(path: Path, **content: Any) -> Path:
    with pytest.importorskip("h5py").File(path, "w") as file:
        for name, values in content.items():
            file[name.replace("__", "/")] = values
    return path


def test_two_groups_of_one_name_are_a_question_that_a_map_answers(tmp_path: Path) -> None:
    """The answer that the message offers is one: by the path of a column, or by the group."""
    path = hdf5(tmp_path / "m.h5", t=T, delta_e=WAVE, q=WAVE, raw__q=2.0 * WAVE)
    with pytest.raises(InputError, match="q stands as '/q' and '/raw/q'.*--map q=/raw/q"):
        cs.read_record(path)
    for name, factor in (("/q", 1.0), ("/raw/q", 2.0)):
        record = cs.read_record(path, {"q": name})
        np.testing.assert_allclose(record["q"], factor * WAVE)
        assert set(record.channels) == {"delta_e", "q"} and len(record.contents.unread) == 1
    runs = hdf5(tmp_path / "r.h5", one__t=T, one__delta_e=WAVE, two__t=T + 1.0, two__delta_e=3.0 * WAVE)
    with pytest.raises(InputError, match="'/one/t' and '/two/t'"):
        cs.read_record(runs)
    (tmp_path / "map.toml").write_text('variable = "two"\n[columns]\ndelta_e = "delta_e"\n', encoding="utf-8")
    np.testing.assert_allclose(cs.read_record(runs, tmp_path / "map.toml")["delta_e"], 3.0 * WAVE)


def test_what_stands_twice_and_is_the_same_is_no_question(tmp_path: Path) -> None:
    record = cs.read_record(hdf5(tmp_path / "m.h5", t=T, delta_e=WAVE, raw__delta_e=WAVE))
    assert record.contents.unread == {"/raw/delta_e": "the same as '/delta_e'"}


def test_two_entries_of_a_npz_and_two_columns_of_a_text_are_a_question(tmp_path: Path) -> None:
    """numpy's own reader takes the last of two entries of one name."""
    with zipfile.ZipFile(tmp_path / "m.npz", "w") as archive, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of zipfile, about the name
        for name, values in (("t", T), ("delta_e", WAVE), ("delta_e", 2.0 * WAVE)):
            with archive.open(f"{name}.npy", "w") as file:
                np.lib.format.write_array(file, values)
    rows = np.stack([T, WAVE, 2.0 * WAVE], axis=1)
    np.savetxt(tmp_path / "m.csv", rows, delimiter=",", header="t,delta_e,delta_e", comments="")
    for name in ("m.npz", "m.csv"):
        with pytest.raises(InputError, match="delta_e stands as 'delta_e' and 'delta_e#2'"):
            cs.read_record(tmp_path / name)
        for column in ("delta_e#2", 3):
            record = cs.read_record(tmp_path / name, ColumnMap.of({"delta_e": column}))
            np.testing.assert_allclose(record["delta_e"], 2.0 * WAVE)


def test_links_of_hdf5_lead_to_data_to_nothing_and_to_no_other_file(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    other = hdf5(tmp_path / "other.h5", q=WAVE)
    path = hdf5(tmp_path / "m.h5", t=T, deep__delta_e=WAVE)
    with h5py.File(path, "a") as file:
        file["lost"] = h5py.SoftLink("/nowhere")
        file["q"] = h5py.ExternalLink(other.name, "/q")
        file["deep/again"] = h5py.SoftLink("/deep")
    with pytest.raises(InputError, match="'/q' is not read: a link to another file"):
        cs.read_record(path)
    with h5py.File(path, "a") as file:
        del file["q"]
    record = cs.read_record(path)
    assert record.contents.unread == {"/lost": "a link to nothing"}


def test_times_of_parquet_and_numpy_are_times(tmp_path: Path) -> None:
    """Of any resolution and name; what is no time of the clock is counted in s too."""
    arrow = pytest.importorskip("pyarrow")
    stamps = np.datetime64("2026-05-17T09:30:00.25", "ns") + np.round(T * 1e9).astype("timedelta64[ns]")
    for unit in ("ms", "us", "ns"):
        held = {"stamped": stamps.astype(f"datetime64[{unit}]"), "delta_e": WAVE}
        pytest.importorskip("pyarrow.parquet").write_table(arrow.table(held), tmp_path / "m.parquet")
        np.savez(tmp_path / "m.npz", **held)
        for name in ("m.parquet", "m.npz"):
            np.testing.assert_allclose(cs.read_record(tmp_path / name).t, T, atol=1e-12)


def test_a_file_without_a_time_says_what_is_not_read(tmp_path: Path) -> None:
    np.savez(tmp_path / "m.npz", clock_text=np.array(["up"] * N), delta_e=WAVE)
    with pytest.raises(InputError, match="no column 't'.*not read: 'clock_text' .text"):
        cs.read_record(tmp_path / "m.npz")


@pytest.mark.parametrize(
    ("name", "ticks"),
    [("time_us", 1e6), ("TimeUS", 1e6), ("time_boot_ms", 1e3), ("timestamp_ns", 1e9), ("Time_sec", 1.0)],
)
def test_the_unit_in_the_name_of_a_time(tmp_path: Path, name: str, ticks: float) -> None:
    rows = np.stack([np.round(ticks * T, 3), WAVE], axis=1)
    np.savetxt(tmp_path / "m.csv", rows, delimiter=",", header=f"{name},delta_e", comments="", fmt="%.10g")
    np.testing.assert_allclose(cs.read_record(tmp_path / "m.csv").t, T, atol=1e-9)
    np.testing.assert_allclose(cs.read_record(tmp_path / "m.csv", {"t": name}).t, T, atol=1e-9)


def signal(values: np.ndarray, **fields: Any) -> dict[str, Any]:
    return {"data": values[:, np.newaxis], **fields}


def test_signals_of_matlab_have_their_units_and_rates(tmp_path: Path) -> None:
    """A slower signal has its own samples at its own times and no others; an input runs in straight lines between."""
    fast, slow = np.arange(160) / 20.0, np.arange(40) / 5.0
    content = {
        "PTCH": signal(np.sin(fast), Rate=20, Units="DEG", Description="pitch attitude"),
        "TAS": signal(100.0 + slow, Rate=5, Units="KNOTS"),
        "ELEV": signal(2.0 * slow, Rate=5, Units="DEG"),
    }
    scipy.io.savemat(tmp_path / "m.mat", content)
    record = cs.read_record(tmp_path / "m.mat", {"theta": "PTCH", "V": "TAS", "delta_e": "ELEV"})
    np.testing.assert_allclose(record.t, fast)
    np.testing.assert_allclose(record["theta"], np.radians(np.sin(fast)))
    np.testing.assert_allclose(record["V"][::4], KNOT * (100.0 + slow))
    assert np.isnan(record["V"]).sum() == 120
    np.testing.assert_allclose(record["delta_e"][:157], np.radians(2.0 * fast[:157]))


def test_signals_of_matlab_in_one_structure(tmp_path: Path) -> None:
    content = {"time": signal(T, units="sec"), "delta_e": signal(WAVE, units="deg", description="elevator")}
    scipy.io.savemat(tmp_path / "m.mat", {"flightdata": content})
    record = cs.read_record(tmp_path / "m.mat")
    np.testing.assert_allclose(record["delta_e"], np.radians(WAVE))
    assert record.contents.read["delta_e"].startswith("column 'flightdata.delta_e'; [deg], times 0.0174")


def logged(t: np.ndarray, *signals: np.ndarray) -> dict[str, Any]:
    """A log of Simulink in the format of structures with time."""
    held = np.zeros((1, len(signals)), dtype=[("values", object), ("dimensions", object), ("label", object)])
    for i, values in enumerate(signals):
        held[0, i] = values, values.shape[1], ""
    return {"time": t[:, np.newaxis], "signals": held}


def test_structures_with_time_of_simulink(tmp_path: Path) -> None:
    """Of two with times of their own one is asked for; of several signals each has its place."""
    pair = np.stack([WAVE, 2.0 * WAVE], axis=1)
    content = {"sensors": logged(T, pair, WAVE[:, np.newaxis]), "motors": logged(T[:70], pair[:70])}
    scipy.io.savemat(tmp_path / "m.mat", content)
    with pytest.raises(InputError, match="'sensors.time' .80 samples.*--map t=.*variable = \"GROUP\""):
        cs.read_record(tmp_path / "m.mat")
    names = {"t": "sensors.time", "q": "sensors.signals(1)[2]", "delta_e": "sensors.signals(2)"}
    record = cs.read_record(tmp_path / "m.mat", names)
    np.testing.assert_allclose(record.matrix(["q", "delta_e"]), np.stack([2.0 * WAVE, WAVE], axis=1))
    (tmp_path / "map.toml").write_text('variable = "motors"\n[columns]\ndelta_e = "signals[1]"\n', encoding="utf-8")
    np.testing.assert_allclose(cs.read_record(tmp_path / "m.mat", tmp_path / "map.toml")["delta_e"], WAVE[:70])


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("ending", ["mat", "npz", "h5"])
def test_matrices_beside_a_time_are_columns(tmp_path: Path, ending: str, turned: bool) -> None:
    rates = np.stack([WAVE, 2.0 * WAVE, 3.0 * WAVE], axis=1)
    content = {"time": T, "rate": rates.T if turned else rates, "delta_e": WAVE, "note": np.array([1.0])}
    path = tmp_path / f"m.{ending}"
    if ending == "h5":
        hdf5(path, **content)
    else:
        np.savez(path, **content) if ending == "npz" else scipy.io.savemat(path, content)
    record = cs.read_record(path, {"p": "rate[1]", "q": "rate[2]", "r": "rate[3]"})
    np.testing.assert_allclose(record.matrix(["p", "q", "r"]), rates)
    assert list(record.contents.unread.values()) == ["one value, 1"]


def test_the_map_to_begin_with_knows_matrices_by_their_names(tmp_path: Path) -> None:
    matrix = np.stack([WAVE, 2.0 * WAVE, -5.0 + WAVE], axis=1)
    np.savez(tmp_path / "m.npz", time=T, rate=matrix, attitude=matrix, accel=matrix, elev=WAVE)
    written = suggested_map(read_table(tmp_path / "m.npz", ColumnMap()), ColumnMap())
    (tmp_path / "map.toml").write_text(written, encoding="utf-8")
    record = cs.read_record(tmp_path / "m.npz", tmp_path / "map.toml")
    for channels in (["p", "q", "r"], ["phi", "theta", "psi"], ["ax", "ay", "az"]):
        np.testing.assert_allclose(record.matrix(channels), matrix)


def test_check_lists_what_was_read_and_what_was_not(tmp_path: Path) -> None:
    record = cs.read_record(hdf5(tmp_path / "m.h5", t=T, delta_e=WAVE, q=WAVE, mode=np.array([b"up"] * N)))
    found = cs.check(record).to_dict()["contents"]["m"]
    assert set(found["read"]) == {"t", "delta_e", "q"} and found["unread"] == {"/mode": "text"}


ROWS = [f"{t:.2f};{1000.0 * d:.3f};{d:.6f}" for t, d in zip(T, WAVE, strict=True)]


def text(path: Path, head: str, rows: list[str], end: str = "\n") -> Path:
    path.write_text("\n".join([head, *rows]) + end, encoding="utf-8")
    return path


@given(whole=st.lists(st.integers(900, 2_500_000), min_size=N, max_size=N))
@settings(max_examples=30, derandomize=True, deadline=None, suppress_health_check=list(HealthCheck))
def test_points_between_thousands_are_read_where_decimals_have_a_comma(whole: list[int], tmp_path: Path) -> None:
    """999 is followed by 1.000, as Excel writes it in German."""
    rows = [
        f"{t:.2f};{d:.6f}".replace(".", ",") + f";{n:,}".replace(",", ".")
        for t, d, n in zip(T, WAVE, whole, strict=True)
    ]
    record = cs.read_record(text(tmp_path / "m.csv", "t;delta_e;rounds", rows))
    np.testing.assert_array_equal(record["rounds"], whole)


def test_a_decimal_point_beside_decimal_commas_is_refused(tmp_path: Path) -> None:
    rows = [row.replace(".", ",") for row in ROWS]
    rows[7] = rows[7].rpartition(",")[0] + ".02"
    with pytest.raises(InputError, match="row 8 .*is not a number"):
        cs.read_record(text(tmp_path / "m.csv", "t;x;delta_e", rows))


@pytest.mark.parametrize(("cut", "kept"), [("e", "e"), ("e", "e-"), ("e", "e-0"), (".", ".")])
def test_a_last_number_that_is_cut_off_is_left_out(tmp_path: Path, cut: str, kept: str) -> None:
    rows = [f"{t:.2f},{d:.4e}" for t, d in zip(T, WAVE, strict=True)]
    rows[-1] = rows[-1].rpartition(cut)[0] + kept
    record = cs.read_record(text(tmp_path / "m.csv", "t,delta_e", rows, end=""))
    assert len(record) == N - 1 and any("cut off" in note for note in record.notes)
    np.testing.assert_allclose(record["delta_e"], WAVE[:-1], rtol=1e-4)


def test_exponents_of_one_digit_are_whole(tmp_path: Path) -> None:
    rows = [f"{t:.2f},{100.0 * d:.4f}e-2" for t, d in zip(T, WAVE, strict=True)]
    assert len(cs.read_record(text(tmp_path / "m.csv", "t,delta_e", rows, end=""))) == N


def test_comments_between_rows_are_no_rows(tmp_path: Path) -> None:
    rows = ["# Event LAUNCH occurred at t=0 seconds", *ROWS[:9], "% a remark; of two cells", *ROWS[9:], "# the end"]
    record = cs.read_record(text(tmp_path / "m.csv", "# t;x;delta_e", rows))
    np.testing.assert_allclose(record["delta_e"], WAVE, atol=1e-6)


def test_columns_with_names_are_mapped_by_number(tmp_path: Path) -> None:
    record = cs.read_record(text(tmp_path / "m.csv", "t;x;y", ROWS), {"delta_e": 3})
    np.testing.assert_allclose(record["delta_e"], WAVE, atol=1e-6)


@pytest.mark.parametrize(("ticks", "unit"), [(1e6, "us"), (1e9, "ns")])
def test_a_time_without_unit_that_cannot_be_in_seconds_is_a_question(tmp_path: Path, ticks: float, unit: str) -> None:
    rows = [f"{ticks * t:.0f},{d:.6f}" for t, d in zip(T, WAVE, strict=True)]
    path = text(tmp_path / "m.csv", "timestamp,delta_e", rows)
    with pytest.raises(InputError, match=f"--map t=COLUMN:{unit}"):
        cs.read_record(path)
    np.testing.assert_allclose(cs.read_record(path, {"t": f"timestamp:{unit}"}).t, T, atol=1e-9)


OPENROCKET = """# Simulation 1 (Up to date)
# Time (s),Altitude (m),Vertical velocity (m/s),Mass (g),Thrust (N),Roll rate (\u00b0/s)
# Event LAUNCH occurred at t=0 seconds
"""


def test_openrocket(tmp_path: Path) -> None:
    """Its roll rate is a column of its own, whose sign is not that of an aircraft: nobody is asked, a map takes it."""
    rows = [f"{t:.3f},{10.0 * t:.4f},{2.0 + t:.4f},900.0,60.0,{5.0 * d:.6f}" for t, d in zip(T, WAVE, strict=True)]
    rows.insert(40, "# Event BURNOUT occurred at t=2 seconds")
    path = text(tmp_path / "m.csv", OPENROCKET.rstrip(), rows)
    assert "p" not in cs.read_record(path)
    record = cs.read_record(path, {"p": "Roll rate"})
    np.testing.assert_allclose(record["v_down"], -2.0 - T)
    np.testing.assert_allclose(record["p"], np.radians(5.0 * WAVE), atol=1e-7)
    np.testing.assert_allclose(record["Mass"], 0.9)


def test_altus_metrum(tmp_path: Path) -> None:
    """Two columns are called altitude: of the barometer, then of the GPS."""
    head = "#version,serial,flight,call,time,state,state_name,altitude,gyro_roll,gyro_pitch,gyro_yaw,altitude"
    rows = [
        f"6, 1, 3,CALL, {t - 1.0:.2f}, 3, boost, {1330.0 + t:.2f}, {d:.6f}, 0.5, 1.0, 1394.0"
        for t, d in zip(T, WAVE, strict=True)
    ]
    record = cs.read_record(text(tmp_path / "m.csv", head, rows))
    np.testing.assert_allclose(record.t, T - 1.0)
    np.testing.assert_allclose(record["altitude"], 1330.0 + T)
    np.testing.assert_allclose(record["p"], np.radians(WAVE), atol=1e-7)
    assert set(record.contents.unread) == {"altitude#2", "call", "state_name"}
    mute = text(tmp_path / "n.csv", head.replace(",call", ""), [row.replace("CALL,", "") for row in rows])
    np.testing.assert_array_equal(cs.read_record(mute)["p"], record["p"])  # of an EasyMini, which has no radio


def sheet(path: Path, *above: list[str], formula: str = "") -> Path:
    book = pytest.importorskip("openpyxl").Workbook()
    rows = [[t, d] for t, d in zip(T.tolist(), WAVE.tolist(), strict=True)]
    rows[9][1] = formula or rows[9][1]
    for row in (*above, *rows):
        book.active.append(row)
    book.save(path)
    return path


def test_a_sheet_has_titles_and_a_row_of_units(tmp_path: Path) -> None:
    path = sheet(tmp_path / "m.xlsx", ["Flight 12"], [], ["t", "delta_e"], ["s", "deg"])
    np.testing.assert_allclose(cs.read_record(path)["delta_e"], np.radians(WAVE))


def test_a_formula_that_was_never_evaluated_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="row 10 .*'=B8' is not a number"):
        cs.read_record(sheet(tmp_path / "m.xlsx", ["t", "delta_e"], formula="=B8"))


def test_rows_that_are_copies_are_left_out(tmp_path: Path) -> None:
    """As telemetry repeats its last packet; a time that repeats with other numbers stays an error."""
    path = text(tmp_path / "m.csv", "t;x;delta_e", [*ROWS[:9], ROWS[8], ROWS[8], *ROWS[9:]])
    record = cs.read_record(path)
    np.testing.assert_allclose(record.t, T)
    assert any("2 rows are copies" in note for note in record.notes)
    other = ROWS[8].rpartition(";")[0] + ";0.5"
    with pytest.raises(InputError, match="row 10 .*time repeats"):
        cs.read_record(text(tmp_path / "n.csv", "t;x;delta_e", [*ROWS[:9], other, *ROWS[9:]]))


@pytest.mark.parametrize("unit", ["rad/s", "rad s-1", "rad s^-1", "rad·s^-1", "\u200b", ""])
def test_units_as_others_write_them(tmp_path: Path, unit: str) -> None:
    """OpenRocket writes a mark without width where there is no unit."""
    record = cs.read_record(text(tmp_path / "m.csv", f"t;x;q ({unit})", ROWS))
    np.testing.assert_allclose(record["q"], WAVE, atol=1e-6)


def test_a_note_is_no_command_to_a_terminal(tmp_path: Path) -> None:
    record = cs.read_record(text(tmp_path / "m.csv", "t;\x1b[31mx;delta_e", ROWS))
    assert all(map(str.isprintable, (*record.channels, *record.notes)))


@pytest.mark.parametrize("ending", [".rlog", ".xls", ".nc", ".any", ".tdms"])
def test_a_kind_that_is_not_read_says_what_to_do(tmp_path: Path, ending: str) -> None:
    (tmp_path / f"m{ending}").write_bytes(b"?")
    with pytest.raises(InputError, match="are not read: .*(convert|save|rename)") as caught:
        cs.read_record(tmp_path / f"m{ending}")
    assert "did you mean" not in str(caught.value)
