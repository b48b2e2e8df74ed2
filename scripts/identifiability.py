"""Which derivatives can these records tell apart, which did they not move, and which manoeuvre would help?

Question     weak directions of the scaled information matrix in words, what the a-priori values did, what to fly next
Set-up       an aircraft file and flight records; output error, multiple shooting, all derivatives of the file free
             without a prior. With no record: the first of the demonstration records.
Expectation  one manoeuvre leaves directions that another, named with its gain, would open. DIR/identifiability.txt,
             DIR/identifiability.json.

    python scripts/identifiability.py [RECORD ... --aircraft FILE] [--free GLOB ...] [--axes AXES] [--map ...]
        [--out DIR]
"""

from __future__ import annotations

import argparse
import json
import math
from pathlib import Path
from typing import Any, NoReturn

from casid.analysis import Identifiability, identifiability
from casid.analysis.excitation import Suggestion
from casid.errors import EstimationError, InputError, run_script
from casid.estimation import Problem, solve
from casid.model.aircraft import Aircraft
from casid.model.applied import apply_effects, default_free
from casid.records.column_map import ColumnMap
from casid.records.readers import read_records
from casid.report.folder import provenance, whole_folder, write_provenance
from casid.report.progress import progress

DEMO = Path(__file__).resolve().parent.parent / "casid" / "cli" / "demo"


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="What records tell of the derivatives of an aircraft file.")
    parser.add_argument("records", nargs="*", metavar="RECORD", help="file, or pattern like 'flight/m*.csv'")
    parser.add_argument("--aircraft", type=Path, metavar="FILE", help="aircraft file (TOML)")
    parser.add_argument("--free", nargs="+", metavar="GLOB", help="parameters to estimate; default: all derivatives")
    parser.add_argument("--axes", choices=("full", "longitudinal", "lateral"), help="default: what the surfaces allow")
    parser.add_argument("--map", action="append", default=[], help="column map: alpha=ALCG:deg, or a TOML file")
    parser.add_argument("--out", type=Path, default=Path("out/identifiability"), metavar="DIR")
    parser.error = _one_line
    given = parser.parse_args()
    if bool(given.records) != bool(given.aircraft):
        raise InputError(
            "identifiability.py: give records and --aircraft FILE together, or neither for the demonstration"
        )
    if not given.records:
        given.records, given.aircraft = [str(DEMO / "m1.csv")], DEMO / "aircraft.toml"
    return given


def _one_line(message: str) -> NoReturn:
    raise InputError(f"{message}; see identifiability.py --help")


def main() -> None:
    given = arguments()
    aircraft = Aircraft.read(given.aircraft)
    records = read_records(given.records, ColumnMap.from_options(given.map))
    made_with = provenance(0)
    with whole_folder(given.out) as folder, progress() as stage:
        try:
            applied = apply_effects(aircraft, records, given.axes)
            globs = given.free or default_free(applied)
            biases = [glob for glob in globs if glob.startswith("bias_")]
            shared = [glob for glob in globs if glob not in biases]
            stage("estimation")
            fit = solve(Problem(applied.model, applied.records, free=shared, per_record=biases))
            stage("identifiability")
            report = identifiability(fit)
        except EstimationError as error:
            raise InputError(str(error)) from None
        text = f"{aircraft.name}: estimation {fit.status}\n{report}\n"
        (folder / "identifiability.txt").write_text(text, encoding="utf-8")
        (folder / "identifiability.json").write_text(json.dumps(document(report), indent=1) + "\n", encoding="utf-8")
        write_provenance(made_with, folder / "run.json")
    print(text, end="")


def document(report: Identifiability) -> dict[str, Any]:
    """The report as plain numbers and texts; what is infinite is None."""

    def number(value: float) -> float | None:
        return float(value) if math.isfinite(value) else None

    def suggested(helped: Suggestion | None) -> dict[str, Any] | None:
        if helped is None:
            return None
        return {
            "control": helped.control,
            "form": helped.form,
            "unit_s": helped.unit_s,
            "amplitude": helped.amplitude,
            "gain": number(helped.gain),
        }

    return {
        "schema": "casid.identifiability/1",
        "condition": number(report.condition),
        "names": list(report.names),
        "singular_values": [float(value) for value in report.singular_values],
        "std_inflation": {name: number(value) for name, value in report.inflation.items()},
        "unseen": {name: suggested(helped) for name, helped in report.unseen.items()},
        "excitation": [moved.sentence for moved in report.excitation],
        "weak": [
            {
                "condition": number(d.condition),
                "change": dict(d.change),
                "cannot": d.cannot,
                "sentence": d.sentence,
                "poor": [moved.control for moved in d.poor],
                "help": suggested(d.help),
            }
            for d in report.weak
        ],
        "blend": {
            name: {
                "prior": b.prior,
                "prior_std": b.prior_std,
                "value": number(b.value),
                "std": number(b.std),
                "data_std": number(b.data_std),
                "moved": b.moved,
            }
            for name, b in report.blends.items()
        },
    }


if __name__ == "__main__":
    run_script(main)
