"""Simulated unstable short period under feedback: single shooting ends in a wrong minimum, multiple shooting does not.

Test case 8 of R. V. Jategaonkar, Flight Vehicle System Identification, 2nd ed., AIAA 2015 (data: `unStabAC_sim.asc` in
supplement 10.2514/4.102790): vertical speed w and pitch rate q with the measured elevator as input. The wrong minimum
is reached from START when the initial state is held in trim, as the book holds it. With a free one even Gauss-Newton
with full steps gets out of it again.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from casid.estimation import Problem, RangeWeights
from casid.model.system import Model, define_model
from casid.records.record import Record

SPEED = 44.57  # m/s, trim speed of the simulation
TRUTH = {"Zw": -1.4249, "Zq": -1.4768, "Zde": -6.2632, "Mw": 0.2163, "Mq": -3.7067, "Mde": -12.784}
START = {"Zw": -1.22871, "Zq": 0.0, "Zde": -4.20491, "Mw": 0.116197, "Mq": -2.7067, "Mde": -18.7718}


def _lift(s: Any) -> Any:
    return s.Zw * s.w + s.Zq * s.q + s.Zde * s.delta_e


def model() -> Model:
    """States w [m/s], q [rad/s]; input delta_e [rad]; outputs also the vertical acceleration az [m/s2]."""
    return define_model(
        "unstable short period",
        states=("w", "q"),
        inputs=("delta_e",),
        parameters=START,
        outputs=("az", "w", "q"),
        dynamics=lambda s: {"w": _lift(s) + SPEED * s.q, "q": s.Mw * s.w + s.Mq * s.q + s.Mde * s.delta_e},
        output=lambda s: {"az": _lift(s), "w": s.w, "q": s.q},
        state_scale={"w": 5.0},
    )


def record_from(path: str | Path) -> Record:
    """The record `unStabAC_sim.asc`: t, pilot command, w, q, delta_e, az."""
    table = np.loadtxt(path)
    names: list[str] = ["command", "w", "q", "delta_e", "az"]
    channels = dict(zip(names, table.T[1:], strict=True))
    return Record(name=Path(path).stem, t=table[:, 0], channels=channels, source=str(path))


def problem(record: Record) -> Problem:
    """All six derivatives free, free initial state; weights by range, because the simulated data have no noise."""
    return Problem(model(), [record], free=["Z*", "M*"], noise=RangeWeights())
