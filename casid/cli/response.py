"""`casid response`: frequency responses of flight records, alone or with those of aircraft files."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from casid.cli.options import AsJson, Axes, Files, Folder, Maps, records_of, say_idle_effects
from casid.cli.simulate import fleet
from casid.errors import InputError
from casid.frequency.mismatch import MismatchEnvelope, ResponseComparison, compare_responses
from casid.frequency.model_response import LinearModel, linear_model
from casid.frequency.response import FrequencyResponse, frequency_response
from casid.model.aircraft import Aircraft
from casid.records.record import Record
from casid.report.folder import provenance, whole_folder, write_provenance
from casid.report.response_figures import bode, bode_mismatch
from casid.report.result_page import write_result

Numbers = Annotated[list[float], Parameter(consume_multiple=True, negative="")]


def response(
    *records: Annotated[str, Parameter(name="RECORD")],
    input: str,
    output: Files,
    other: Files | None = None,
    aircraft: Files | None = None,
    axes: Axes | None = None,
    band: tuple[float, float] | None = None,
    windows: Numbers | None = None,
    envelope: Path | None = None,
    maps: Maps | None = None,
    out: Folder = Path("out/response"),
    as_json: AsJson = False,
) -> None:
    """Estimate frequency responses from flight records, with coherence and random error.

    Writes DIR/response.json and the page DIR/response.html with a Bode diagram for each output. The responses of
    aircraft files, by exact linearisation at the medians of the records, are drawn beside it with the mismatch and its
    cost.

    Parameters
    ----------
    records
        Files, or patterns like 'flight/m*.csv'; all together give one response.
    input
        Input channel, like delta_e.
    output
        Output channels, like q alpha.
    other
        Inputs that move with it, like delta_r with delta_a; their part is taken off.
    aircraft
        Aircraft files (TOML), such as an original and its extended one.
    axes
        Plane of motion of the aircraft; default: what the surfaces allow.
    band
        Lowest and highest frequency, rad/s; default: what the windows and the samples allow.
    windows
        Lengths of windows, s; default: five, from half of the longest record down.
    envelope
        CSV file with bounds of the mismatch: omega, gain_low_db, gain_high_db, phase_low_deg, phase_high_deg.
    """
    if not records:
        raise InputError("RECORD is missing; expected: response RECORD ... --input delta_e --output q")
    if envelope is not None and not aircraft:
        raise InputError("--envelope bounds the mismatch of a model; expected --aircraft FILE with it")
    bounds = MismatchEnvelope.read(envelope) if envelope is not None else None
    files = fleet([Path(file) for file in aircraft or []])
    others = tuple(other or ())
    read = records_of(records, maps or [], own=(input, *output, *others))
    for one in files.values():
        say_idle_effects(one, read)
    made_with = provenance()
    with whole_folder(out) as folder:
        models = _linear(files, read, axes, output)
        flown = [
            frequency_response(read, input, name, other_inputs=others, band=band, windows=windows) for name in output
        ]
        found = [compare_responses(one, models, envelope=bounds) if models else one for one in flown]
        text = json.dumps(document(found, models), indent=1)
        (folder / "response.json").write_text(text + "\n", encoding="utf-8")
        said = "\n\n".join(map(_said, found))
        drawn = [bode(x) if isinstance(x, FrequencyResponse) else bode_mismatch(x) for x in found]
        write_result(folder, "response", f"Responses to {input}", said, drawn)
        write_provenance(made_with, folder / "run.json")
    print(text if as_json else said)


def document(found: Sequence[FrequencyResponse | ResponseComparison], models: dict[str, LinearModel]) -> dict[str, Any]:
    """The content of response.json."""
    return {
        "schema": "casid.responses/1",
        "responses": [one.to_dict() for one in found],
        "models": {
            label: {
                "states": list(model.states),
                "eigenvalues": [[float(root.real), float(root.imag)] for root in model.eigenvalues],
                "point": model.point,
                "not_linear": list(model.not_linear),
            }
            for label, model in models.items()
        },
    }


def _said(found: FrequencyResponse | ResponseComparison) -> str:
    return str(found) if isinstance(found, FrequencyResponse) else f"{found.flight}\n\n{found}"


def _linear(
    files: dict[str, Aircraft], records: Sequence[Record], axes: Axes | None, outputs: Sequence[str]
) -> dict[str, LinearModel]:
    return {label: linear_model(one, records, axes=axes, outputs=outputs) for label, one in files.items()}
