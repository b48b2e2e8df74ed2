"""ATTAS: dimensional derivatives from real flight, and what a high R2 on unseen data does not say.

Question     does the estimator agree with an independent program on real records, and is the model then adequate?
Set-up       lateral: AilRud1 (aileron, then rudder) fitted, its repeat AilRud2 held out; longitudinal: Elv1 and Elv2
             fitted together. Output error, multiple shooting, Gauss-Newton; noise estimated; inputs linear between
             samples. On the held-out manoeuvres only the initial state is found anew.
Expectation  the independent values within two standard errors that allow for coloured residuals; R2 above 0.95 on the
             repeat; and yet residuals with a lag-1 autocorrelation far above that of noise: R2 does not make a model
             adequate. DIR/attas.json, DIR/figures, DIR/run.json, a table.

    python scripts/attas.py DIR [--out DIR]        DIR: folder with fAttasAilRud1.mat ... (see README)
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path

import casid  # noqa: F401  before numpy: it sets the number of threads

# isort: split
import numpy as np

from casid.errors import run_script
from casid.estimation import Fit, solve
from casid.estimation.fit import channel_fit
from casid.estimation.initial_state import fit_initial_state
from casid.model.simulate import simulate
from casid.model.system import Model
from casid.records.record import Record
from casid.report.estimate_figures import autocorrelation, estimates, histories, write_pictures
from casid.report.folder import provenance, whole_folder, write_provenance
from casid.report.style import Picture
from problems import attas


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


def table(title: str, fit: Fit, independent: Mapping[str, float]) -> str:
    lines = [f"{title}: {fit.status}, {fit.iterations} iterations, {fit.seconds:.2f} s"]
    lines.append(f"{'':6} {'independent':>12} {'estimate':>10} {'std':>8} {'corrected':>9} {'off/corrected':>14}")
    for name, value in independent.items():
        e = fit[name]
        off = (e.value - value) / e.std_corrected
        lines.append(f"{name:6} {value:12.5f} {e.value:10.5f} {e.std:8.2g} {e.std_corrected:9.2g} {off:14.2f}")
    return "\n".join(lines)


def picture(name: str, fit: Fit, independent: Mapping[str, float]) -> Picture:
    pairs = {
        "independent": [(value, 0.0) for value in independent.values()],
        "casid": [(fit[n].value, fit[n].std_corrected) for n in independent],
    }
    return replace(estimates(tuple(independent), pairs, "independent"), name=f"estimates_{name}")


def main() -> None:
    parser = argparse.ArgumentParser(description="Lateral and longitudinal derivatives of ATTAS from real flight.")
    parser.add_argument("folder", type=Path, metavar="DIR", help="folder with fAttasAilRud1.mat, fAttasElv1.mat ...")
    parser.add_argument("--out", type=Path, default=Path("out/attas"), help="folder for the results")
    given = parser.parse_args()
    made_with = provenance(0)
    read = {name: attas.records_from(given.folder, f"fAttas{name}") for name in ("AilRud1", "AilRud2", "Elv1", "Elv2")}
    with whole_folder(given.out) as folder:
        lateral = solve(attas.lateral_problem(read["AilRud1"]))
        longitudinal = solve(attas.longitudinal_problem([*read["Elv1"], *read["Elv2"]]))
        model = lateral.problem.model
        flown = {record.name: held_out(model, record, lateral.values) for record in read["AilRud2"]}
        unseen = {record.name: judged(record, model.outputs, flown[record.name]) for record in read["AilRud2"]}
        results = {
            "schema": "casid.attas/1", "lateral": lateral.to_dict(), "longitudinal": longitudinal.to_dict(),
            "independent": {**attas.LATERAL, **attas.LONGITUDINAL}, "held_out": unseen,
        }  # fmt: skip
        (folder / "attas.json").write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
        write_provenance(made_with, folder / "run.json")
        drawn = [picture("lateral", lateral, attas.LATERAL), picture("longitudinal", longitudinal, attas.LONGITUDINAL)]
        for r in read["AilRud2"]:
            drawn.append(histories(r.name, r.t, model.outputs, r.matrix(model.outputs), {"held out": flown[r.name]}))
        write_pictures(drawn, folder / "figures")
    print(table("lateral", lateral, attas.LATERAL))
    print(table("longitudinal", longitudinal, attas.LONGITUDINAL))
    print("held out:")
    for name, channels in unseen.items():
        cells = "   ".join(f"{c}: R2 {v['R2']:.3f} lag-1 {v['lag1']:.2f}" for c, v in channels.items())
        print(f"  {name}  {cells}")


if __name__ == "__main__":
    run_script(main)
