"""Foreign files: column maps, text columns, .mat, .npz, .parquet. Truth: the numbers written; the physics of flight."""

import sys

import numpy as np
import pytest
import scipy.io
from hypothesis import given, settings
from hypothesis import strategies as st

from casid.errors import InputError
from casid.records import ColumnMap, ColumnTerm, parse_map_option, read_record

N = 200
T = 0.02 * np.arange(N)
WAVE = np.sin(T)
MATRIX = np.stack([T, 5.0 * WAVE, 2.0 * WAVE, 8.0 * WAVE], axis=1)  # t [s], alpha [deg], ailerons left and right [deg]
MAP = ["t=1", "alpha=2:deg", "delta_a=0.5*4:deg,-0.5*3:deg"]


def check(record):
    assert set(record.channels) == {"alpha", "delta_a"}
    np.testing.assert_array_equal(record.t, T)
    np.testing.assert_allclose(record["alpha"], np.radians(5.0 * WAVE), rtol=1e-14)
    np.testing.assert_allclose(record["delta_a"], np.radians(3.0 * WAVE), rtol=1e-14)


def matrix_file(path):
    if path.suffix == ".mat":
        scipy.io.savemat(path, {"flight": MATRIX, "comment": "noon"})
    elif path.suffix == ".npz":
        np.savez(path, flight=MATRIX)
    else:
        np.savetxt(path, MATRIX, fmt="%.17g", delimiter="," if path.suffix == ".csv" else "  ")
    return path


@pytest.mark.parametrize("ending", [".mat", ".npz", ".asc", ".txt", ".dat", ".csv"])
def test_columns_without_names(tmp_path, ending):
    path = matrix_file(tmp_path / f"m1{ending}")
    check(read_record(path, ColumnMap.from_options(MAP)))
    with pytest.raises(InputError, match="its 4 columns have no names"):
        read_record(path)


def test_a_map_in_a_file(tmp_path):
    toml = tmp_path / "map.toml"
    toml.write_text(
        'variable = "flight"\n[columns]\nt = 1\nalpha = "2:deg"\ndelta_a = ["0.5*4:deg", "3:deg*-0.5"]\n',
        encoding="utf-8",
    )
    path = tmp_path / "m1.mat"
    scipy.io.savemat(path, {"flight": MATRIX, "other": MATRIX})
    check(read_record(path, toml))
    with pytest.raises(InputError, match=r"matrices in the file: 'flight', 'other'; name one as 'variable'"):
        read_record(path, ColumnMap.from_options(MAP))
    toml.write_text(toml.read_text().replace('"flight"', '"fligth"'))
    with pytest.raises(InputError, match="unknown variable 'fligth'; did you mean 'flight'"):
        read_record(path, toml)


def test_an_option_wins_over_the_map_before_it(tmp_path):
    toml = tmp_path / "map.toml"
    toml.write_text('[columns]\nt = 1\nalpha = "3:deg"\ndelta_a = ["0.5*4:deg", "-0.5*3:deg"]\n', encoding="utf-8")
    check(read_record(matrix_file(tmp_path / "m1.npz"), ColumnMap.from_options([str(toml), "alpha=2:deg"])))


@pytest.mark.parametrize("ending", [".csv", ".txt", ".mat", ".npz", ".parquet"])
def test_columns_with_foreign_names(tmp_path, ending):
    path = tmp_path / f"m1{ending}"
    columns = dict(zip(("t", "ALCG", "AIL", "AIR"), MATRIX.T, strict=True))
    if ending == ".mat":
        scipy.io.savemat(path, {**columns, "rate": 50.0})
    elif ending == ".npz":
        np.savez(path, **columns)
    elif ending == ".parquet":
        pyarrow = pytest.importorskip("pyarrow", reason="needs the extra 'parquet'")
        parquet = pytest.importorskip("pyarrow.parquet")
        parquet.write_table(pyarrow.table(columns), path)
    else:
        separator = "," if ending == ".csv" else " "
        np.savetxt(path, MATRIX, fmt="%.17g", delimiter=separator, header=separator.join(columns), comments="")
    record = read_record(path, ColumnMap.from_options(["alpha=ALCG:deg", "delta_a=0.5*AIR:deg,-0.5*AIL:deg"]))
    check(record)


def test_a_map_takes_the_unit_of_the_header(tmp_path):
    path = tmp_path / "m1.csv"
    np.savetxt(path, MATRIX[:, [0, 1]], delimiter=",", header="t,ALCG [deg]", comments="")
    record = read_record(path, ColumnMap.from_options(["delta_e=ALCG"]))
    np.testing.assert_allclose(record["delta_e"], np.radians(MATRIX[:, 1]), rtol=1e-15)
    np.testing.assert_array_equal(read_record(path, parse_map_option("delta_e=ALCG:deg"))["delta_e"], record["delta_e"])
    with pytest.raises(InputError, match=r"the column map says \[rad\], the header says \[deg\]"):
        read_record(path, parse_map_option("delta_e=ALCG:rad"))


def test_a_column_mapped_to_its_own_name_is_meant(tmp_path):
    path = tmp_path / "m1.csv"
    np.savetxt(path, MATRIX[:, :3] * [1.0, 0.1, 0.1], delimiter=",", header="t,delta_e,delta_f", comments="")
    with pytest.raises(InputError, match="--map delta_f=delta_f to keep it"):
        read_record(path)
    assert set(read_record(path, parse_map_option("delta_f=delta_f")).channels) == {"delta_e", "delta_f"}


@pytest.mark.parametrize(
    ("option", "channel", "terms"),
    [
        ("alpha=ALCG:deg", "alpha", [ColumnTerm(column="ALCG", unit="deg")]),
        ("alpha=ALCG", "alpha", [ColumnTerm(column="ALCG")]),
        ("q = 8:deg/s", "q", [ColumnTerm(column=8, unit="deg/s")]),
        ("alpha=12:deg*-1", "alpha", [ColumnTerm(column=12, unit="deg", weight=-1.0)]),
        ("alpha=-1*12:deg", "alpha", [ColumnTerm(column=12, unit="deg", weight=-1.0)]),
        ("ax=1e-3*Acc x", "ax", [ColumnTerm(column="Acc x", weight=1e-3)]),
        ("d=.5*A,-.5*B", "d", [ColumnTerm(column="A", weight=0.5), ColumnTerm(column="B", weight=-0.5)]),
    ],
)
def test_map_options(option, channel, terms):
    assert parse_map_option(option).columns == {channel: tuple(terms)}


@pytest.mark.parametrize(
    "option", ["alpha", "alpha=", "=ALCG", "alpha=:deg", "alpha=2*ALCG*3", "alpha=a*b", "alpha=A:deg:x"]
)
def test_what_is_no_map_option(option):
    with pytest.raises(InputError, match=r"--map"):
        parse_map_option(option)


@pytest.mark.parametrize(
    ("option", "part"),
    [
        ("alhpa=2", "unknown channel 'alhpa'; did you mean 'alpha'"),
        ("alpha=5:deg", "there is no column 5; the file has columns 1 to 4"),
        ("alpha=0:deg", "there is no column 0"),
        ("alpha=ALCG:deg", "'ALCG' is a name, but the columns have none"),
        ("alpha=2:m", "unit 'm' does not fit channel 'alpha', whose SI unit is rad"),
        ("alpha=2", "row 18, column 2 (mapped to 'alpha'): 1.66744 rad is 95.54 deg"),
    ],
)
def test_a_map_that_does_not_fit(tmp_path, option, part):
    with pytest.raises(InputError) as caught:
        read_record(matrix_file(tmp_path / "m1.npz"), ColumnMap.from_options([*MAP, option]))
    assert part in str(caught.value)


@pytest.mark.parametrize(
    ("content", "part"),
    [
        ("[colums]\nt = 1\n", "unknown key 'colums'; did you mean 'columns'"),
        ('variable = "a"\n', "needs a table [columns]"),
        ("[columns]\nt = 1.5\n", "[columns] t: 1.5 is not a column"),
        ("[columns]\nt = true\n", "[columns] t: True is not a column"),
        ("[columns]\nt = []\n", "no column"),
        ("variable = 3\n[columns]\nt = 1\n", "'variable' must be a name"),
        ("[columns\n", "not valid TOML"),
    ],
)
def test_a_map_file_with_a_fault(tmp_path, content, part):
    path = tmp_path / "map.toml"
    path.write_text(content)
    with pytest.raises(InputError) as caught:
        ColumnMap.read(path)
    assert part in str(caught.value) and "map.toml" in str(caught.value)


def test_vectors_must_be_of_one_length(tmp_path):
    np.savez(tmp_path / "m1.npz", t=T, delta_e=WAVE[1:])
    with pytest.raises(InputError, match="'delta_e' is not read: it has 199 samples, the others have 200"):
        read_record(tmp_path / "m1.npz")


def test_a_matrix_is_not_transposed_by_guess(tmp_path):
    np.savez(tmp_path / "m1.npz", flight=MATRIX.T)
    with pytest.raises(InputError, match=r"shape \(4, 200\); expected samples in rows"):
        read_record(tmp_path / "m1.npz", ColumnMap.from_options(MAP))


def test_pickled_objects_are_refused(tmp_path):
    np.savez(tmp_path / "m1.npz", t=np.array([{"a": 1}], dtype=object))
    with pytest.raises(InputError, match="'t' is not read: pickled objects"):
        read_record(tmp_path / "m1.npz")


def test_parquet_without_pyarrow_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow.parquet", None)
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(InputError, match=r"pip install 'casid\[parquet\]'"):
        read_record(tmp_path / "m1.parquet")


@pytest.mark.parametrize("ending", [".mat", ".npz"])
@given(kept=st.floats(0.0, 0.99))
@settings(max_examples=40)
def test_a_binary_file_that_was_cut_off_is_one_line_of_error(tmp_path_factory, ending, kept):
    path = matrix_file(tmp_path_factory.mktemp("records") / f"m1{ending}")
    path.write_bytes(path.read_bytes()[: int(kept * path.stat().st_size)])
    with pytest.raises(InputError) as caught:
        read_record(path, ColumnMap.from_options(MAP))
    assert "\n" not in str(caught.value)


@given(data=st.data())
@settings(max_examples=60)
def test_a_mutilated_npz_file_is_a_record_or_one_line_of_error(tmp_path_factory, data):
    path = matrix_file(tmp_path_factory.mktemp("records") / "m1.npz")
    content = bytearray(path.read_bytes())
    for _ in range(data.draw(st.integers(1, 3))):
        at = data.draw(st.integers(0, 300) | st.integers(0, len(content) - 1))
        content[at : at + data.draw(st.integers(0, 8))] = data.draw(st.binary(max_size=8))
    path.write_bytes(content)
    try:
        read_record(path, ColumnMap.from_options(MAP))
    except InputError as error:
        assert "\n" not in str(error)


def test_attas_obeys_the_gas_law_and_the_kinematics_of_flight(flight_data):
    """Columns 7, 13, 16, 32-34 are p, alpha, altitude, air temperature [K], static pressure [hPa] and density."""
    options = ["t=1", "q=8:deg/s", "theta=11:deg", "delta_e=22:deg", "rho=34", "pressure=33:hPa", "temperature=32"]
    record = read_record(flight_data / "fAttasElv1.mat", ColumnMap.from_options(options))
    assert (len(record), record.notes) == (626, ())
    gas = record["pressure"] / (287.053 * record["temperature"])
    np.testing.assert_allclose(record["rho"], gas, rtol=0.01)
    # wings nearly level: theta is the integral of q up to a small bias of the gyro
    turned = np.concatenate([[0.0], np.cumsum(0.5 * (record["q"][1:] + record["q"][:-1]) * np.diff(record.t))])
    drift = np.polyfit(record.t, record["theta"] - turned, 1)
    np.testing.assert_allclose(record["theta"] - turned, np.polyval(drift, record.t), atol=np.radians(0.5))


def test_attas_of_two_manoeuvres_has_a_gap(flight_data):
    record = read_record(
        flight_data / "fAttasAilRud1.mat", ColumnMap.from_options(["t=1", "delta_a=0.5*29:deg,-0.5*28:deg"])
    )
    assert len(record.notes) == 1 and "longest gap is 30.08 s" in record.notes[0] and "split" in record.notes[0]


def test_hfb320_is_the_same_as_numpy_reads_it(flight_data):
    path = flight_data / "hfb320_1_10.asc"
    order = "t delta_e qbar thrust V alpha theta q qdot ax az ay p r pdot rdot beta phi delta_a delta_r"
    names = order.split()
    options = [f"{name}={column}" for column, name in enumerate(names, start=1)]
    record = read_record(path, ColumnMap.from_options(options))
    np.testing.assert_array_equal(record.matrix(names), np.loadtxt(path))


@pytest.mark.parametrize(("count", "said"), [(0, "sheet 'Sheet' is empty"), (1, "1 samples are too few")])
def test_a_sheet_of_names_alone_is_empty_and_one_with_a_row_is_short(tmp_path, count, said):
    book = pytest.importorskip("openpyxl").Workbook()
    for row in (["t", "V", "delta_e"], *[[0.0, 100.0, 0.01]] * count):
        book.active.append(row)
    book.save(tmp_path / "m.xlsx")
    with pytest.raises(InputError, match=said):
        read_record(tmp_path / "m.xlsx")
