"""ATTAS: dimensional derivatives from real flight, and what a high R2 on unseen data does not say.

Question     does the estimator agree with an independent program on real records, and is the model then adequate?
Set-up       lateral: AilRud1 (aileron, then rudder) fitted, its repeat AilRud2 held out; longitudinal: Elv1 and Elv2
             fitted together. Output error, multiple shooting, Gauss-Newton; noise estimated; inputs linear between
             samples. On the held-out manoeuvres only the initial state is found anew. Then the aircraft file of all six
             coefficients, linear, is diagnosed: AilRud1 and Elv1 fitted, AilRud2 and Elv2 held out; what kinematics
             alone say about the instruments is estimated from the repeats too, which share nothing with the first.
Expectation  the independent values within two standard errors that allow for coloured residuals; R2 above 0.95 on the
             repeat; and yet residuals with a lag-1 autocorrelation far above that of noise: R2 does not make a model
             adequate. DIR/attas.json, DIR/figures, DIR/run.json, a table; DIR/diagnosis.json and DIR/report.html say
             what the linear model leaves. problems/real/attas_findings.md says what of it is certain.

    python scripts/attas.py DIR [--out DIR]        DIR: folder with fAttasAilRud1.mat ... (see README)
"""

from __future__ import annotations

from casid.cli.start import run_script

import argparse
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from casid.diagnosis.diagnose import diagnose
from casid.diagnosis.evidence.evidence import weigh
from casid.diagnosis.flight.evaluation import FlightFit as Reconstruction
from casid.diagnosis.flight.flight import prepare
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.flight.noise import with_noise_level
from casid.diagnosis.flight.subject import Subject
from casid.diagnosis.given.contradicted import flight_values
from casid.diagnosis.kinematics import kinematics
from casid.diagnosis.result import Diagnosis
from casid.estimation import Fit, solve
from casid.estimation.fitted import channel_fit
from casid.filtering.initial_state import fit_initial_state
from casid.model.causes.instruments import sensor_bias, sensor_delay, sensor_scale, vane_position
from casid.model.effect import Effect
from casid.model.simulate import simulate
from casid.model.system import Model
from casid.records.record import Record
from casid.report.estimate_figures import autocorrelation, estimates, histories
from casid.report.figure import Picture
from casid.report.folder import out_folder, provenance, whole_folder, write_provenance
from casid.report.page import write_report
from casid.report.progress import progress
from problems.real import attas
from problems.real.pictures import write_pictures

INSTRUMENTS = (
    *(sensor_bias(rate) for rate in "pqr"),
    *(sensor_scale(rate) for rate in "pqr"),
    sensor_delay("p"),
    sensor_delay("psi"),
)
AHEAD = (vane_position("alpha"), vane_position("beta"))  # air data taken ahead of the c.g., as on a nose boom
LATE = (sensor_delay("alpha"), sensor_delay("beta"))  # or late: nearly the same, since alpha-dot is nearly q
_FIRST_DELAY = 0.05  # s: a delay has no slope at zero
WHICH_STD = """\
std: Cramer-Rao, as if the residuals were white. corrected: with the autocorrelation that they have; 'off' is in units
of that, in brackets of the former. Which is honest, the repeats say, fitted on their own: difference of two estimates
over its standard deviation, r.m.s. over the derivatives (1 expected):"""


def held_out(model: Model, record: Record, values: Mapping[str, float]) -> np.ndarray:
    """(N, outputs) simulated from the initial state that fits the record best, nothing else changed."""
    fitted = replace(model, nominal={**model.nominal, **values})
    return simulate(fitted, record, fit_initial_state(fitted, record)).outputs


def judged(record: Record, outputs: tuple[str, ...], simulated: np.ndarray) -> dict[str, dict[str, float]]:
    """Output -> rms, R2, theil and the lag-1 autocorrelation of the residual."""
    return {
        name: asdict(channel_fit(record[name], simulated[:, i]))
        | {"lag1": float(autocorrelation(record[name] - simulated[:, i], 1)[1])}
        for i, name in enumerate(outputs)
    }


def instruments(records: Sequence[Record]) -> dict[str, Any]:
    """Instrument errors by kinematics alone, in calm air, all together: "found" name -> (estimate, 1-sigma with colour
    and stretches of record that disagree allowed for), SI, and by how much the deviance grows when the air data are
    taken as late and not as measured ahead of the c.g."""
    flight = with_noise_level(prepare(attas.aircraft(), records), ())
    ahead, late = (reconstructed(flight, (*INSTRUMENTS, *air_data)) for air_data in (AHEAD, LATE))
    honest = flight_values(weigh(ahead, discrepancy=False))
    found = {one.name: (ahead[one.name], honest[one.name].std) for one in ahead.attached}
    return {"found": found, "late_instead_of_ahead": late.deviance - ahead.deviance}


def reconstructed(flight: Subject, effects: Sequence[Effect]) -> Reconstruction:
    given = [Attached(effect=e, values={"value": 0.0 if e.linear else _FIRST_DELAY}) for e in effects]
    return kinematics.reconstruct(flight, given)


def told(diagnosis: Diagnosis, by_kinematics: Mapping[str, Mapping[str, Any]]) -> str:
    """What the diagnosis says, and the instruments from both sets of records side by side."""
    lines = [str(diagnosis), "", "instruments by kinematics alone, SI (1-sigma that allows for their colour):"]
    lines.append(f"{'':22}" + "".join(f"{label:>24}" for label in by_kinematics))
    sets = list(by_kinematics.values())
    for name in sets[0]["found"]:
        cells = ("{:.4f} +- {:.1g}".format(*one["found"][name]) for one in sets)
        lines.append(f"{name:22}" + "".join(f"{cell:>24}" for cell in cells))
    rises = "".join(f"{one['late_instead_of_ahead']:24.0f}" for one in sets)
    return "\n".join([*lines, f"{'late, not ahead: -2lnL':22}{rises}"])


def repeatability(first: Fit, repeat: Fit, names: Iterable[str]) -> dict[str, float]:
    """r.m.s. of the difference of two independent estimates over its standard deviation, white and corrected."""
    pairs = [(first[name], repeat[name]) for name in names]
    white = [(a.value - b.value) / np.hypot(a.std_cramer_rao, b.std_cramer_rao) for a, b in pairs]
    corrected = [(a.value - b.value) / np.hypot(a.std_corrected, b.std_corrected) for a, b in pairs]
    return {
        "std": float(np.sqrt(np.mean(np.square(white)))),
        "std_corrected": float(np.sqrt(np.mean(np.square(corrected)))),
    }


def table(title: str, fit: Fit, independent: Mapping[str, float]) -> str:
    lines = [f"{title}: {fit.status}, {fit.iterations} iterations, {fit.seconds:.2f} s"]
    lines.append(f"{'':6} {'independent':>12} {'estimate':>10} {'std':>8} {'corrected':>9} {'off':>6} {'(white)':>8}")
    for name, value in independent.items():
        e = fit[name]
        off, white = (e.value - value) / e.std_corrected, f"({(e.value - value) / e.std_cramer_rao:.2f})"
        lines.append(
            f"{name:6} {value:12.5f} {e.value:10.5f} {e.std_cramer_rao:8.2g} {e.std_corrected:9.2g} {off:6.2f} "
            f"{white:>8}"
        )
    return "\n".join(lines)


def picture(name: str, fit: Fit, independent: Mapping[str, float]) -> Picture:
    pairs = {
        "independent": [(value, 0.0) for value in independent.values()],
        "casid": [(fit[n].value, fit[n].std_corrected) for n in independent],
    }
    return replace(estimates(tuple(independent), pairs, "independent"), name=f"estimates_{name}")


def main() -> None:
    parser = argparse.ArgumentParser(
        description="Lateral and longitudinal derivatives of ATTAS from real flight.",
        epilog="Example: python scripts/attas.py data/fvsysid --out out/attas",
    )
    parser.add_argument("folder", type=Path, metavar="DIR", help="folder with fAttasAilRud1.mat, fAttasElv1.mat ...")
    parser.add_argument("--out", type=out_folder, default=Path("out/attas"), help="folder for the results")
    given = parser.parse_args()
    made_with = provenance(0)
    read = {name: attas.records_from(given.folder, f"fAttas{name}") for name in ("AilRud1", "AilRud2", "Elv1", "Elv2")}
    with whole_folder(given.out) as folder, progress() as stage:
        stage("estimates")
        lateral = solve(attas.lateral_problem(read["AilRud1"]))
        longitudinal = solve(attas.longitudinal_problem([*read["Elv1"], *read["Elv2"]]))
        elevator = [solve(attas.longitudinal_problem(read[name])) for name in ("Elv1", "Elv2")]
        again = {
            "lateral": repeatability(lateral, solve(attas.lateral_problem(read["AilRud2"])), attas.LATERAL),
            "longitudinal": repeatability(elevator[0], elevator[1], attas.LONGITUDINAL),
        }
        model = lateral.problem.model
        flown = {record.name: held_out(model, record, lateral.values) for record in read["AilRud2"]}
        unseen = {record.name: judged(record, model.outputs, flown[record.name]) for record in read["AilRud2"]}
        first, repeat = [*read["AilRud1"], *read["Elv1"]], [*read["AilRud2"], *read["Elv2"]]
        stage("instruments")
        by_kinematics = {"AilRud1 and Elv1": instruments(first), "AilRud2 and Elv2": instruments(repeat)}
        diagnosis = diagnose(attas.aircraft(), first, repeat, report=stage)
        results = {
            "schema": "casid.attas/1",
            "lateral": lateral.to_dict(),
            "longitudinal": longitudinal.to_dict(),
            "independent": {**attas.LATERAL, **attas.LONGITUDINAL},
            "held_out": unseen,
            "instruments": by_kinematics,
            "repeatability": again,
        }
        (folder / "attas.json").write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
        diagnosis.write(folder / "diagnosis.json")
        write_report(diagnosis, folder, made_with)
        write_provenance(made_with, folder / "run.json")
        drawn = [picture("lateral", lateral, attas.LATERAL), picture("longitudinal", longitudinal, attas.LONGITUDINAL)]
        for r in read["AilRud2"]:
            drawn.append(histories(r.name, r.t, model.outputs, r.matrix(model.outputs), {"held out": flown[r.name]}))
        write_pictures(drawn, folder / "figures")
    print(table("lateral", lateral, attas.LATERAL))
    print(table("longitudinal", longitudinal, attas.LONGITUDINAL))
    print(WHICH_STD)
    for plane, ratio in again.items():
        print(f"  {plane:12} Cramer-Rao {ratio['std']:.1f}, corrected {ratio['std_corrected']:.1f}")
    print("held out:")
    for name, channels in unseen.items():
        cells = "   ".join(f"{c}: R2 {v['R2']:.3f} lag-1 {v['lag1']:.2f}" for c, v in channels.items())
        print(f"  {name}  {cells}")
    print(told(diagnosis, by_kinematics))


if __name__ == "__main__":
    run_script(main)
