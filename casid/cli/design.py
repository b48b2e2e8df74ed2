"""`casid design`: the most informative manoeuvre for the derivatives of an aircraft file, within stated limits."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from casid.cli.options import AsJson, Files, Folder, Whole, aircraft_of, called_by, require_positive
from casid.cli.results import write_json
from casid.design import Experiment, InputDesign, Multisine, StepInput, design_input, standard_3211
from casid.design.flight_card import FlightCard, flight_card
from casid.design.level_flight import SURFACES, Limits, experiment_of, level_rivals
from casid.design.separation import NoManoeuvre, separating_manoeuvre
from casid.diagnosis.document import Called, NextStep
from casid.errors import InputError
from casid.frames import Rows
from casid.model.aircraft import Aircraft
from casid.model.effect_value import EffectValue
from casid.model.effects import effect_of, effect_value
from casid.model.plausible import impossibilities
from casid.records.readers import write_record
from casid.records.record import Record
from casid.report.card_tables import card_in_words, card_tables
from casid.report.design_figures import designed_histories, separated
from casid.report.figure import Picture
from casid.report.folder import results
from casid.report.progress import progress
from casid.report.result_page import Answer, in_numbers, write_result
from casid.report.words import digits, effect_name, expectation_in_words, manoeuvre_in_words, odds_in_words, quantity
from casid.signals import label_of

SHAPES = {"pulses4": StepInput(pulses=4), "pulses8": StepInput(pulses=8), "multisine": Multisine(lines=8)}


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
    separate: Files | None = None,
    seed: Whole = 0,
    out: Folder = Path("out/design"),
    as_json: AsJson = False,
) -> None:
    """Design the most informative input for the derivatives, or the input that separates two causes.

    The aircraft flies level at the trim of its file. Writes the designed manoeuvre and the standard one as records,
    DIR/design.json with the Cramer-Rao bounds of both, DIR/autopilot.csv with the changes of the surfaces from trim,
    and the page DIR/design.html with a flight card; with --separate DIR/next_flight.csv.

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
    separate
        Two causes with their sizes in SI, like 'actuator_lag(delta_e)=0.1' 'input_delay(delta_e)=0.1': the manoeuvre
        that separates them best, by what no derivative can imitate.
    seed
        Seed of the random starts.
    """
    require_positive({"deflection-deg": deflection_deg, "angle-deg": angle_deg, "load-g": load_g})
    if separate is not None and (axes, shape, criterion, free) != ("longitudinal", "pulses4", "D", None):
        raise InputError(
            "--separate chooses plane, surface and shape itself; leave out --axes, --shape, --criterion, --free"
        )
    file = aircraft_of(aircraft)
    limits = Limits(
        surfaces=dict.fromkeys(SURFACES["full"], math.radians(deflection_deg)),
        channels={name: math.radians(angle_deg) for name in ("alpha", "beta")}
        | {name: load_g * file.gravity for name in ("az", "ay")},
        duration=duration,
    )
    with results(out, seed) as folder, progress(quiet=as_json) as stage:
        if separate is not None:
            found = _separating(file, separate, limits, stage)
        else:
            found = _telling(experiment_of(file, axes, limits, free or ()), shape, criterion, seed, stage)
        for name, record in found.records.items():
            write_record(record, folder / f"{name}.csv")
        name, record = list(found.records.items())[-1]
        card = flight_card(record, found.experiment)
        (folder / "autopilot.csv").write_text(card.to_csv(), encoding="utf-8")
        answer = answer_of(card, found.gain, called_by([str(out / f"{name}.csv")], (), aircraft, out))
        numbers = [in_numbers(found.numbers)] if found.numbers else []
        write_result(folder, "design", found.title, answer, [*card_tables(card), found.picture, *numbers])
        text = write_json(found.content | {"card": card.to_dict()}, folder / "design.json")
    said = (str(answer), card_in_words(card), found.numbers)
    print(text if as_json else "\n\n".join(filter(None, said)))


@dataclass(frozen=True, eq=False, kw_only=True)
class Designed:
    """What was designed: an experiment and its records, the last of which is to be flown; the gain in a sentence, and
    what the page, design.json and the terminal have of it beside the flight card."""

    experiment: Experiment
    records: Mapping[str, Record]
    gain: str
    title: str
    picture: Picture
    content: dict[str, Any]
    numbers: str = ""


def _telling(experiment: Experiment, shape: str, criterion: str, seed: int, stage: Callable[[str], None]) -> Designed:
    """Design the most informative manoeuvre, beside the standard one."""
    stage("standard 3-2-1-1")
    designs = {"3-2-1-1": standard_3211(experiment, criterion=criterion)}
    stage(f"design: {shape}")
    designs[shape] = design_input(experiment, SHAPES[shape], criterion=criterion, seed=seed)
    records = {name: one.record for name, one in designs.items()}
    ratios = [designs[shape].std[name] / std for name, std in designs["3-2-1-1"].std.items() if std > 0.0]
    ratio = digits(math.exp(float(np.mean(np.log(ratios)))) if ratios else math.nan, 2)
    these = f"The standard errors of the {len(ratios)} derivatives"
    return Designed(
        experiment=experiment,
        records=records,
        gain=f"{these} are on average {ratio} times those of a standard 3-2-1-1.",
        title=f"Designed manoeuvre: {shape}",
        picture=designed_histories("design", records, [*experiment.surfaces, *experiment.limits]),
        content=document(experiment, designs),
        numbers=table(designs, shape),
    )


def answer_of(card: FlightCard, gain: str, called: Called) -> Answer:
    """Return what the page begins with: what is flown, what it gains, and what to do next."""
    moved = ", ".join(
        f"{label_of(name)} by up to {digits(float(np.abs(card.command[:, k]).max()), 2)} {card.units[name]}"
        for k, name in enumerate(card.inputs, 1)
    )
    isolate = (
        f"casid isolate --aircraft {called.aircraft} --manoeuvre {called.records} --out {called.inside('isolate')}"
    )
    fly = f"Fly the card below; an autopilot flies {called.inside('autopilot.csv')}, changes from trim."
    return Answer(
        badge="Flight card",
        sentence=f"From level flight, move {moved}, in {card.duration:.1f} s. {gain}",
        next=(
            NextStep(text=fly),
            NextStep(text="Before that, see which causes the flight would tell apart:", command=isolate),
        ),
    )


def _separating(file: Aircraft, separate: Sequence[str], limits: Limits, stage: Callable[[str], None]) -> Designed:
    """Design the manoeuvre that separates two causes."""
    if len(separate) != 2:
        raise InputError(f"--separate {' '.join(separate)}: expected two causes, like 'actuator_lag(delta_e)=0.1'")
    first, second = (effect_value(text) for text in separate)
    if effect_of(first).name == effect_of(second).name:
        raise InputError(f"--separate: {effect_of(first).name} stands twice; expected two causes that differ")
    for doubt in impossibilities(replace(file, effects=(first, second))):
        if doubt.parameter != "inertia":
            raise InputError(f"--separate {doubt.parameter}={doubt.given:g}: such a size is impossible")
    rivals, experiment = level_rivals(file, first, second, limits)
    stage("the manoeuvre that separates them")
    found = separating_manoeuvre(rivals, experiment)
    if isinstance(found, NoManoeuvre):
        raise InputError(f"--separate: {found.reason}")
    expected = f"Expected log of the odds: {expectation_in_words(found.separation)}, from flight to flight."
    return Designed(
        experiment=experiment,
        records={"next_flight": found.flown},
        gain=f"The {manoeuvre_in_words(found)}, {odds_in_words(found.separation)}. {expected}",
        title=f"Manoeuvre that separates {' from '.join(map(_in_words, (first, second)))}",
        picture=separated(found, rivals),
        content={
            "schema": "casid.design/1",
            "separate": list(separate),
            "manoeuvre": {
                "surface": found.manoeuvre.surface,
                "shape": found.manoeuvre.words,
                "amplitude_rad": found.amplitude,
            },
            "limits": dict(experiment.limits),
            "noise": dict(rivals.noise),
            "log_odds": found.separation.log_odds,
            "log_odds_scatter": found.separation.scatter,
            "told_by": dict(found.separation.told),
        },
    )


def _in_words(value: EffectValue) -> str:
    return f"{effect_name(effect_of(value))} of {quantity(value.value, value.unit)}"


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
    standard = designs["3-2-1-1"]
    own = designs[shape]
    rows = Rows(
        heads={"derivative": "", "3-2-1-1": ".4g", shape: ".4g", "ratio": ".2f"},
        rows=[(name, std, own.std[name], own.std[name] / std) for name, std in standard.std.items()],
    )
    head = f"Least 1-sigma of each derivative (Cramer-Rao bound) with either manoeuvre; search: {own.status}"
    return f"{head}\n{rows.text()}"
