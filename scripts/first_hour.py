"""The first hour of a new user, from the wheel, in an environment of its own.

Question     does everything that a newcomer does in the first hour work outside the repository?
Set-up       the wheel is built and installed into a new virtual environment; everything runs in a temporary folder.
             The user's own flight is a record of the embedded example, written again in degrees, knots, g and feet.
Expectation  every step ends with the status, the files and the numbers that are stated here. Status 1 names the step
             that did not.

    python scripts/first_hour.py [--wheel FILE] [--keep DIR]
"""

from __future__ import annotations

import csv
import json
import math
import os
import subprocess
import sys
import tempfile
import time
import zipfile
from dataclasses import dataclass
from pathlib import Path

REPO = Path(__file__).resolve().parent.parent
MOST_MB = 3.0  # of the wheel
MOST_IMPORT_S = 0.1  # of processor time
# unit of the header -> its columns, and its size in SI
UNITS = {
    "deg": (("alpha", "beta", "phi", "theta", "psi", "delta_e", "delta_a", "delta_r"), math.pi / 180.0),
    "deg/s": (("p", "q", "r"), math.pi / 180.0),
    "kt": (("V",), 1852.0 / 3600.0),
    "g": (("ax", "ay", "az"), 9.80665),
    "ft": (("altitude",), 0.3048),
}
PLOT = """
import matplotlib; matplotlib.use("Agg")
import casid as cs
aircraft = cs.Aircraft.read("mine.toml")
record = cs.flight_inputs(aircraft, cs.read_record("flight1.csv"))
fit = cs.solve(cs.Problem(cs.aircraft_model(aircraft), [record], free=["Cm_*"]))
fit.plot(); fit.save("fit.casid"); again = cs.load("fit.casid")
assert again["Cm_alpha"].value == fit["Cm_alpha"].value
print(fit.summary() if hasattr(fit, "summary") else fit)
"""
IMPORT = """
import os, time; before = dict(os.environ); start = time.process_time()
import casid
print(time.process_time() - start, os.environ == before, casid.__version__)
"""


class StepError(Exception):
    """A step that did not end as it should."""


@dataclass(frozen=True, kw_only=True)
class Desk:
    """The user's environment and folder."""

    binaries: Path
    folder: Path

    def run(self, *words: object, status: int = 0) -> str:
        """Run a command of the environment in the folder and return what it printed; StepError for another status."""
        program, *rest = map(str, words)
        environment = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "VIRTUAL_ENV")}
        environment["MPLCONFIGDIR"] = str(self.binaries.parent / "matplotlib")  # a list of fonts of this environment
        command = [str(self.binaries / program), *rest]
        done = subprocess.run(command, cwd=self.folder, capture_output=True, text=True, env=environment, check=False)
        if done.returncode != status:
            said = (done.stderr or done.stdout).strip()[-600:]
            raise StepError(f"{program} {' '.join(rest)[:80]}: status {done.returncode}, expected {status}: {said}")
        if status == 2 and (done.stderr.count("\n") != 1 or done.stdout):
            raise StepError(f"{program} {' '.join(rest)[:80]}: more than one line: {done.stderr[-600:]}")
        return done.stdout

    def need(self, *files: str) -> None:
        """StepError when a file is missing."""
        for name in files:
            if not (self.folder / name).is_file():
                raise StepError(f"{name} was not written")


def build(target: Path) -> Path:
    """The wheel, one top-level package and small; built by a pip of its own, since an environment may have none."""
    environment = target / "build"
    subprocess.run([sys.executable, "-m", "venv", str(environment)], check=True)
    python = environment / ("Scripts" if os.name == "nt" else "bin") / "python"
    command = [str(python), "-m", "pip", "wheel", "--quiet", "--disable-pip-version-check", "--no-deps"]
    subprocess.run([*command, "--wheel-dir", str(target), str(REPO)], check=True)
    (wheel,) = target.glob("casid-*.whl")
    return wheel


def check_wheel(wheel: Path) -> None:
    names = {name.split("/")[0] for name in zipfile.ZipFile(wheel).namelist()}
    packages = {name for name in names if not name.endswith(".dist-info")}
    if packages != {"casid"}:
        raise StepError(f"the wheel holds {sorted(packages)}, expected casid alone")
    if wheel.stat().st_size > MOST_MB * 1e6:
        raise StepError(f"the wheel has {wheel.stat().st_size / 1e6:.1f} MB, expected at most {MOST_MB:g}")


def install(desk: Desk, wheel: Path) -> None:
    subprocess.run([sys.executable, "-m", "venv", str(desk.binaries.parent)], check=True)
    desk.run("python", "-m", "pip", "install", "--quiet", "--disable-pip-version-check", wheel)
    seconds, same, version = desk.run("python", "-c", IMPORT).split()
    if float(seconds) > MOST_IMPORT_S or same != "True":
        raise StepError(f"import casid takes {seconds} s, environment unchanged: {same}")
    if version not in desk.run("casid", "--version"):
        raise StepError("casid --version and casid.__version__ differ")


def demonstration(desk: Desk) -> None:
    desk.run("casid", "demo", "--quick", "--out", "demo")
    desk.need("demo/report.html", "demo/diagnosis.json", "demo/extended.toml")
    found = json.loads((desk.folder / "demo" / "diagnosis.json").read_text(encoding="utf-8"))
    names = {(cause["kind"], cause["target"]) for cause in found["causes"]}
    if ("actuator_lag", "delta_e") not in names:
        raise StepError(f"the demonstration names {names}, expected the lag of the elevator")


def own_flight(desk: Desk) -> None:
    """Records of the example as a user may have them: degrees, knots, g and feet, units in the header."""
    demo = REPO / "casid" / "cli" / "demo"
    for i in (1, 2):
        with (demo / f"m{i}.csv").open(encoding="utf-8") as file:
            rows = list(csv.reader(file))
        head, *body = rows
        names, sizes = zip(*map(_foreign, head), strict=True)
        with (desk.folder / f"flight{i}.csv").open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(names)
            writer.writerows([[repr(float(v) / s) if v else "" for v, s in zip(r, sizes, strict=True)] for r in body])
    (desk.folder / "mine.toml").write_text((demo / "aircraft.toml").read_text(encoding="utf-8"), encoding="utf-8")
    desk.run("casid", "convert", "flight1.csv", "si.csv")
    for name, worst in _differences(desk.folder / "si.csv", demo / "m1.csv").items():
        if worst > 1e-9:
            raise StepError(f"si.csv: {name} is not that of the example: {worst:g} of its largest value off")


def _differences(file: Path, other: Path) -> dict[str, float]:
    """Column of `other` -> largest difference of `file` from it, over its largest value."""
    columns = []
    for path in (file, other):
        with path.open(encoding="utf-8") as opened:
            rows = list(csv.DictReader(opened))
        columns.append({name: [float(row[name]) for row in rows if row[name]] for name in rows[0]})
    mine, its = columns
    return {
        name: max(abs(a - b) for a, b in zip(mine[name], values, strict=True)) / (max(map(abs, values)) or 1.0)
        for name, values in its.items()
    }


def _foreign(name: str) -> tuple[str, float]:
    """Header of a column with its unit, and the size of that unit in SI."""
    unit, size = next(((unit, size) for unit, (names, size) in UNITS.items() if name in names), ("", 1.0))
    return f"{name} [{unit}]" if unit else name, size


def work(desk: Desk) -> None:
    desk.run("casid", "check", "flight1.csv", "--aircraft", "mine.toml")
    desk.run("casid", "estimate", "flight1.csv", "--aircraft", "mine.toml", "--free", "Cm_*", "--out", "estimate")
    desk.need("estimate/estimate.json", "estimate/model.toml")
    desk.run("casid", "simulate", "flight2.csv", "--aircraft", "mine.toml", "estimate/model.toml", "--out", "flown")
    desk.need("flown/simulate.json")
    desk.run("python", "-c", PLOT)
    desk.need("fit.casid")
    flights = ("flight1.csv", "--hold-out", "flight2.csv", "--aircraft", "mine.toml")
    desk.run("casid", "diagnose", *flights, "--quick", "--out", "own")
    desk.need("own/report.html", "own/extended.toml")


def mistakes(desk: Desk) -> None:
    before = sorted(path.name for path in desk.folder.iterdir())
    for words in (
        ("diagnose", "flight9.csv", "--aircraft", "mine.toml"),
        ("diagnose", "--aircraft", "mine.toml"),
        ("estimate", "flight1.csv"),
        ("estimate", "flight1.csv", "--aircraft", "mine.toml", "--cost", "outptu"),
        ("simulate", "flight1.csv", "--aircraft", "flight1.csv"),
        ("diagnos",),
    ):
        desk.run("casid", *words, status=2)
    if sorted(path.name for path in desk.folder.iterdir()) != before:
        raise StepError("a command that was refused left something behind")


def walk(wheel: Path | None, place: Path) -> None:
    """Every step, with its seconds."""
    desk = Desk(binaries=place / "environment" / ("Scripts" if os.name == "nt" else "bin"), folder=place / "work")
    desk.folder.mkdir()
    built = wheel or build(place)
    steps = {
        "the wheel": lambda: check_wheel(built),
        "install": lambda: install(desk, built),
        "demonstration": lambda: demonstration(desk),
        "own flight in deg, kt, g and ft": lambda: own_flight(desk),
        "check, estimate, simulate, plot, save, load, diagnose": lambda: work(desk),
        "mistakes": lambda: mistakes(desk),
    }
    for name, step in steps.items():
        start = time.perf_counter()
        step()
        print(f"{time.perf_counter() - start:7.1f} s  {name}", flush=True)


def first_hour(*, wheel: Path | None = None, keep: Path | None = None) -> int:
    """Walk the first hour of a new user.

    Example: python scripts/first_hour.py --keep /tmp/first-hour

    Parameters
    ----------
    wheel
        The wheel to install; built from this checkout when it is not given.
    keep
        A new folder in which everything is left; a temporary one otherwise.
    """
    try:
        if keep is not None:
            keep.mkdir(parents=True)
            walk(wheel.resolve() if wheel else None, keep.resolve())
        else:
            with tempfile.TemporaryDirectory(prefix="casid-first-hour-") as place:
                walk(wheel.resolve() if wheel else None, Path(place))
    except StepError as wrong:
        print(f"not as it should be: {wrong}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    from casid.cli.run import run

    run(first_hour)
