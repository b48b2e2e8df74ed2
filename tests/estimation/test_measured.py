"""Truth: states recorded under another name give the fit of the same records with the states' own names."""

from __future__ import annotations

import numpy as np
import pytest
from estimation_cases import NOISE, START, flight, short_period

from casid.errors import InputError
from casid.estimation import CombinedError, EquationError, OutputError, Problem, solve
from casid.model.system import define_model
from casid.records.record import Record

OWN = flight(noise=NOISE, rng=np.random.default_rng(3))
FOREIGN = Record(name="m1", t=OWN.t, channels={"delta_e": OWN["delta_e"], "vane": OWN["alpha"], "gyro": OWN["q"]})


def renamed():
    """The short period whose outputs are called as the record calls them."""
    model = short_period()
    alpha, q = model.states
    return define_model(
        "short period",
        states=(alpha, q),
        inputs=model.inputs,
        parameters=model.nominal,
        outputs=("vane", "gyro"),
        dynamics=lambda s: {
            "alpha": s.Za * s.alpha + s.q + s.Zde * s.delta_e,
            "q": s.Ma * s.alpha + s.Mq * s.q + s.Mde * s.delta_e,
        },
        output=lambda s: {"vane": s.alpha, "gyro": s.q},
    )


@pytest.mark.parametrize("cost", [EquationError(), CombinedError(), OutputError()])
def test_states_are_measured_by_channels_of_other_names(cost):
    plain = solve(Problem(short_period(), OWN, free=["*"], start=START, cost=cost))
    mapped = Problem(renamed(), FOREIGN, free=["*"], start=START, cost=cost, measured={"alpha": "vane", "q": "gyro"})
    fit = solve(mapped)
    assert fit.converged
    np.testing.assert_allclose(list(fit.values.values()), list(plain.values.values()), rtol=1e-9)


def test_a_map_that_names_nothing_is_an_error():
    for measured, part in (({"alfa": "vane"}, "did you mean 'alpha'"), ({"alpha": "van"}, "did you mean 'vane'")):
        with pytest.raises(InputError, match=part):
            Problem(renamed(), FOREIGN, free=["*"], cost=EquationError(), measured=measured)
