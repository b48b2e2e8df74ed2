"""Sixty ways to misuse the command line: each is one line that says what to do, and leaves nothing behind."""

from __future__ import annotations

import gzip
import inspect
from pathlib import Path

import numpy as np
import pytest
from cyclopts import App

import casid as cs
from casid.cli.app import COMMANDS
from casid.cli.options import DEMO, records_of
from casid.cli.run import status_of
from casid.records import read_record

RECORD, PLANE = str(DEMO / "m1.csv"), str(DEMO / "aircraft.toml")

# words of the command line ({d}: a folder with the broken files below), and what the line must name
MISUSES: list[tuple[str, str]] = [
    ("diagnos", "diagnos"),
    ("estimat x.csv", "estimat"),
    ("--vresion", "--vresion"),
    # what is missing
    ("diagnose {r}", "--aircraft"),
    ("diagnose --aircraft {p}", "records"),
    ("diagnose --hold-out {r}", "--hold-out"),
    ("diagnose {r} --aircraft", "--aircraft"),
    ("estimate {r}", "aircraft"),
    ("estimate --aircraft {p}", "RECORD"),
    ("simulate {r}", "aircraft"),
    ("simulate --aircraft {p}", "RECORD"),
    ("identifiability {r}", "--aircraft"),
    ("identifiability --aircraft {p}", "together"),
    ("response --input delta_e --output q", "RECORD"),
    ("response {r} --output q", "--input"),
    ("response {r} --input delta_e --output qq", "did you mean 'q'"),
    ("response {r} --input delta_e --output q --band 3", "--band"),
    ("response {r} --input delta_e --output q --band 9 3", "lower one first"),
    ("response {r} --input delta_e --output q --windows 40", "longest has"),
    ("response {r} --input delta_e --output q --envelope {r}", "--aircraft"),
    ("response {r} --input delta_e --output q --aircraft {p} --envelope {r}", "no column"),
    ("response {r} --input delta_e --output q --aircraft {d}/none.toml", "none.toml"),
    ("match {r}", "--aircraft"),
    ("match {r} --aircraft {p} --tolerances part61", "did you mean 'part60'"),
    ("match {r} --aircraft {p} --tolerances {p}", "unknown key"),
    ("match {r} --aircraft {p} --test 2.c.99", "2.c.9"),
    ("match {r} --aircraft {p} --test 2.c.4=one:two", "START:END"),
    ("match {d}/none.csv --aircraft {p}", "none.csv"),
    ("modes", "AIRCRAFT"),
    ("modes {d}/none.toml", "none.toml"),
    ("modes {p} --V -5", "positive"),
    ("modes {p} --estimate {p}", "JSON"),
    ("modes {p} --record {d}/none.csv", "none.csv"),
    ("isolate --aircraft {p}", "--manoeuvre"),
    ("isolate --aircraft {p} --manoeuvre {d}/none.csv", "none.csv"),
    ("isolate --aircraft {p} --manoeuvre {r} --channels alfa", "did you mean 'alpha'"),
    ("isolate --aircraft {p} --manoeuvre {r} --causes sensor_scal(q)", "unknown cause"),
    ("check", "RECORD"),
    ("check {r} --believe alhpa", "--believe: unknown channel 'alhpa'; did you mean 'alpha'"),
    ("diagnose {r} --aircraft {p} --believe alhpa", "--believe: unknown channel 'alhpa'; did you mean 'alpha'"),
    ("check {d}", "folder"),
    ("check {r} --from 100", "from 100 s on"),
    ("check {r} --to -5", "before -5 s"),
    ("check {d}/units.csv", "does not fit channel"),
    ("convert {r}", "TARGET"),
    ("convert", "SOURCE"),
    ("estimat x", "estimate"),
    ("compatibility", "RECORD"),
    ("segments", "LOG"),
    ("check {r} --from 9 --to 3", "--from 9 --to 3"),
    ("convert {r} {p} {d}/o.csv", "name a folder"),
    ("design", "aircraft"),
    ("new-aircraft", "target"),
    ("new-aircraft {d}/n.toml", "--mass"),
    # files that are not there or are something else
    ("diagnose {d}/none.csv --aircraft {p}", "none.csv"),
    ("diagnose {r} --aircraft {d}/none.toml", "none.toml"),
    ("diagnose {r} --aircraft {r}", "m1.csv"),
    ("diagnose {p} --aircraft {p}", ".toml"),
    ("diagnose {d} --aircraft {p}", "{d}"),
    ("diagnose {r} --aircraft {d}", "{d}"),
    ("estimate {d}/none*.csv --aircraft {p}", "none*.csv"),
    ("simulate {r} --aircraft {p} {d}/none.toml", "none.toml"),
    ("simulate {r} --aircraft {p} {p}", "two files"),
    ("convert {d}/none.csv {d}/o.csv", "none.csv"),
    ("convert {r} {d}/o.xlsx", ".csv"),
    ("convert {r} {r}", "itself"),
    ("check {d}/none.csv", "none.csv"),
    ("new-aircraft {d}/n.txt --mass 1 --span 1 --chord 1 --area 1 --speed 1", "TOML"),
    ("new-aircraft {d}/plane.toml --mass 1 --span 1 --chord 1 --area 1 --speed 1", "there already"),
    # broken files
    ("check {d}/empty.csv", "empty"),
    ("check {d}/text.csv", "sample of an input is missing"),
    ("check {d}/back.csv", "runs back"),
    ("check {d}/short.csv", "too few"),
    ("check {d}/ragged.csv", "ragged"),
    ("check {d}/degrees.csv", "deg"),
    ("check {d}/notime.csv", "'t'"),
    ("check {d}/misspelt.csv", "alpha"),
    ("check {d}/cut.csv.gz", ".gz"),
    ("check {d}/rubbish.mat", "rubbish.mat"),
    ("estimate {r} --aircraft {d}/key.toml", "mass"),
    ("estimate {r} --aircraft {d}/negative.toml", "positive"),
    ("estimate {r} --aircraft {d}/notoml.toml", "notoml.toml"),
    # values
    ("estimate {r} --aircraft {p} --cost outptu", "outptu"),
    ("estimate {r} --aircraft {p} --method doubel", "doubel"),
    ("estimate {r} --aircraft {p} --solver newtno", "newtno"),
    ("estimate {r} --aircraft {p} --interval 0", "interval"),
    ("estimate {r} --aircraft {p} --interval 2.5", "2.5"),
    ("estimate {r} --aircraft {p} --free Cm_alhpa", "Cm_alpha"),
    ("estimate {r} --aircraft {p} --equation-weight 0.5", "--cost combined"),
    ("estimate {r} --aircraft {p} --cost filter --method single", "leave --method"),
    ("estimate {r} --aircraft {p} --axes lateral-ish", "lateral-ish"),
    ("diagnose {r} --aircraft {p} --criteria {d}/none.toml", "none.toml"),
    ("diagnose {r} --aircraft {p} --map alpha", "alpha"),
    ("diagnose {r} --aircraft {p} --map alfa=alpha", "alfa"),
    ("diagnose {r} --aircraft {p} --map alpha=ALCG:dge", "ALCG"),
    ("diagnose {r} --aircraft {p} --hold-out {r}", "every record is held out"),
    ("diagnose {r} {r} --aircraft {p}", "twice"),
    ("diagnose {r} --aircraft {p} --out {r}", "--out"),
    ("check {r} --out {r}", "--out"),
    ("check {d}/sentinel.csv", "-999"),
    ("diagnose {r} --aircraft {p} --out=", "--out is empty"),
    ("simulate {r} --aircraft {p} --out=", "--out is empty"),
    ("demo --out=", "--out is empty"),
    ("demo --out {r}/o", "--out"),
    ("design --aircraft {p} --deflection-deg -1", "positive"),
    ("design --aircraft {p} --duration 0.1 --out {d}/o", "samples"),
    ("design --aircraft {p} --free Cx_*", "Cx_"),
    ("design --aircraft {p} --separate actuator_lag(delta_e)=0.1", "two causes"),
    ("design --aircraft {p} --separate actuator_lag(delta_e)=0.1 input_delay(delta_e)", "size in SI"),
    ("design --aircraft {p} --separate actuator_lag(delta_e)=0.1 gust(z)=2", "no manoeuvre"),
    ("design --aircraft {p} --separate", "two causes"),
    ("design --aircraft {p} --separate actuator_lag(delta_e)=0.1 actuator_lag(delta_e)=0.2", "stands twice"),
    ("design --aircraft {p} --separate actuator_lag(delta_e)=-0.1 input_delay(delta_e)=0.1", "impossible"),
    ("design --aircraft {p} --separate actuator_lag(delta_e)=0.1 mass=100 --axes lateral", "--axes"),
    ("check {r} --out=", "--out is empty"),
    ("diagnose {r} --aircraft {p} --axes sideways", "longitudinal"),
    ("diagnose {r} --aircraft {p} --as-recorded maybe", "maybe"),
    ("diagnose {r} --model {d}/none.py:tank", "there is no file"),
    ("diagnose {r} --model {p}", "like tanks.py:model"),
    ("diagnose {r} --model {d}/none.py:tank --aircraft {p}", "neither --aircraft"),
    ("diagnose {r} --model {d}/none.py:tank --as-recorded", "--as-recorded"),
    ("new-aircraft {d}/n.toml --mass -1 --span 1 --chord 1 --area 1 --speed 1", "--mass"),
]


@pytest.fixture(scope="module")
def broken(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of files that each have one fault."""
    folder = tmp_path_factory.mktemp("broken")
    head, *rows = Path(RECORD).read_text().splitlines()[:400]
    whole = "\n".join([head, *rows])
    first = rows[0].split(",")
    column = head.split(",").index
    degrees = [*first]
    degrees[column("alpha")] = "4.0"
    sentinel = [*first]
    sentinel[column("ax")] = "-999"
    files = {
        "empty.csv": "",
        "text.csv": "\n".join([head, ",".join([*first[:-1], "n/a"]), *rows[1:]]),
        "back.csv": "\n".join([head, *rows, rows[10]]),
        "short.csv": "\n".join([head, *rows[:20]]),
        "ragged.csv": "\n".join([head, *rows[:50], "1,2,3", *rows[51:]]),
        "degrees.csv": "\n".join([head, ",".join(degrees), *rows[1:]]),
        "sentinel.csv": "\n".join([head, ",".join(sentinel), *rows[1:]]),
        "nosurface.csv": whole.replace("delta_e", "x").replace("delta_a", "y").replace("delta_r", "z", 1),
        "notime.csv": "clock" + whole[1:],
        "misspelt.csv": whole.replace("alpha", "alhpa", 1),
        "units.csv": "\n".join([head, ",".join(["s"] * len(first)), *rows]),
        "rubbish.mat": "no matrix",
        "key.toml": Path(PLANE).read_text().replace("mass =", "maas ="),
        "negative.toml": Path(PLANE).read_text().replace("mass = 1", "mass = -1"),
        "notoml.toml": "[aircraft\nmass",
        "plane.toml": Path(PLANE).read_text(),
    }
    for name, content in files.items():
        (folder / name).write_text(content)
    (folder / "cut.csv.gz").write_bytes(gzip.compress(whole.encode())[:500])
    return folder


@pytest.mark.parametrize(("words", "named"), MISUSES, ids=[words for words, _ in MISUSES])
def test_misuse_is_one_line(words, named, broken, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    before = sorted(broken.iterdir())
    app = App(name="casid", version="0")
    for name, where in COMMANDS.items():
        app.command(where, name=name)
    places = {"d": str(broken), "r": RECORD, "p": PLANE}
    status = status_of(app, words.format(**places).split())
    said = capsys.readouterr()
    assert status == 2, said
    assert said.err.startswith("error: ") and said.err.count("\n") == 1 and ", ;" not in said.err
    assert named.format(**places) in said.err, said.err
    assert not list(tmp_path.iterdir()) and sorted(broken.iterdir()) == before


def test_what_needs_a_surface_names_it(broken, monkeypatch, capsys):
    """A record without a surface can be checked; what identifies from it says what is missing, in its last line."""
    app = App(name="casid", version="0")
    for name, where in COMMANDS.items():
        app.command(where, name=name)
    file = str(broken / "nosurface.csv")
    assert status_of(app, ["estimate", file, "--aircraft", PLANE]) == 2
    assert "surfaces delta_e, delta_a, delta_r are missing" in capsys.readouterr().err.splitlines()[-1]
    assert status_of(app, ["check", file]) in (0, 1)


def test_a_map_is_written_that_reads_a_file_of_foreign_names(tmp_path, capsys):
    """Truth: the demonstration's first record, its columns renamed, in other units, and its az turned over."""
    app = App(name="casid", version="0")
    for name, where in COMMANDS.items():
        app.command(where, name=name)
    first = read_record(RECORD)
    foreign = {"Time": first.t, "TAS [kt]": first["V"] / 0.514444444, "AOA [deg]": np.degrees(first["alpha"])}
    foreign |= {"P": first["p"], "Q": first["q"], "R": first["r"], "NZ [g]": -first["az"] / 9.80665}
    foreign |= {"ELEV": first["delta_e"], "light": first["q"]}
    file, target = tmp_path / "foreign.csv", tmp_path / "map.toml"
    rows = np.stack(list(foreign.values()), axis=1)
    np.savetxt(file, rows, delimiter=",", header=",".join(foreign), comments="", fmt="%.12g")
    assert status_of(app, ["check", str(file)]) == 2 and "--write-map" in capsys.readouterr().err
    assert status_of(app, ["check", str(file), "--write-map", str(target)]) in (0, 1)
    record = read_record(file, target)
    for name in ("V", "alpha", "p", "q", "r", "az", "delta_e"):
        np.testing.assert_allclose(record[name], first[name], rtol=1e-6, atol=1e-9)
    assert "light" in target.read_text() and "# thrust = " in target.read_text()
    assert status_of(app, ["check", str(file), "--write-map", str(target)]) == 2
    named, motors = tmp_path / "named.csv", tmp_path / "motors.toml"
    head = "t,q,m1,stick"
    np.savetxt(named, rows[:, [0, 4, 1, 2]], delimiter=",", header=head, comments="", fmt="%.12g")
    assert status_of(app, ["check", str(named), "--map", "m1=m1", "--write-map", str(motors)]) in (0, 1)
    lines = motors.read_text().splitlines()
    assert 'm1 = "m1"' in lines and sum("m1 =" in one for one in lines) == 1  # a rotor has no line of its own to fill
    maps = ["t=Time", "V=TAS", "alpha=AOA", "p=P", "q=Q", "r=R", "az=NZ*-1", "delta_e=ELEV"]
    assert status_of(app, ["check", "--map", *maps, str(file)]) in (0, 1)


def test_there_are_enough():
    assert len(MISUSES) >= 60 and np.unique([words for words, _ in MISUSES]).size == len(MISUSES)


def test_names_that_people_guess_are_taken() -> None:
    """Truth: the same call by the names of the documentation."""
    t = 0.02 * np.arange(400)
    u = np.random.default_rng(0).standard_normal(len(t))
    record, plain = cs.Record("m", t, {"u": u, "y": 2.0 * u}), cs.Record(name="m", t=t, channels={"u": u, "y": 2.0 * u})
    assert (record.name, record.channels.keys()) == (plain.name, plain.channels.keys())
    lag = cs.define_model(
        "lag",
        states=["x", "z"],
        inputs=["u"],
        parameters={"T": 0.5},
        outputs=["y"],
        dynamics=lambda s: {"x": (s.u - s.x) / s.T, "z": -s.z},
        output=lambda s: {"y": s.x + s.z},
    )
    named, listed = (cs.simulate(lag, record, start).outputs for start in ({"z": 2.0, "x": 1.0}, [1.0, 2.0]))
    np.testing.assert_array_equal(named, listed)
    band = cs.frequency_response(record, "u", "y", band=(4.0, 20.0))
    np.testing.assert_allclose(band.omega, np.geomspace(4.0, 20.0, 100))
    for call, said in (
        (lambda: cs.simulate(lag, record, {"x": 1.0}), "no z"),
        (lambda: cs.simulate(lag, record, {"x": 1.0, "zz": 0.0}), "'zz'"),
        (lambda: cs.frequency_response(record, "u", "y", band=(20.0, 4.0)), "lower"),
        (lambda: cs.diagnose(lag, [record], holdout=[record]), "hold_out"),
    ):
        with pytest.raises(cs.InputError, match=said):
            call()


def test_help_shows_the_arguments_of_a_diagnosis() -> None:
    shown = inspect.signature(cs.diagnose).parameters
    assert {"records", "hold_out", "report", "criteria", "as_recorded", "axes"} <= shown.keys()


def test_maps_may_follow_each_other(tmp_path: Path) -> None:
    """`--map a=.. b=..` as people type it is `--map a=.. --map b=..`."""
    t = 0.02 * np.arange(600)
    columns = {"t": t, "AL": np.degrees(0.05 + 0.01 * np.sin(t)), "Q": 0.01 * np.cos(t), "delta_e": 0.02 * np.sin(t)}
    file = tmp_path / "m.csv"
    np.savetxt(file, np.column_stack(list(columns.values())), delimiter=",", header=",".join(columns), comments="")
    (one,), (two,) = (
        records_of(patterns, maps)
        for patterns, maps in (
            ([str(file), "q=Q"], ["alpha=AL:deg"]),
            ([str(file)], ["alpha=AL:deg", "q=Q"]),
        )
    )
    np.testing.assert_array_equal(one["q"], two["q"])
    np.testing.assert_allclose(one["alpha"], np.radians(columns["AL"]))
