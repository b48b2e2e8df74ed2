"""`casid isolate`: which causes a manoeuvre and its channels can detect and tell apart, before it is flown."""

from __future__ import annotations

from pathlib import Path

from casid.acceptance.isolability import isolability
from casid.cli.options import AsJson, Files, Flag, Folder, Maps, aircraft_of, records_of
from casid.cli.results import write_json
from casid.report.folder import results
from casid.report.isolability_page import write_isolability
from casid.report.progress import progress


def isolate(
    *,
    aircraft: Path,
    manoeuvre: Files,
    channels: Files | None = None,
    causes: Files | None = None,
    only_this: Flag = False,
    maps: Maps | None = None,
    out: Folder = Path("out/isolate"),
    as_json: AsJson = False,
) -> None:
    """List the causes that a manoeuvre and its channels can detect and separate, before it is flown.

    Writes DIR/isolability.html, DIR/isolability.json and DIR/isolability_figures.

    Parameters
    ----------
    aircraft
        The aircraft file (TOML), with V and altitude or rho under [trim].
    manoeuvre
        Records of the surfaces, flown from level flight; such as the ones that `casid design` writes.
    channels
        What is measured; default: V, flow angles, rates, attitude and specific forces.
    causes
        Globs of causes, like 'sensor_*'; default: all but most aerodynamic terms.
    only_this
        Do not look for the channel or manoeuvre that would add most.
    maps
        Column map: delta_e=DE:deg, or a TOML file.
    """
    file = aircraft_of(aircraft)
    records = records_of(manoeuvre, maps)
    with results(out) as folder, progress(quiet=as_json) as stage:
        stage("responses of the causes" if only_this else "responses of the causes, further channels and manoeuvres")
        found = isolability(file, records, channels=channels, causes=causes, suggest=not only_this)
        text = write_json(found.to_dict(), folder / "isolability.json")
        write_isolability(found, folder)
    print(text if as_json else found)
