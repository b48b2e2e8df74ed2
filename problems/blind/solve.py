"""Blind tests as a campaign: diagnose a set of which only the records and the aircraft file are known."""

from __future__ import annotations

import json
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from casid.diagnosis.criteria import Criteria
from casid.diagnosis.diagnose import diagnose
from casid.diagnosis.engine.trial import Trial
from casid.diagnosis.result import Diagnosis
from casid.errors import CasidError
from casid.model.aircraft import Aircraft
from casid.records.readers import read_records

_TRIALS = 6  # kept of every round of naming


def solve(task: Mapping[str, Any]) -> dict[str, Any]:
    """Diagnose the records m*.csv with aircraft.toml of the task's folder; nothing else is opened but the file of
    `criteria`, if the task names one.

    Returns what diagnosis.json has of verdict and causes, the strongest trials of every round, and seconds of
    processor time; {"failed": message} when the diagnosis cannot be carried out.
    """
    folder = Path(task["folder"])
    begin = time.process_time()
    try:
        found = diagnose(
            Aircraft.read(folder / "aircraft.toml"),
            read_records([folder / "m*.csv"]),
            criteria=Criteria.read(task["criteria"]) if task.get("criteria") else None,
        )
    except (CasidError, ArithmeticError, ValueError, IndexError) as fault:
        return {"failed": f"{type(fault).__name__}: {fault}"}
    return shortened(found) | {"cpu_s": time.process_time() - begin}


def shortened(found: Diagnosis) -> dict[str, Any]:
    """The part of a diagnosis that is scored, and what shows why it went wrong."""
    with tempfile.TemporaryDirectory() as folder:
        found.write(Path(folder) / "diagnosis.json")
        document = json.loads((Path(folder) / "diagnosis.json").read_text(encoding="utf-8"))
    return {
        **{
            name: document[name]
            for name in (
                *("verdict", "sentence", "causes", "minor", "contradicted", "factors", "parameters"),
                *("smallest_detectable", "decisions"),
            )
        },
        **{name: document[name] for name in ("explanations", "believed", "nothing")},
        "entered": dict(found.entered),
        "seconds": document["seconds"],
        "unexplained": {missing.station: missing.gain for missing in found.unexplained},
        "turbulence": {"sigma": found.turbulence.sigma, "gain": found.turbulence.gain},
        "kinematic": [{"name": one.name, "net": one.net, "value": float(one.value)} for one in found.kinematic[:3]],
        "rounds": [
            {"named": one.named, "trials": [_trial(trial) for trial in one.trials[:_TRIALS]]} for one in found.rounds
        ],
    }


def _trial(trial: Trial) -> dict[str, Any]:
    return {
        "name": trial.candidate.name,
        "net": float(trial.gain.net),
        "share": float(trial.share),
        "value": float(trial.candidate.attached.values["value"]),
        "refuted": bool(trial.refuted),
    }
