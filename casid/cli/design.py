"""`casid design`: the manoeuvre that tells most about the derivatives of an aircraft file, within stated limits."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any, Literal

import numpy as np

from casid.cli.options import AsJson, Files, Folder, Whole
from casid.design import Experiment, InputDesign, Multisine, Steps, design_input, standard_3211
from casid.errors import EstimationError, InputError
from casid.model.aircraft import Aircraft
from casid.model.dynamics import aircraft_model
from casid.model.trim import trim
from casid.records.readers import write_record
from casid.report.design_figures import designed_histories
from casid.report.estimate_figures import write_pictures
from casid.report.folder import provenance, whole_folder, write_provenance
from casid.report.progress import progress

SHAPES = {"pulses4": Steps(pulses=4), "pulses8": Steps(pulses=8), "multisine": Multisine(lines=8)}
SURFACES = {"longitudinal": ("delta_e",), "lateral": ("delta_a", "delta_r")}
OUTPUTS = {"longitudinal": ("V", "alpha", "q", "theta", "ax", "az"), "lateral": ("beta", "p", "r", "phi", "ay")}
COEFFICIENTS = {"longitudinal": ("CL", "CD", "CX", "CZ", "Cm"), "lateral": ("CY", "Cl", "Cn")}
REGRESSORS = {"longitudinal": ("alpha", "q", "delta_e"), "lateral": ("beta", "p", "r", "delta_a", "delta_r")}
# 1-sigma of ordinary flight-test instruments, where the aircraft file names none
TYPICAL_NOISE = dict.fromkeys(("alpha", "beta"), 0.003) | dict.fromkeys(("p", "q", "r"), 0.002)
TYPICAL_NOISE |= dict.fromkeys(("phi", "theta"), 0.005) | dict.fromkeys(("ax", "ay", "az"), 0.1) | {"V": 0.5}


def design(
    *,
    aircraft: Path,
    axes: Literal["longitudinal", "lateral"] = "longitudinal",
    shape: Literal["pulses4", "pulses8", "multisine"] = "pulses4",
    criterion: Literal["D", "A"] = "D",
    deflection_deg: float = 3.0,
    angle_deg: float = 3.0,
    load_g: float = 0.5,
    duration: float = 10.0,
    free: Files | None = None,
    seed: Whole = 0,
    out: Folder = Path("out/design"),
    as_json: AsJson = False,
) -> None:
    """Design the input that tells most about the derivatives, and compare it with the standard 3-2-1-1.

    The aircraft flies level at the trim of its file. Writes the designed manoeuvre and the standard one as records,
    DIR/design.json with the Cramer-Rao bounds of both, and DIR/figures.

    Parameters
    ----------
    aircraft
        The aircraft file (TOML), with V and altitude or rho under [trim].
    axes
        Plane of motion: the elevator, or aileron and rudder.
    shape
        Free pulses, or a sum of sines.
    criterion
        D: mean log variance of the derivatives over their sizes; A: log of the mean variance.
    deflection_deg
        Largest deflection of a surface from trim [deg].
    angle_deg
        Largest change of alpha or beta from trim [deg].
    load_g
        Largest change of az or ay from trim [g].
    duration
        Length of the manoeuvre [s].
    free
        Globs of the derivatives to be estimated; default: all of these axes.
    seed
        Of the random starts.
    out
        Folder for the results.
    as_json
        Print design.json and nothing else.
    """
    for name, value in {"deflection-deg": deflection_deg, "angle-deg": angle_deg, "load-g": load_g}.items():
        if not (math.isfinite(value) and value > 0.0):
            raise InputError(f"--{name} {value:g}: expected a positive number")
    file = Aircraft.read(aircraft)
    angle, load = ("alpha", "az") if axes == "longitudinal" else ("beta", "ay")
    limits = {angle: math.radians(angle_deg), load: load_g * file.gravity}
    experiment = experiment_of(file, axes, math.radians(deflection_deg), limits, duration, free)
    made_with = provenance(seed)
    with whole_folder(out) as folder, progress(quiet=as_json) as stage:
        try:
            stage("standard 3-2-1-1")
            designs = {"3-2-1-1": standard_3211(experiment, criterion=criterion)}
            stage(f"design: {shape}")
            designs[shape] = design_input(experiment, SHAPES[shape], criterion=criterion, seed=seed)
        except EstimationError as error:
            raise InputError(str(error)) from None
        text = json.dumps(document(experiment, designs), indent=1)
        (folder / "design.json").write_text(text + "\n", encoding="utf-8")
        for name, one in designs.items():
            write_record(one.record, folder / f"{name}.csv")
        shown = [*experiment.surfaces, *limits]
        histories = designed_histories(axes, {name: one.record for name, one in designs.items()}, shown)
        write_pictures([histories], folder / "figures")
        write_provenance(made_with, folder / "run.json")
    print(text if as_json else table(designs, shape))


def experiment_of(
    aircraft: Aircraft,
    axes: Literal["longitudinal", "lateral"],
    deflection: float,
    limits: dict[str, float],
    duration: float,
    free: list[str] | None,
) -> Experiment:
    """Level flight at the trim of the file, surfaces within `deflection` [rad], outputs within `limits`.

    Raises InputError when the file has no trim point.
    """
    known = {name: aircraft.trim[name] for name in ("V", "altitude", "rho") if name in aircraft.trim}
    if "V" not in known or len(known) < 2:
        raise InputError(f"'{aircraft.name}': [trim] needs V, and altitude or rho, for a design; add them to the file")
    known.pop("altitude" if "rho" in known else "rho", None)
    at = trim(aircraft, V=known["V"], altitude=known.get("altitude"), rho=known.get("rho"))
    whole = aircraft_model(aircraft, effects=())
    level = dict(zip(whole.states, at.state.tolist(), strict=True)) | at.inputs
    outputs = OUTPUTS[axes]
    model = aircraft_model(aircraft, axes=axes, outputs=outputs, effects=())
    return Experiment(
        model=model,
        surfaces=dict.fromkeys(SURFACES[axes], deflection),
        rest={name: level[name] for name in model.inputs},
        start=np.array([level[name] for name in model.states]),
        noise={name: aircraft.noise.get(name, TYPICAL_NOISE[name]) for name in outputs},
        duration=duration,
        dt=0.04,
        parameters=free or [name for name in model.parameters if _is_of(axes, name)],
        limits=limits,
    )


def _is_of(axes: str, name: str) -> bool:
    coefficient, _, regressor = name.partition("_")
    return coefficient in COEFFICIENTS[axes] and regressor in REGRESSORS[axes]


def document(experiment: Experiment, designs: dict[str, InputDesign]) -> dict[str, Any]:
    """The content of design.json: standard deviations that each manoeuvre allows at best."""
    return {
        "schema": "casid.design/1",
        "limits": dict(experiment.limits),
        "deflection_rad": dict(experiment.surfaces),
        "noise": dict(experiment.noise),
        "designs": {
            name: {"status": one.status, "cost": one.cost, "std": dict(one.std)} for name, one in designs.items()
        },
    }


def table(designs: dict[str, InputDesign], shape: str) -> str:
    """Cramer-Rao bounds of both manoeuvres, one line per derivative."""
    standard, own = designs["3-2-1-1"], designs[shape]
    lines = [f"{'derivative':16} {'3-2-1-1':>12} {shape:>12} {'ratio':>7}   {own.status}"]
    for name, std in standard.std.items():
        lines.append(f"{name:16} {std:12.4g} {own.std[name]:12.4g} {own.std[name] / std:7.2f}")
    return "\n".join(lines)
