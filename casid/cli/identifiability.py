"""`casid identifiability`: what records can tell of the derivatives of an aircraft file, in words."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from casid.analysis import Identifiability
from casid.analysis import identifiability as identifiability_of
from casid.analysis.excitation import Suggestion
from casid.cli.options import DEMO, AsJson, Axes, Files, Folder, Maps, aircraft_of, records_of, shared_and_biases
from casid.cli.results import write_json
from casid.errors import InputError
from casid.estimation import Problem, solve
from casid.keeping import plain
from casid.model.flown_records import flown_records
from casid.report.folder import results
from casid.report.progress import progress


def identifiability(
    *records: Annotated[str, Parameter(name="RECORD")],
    aircraft: Path | None = None,
    free: Files | None = None,
    axes: Axes | None = None,
    maps: Maps | None = None,
    out: Folder = Path("out/identifiability"),
    as_json: AsJson = False,
) -> None:
    """List the derivatives that the records separate, those that they did not excite, and a manoeuvre that would help.

    Writes DIR/identifiability.txt and DIR/identifiability.json.

    Parameters
    ----------
    records
        Files, or patterns like 'flight/m*.csv'. Without any, the first record of the embedded example.
    aircraft
        The aircraft file (TOML).
    free
        Globs of the parameters to estimate; default: all derivatives.
    axes
        Default: what the surfaces allow.
    """
    if bool(records) != bool(aircraft):
        raise InputError("identifiability: give records and --aircraft FILE together, or neither for the demonstration")
    file = aircraft_of(aircraft or DEMO / "aircraft.toml")
    read = records_of(records or (str(DEMO / "m1.csv"),), maps)
    with results(out) as folder, progress(quiet=as_json) as stage:
        applied = flown_records(file, read, axes)
        shared, biases = shared_and_biases(applied, free)
        stage("estimation")
        fit = solve(Problem(applied.model, applied.records, free=shared, per_record=biases))
        stage("identifiability")
        report = identifiability_of(fit)
        text = f"{file.name}: estimation {fit.status}\n{report}"
        (folder / "identifiability.txt").write_text(text + "\n", encoding="utf-8")
        found = write_json(document(report), folder / "identifiability.json")
    print(found if as_json else text)


def document(report: Identifiability) -> dict[str, Any]:
    """The report as plain numbers and texts; what is infinite is None."""

    def suggested(helped: Suggestion | None) -> dict[str, Any] | None:
        return helped and plain(helped, "control form unit_s amplitude gain")

    return {
        "schema": "casid.identifiability/1",
        "condition": plain(report.condition),
        "names": list(report.names),
        "singular_values": plain(report.singular_values),
        "std_inflation": plain(report.inflation),
        "unseen": {name: suggested(helped) for name, helped in report.unseen.items()},
        "excitation": [moved.sentence for moved in report.excitation],
        "weak": [
            plain(d, "condition change cannot sentence")
            | {"poor": [moved.control for moved in d.poor], "help": suggested(d.help)}
            for d in report.weak
        ],
        "blend": {name: plain(b, "prior prior_std value std data_std moved") for name, b in report.blends.items()},
    }
