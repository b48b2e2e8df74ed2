"""`casid modes`: handbook numbers of aircraft files, with the deviations that their parameters leave."""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from casid.acceptance.handbook import Handbook, flight_point, handbook, usual_speeds
from casid.acceptance.parameters import known_by_document, known_by_file
from casid.acceptance.steady import SteadyFlight
from casid.acceptance.theil import Theil, theil
from casid.cli.options import AsJson, Files, Folder, Maps, fleet, records_of, require_words
from casid.cli.results import write_json
from casid.model.aircraft import Aircraft
from casid.records.limits import read_json, sound
from casid.report.folder import results
from casid.report.modes_page import text as in_words
from casid.report.modes_page import write_modes


def modes(
    *aircraft: Annotated[Path, Parameter(name="AIRCRAFT")],
    estimate: Path | None = None,
    record: Files | None = None,
    V: Annotated[float | None, Parameter(name="--V")] = None,
    altitude: float | None = None,
    climb_deg: float = 0.0,
    maps: Maps | None = None,
    out: Folder = Path("out/modes"),
    as_json: AsJson = False,
) -> None:
    """Compute modes, static and manoeuvre margins, lift over drag, best glide and trim curves, with intervals.

    Several aircraft files, such as an original and its extended one, are compared, all at the flight point of the
    first. Writes DIR/modes.html, DIR/modes.json and DIR/modes_figures.

    Parameters
    ----------
    aircraft
        Aircraft files (TOML).
    estimate
        An estimate.json of `casid estimate` of the first file: one more column, with its covariance.
    record
        Flight records: Theil's coefficients of the files, flown open loop, and their parts.
    V
        Airspeed [m/s]; default: that of [trim].
    altitude
        Altitude [m], standard atmosphere; default: that of [trim].
    climb_deg
        Climb angle [deg].
    maps
        Column map of the records: alpha=ALCG:deg, or a TOML file.
    """
    require_words(aircraft, "AIRCRAFT", "modes AIRCRAFT ... [--estimate FILE] [--record FILE ...]")
    files = fleet(aircraft)
    first = next(iter(files))
    point = flight_point(files[first], V, altitude, None) | {"climb_angle": math.radians(climb_deg)}
    read = records_of(record, maps, flown_by=files.values()) if record else []
    with results(out) as folder:
        found: dict[str, Handbook] = {}
        for label, one in files.items():
            flight = SteadyFlight(one)
            found[label] = handbook(flight, known_by_file(flight), point, usual_speeds(point["V"]))
            if label == first and estimate is not None:
                written = read_json(estimate, "the estimate.json of casid estimate")
                with sound(estimate, "the estimate.json of casid estimate"):
                    known = known_by_document(flight, written, str(estimate))
                found[f"{label}, estimated"] = handbook(flight, known, point, usual_speeds(point["V"]))
        compared = _theil(files, read) if read else {}
        text = write_json(document(found, compared), folder / "modes.json")
        write_modes(found, compared, folder)
    print(text if as_json else in_words(found, compared))


def document(found: dict[str, Handbook], compared: dict[str, dict[str, dict[str, Theil]]]) -> dict[str, Any]:
    """The content of modes.json."""
    return {
        "schema": "casid.modes/1",
        "aircraft": {label: one.to_dict() for label, one in found.items()},
        "theil": {
            record: {label: {c: asdict(t) for c, t in channels.items()} for label, channels in by_label.items()}
            for record, by_label in compared.items()
        },
    }


def _theil(files: dict[str, Aircraft], read: Sequence[Any]) -> dict[str, dict[str, dict[str, Theil]]]:
    """Record -> label -> channel -> Theil."""
    by_label = {label: theil(one, read) for label, one in files.items()}
    for label, by_record in by_label.items():
        for name in (name for name, channels in by_record.items() if not channels):
            print(f"note: {label} diverges on {name}: no coefficients of Theil", file=sys.stderr)
    return {r.name: {label: by_record[r.name] for label, by_record in by_label.items()} for r in read}
