"""Truth: the equations of the model, by which it is known what drives a state."""

from __future__ import annotations

import numpy as np

import casid as cs
from casid.estimation.problem import Problem
from casid.filtering.forces import noise_of_forces


def test_noise_is_put_on_the_disturbances_that_drive_a_state() -> None:
    """Of three disturbances one is seen by the output alone, one acts nowhere."""
    model = cs.define_model(
        "lag",
        states=["x"],
        inputs=["u"],
        parameters={"T": 0.5},
        outputs=["y"],
        disturbances=["of_vane", "of_force", "unused"],
        dynamics=lambda s: {"x": (s.u - s.x) / s.T + s.of_force},
        output=lambda s: {"y": s.x + s.of_vane},
    )
    t = 0.1 * np.arange(20)
    record = cs.Record(name="m", t=t, channels={"u": np.sin(t), "y": np.sin(t)})
    cost = noise_of_forces(Problem(model, [record], free=["T"]))
    assert dict(cost.process_noise) == {"of_force": 0.0}
