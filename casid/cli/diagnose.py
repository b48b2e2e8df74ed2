"""`casid diagnose` and `casid demo`: what the simulation gets wrong, why, and what the extended model gains."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from casid.cli.model_file import model_of
from casid.cli.options import DEMO, AsJson, Axes, Begin, End, Files, Flag, Folder, Maps, called_by, records_of
from casid.data_check.check import channels_of
from casid.diagnosis import diagnose as diagnosis_of
from casid.diagnosis.criteria import Criteria
from casid.diagnosis.document import Called
from casid.diagnosis.given.shape import with_shapes
from casid.diagnosis.result import Diagnosis
from casid.errors import InputError
from casid.model.aircraft import Aircraft
from casid.records.readers import files_of
from casid.records.record import Record
from casid.records.thinning import thinned
from casid.report.folder import provenance, whole_folder, write_provenance
from casid.report.page import unfinished, write_report
from casid.report.progress import Course, progress

QUICK_RATE_HZ = 25.0
# parts of the time of a diagnosis, the mean of three with a warm cache of kernels; single ones differ from it by a half
_COURSE = (
    ("faults of the data", 0.02),
    ("reading the records", 0.005),
    ("simulation as given", 0.04),
    ("refit of the file", 0.03),
    ("kinematics", 0.11),
    ("refit of the file", 0.015),
    ("naming", 0.05),
    ("naming, round 1", 0.40),
    ("naming, round 2", 0.06),
    ("held-out records", 0.03),
    ("missing inputs", 0.04),
    ("verdict", 0.06),
    ("report", 0.14),
)


def diagnose(
    *records: Annotated[str, Parameter(name="RECORD")],
    aircraft: Path | None = None,
    model: str | None = None,
    hold_out: Files | None = None,
    maps: Maps | None = None,
    begin: Begin = None,
    end: End = None,
    axes: Axes | None = None,
    out: Folder = Path("out/diagnosis"),
    quick: Flag = False,
    seconds: float | None = None,
    criteria: Path | None = None,
    as_recorded: Flag = False,
    believe: Files | None = None,
    shapes: Flag = False,
    as_json: AsJson = False,
) -> None:
    """Diagnose what a flight simulation lacks, from flight records.

    Writes DIR/report.html (one page for a person), DIR/diagnosis.json (the same for a program), DIR/extended.toml
    (the aircraft file with the causes that were found) and DIR/run.json (command and versions). The status is 0
    whatever is found. All processors that the process may use are used, or as many as the variable OMP_NUM_THREADS
    allows; the results are the same.

    Parameters
    ----------
    records
        Files, or patterns like 'flight/m*.csv', that are fitted. Without any, the embedded example is diagnosed.
    aircraft
        The aircraft file (TOML).
    model
        The model of any dynamic system in place of an aircraft, in a Python file that is executed: tanks.py:model. It
        gives diagnosis.txt in place of extended.toml.
    hold_out
        Records that are never fitted. Default: the last record, or the last third of a single one.
    axes
        Plane of motion that is judged. Default: what surfaces and motion of the records allow.
    quick
        Thin the records to 25 Hz.
    seconds
        Time for the verdict: what is not tried in it is listed. The file is re-estimated and flown on the held-out
        records in any case. Ctrl-C asks for the verdict so far; a second one ends without results.
    criteria
        TOML file with other thresholds of decisions.
    as_recorded
        Leave the data as they are: faults are reported, and neither corrected nor left out.
    believe
        Channels that are right as recorded: `--believe thrust` undoes a correction of the thrust alone.
    shapes
        Write the curves of what stays unexplained to extended.toml too, as tables.
    """
    channels_of(believe or False, "--believe")
    by = Criteria() if criteria is None else Criteria.read(criteria)
    held = hold_out or []
    if held and not records:
        raise InputError("--hold-out needs records to fit beside it; expected: diagnose RECORD ... --hold-out RECORD")
    if model is not None and (aircraft is not None or axes is not None or not records):
        raise InputError("--model FILE.py:NAME takes records, and neither --aircraft nor --axes")
    if model is not None and (as_recorded or believe or shapes):
        raise InputError(
            "--as-recorded, --believe and --shapes are for an aircraft file; leave them out beside --model"
        )
    if records and aircraft is None and model is None:
        raise InputError("--aircraft FILE is missing; the records alone do not say what flew")
    if aircraft is not None and not records:
        raise InputError(f"--aircraft {aircraft} needs records; expected: diagnose RECORD ... --aircraft FILE")
    system = None if model is None else model_of(model)
    own = () if system is None else (*system.inputs, *system.outputs)
    file = aircraft or DEMO / "aircraft.toml"
    patterns = records or (str(DEMO / "m*.csv"),)
    fitted, held_out = _flight(patterns, held, maps, own, (begin, end))
    if quick:
        fitted, held_out = ([thinned(r, QUICK_RATE_HZ) for r in some] for some in (fitted, held_out))
    made_with = provenance() | {"criteria": by.changes}
    called = called_by([*patterns, *held], maps, file, out)
    course = Course(stages=_COURSE, limit=math.inf if seconds is None else seconds / (1.0 - dict(_COURSE)["report"]))
    choices = {"criteria": by, "axes": axes, "as_recorded": as_recorded or believe or False, "seconds": seconds}
    given = Aircraft.read(file) if system is None else system
    diagnosed = partial(diagnosis_of.diagnose, given, fitted, held_out, **choices)
    results = partial(_of_aircraft, file=file, shapes=shapes) if system is None else _of_system
    _write(diagnosed, results, made_with, called, as_json, course)


def demo(*, out: Folder = Path("out/demo"), quick: Flag = False, as_json: AsJson = False) -> None:
    """Diagnose the embedded example: a Fokker 50 whose elevator lags its command, a lag that its file lacks.

    Parameters
    ----------
    quick
        Thin the records to 25 Hz.
    """
    diagnose(out=out, quick=quick, as_json=as_json)


def _flight(
    patterns: Sequence[str],
    held: Sequence[str],
    maps: Sequence[str] | None,
    own: Sequence[str],
    span: tuple[float | None, float | None],
) -> tuple[list[Record], list[Record]]:
    """Records to fit and records held out. What is held out is not fitted, also when it is given twice."""
    held_files = files_of(held)
    apart = {file.resolve() for file in held_files}
    fit_files = [file for file in files_of(patterns) if file.resolve() not in apart]
    if not fit_files:
        names = ", ".join(file.name for file in held_files[:3])
        raise InputError(f"--hold-out {names}: every record is held out; leave at least one to be fitted")
    files = [str(file) for file in (*fit_files, *held_files)]
    both = records_of(files, maps, own, span)  # names of two folders differ
    return both[: len(fit_files)], both[len(fit_files) :]


def _write(
    diagnosed: Callable[..., Diagnosis],
    results: Callable[[Diagnosis, Path], None],
    made_with: Mapping[str, Any],
    called: Called,
    as_json: bool,
    course: Course,
) -> None:
    """Run a diagnosis into its folder: the results are there before anything is drawn."""
    out = Path(called.out)
    with progress(quiet=as_json, course=course) as stage:
        with whole_folder(out) as folder:
            diagnosis = replace(diagnosed(report=stage), called=called)
            diagnosis.write(folder / "diagnosis.json")
            results(diagnosis, folder)
            (folder / "report.html").write_text(unfinished(diagnosis.sentence), encoding="utf-8")
            write_provenance(made_with, folder / "run.json")
        stage("report")
        try:
            with whole_folder(out) as folder:
                failed = write_report(diagnosis, folder, made_with)
        except KeyboardInterrupt:
            print(f"interrupted; the results are in {out}, without the pictures of the report", file=sys.stderr)
            raise SystemExit(130) from None
    for one in failed:
        print(f"note: a picture could not be drawn: {one}", file=sys.stderr)
    if as_json:
        print(json.dumps(json.loads((out / "diagnosis.json").read_text(encoding="utf-8")), indent=1))
        return
    print(diagnosis)
    print(f"report: {out / 'report.html'}")


def _of_aircraft(diagnosis: Diagnosis, folder: Path, *, file: Path, shapes: bool) -> None:
    """Write the extended aircraft file, in the layout of the given one."""
    like = file if file.suffix.lower() == ".toml" else None
    extended = with_shapes(diagnosis.extended_aircraft, diagnosis.shapes if shapes else ())
    extended.write(folder / "extended.toml", like=like)


def _of_system(diagnosis: Diagnosis, folder: Path) -> None:
    """Write the account of a system, which has no file of its own."""
    (folder / "diagnosis.txt").write_text(f"{diagnosis}\n", encoding="utf-8")
