"""`casid response`: frequency responses of flight records, alone or with those of aircraft files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from cyclopts import Parameter

from casid.cli.options import AsJson, Axes, Files, Folder, Maps, fleet, records_of, require_words
from casid.cli.results import write_json
from casid.errors import InputError
from casid.frequency.mismatch import Mismatch, MismatchEnvelope, ResponseComparison, compare_responses
from casid.frequency.model_response import LinearModel, linear_model
from casid.frequency.response import FrequencyResponse, frequency_response
from casid.report.folder import results
from casid.report.response_figures import bode, bode_mismatch
from casid.report.result_page import BAD, GOOD, Answer, in_numbers, write_result

Numbers = Annotated[list[float], Parameter(consume_multiple=True, negative="")]

ACCEPTABLE = 100.0  # cost of Tischler and Remple, Aircraft and Rotorcraft System Identification, 2nd ed. (2012)


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
    require_words(records, "RECORD", "response RECORD ... --input delta_e --output q")
    if envelope is not None and not aircraft:
        raise InputError("--envelope bounds the mismatch of a model; expected --aircraft FILE with it")
    bounds = MismatchEnvelope.read(envelope) if envelope is not None else None
    files = fleet(aircraft or [])
    others = tuple(other or ())
    read = records_of(records, maps, own=(input, *output, *others), flown_by=files.values())
    with results(out) as folder:
        models = {label: linear_model(one, read, axes=axes, outputs=output) for label, one in files.items()}
        flown = [
            frequency_response(read, input, name, other_inputs=others, band=band, windows=windows) for name in output
        ]
        found = [compare_responses(one, models, envelope=bounds) if models else one for one in flown]
        text = write_json(document(found, models), folder / "response.json")
        said = "\n\n".join(map(_said, found))
        drawn = [bode(x) if isinstance(x, FrequencyResponse) else bode_mismatch(x) for x in found]
        answer = answer_of(found, input)
        write_result(folder, "response", f"Responses to {input}", answer, [*drawn, in_numbers(said)])
    print(text if as_json else f"{answer}\n\n{said}")


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


def answer_of(found: Sequence[FrequencyResponse | ResponseComparison], input: str) -> Answer:
    """Return where the responses can be read, and where and by how much the models differ; the last model first."""
    flights = [one if isinstance(one, FrequencyResponse) else one.flight for one in found]
    points = [_readable(one) for one in flights]
    comparisons = [one for one in found if isinstance(one, ResponseComparison)]
    labels = list(comparisons[0].mismatches)[::-1] if comparisons else []
    off = [(label, one.flight, one.mismatches[label]) for label in labels for one in comparisons]
    if not off:
        return Answer(badge=f"Response to {input}", sentence=points[0], points=tuple(points[1:]))
    told = [f"{label}, {flight.output} to {input}: {_off(flight, m)}" for label, flight, m in off]
    good = all(m.cost <= ACCEPTABLE for label, _, m in off if label == labels[0])
    return Answer(
        badge="Within the guideline" if good else "Beyond the guideline",
        sentence=told[0],
        points=(*told[1:], *points),
        colour=GOOD if good else BAD,
    )


def _readable(flight: FrequencyResponse) -> str:
    """Return the band in which a response can be read, and where its gain is largest."""
    used = np.flatnonzero(flight.usable)
    if not len(used):
        return f"{flight.output}: the coherence is too low at every frequency; nothing can be read."
    omega = flight.omega[used]
    peak = used[np.argmax(flight.gain_db[used])]
    return (
        f"{flight.output}: readable from {omega[0]:.2g} to {omega[-1]:.2g} rad/s; the gain is largest at "
        f"{flight.omega[peak]:.2g} rad/s, {flight.gain_db[peak]:.3g} dB."
    )


def _off(flight: FrequencyResponse, found: Mismatch) -> str:
    """Return where a model differs most from flight, and by how much."""
    judged = np.flatnonzero(found.judged)
    if not len(judged):
        return "not judged at any frequency."
    k, j = (judged[np.argmax(np.abs(one[judged]))] for one in (found.gain_db, found.phase_deg))
    return (
        f"off by up to {found.gain_db[k]:+.2g} dB at {flight.omega[k]:.2g} rad/s and {found.phase_deg[j]:+.2g} deg at "
        f"{flight.omega[j]:.2g} rad/s; cost {found.cost:.3g}, where at most {ACCEPTABLE:g} is acceptable."
    )


def _said(found: FrequencyResponse | ResponseComparison) -> str:
    return str(found) if isinstance(found, FrequencyResponse) else f"{found.flight}\n\n{found}"
