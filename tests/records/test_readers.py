"""Reading and writing flight records. Truth: the written numbers themselves, and definitions of units."""

import csv
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from casid.errors import InputError
from casid.records import Record, read_record, read_records, require_channels, write_record
from casid.signals import CHANNELS

FORMAT = [
    "t",
    "V",
    "alpha",
    "beta",
    "p",
    "q",
    "r",
    "phi",
    "theta",
    "psi",
    "ax",
    "ay",
    "az",
    "pdot",
    "qdot",
    "rdot",
    "delta_e",
    "delta_a",
    "delta_r",
    "thrust",
    "altitude",
    "rho",
]


def flight(names=FORMAT, n=200, dt=0.02, seed=1):
    """Channels of plausible size; positive, so that airspeed and density may be among them."""
    rng = np.random.default_rng(seed)
    columns = {name: 0.01 + 0.1 * rng.random(n) for name in names if name != "t"}
    return Record(name="m1", t=dt * np.arange(n), channels=columns)


def write(path, names, rows, sep=","):
    lines = [sep.join(names), *(sep.join(map(repr, row)) for row in rows)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def test_reads_the_channels_of_the_format(tmp_path):
    record = flight()
    path = write(tmp_path / "m1.csv", FORMAT, record.matrix(FORMAT).tolist())
    again = read_record(path)
    assert (again.name, again.source, again.hold, again.notes) == ("m1", str(path), "linear", ())
    assert list(again.channels) == FORMAT[1:]
    for name in FORMAT:
        np.testing.assert_array_equal(again[name], record[name])


FLOATS = st.floats(-499.0, 499.0)
OUTPUTS = ("ax", "ay", "az", "pdot", "altitude", "thrust_lever")


@given(data=st.data(), held=st.booleans(), n=st.integers(50, 60))
@settings(max_examples=40)
def test_what_is_written_is_read_back_exactly(tmp_path_factory, data, held, n):
    samples = st.lists(FLOATS | st.just(np.nan), min_size=n, max_size=n).map(np.array)
    steps = data.draw(st.lists(st.floats(0.1, 0.5), min_size=n - 1, max_size=n - 1))
    channels = data.draw(st.dictionaries(st.sampled_from(OUTPUTS), samples, max_size=3))
    channels = {name: values for name, values in channels.items() if not np.isnan(values).all()}
    channels["delta_e"] = np.array(data.draw(st.lists(st.floats(-1.5, 1.5), min_size=n, max_size=n)))
    record = Record(
        name="m1", t=np.concatenate([[0.0], np.cumsum(steps)]), channels=channels, hold="held" if held else "linear"
    )
    path = tmp_path_factory.mktemp("records") / "m1.csv"
    write_record(record, path)
    again = read_record(path)
    assert (again.name, again.hold, list(again.channels)) == (record.name, record.hold, list(record.channels))
    for name in ("t", *record.channels):
        np.testing.assert_array_equal(again[name], record[name])


@pytest.mark.parametrize(
    ("channel", "unit", "in_unit", "in_si"),
    [
        ("alpha", "deg", 4.5, np.pi / 40),
        ("q", "deg/s", 90.0, np.pi / 2),
        ("qdot", "deg/s2", 180.0, np.pi),
        ("altitude", "ft", 10000.0, 3048.0),
        ("ax", "g", 1.0, 9.80665),
        ("V", "kt", 3600.0 / 1852.0, 1.0),
        ("V", "km/h", 360.0, 100.0),
        ("thrust", "kN", 10.0, 10000.0),
        ("t", "ms", 1000.0, 1.0),
        ("delta_e", "°", 18.0, np.pi / 10),
        ("ax", "m/s^2", 2.0, 2.0),
    ],
)
def test_a_unit_in_the_header_is_converted(tmp_path, channel, unit, in_unit, in_si):
    record = flight(("t", "delta_e", "V", "alpha", "q"))
    columns = {name: record[name] for name in ("t", *record.channels)}
    ramp = np.linspace(1.0, 5.0, len(record))
    columns[channel] = ramp if channel == "t" else np.full(len(record), in_si)
    names = [f"{name} [{unit}]" if name == channel else name for name in columns]
    columns[channel] = columns[channel] * in_unit / in_si
    path = write(tmp_path / "m1.csv", names, np.stack(list(columns.values()), axis=1).tolist())
    np.testing.assert_allclose(read_record(path)[channel], ramp if channel == "t" else in_si, rtol=1e-14)


@given(st.lists(st.floats(-90.0, 90.0), min_size=50, max_size=50))
@settings(max_examples=30)
def test_degrees_and_radians_are_the_same_record(tmp_path_factory, degrees):
    path = tmp_path_factory.mktemp("records") / "m1.csv"
    write(path, ["t", "delta_e [deg]"], [[0.1 * i, d] for i, d in enumerate(degrees)])
    np.testing.assert_allclose(read_record(path)["delta_e"], np.radians(degrees), rtol=1e-15, atol=1e-300)


@pytest.mark.parametrize(
    "change",
    [
        lambda text: "\ufeff" + text,
        lambda text: text.replace("\n", "\r\n"),
        lambda text: "# flight 12\n# of today, at noon\n" + text,
        lambda text: text.replace(",", ";"),
        lambda text: text.replace(",", "\t"),
        lambda text: text.replace(",", " , "),
        lambda text: text.replace("\n", ",\n"),
        lambda text: text + "\n\n",
        lambda text: text.replace("delta_e", '"delta_e"'),
        lambda text: text.removesuffix("\n"),
    ],
    ids=["bom", "crlf", "comments", "semicolon", "tab", "spaces", "trailing comma", "blank lines", "quotes", "no end"],
)
def test_the_spelling_of_the_file_does_not_matter(tmp_path, change):
    record = flight()
    path = write(tmp_path / "m1.csv", FORMAT, record.matrix(FORMAT).tolist())
    path.write_bytes(change(path.read_text(encoding="utf-8")).encode())
    again = read_record(path)
    assert not again.notes
    for name in FORMAT:
        np.testing.assert_array_equal(again[name], record[name])


def test_empty_cells_and_nan_of_an_output_are_missing_samples(tmp_path):
    record = flight(("t", "delta_e", "q"))
    rows = [list(map(repr, row)) for row in record.matrix(("t", "delta_e", "q")).tolist()]
    rows[3][2], rows[7][2], rows[8][2] = "", "nan", " NaN "
    path = tmp_path / "m1.csv"
    path.write_text("t,delta_e,q\n" + "\n".join(map(",".join, rows)))
    again = read_record(path)
    assert np.flatnonzero(np.isnan(again["q"])).tolist() == [3, 7, 8]
    keep = np.isfinite(again["q"])
    np.testing.assert_array_equal(again["q"][keep], record["q"][keep])


def test_rows_that_are_far_from_uniform_in_time_are_read_and_noted(tmp_path):
    rng = np.random.default_rng(2)
    steps = 0.02 * (1 + 0.1 * rng.uniform(-1, 1, 299))
    steps[100] = 0.5
    t = np.concatenate([[0.0], np.cumsum(steps)])
    record = Record(name="m1", t=t, channels={"delta_e": 0.1 * rng.random(300), "q": rng.random(300)})
    write_record(record, tmp_path / "m1.csv")
    again = read_record(tmp_path / "m1.csv")
    np.testing.assert_array_equal(again.t, t)
    assert [note.split(",")[0] for note in again.notes] == [
        "time: rows are missing in 1 place(s)",
        "time: sampling is not uniform",
    ]
    assert "0.5 s after t =" in again.notes[0]


def noted(tmp_path, **channels):
    n = 200
    base = {"delta_e": 0.1 * np.sin(np.arange(n)), "q": np.cos(np.arange(n)), **channels}
    write_record(Record(name="m1", t=0.02 * np.arange(n), channels=base), tmp_path / "m1.csv")
    return read_record(tmp_path / "m1.csv")


@pytest.mark.parametrize(
    ("channels", "note"),
    [
        ({"beta": np.full(200, 0.02)}, "beta: constant at 0.02"),
        ({"delta_r": np.zeros(200)}, "delta_r: constant at 0; nothing can be identified from it"),
        ({"r": np.where(np.arange(200) % 3, np.arange(200.0) / 100, np.nan)}, "samples are missing: r 34 %"),
        ({"psi": np.full(200, np.nan)}, "psi: has no sample at all and is left out"),
        ({"beta": 1.2 * np.sin(np.arange(200))}, "is the column in degrees?"),
        ({"az": -1.0 + 0.1 * np.sin(np.arange(200))}, "if the file is in g, write the header as 'az [g]'"),
        ({"az": 9.8 + 0.1 * np.sin(np.arange(200))}, "z points down"),
        ({"flap": np.arange(200.0)}, "'flap' is no channel that casid knows; kept as it is"),
    ],
)
def test_what_a_person_should_know_is_a_note(tmp_path, channels, note):
    record = noted(tmp_path, **channels)
    assert len(record.notes) == 1 and note in record.notes[0]


def test_a_good_record_has_no_notes(tmp_path):
    assert noted(tmp_path).notes == ()


def test_columns_that_casid_does_not_know_are_kept(tmp_path):
    record = flight(("t", "delta_e"))
    rows = [[*row, 180.0, "day", 1.0] for row in record.matrix(("t", "delta_e")).tolist()]
    rows[6][-1] = "1;0"
    path = write(tmp_path / "m1.csv", ["t", "delta_e", "stick [deg]", "light", "flap"], rows)
    again = read_record(path)
    np.testing.assert_allclose(again["stick"], np.pi, rtol=1e-15)
    assert "light" not in again and again.contents.unread["light"] == "text"
    assert "flap" not in again and "row 7 (line 8)" in again.contents.unread["flap"]
    assert any("'light'" in note and "'flap'" in note for note in again.notes)


def test_patterns_and_names(tmp_path):
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        for name in ("m2", "m1"):
            write_record(flight(("t", "delta_e")), tmp_path / folder / f"{name}.csv")
    assert [r.name for r in read_records(str(tmp_path / "a" / "m*.csv"))] == ["m1", "m2"]
    assert [r.name for r in read_records(tmp_path / "a" / "m1.csv")] == ["m1"]
    both = read_records([tmp_path / "b" / "m1.csv", str(tmp_path / "a" / "m*.csv")])
    assert [r.name for r in both] == ["b/m1", "a/m1", "m2"]
    with pytest.raises(InputError, match="given twice"):
        read_records([tmp_path / "a" / "m1.csv", str(tmp_path / "a" / "*.csv")])
    with pytest.raises(InputError, match="no such file, and no file matches"):
        read_records(str(tmp_path / "c" / "*.csv"))
    with pytest.raises(InputError, match="no record was given"):
        read_records([])


def test_require_names_channel_reason_and_remedy():
    record = flight(("t", "delta_e", "q"))
    require_channels(record, ["t", "q"], "nothing")
    with pytest.raises(InputError) as caught:
        require_channels(record, ["q", "delta_a", "rho"], "the model of six degrees of freedom")
    message = str(caught.value)
    assert "'m1': needs delta_a (aileron), rho (air density) for the model of six degrees of freedom" in message
    assert "--map delta_a=COLUMN:unit" in message


@pytest.mark.parametrize("name", ["t", "", "a [deg]", " a", "a\nb"])
def test_a_name_that_cannot_stand_in_a_header_is_not_written(tmp_path, name):
    record = Record(name="m1", t=np.arange(3.0), channels={name: np.zeros(3)})
    with pytest.raises(InputError, match="cannot stand in a header"):
        write_record(record, tmp_path / "m1.csv")


def test_only_csv_is_written(tmp_path):
    with pytest.raises(InputError, match=r"written as \.csv"):
        write_record(flight(), tmp_path / "m1.mat")
    with pytest.raises(InputError, match="cannot be written"):
        write_record(flight(), tmp_path / "nowhere" / "m1.csv")


@given(st.data())
@settings(max_examples=300)
def test_a_mutilated_file_is_a_record_or_one_line_of_error(tmp_path_factory, data):
    """Random cuts and insertions of bytes, rows and cells."""
    path = tmp_path_factory.mktemp("records") / "m1.csv"
    names = [f"{name} [deg]" if CHANNELS[name].unit == "rad" else name for name in FORMAT]
    write(path, names, flight(n=60, dt=0.1).matrix(FORMAT).tolist())
    content = path.read_bytes()
    pieces = [
        b"",
        b",",
        b";",
        b'"',
        b"\n",
        b"\r",
        b"\x00",
        b"nan",
        b"inf",
        b"-",
        b"1e999",
        b"1e308",
        b"x",
        b"_1",
        b"[",
        b"t",
    ]
    for _ in range(data.draw(st.integers(1, 3))):
        separator = data.draw(st.sampled_from([b"", b"\n", b","]))
        parts = content.split(separator) if separator else [content[i : i + 1] for i in range(len(content))]
        at = data.draw(st.integers(0, max(len(parts) - 1, 0)))
        piece = data.draw(st.sampled_from(pieces) | st.binary(max_size=4))
        parts[at : at + data.draw(st.integers(0, 2))] = [piece]
        content = separator.join(parts)
    path.write_bytes(content)
    try:
        record = read_record(path)
    except InputError as error:
        assert "\n" not in str(error) and "m1" in str(error)
    else:
        assert np.all(np.diff(record.t) > 0) and all(not np.isinf(v).any() for v in record.channels.values())


def test_a_record_that_is_sent_to_another_process_keeps_its_units(tmp_path):
    record = flight(("t", "delta_e"))
    rows = [[t, float(np.degrees(value))] for t, value in record.matrix(("t", "delta_e")).tolist()]
    again = read_record(write(tmp_path / "m1.csv", ["t", "delta_e [deg]"], rows))
    for one in (again, pickle.loads(pickle.dumps(again)), again.with_channels(q=again["delta_e"])):
        assert dict(one.stated) == {"delta_e": "deg"}
    old = dict(again.__getstate__(), stated=frozenset({"delta_e"}))  # as a file that was kept before has it
    again.__setstate__(old)
    assert not again.stated


@given(
    first=st.sampled_from("=+-@"),
    rest=st.text(alphabet="abcxyz()!|1", min_size=1, max_size=12),
)
def test_no_spreadsheet_evaluates_a_header_and_it_is_read_back(
    first: str, rest: str, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """Excel and LibreOffice evaluate a cell that begins with = + - @ (OWASP, CSV injection)."""
    name = f"{first}{rest}"
    file = tmp_path_factory.mktemp("formula") / "m.csv"
    t = 0.02 * np.arange(200)
    record = Record(name="m", t=t, channels={name: np.sin(t)})
    try:
        write_record(record, file)
    except InputError:  # a name that ends like a unit
        return
    header = file.read_text(encoding="utf-8").splitlines()[0]
    assert not any(cell[:1] in "=+-@" for cell in next(csv.reader([header])))
    assert np.array_equal(read_record(file, own=[name])[name], record[name])


def test_a_record_holds_what_it_was_given_and_nobody_writes_to_it() -> None:
    """Masked samples are missing, infinite ones are refused, and the arrays are the record's own."""
    t = 0.02 * np.arange(100)
    given_values = np.sin(t)
    record = Record(name="m", t=t, channels={"x": np.ma.masked_where(t > 1.0, t), "y": given_values})
    assert np.array_equal(np.isnan(record["x"]), t > 1.0)
    given_values[:] = 7.0
    assert np.array_equal(record["y"], np.sin(t))
    again = pickle.loads(pickle.dumps(record))
    for array in (record.t, record["y"], again.t, again["y"]):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0
    for wrong in (np.inf, -np.inf):
        with pytest.raises(InputError, match="infinite"):
            Record(name="m", t=t, channels={"x": np.where(t > 1.0, wrong, t)})
    with pytest.raises(InputError):
        Record(name="m", t=np.ma.masked_where(t > 1.0, t), channels={"x": t})
