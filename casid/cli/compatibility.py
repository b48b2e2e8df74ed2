"""`casid compatibility`: do the measurements agree with each other?"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from casid.cli.options import AsJson, Axes, Begin, End, Folder, Maps, records_of, require_words
from casid.cli.results import tell
from casid.diagnosis.kinematics.compatibility import compatibility as checked
from casid.model.aircraft import Aircraft
from casid.report.data_pages import write_compatibility


def compatibility(
    *records: Annotated[str, Parameter(name="RECORD")],
    aircraft: Path | None = None,
    axes: Axes | None = None,
    maps: Maps | None = None,
    begin: Begin = None,
    end: End = None,
    out: Folder | None = None,
    as_json: AsJson = False,
) -> int:
    """Check the kinematic consistency of measurements by flight-path reconstruction.

    Begins with `casid check`. Estimates the motion with biases of all instruments, and those errors of scale, delay and
    position that the data require; with velocity over ground also the steady wind. Aerodynamics play no part.
    Status 0: the measurements are compatible; 1: the data have a fault, an error is clear and larger than allowed or of
    an impossible size, or more than noise is left.
    With --out also DIR/compatibility.html, a page with measured and reconstructed histories, and compatibility.json.

    Parameters
    ----------
    records
        Files, or patterns like 'flight/m*.csv', of one set of instruments.
    aircraft
        An aircraft file (TOML), for the places of the instruments and their noise.
    axes
        Default: what the channels allow.
    """
    require_words(records, "RECORD", "compatibility RECORD ... [--aircraft FILE]")
    file = None if aircraft is None else Aircraft.read(aircraft)
    found = checked(records_of(records, maps, span=(begin, end)), file, axes=axes)
    tell("compatibility", found, out, as_json, write_compatibility)
    return 0 if found.passed else 1
