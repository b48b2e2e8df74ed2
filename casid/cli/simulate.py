"""`casid simulate`: recorded inputs flown through aircraft files, side by side."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np

from casid.acceptance.fleet import fly
from casid.cli.options import AsJson, Axes, Begin, End, Files, Folder, Maps, Records, fleet, records_of, require_words
from casid.cli.results import write_json
from casid.estimation.fitted import channel_fit
from casid.frames import Rows
from casid.model.flown_records import FlownRecords, flown_records
from casid.records.readers import write_record
from casid.records.record import Record
from casid.report.estimate_figures import file_name, histories
from casid.report.figure import Picture
from casid.report.folder import results
from casid.report.result_page import Answer, in_numbers, write_result
from casid.report.words import channel_scale, digits
from casid.signals import SURFACES

FOLLOWED = 0.9  # R2 from which a channel counts as followed; the sentence states it


def simulate(
    *records: Records,
    aircraft: Files,
    axes: Axes | None = None,
    maps: Maps | None = None,
    begin: Begin = None,
    end: End = None,
    out: Folder = Path("out/simulate"),
    as_json: AsJson = False,
) -> None:
    """Fly recorded inputs through one or more aircraft files, open loop.

    Every flight begins at the measured state; states that are not measured begin as they fit the first seconds of the
    record best. Writes the simulated records, DIR/simulate.json with r.m.s., R2 and Theil's coefficient per channel,
    and the page DIR/simulate.html. A simulation that diverges is reported, and is no error.

    Parameters
    ----------
    aircraft
        Aircraft files (TOML), such as an original and its extended one.
    axes
        Default: what the surfaces allow.
    """
    require_words(records, "RECORD", "simulate RECORD ... --aircraft FILE ...")
    files = fleet(aircraft)
    read = records_of(records, maps, span=(begin, end), flown_by=files.values())
    applied = {label: flown_records(one, read, axes) for label, one in files.items()}
    with results(out) as folder:
        found = {}
        pictures = []
        for i, record in enumerate(read):
            flown, found[record.name] = _fly_all(applied, i, record, folder)
            pictures.append(picture(record, flown))
        text = write_json({"schema": "casid.simulate/1", "records": found}, folder / "simulate.json")
        answer = answer_of(found)
        parts = [*pictures, in_numbers(table(found))]
        write_result(folder, "simulate", f"Simulation of {', '.join(found)}", answer, parts)
    print(text if as_json else f"{answer}\n\n{table(found)}")


def _fly_all(
    applied: dict[str, FlownRecords], i: int, record: Record, folder: Path
) -> tuple[dict[str, tuple[FlownRecords, np.ndarray]], dict[str, dict]]:
    """One record through all aircraft, written to the folder: flights that did not diverge, and statistics of all."""
    flown: dict[str, tuple[FlownRecords, np.ndarray]] = {}
    results: dict[str, dict] = {}
    for label, one in applied.items():
        found = fly(one, one.records[i])
        names = one.model.outputs
        if isinstance(found, str):
            results[label] = {"diverged": found}
            continue
        flown[label] = (one, found)
        results[label] = statistics(record, names, found)
        simulated = record.with_channels(**{name: found[:, k] for k, name in enumerate(names)})
        write_record(simulated, folder / f"{file_name(record.name)}__{label}.csv")
    return flown, results


def statistics(record: Record, names: Sequence[str], flown: np.ndarray) -> dict[str, dict[str, float]]:
    """Channel -> rms, R2, theil, samples."""
    return {
        name: asdict(channel_fit(record[name], flown[:, i]))
        for i, name in enumerate(names)
        if name in record and np.isfinite(record[name]).any()
    }


def picture(record: Record, flown: dict[str, tuple[FlownRecords, np.ndarray]]) -> Picture | None:
    """Measured against all aircraft, the channels that all of them model, and below them the inputs that moved."""
    models = [applied.model for applied, _ in flown.values()]
    outputs = models[0].outputs if models else ()
    names = [o for o in outputs if o in record and all(o in model.outputs for model in models)]
    if not names:
        return None
    curves = {
        label: array[:, [applied.model.outputs.index(n) for n in names]] for label, (applied, array) in flown.items()
    }
    flew = {name: record[name] for name in (*SURFACES, "thrust") if name in record and np.ptp(record[name]) > 0.0}
    return histories(record.name, record.t, names, record.matrix(names), curves, flew, given=next(iter(curves)))


def answer_of(results: dict[str, dict]) -> Answer:
    """Return which channels each aircraft file follows, and where it is worst; of the last file first."""
    labels = list(dict.fromkeys(label for row in results.values() for label in row))
    told = [_followed(label, results) for label in labels]
    return Answer(
        badge=labels[-1],
        sentence=told[-1],
        points=tuple(f"{label}: {one}" for label, one in zip(labels[:-1], told, strict=False)),
    )


def _followed(label: str, results: dict[str, dict]) -> str:
    """Return how many channels a file follows, and its worst one, in the unit of the figure."""
    rows = {record: row[label] for record, row in results.items() if label in row}
    lost = [record for record, one in rows.items() if "diverged" in one]
    cells = [
        (float(one["R2"]), float(one["rms"]), c, r)
        for r, row in rows.items()
        if r not in lost
        for c, one in row.items()
        if math.isfinite(one["R2"])
    ]
    diverges = f"diverges in {', '.join(lost)}; " if lost else ""
    if not cells:
        return f"{diverges}no channel can be compared."
    least = {channel: min(r2 for r2, _, c, _ in cells if c == channel) for _, _, channel, _ in cells}
    count = sum(one >= FOLLOWED for one in least.values())
    r2, rms, channel, record = min(cells)
    factor, unit = channel_scale(channel)
    size = f"{digits(factor * rms)} {unit}".strip()
    return (
        f"{diverges}{count} of {len(least)} channels are followed in every record (R2 at least {FOLLOWED:g}); "
        f"the worst is {channel} in {record}: R2 {r2:.3g}, r.m.s. error {size}."
    )


def table(results: dict[str, dict]) -> str:
    """r.m.s. of measured less simulated, in the units of the figure, and R2: a row per channel, for each record."""
    lines: list[str] = []
    for record, row in results.items():
        found = {label: one for label, one in row.items() if "diverged" not in one}
        heads = [f"r.m.s. {label}" for label in found] + [f"R2 {label}" for label in found]
        rows = []
        for channel in dict.fromkeys(c for one in found.values() for c in one):
            factor, unit = channel_scale(channel)
            sizes = [factor * one[channel]["rms"] if channel in one else None for one in found.values()]
            shares = [one[channel]["R2"] if channel in one else None for one in found.values()]
            rows.append((f"{channel} [{unit}]", *sizes, *shares))
        forms = [".4g"] * len(found) + [".4f"] * len(found)
        table = Rows(heads={"channel": "", **dict(zip(heads, forms, strict=True))}, rows=rows)
        lines += ["", f"{record}: measured less simulated", table.text()]
        lines += [f"{label}: {one['diverged']}" for label, one in row.items() if "diverged" in one]
    return "\n".join(lines[1:])
