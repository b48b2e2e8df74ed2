"""Every fault of a flight record has its own message: file, row, column, value, and what to do.

Truth: the place where the test put the fault. Row 5 is the fifth row of numbers, which stands in line 6.
"""

import math
import re

import numpy as np
import pytest

from casid.errors import InputError
from casid.records import ColumnMap, Record, read_record, write_record

NAMES = ("t", "V", "alpha", "q", "az", "delta_e", "thrust", "rho")


def rows(n=200):
    i = np.arange(n)
    wave = 0.05 * np.sin(0.3 * i)
    columns = (0.02 * i, 100 + wave, wave, wave, -9.8 + wave, wave, 1e4 + i, 0.9 + 0 * i)
    return [list(map(repr, row)) for row in np.stack(columns, axis=1).tolist()]


def message(tmp_path, names, cells, ending="\n"):
    path = tmp_path / "m1.csv"
    path.write_text("\n".join([",".join(names), *map(",".join, cells)]) + ending, encoding="utf-8")
    with pytest.raises(InputError) as caught:
        read_record(path)
    line = str(caught.value)
    assert "\n" not in line and "m1.csv" in line
    return line


CELLS = [
    (5, "q", "bad", ["row 5 (line 6)", "column 'q'", "'bad' is not a number"]),
    (5, "q", "0,5", ["row 5 (line 6)", "has 9 cells, expected 8"]),
    (5, "q", '"0,5"', ["row 5 (line 6)", "'0,5' is not a number; write a decimal point"]),
    (5, "q", "1_0", ["row 5 (line 6)", "'1_0' is not a number"]),
    (5, "q", "١", ["row 5 (line 6)", "is not a number"]),
    (5, "q", "inf", ["row 5 (line 6)", "column 'q'", "infinite"]),
    (5, "q", "1e999", ["row 5 (line 6)", "column 'q'", "infinite"]),
    (5, "az", "1e200", ["row 5 (line 6)", "column 'az'", "1e+200 is too large"]),
    (5, "q", 200 * "x", ["row 5 (line 6)", "xxx...' is not a number"]),
    (5, "t", "0.06", ["row 5 (line 6)", "column 't'", "time repeats, 0.06 s after 0.06 s", "split the file"]),
    (5, "t", "0.05", ["row 5 (line 6)", "column 't'", "time runs back, 0.05 s after 0.06 s"]),
    (5, "t", "", ["row 5 (line 6)", "column 't'", "time stamp is missing"]),
    (5, "t", "nan", ["row 5 (line 6)", "column 't'", "time stamp is missing"]),
    (5, "delta_e", "", ["row 5 (line 6)", "column 'delta_e'", "sample of an input is missing", "fill the gaps"]),
    (5, "thrust", "nan", ["row 5 (line 6)", "column 'thrust'", "sample of an input is missing (nan)"]),
    (5, "rho", "", ["row 5 (line 6)", "column 'rho'", "sample of an input is missing"]),
    (5, "alpha", "3.0", ["row 5 (line 6)", "column 'alpha'", "3 rad is 171.9 deg", "'alpha [deg]'"]),
    (5, "delta_e", "-12", ["row 5 (line 6)", "column 'delta_e'", "'delta_e [deg]'"]),
    (5, "q", "20", ["row 5 (line 6)", "20 rad/s is 1146 deg/s", "'q [deg/s]'"]),
    (5, "rho", "-1", ["row 5 (line 6)", "column 'rho'", "must be positive, got -1", "fill the gap"]),
]


@pytest.mark.parametrize(("row", "column", "cell", "parts"), CELLS, ids=[f"{c[1]}={c[2][:8]}" for c in CELLS])
def test_a_wrong_cell(tmp_path, row, column, cell, parts):
    cells = rows()
    cells[row - 1][NAMES.index(column)] = cell
    line = message(tmp_path, NAMES, cells)
    for part in parts:
        assert part in line


HEADERS = [
    ("alpha", "Alpha", "unknown channel 'Alpha'; did you mean 'alpha'?"),
    ("alpha", "aplha", "unknown channel 'aplha'; did you mean 'alpha'?"),
    ("alpha", "angle of attack", "did you mean 'alpha'?"),
    ("delta_e", "elevator", "did you mean 'delta_e'? Rename it, or say what it is: --map delta_e=elevator"),
    ("delta_e", "Delta-E", "did you mean 'delta_e'?"),
    ("t", "tme", "no column 't', the time in s"),
    ("t", "count", "no column 't', the time in s"),
    ("V", "v", "did you mean 'V'?"),
    ("q", "alpha [deg]", "alpha stands as 'alpha' and 'alpha#2'"),
    ("q", "", "column 4 has no name"),
    ("q", "q [m/s]", "column 'q [m/s]': unit 'm/s' does not fit channel 'q', whose SI unit is rad/s"),
    ("q", "q [dge/s]", "unknown unit 'dge/s' of channel 'q'; did you mean 'deg/s'?"),
    ("alpha", "alpha [deg", "did you mean 'alpha'?"),
]


@pytest.mark.parametrize(("good", "bad", "part"), HEADERS, ids=[h[1] or "empty" for h in HEADERS])
def test_a_wrong_header(tmp_path, good, bad, part):
    line = message(tmp_path, [bad if name == good else name for name in NAMES], rows())
    assert part in line


def test_all_slips_are_told_at_once_with_the_map_that_mends_them(tmp_path):
    names = [name.upper() for name in NAMES]
    line = message(tmp_path, ["t", *names[1:]], rows())
    options = line.partition("--map ")[2].partition(";")[0].split()
    assert "V" not in dict(option.split("=") for option in options)
    record = read_record(tmp_path / "m1.csv", ColumnMap.from_options(options))
    assert {"V", "alpha", "q", "az", "delta_e", "thrust", "rho"} <= set(record.channels)


@pytest.mark.parametrize("name", ["time", "Time", "TIME", "timestamp", "TIME_s", "Time (s)", "t [s]", "Elapsed Time"])
def test_time_has_many_names(tmp_path, name):
    record = read_record(write(tmp_path, rows(), [name, *NAMES[1:]]))
    assert len(record) == 200 and record.t[-1] == pytest.approx(3.98)


def test_degrees_under_a_header_without_unit(tmp_path):
    cells = rows()
    for row, cell in enumerate(cells):
        cell[2] = repr(2.0 + 3.0 * math.sin(0.1 * row))
    line = message(tmp_path, NAMES, cells)  # 2 + 3 sin 0 = 2 rad, more than 90 deg, in the very first row
    assert "row 1 (line 2), column 'alpha': 2 rad is 114.6 deg" in line and "'alpha [deg]'" in line


def test_a_stated_unit_is_believed_and_written_back(tmp_path):
    """Truth: the numbers in the file. Limits are of aircraft, and of columns that do not say their unit."""
    cells = rows()
    for row, cell in enumerate(cells):
        cell[3] = repr(30.0 * math.sin(0.3 * row))
    stated = ["q [rad/s]" if name == "q" else name for name in NAMES]
    record = read_record(write(tmp_path, cells, stated))
    assert record["q"].max() > 29.9 and any("accepted" in note for note in record.notes)
    write_record(record, tmp_path / "again.csv")
    np.testing.assert_array_equal(read_record(tmp_path / "again.csv")["q"], record["q"])
    assert "'q [rad/s]'" in message(tmp_path, NAMES, cells)
    mapped = read_record(write(tmp_path, cells), {"q": "q:rad/s"})
    np.testing.assert_array_equal(mapped["q"], record["q"])
    system = Record(name="top", t=record.t, channels={"q": record["q"], "theta": 2.0 * np.sin(record.t)})
    assert len(system) == len(record)


def test_a_pitot_that_reads_nothing_on_the_ground_is_missing_there(tmp_path):
    cells = rows()
    for row in range(20):
        cells[row][1] = repr(0.1 * (row - 25))
    record = read_record(write(tmp_path, cells))
    assert np.flatnonzero(np.isnan(record["V"])).tolist() == list(range(20))
    assert any(note.startswith("V: 20 samples are not positive, down to -2.5 m/s") for note in record.notes)


def test_a_record_without_a_surface_is_read_and_said(tmp_path):
    record = read_record(write(tmp_path, rows(), ["flap" if name == "delta_e" else name for name in NAMES]))
    assert "flap" in record and any("no control surface" in note for note in record.notes)


def test_a_ragged_row(tmp_path):
    cells = rows()
    del cells[4][-1]
    assert "row 5 (line 6) has 7 cells, expected 8" in message(tmp_path, NAMES, cells)
    cells = rows()
    cells[4].append("1.0")
    assert "row 5 (line 6) has 9 cells, expected 8" in message(tmp_path, NAMES, cells)


def test_a_file_that_was_cut_off(tmp_path):
    """The last row of a logger that lost its power is no reason to lose the flight; a short row above it is."""
    cells = rows()
    cells[-1] = cells[-1][:3]
    record = read_record(write(tmp_path, cells))
    assert len(record) == 199 and any("the last row (line 201) is cut off: 3 of 8 cells" in n for n in record.notes)


def test_lines_count_from_the_top_of_the_file(tmp_path):
    cells = rows()
    cells[4][3] = "x"
    path = tmp_path / "m1.csv"
    path.write_text("# one\n# two\n" + "\n".join([",".join(NAMES), *map(",".join, cells)]), encoding="utf-8")
    with pytest.raises(InputError, match=re.escape("row 5 (line 8), column 'q'")):
        read_record(path)


def test_a_record_of_few_samples(tmp_path):
    assert "40 samples are too few" in message(tmp_path, NAMES, rows(40))


def moving_at(omega, seconds, noise=0.0, rate_hz=50.0):
    """Rows of a motion of a frequency [rad/s], with white noise on all outputs."""
    t = np.arange(round(seconds * rate_hz)) / rate_hz
    wave = 0.05 * np.sin(omega * t) + noise * np.random.default_rng(3).standard_normal(len(t))
    columns = (t, 100 + wave, wave, wave, -9.8 + wave, wave, 1e4 + 0 * t, 0.9 + 0 * t)
    return [list(map(repr, row)) for row in np.stack(columns, axis=1).tolist()]


def write(tmp_path, cells, names=NAMES):
    path = tmp_path / "m1.csv"
    path.write_text("\n".join([",".join(names), *map(",".join, cells)]), encoding="utf-8")
    return path


@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_the_shortest_record_is_a_matter_of_its_motion(tmp_path, noise):
    """2.5 s hold 6 periods at 15 rad/s, as of a light model aircraft, and 0.8 at 2 rad/s, as of a transport."""
    assert len(read_record(write(tmp_path, moving_at(15.0, 2.5, noise)))) == 125
    line = message(tmp_path, NAMES, moving_at(2.0, 2.5, noise))
    assert "125 samples in 2.48 s are too short" in line and "a period of its motion is" in line
    assert len(read_record(write(tmp_path, moving_at(2.0, 3.1, noise)))) == 155


def test_noise_alone_is_no_quick_motion(tmp_path):
    assert "it shows no motion" in message(tmp_path, NAMES, moving_at(0.0, 2.5, 0.01))


@pytest.mark.parametrize("header", ["alpha", "alpha [deg]"])
def test_a_mark_of_a_missing_sample_is_no_angle_in_degrees(tmp_path, header):
    cells = rows()
    for row in (4, 9):
        cells[row][2] = "-999"
    line = message(tmp_path, [header if name == "alpha" else name for name in NAMES], cells)
    assert "row 5 (line 6)" in line and "-999 marks a missing sample, 2 in all; leave the cells empty" in line


def test_a_column_without_samples_is_kept_in_mind(tmp_path):
    cells = rows()
    for row in cells:
        row[3] = ""
    record = read_record(write(tmp_path, cells))
    assert record.empty == ("q",) and "q" not in record


def test_a_part_of_a_file(tmp_path):
    """What is wrong elsewhere in a long file does not matter to the part, whose times stay."""
    cells = rows(1000)
    cells[20][NAMES.index("delta_e")] = ""
    path = write(tmp_path, cells)
    with pytest.raises(InputError, match="sample of an input is missing"):
        read_record(path)
    part = read_record(path, between=(4.0, 12.0))
    assert (part.t[0], len(part)) == (pytest.approx(4.0), 400)
    for span in ((-math.inf, 4.0), (4.0, math.inf)):
        assert len(read_record(path, between=span) if span[0] == 4.0 else part) in (400, 800)
    with pytest.raises(InputError, match="no row from 30 to 40 s; the file has 0 to 19.98 s"):
        read_record(path, between=(30.0, 40.0))
    for wrong in ((5.0, 4.0), 3.0, ("a", "b"), (math.nan, 1.0)):
        with pytest.raises(InputError, match="expected two times"):
            read_record(path, between=wrong)
    cells[300][NAMES.index("q")] = "x"
    with pytest.raises(InputError, match=re.escape("row 301 (line 302)")):
        read_record(write(tmp_path, cells), between=(4.0, 12.0))


@pytest.mark.parametrize(
    ("content", "part"),
    [
        (b"", "the file is empty"),
        (b"\n\n", "the file is empty"),
        (b"# only a comment", "the file is empty"),
        (b"t,delta_e\n", "no rows of numbers below the header"),
        (b"0.0,1.0\n0.1,2.0\n", "its 2 columns have no names; say which is which with a column map"),
        (b"# flight\n0.0,1.0\n0.1,2.0\n", "its 2 columns have no names"),
        ("t,δ\n".encode("utf-16"), "no rows of numbers below the header"),
        (bytes(range(256)), "not a text"),
        (b't,delta_e\n0.0,"1.0\n', "line 2: not valid CSV"),
    ],
)
def test_a_file_that_is_no_record(tmp_path, content, part):
    path = tmp_path / "m1.csv"
    path.write_bytes(content)
    with pytest.raises(InputError) as caught:
        read_record(path)
    assert part in str(caught.value)


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(InputError, match="cannot be read: No such file"):
        read_record(tmp_path / "m1.csv")
    with pytest.raises(InputError, match="cannot be read"):
        read_record(tmp_path / "m1.mat")
    (tmp_path / "folder.csv").mkdir()
    with pytest.raises(InputError, match="cannot be read"):
        read_record(tmp_path / "folder.csv")


def test_a_file_of_another_type(tmp_path):
    with pytest.raises(InputError, match=r"files of '.cvs' are not read: .* read are .csv"):
        read_record(tmp_path / "m1.cvs")
