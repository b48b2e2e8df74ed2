"""Fly recorded inputs through aircraft files, side by side.

Question     how well does each aircraft file, original or extended, simulate what was measured?
Set-up       every RECORD through every FILE, open loop on the recorded inputs, from the initial state that fits the
             record's first seconds best. Effects of the file act, those of instruments on what is read; turbulence does
             not, because it is not known in advance.
Expectation  DIR/<record>__<aircraft>.csv, the record with its outputs simulated; DIR/simulate.json with r.m.s., R2 and
             Theil's coefficient per channel; DIR/figures; a table. A simulation that diverges is said, not an error.

    python scripts/simulate.py RECORD ... --aircraft FILE [FILE2 ...] [--axes full|longitudinal|lateral]
        [--map CHANNEL=COLUMN:unit] [--out DIR]
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import NoReturn

import casid  # noqa: F401  before numpy: it sets the number of threads

# isort: split
import numpy as np

from casid.errors import InputError, run_script
from casid.estimation.fit import channel_fit
from casid.filtering.initial_state import fit_initial_state
from casid.model.aircraft import Aircraft
from casid.model.applied import Applied, apply_effects
from casid.model.simulate import simulate
from casid.records.column_map import ColumnMap
from casid.records.readers import read_records, write_record
from casid.records.record import Record
from casid.report.estimate_figures import file_name, histories, write_pictures
from casid.report.folder import provenance, whole_folder, write_provenance
from casid.report.style import Picture

WINDOW_S = 5.0  # of the record, to which the initial state is fitted


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="Fly recorded inputs through one or more aircraft files.")
    parser.add_argument("records", nargs="+", metavar="RECORD", help="file, or pattern like 'flight/m*.csv'")
    parser.add_argument("--aircraft", nargs="+", type=Path, required=True, metavar="FILE", help="aircraft files (TOML)")
    parser.add_argument("--axes", choices=("full", "longitudinal", "lateral"), help="default: what the surfaces allow")
    parser.add_argument("--map", action="append", default=[], help="column map: alpha=ALCG:deg, or a TOML file")
    parser.add_argument("--out", type=Path, default=Path("out/simulate"), metavar="DIR", help="folder for the results")
    parser.error = _one_line
    return parser.parse_args()


def _one_line(message: str) -> NoReturn:
    raise InputError(f"{message}; see simulate.py --help")


def fleet(paths: Sequence[Path]) -> dict[str, Aircraft]:
    """Label -> aircraft; the label is the file's name without ending, with its folder where that is not enough."""
    stems = [path.stem for path in paths]
    labels = [p.stem if stems.count(p.stem) == 1 else f"{p.resolve().parent.name}-{p.stem}" for p in paths]
    if len(set(labels)) < len(labels):
        raise InputError(f"--aircraft: two files are called '{labels[0]}'; give them different names")
    return {label: Aircraft.read(path) for label, path in zip(labels, paths, strict=True)}


def fly(applied: Applied, record: Record) -> np.ndarray | str:
    """(N, outputs) what the instruments would have read; or where the simulation diverged."""
    try:
        flown = simulate(applied.model, record, fit_initial_state(applied.model, record, WINDOW_S))
    except (InputError, np.linalg.LinAlgError) as fault:
        return str(fault)
    return applied.readings(record, flown.outputs)


def statistics(record: Record, names: Sequence[str], flown: np.ndarray) -> dict[str, dict[str, float]]:
    """Channel -> rms, R2, theil, samples."""
    return {
        name: asdict(channel_fit(record[name], flown[:, i]))
        for i, name in enumerate(names)
        if name in record and np.isfinite(record[name]).any()
    }


def picture(record: Record, flown: dict[str, tuple[Applied, np.ndarray]]) -> Picture | None:
    """Measured against all aircraft, the channels that all of them model."""
    models = [applied.model for applied, _ in flown.values()]
    names = (
        [o for o in models[0].outputs if o in record and all(o in model.outputs for model in models)] if models else []
    )
    if not names:
        return None
    curves = {
        label: array[:, [applied.model.outputs.index(n) for n in names]] for label, (applied, array) in flown.items()
    }
    return histories(record.name, record.t, names, record.matrix(names), curves)


def main() -> None:
    given = arguments()
    aircraft = fleet(given.aircraft)
    records = read_records(given.records, ColumnMap.from_options(given.map))
    applied = {label: apply_effects(one, records, given.axes) for label, one in aircraft.items()}
    results: dict[str, dict] = {}
    made_with = provenance(0)
    with whole_folder(given.out) as folder:
        pictures = []
        for i, record in enumerate(records):
            flown = {}
            for label, one in applied.items():
                found = fly(one, one.records[i])
                names = one.model.outputs
                if isinstance(found, str):
                    results.setdefault(record.name, {})[label] = {"diverged": found}
                    continue
                flown[label] = (one, found)
                results.setdefault(record.name, {})[label] = statistics(record, names, found)
                simulated = record.with_channels(**{name: found[:, k] for k, name in enumerate(names)})
                write_record(simulated, folder / f"{file_name(record.name)}__{label}.csv")
            drawn = picture(record, flown)
            pictures += [drawn] if drawn else []
        (folder / "simulate.json").write_text(
            json.dumps({"schema": "casid.simulate/1", "records": results}, indent=1) + "\n"
        )
        write_provenance(made_with, folder / "run.json")
        write_pictures(pictures, folder / "figures")
    print(table(results))


def table(results: dict[str, dict]) -> str:
    """r.m.s. of measured minus simulated, one line per record and aircraft."""
    channels = list(
        dict.fromkeys(c for row in results.values() for one in row.values() if "diverged" not in one for c in one)
    )
    width = max(len(f"{record}  {label}") for record, row in results.items() for label in row)
    lines = [f"{'r.m.s.':{width}} " + " ".join(f"{c:>10}" for c in channels)]
    for record, row in results.items():
        for label, one in row.items():
            head = f"{f'{record}  {label}':{width}} "
            cells = " ".join(f"{one[c]['rms']:10.4g}" if c in one else f"{'':>10}" for c in channels)
            lines.append(head + one.get("diverged", cells))
    return "\n".join(lines)


if __name__ == "__main__":
    run_script(main)
