"""Truth: a simulated predator-prey system by scipy's integrator, whose outputs have other names than its states."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import casid as cs

TRUTH = {"a": 0.6, "b": 0.025, "c": 0.9, "d": 0.03}
START = {"a": 1.0, "b": 0.03, "c": 0.8, "d": 0.02}


def problem(measured: tuple[str, ...], **more) -> cs.Problem:
    model = cs.define_model(
        "Lotka-Volterra",
        states=["prey", "predator"],
        inputs=[],
        parameters=START,
        outputs=list(measured),
        dynamics=lambda s: {
            "prey": s.a * s.prey - s.b * s.prey * s.predator,
            "predator": -s.c * s.predator + s.d * s.prey * s.predator,
        },
        output=lambda s: {k: v for k, v in (("hares", s.prey), ("lynx", s.predator)) if k in measured},
    )
    t, (a, b, c, d) = np.linspace(0.0, 30.0, 121), TRUTH.values()

    def f(_, x):
        return [a * x[0] - b * x[0] * x[1], -c * x[1] + d * x[0] * x[1]]

    x = solve_ivp(f, (0.0, 30.0), [30.0, 6.0], t_eval=t, rtol=1e-10, atol=1e-10).y
    rng = np.random.default_rng(0)
    y = dict(zip(("hares", "lynx"), x + rng.standard_normal(x.shape), strict=True))
    return cs.Problem(model, [cs.Record(name="m1", t=t, channels={k: y[k] for k in measured})], **more)


@pytest.mark.parametrize("method", [cs.MultipleShooting(), cs.Collocation()], ids=lambda m: type(m).__name__)
def test_outputs_of_other_names_than_the_states(method):
    fit = cs.solve(problem(("hares", "lynx"), free=["*"]), method)
    assert fit.converged, fit.status
    for name, value in TRUTH.items():
        assert abs(fit[name].value - value) < 4.0 * fit[name].std
    assert fit.noise["hares"] == pytest.approx(1.0, abs=0.2)


def test_a_state_that_only_shows_in_the_others_motion():
    fit = cs.solve(problem(("hares",), free=["a", "c", "d"], fixed={"b": TRUTH["b"]}))
    assert fit.converged, fit.status
    # nothing tells the predators' number but b, and nothing but theirs tells d
    assert abs(fit["a"].value - 0.6) < 4.0 * fit["a"].std and abs(fit["c"].value - 0.9) < 4.0 * fit["c"].std


def test_a_guess_is_that_of_the_records_at_hand():
    """One model for two records of the same name: the estimates from the whole are those of a model that is new."""
    whole = problem(("hares",), free=["a", "c"], fixed={"b": TRUTH["b"], "d": TRUTH["d"]})
    cs.solve(replace(whole, records=[whole.records[0].between(0.0, 10.0)]))
    again = cs.solve(whole)
    new = cs.solve(problem(("hares",), free=["a", "c"], fixed={"b": TRUTH["b"], "d": TRUTH["d"]}))
    assert again.converged and again.values == pytest.approx(new.values, rel=1e-9)
