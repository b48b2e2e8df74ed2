"""Truth: states recorded under another name give the fit of the same records with the states' own names."""

from __future__ import annotations

import numpy as np
import pytest
from estimation_cases import NOISE, START, flight, short_period

from casid.errors import InputError
from casid.estimation import (
    Collocation,
    CombinedError,
    EquationError,
    MultipleShooting,
    OutputError,
    Problem,
    SingleShooting,
    solve,
)
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


@pytest.mark.parametrize("method", [MultipleShooting(), SingleShooting(), Collocation(substeps=4)])
@pytest.mark.parametrize("sigma", [0.1, None])
def test_states_alone_are_estimated(method, sigma):
    """An oscillator with known frequency: the initial state and its errors are those of linear least squares."""
    t = np.linspace(0.0, 10.0, 101)
    y = 1.3 * np.cos(2.0 * t) - 0.4 * np.sin(2.0 * t) + 0.1 * np.random.default_rng(0).standard_normal(101)
    model = define_model(
        "oscillator",
        states=("x", "v"),
        inputs=(),
        parameters={"w": 2.0},
        outputs=("y",),
        dynamics=lambda s: {"x": s.v, "v": -(s.w**2) * s.x},
        output=lambda s: {"y": s.x},
    )
    record = Record(name="r", t=t, channels={"y": y})
    fit = solve(Problem(model, record, noise=None if sigma is None else {"y": sigma}), method)
    columns = np.stack([np.cos(2.0 * t), np.sin(2.0 * t) / 2.0], axis=1)
    best = np.linalg.lstsq(columns, y)[0]
    std = fit.noise["y"] * np.sqrt(np.diagonal(np.linalg.inv(columns.T @ columns)))
    assert fit.converged and not fit.values and "oscillator" in str(fit)
    assert (np.abs(fit.states["r"].trajectory[0] - best) < 0.02 * std).all()


def test_two_records_with_the_same_numbers_are_remarked():
    again = Record(name="again", t=OWN.t, channels=dict(OWN.channels))
    fit = solve(Problem(short_period(), [OWN, again], free=["*"], start=START))
    assert any("'again'" in remark and "twice" in remark for remark in fit.remarks)
    other = Record(name="other", t=OWN.t, channels=dict(OWN.channels) | {"q": OWN["q"] + 1e-9})
    fit = solve(Problem(short_period(), [OWN, other], free=["*"], start=START))
    assert not any("twice" in remark for remark in fit.remarks)
