"""Truth: CasADi's derivatives of the same cost and constraints, taken of the whole programme at once."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from estimation_cases import NOISE, START, flight, short_period

import casid.estimation.solvers.ipopt as under_test
from casid.estimation import CombinedError, Ipopt, MultipleShooting, Problem, solve

POSED = {
    "noise estimated": ({}, MultipleShooting(interval=20)),
    "one segment": ({}, MultipleShooting(interval=200)),
    "two steps a sample": ({}, MultipleShooting(interval=20, substeps=2)),
    "own values per record": ({"free": ["Z*"], "per_record": ["M*"]}, MultipleShooting(interval=7)),
    "equations too": ({"cost": CombinedError()}, MultipleShooting(interval=20)),
    "process noise": ({"noise": NOISE}, MultipleShooting(interval=20, process_noise={"q": 0.01})),
}


class _CaughtError(Exception):
    pass


def programme(monkeypatch: pytest.MonkeyPatch, posed: str, hessian: str) -> tuple[dict, dict]:
    """nlp and the functions given to casadi.nlpsol."""

    def catch(nlp: dict, options: dict, given: dict) -> None:
        raise _CaughtError(nlp, given)

    monkeypatch.setattr(under_test, "CompilableProgramme", catch)
    records = [flight(f"m{seed}", noise=NOISE, rng=np.random.default_rng(seed)) for seed in (1, 2)]
    more, method = POSED[posed]
    with pytest.raises(_CaughtError) as caught:
        problem = Problem(short_period(), records, **({"free": ["*"], "start": START} | more))
        solve(problem, method, Ipopt(hessian=hessian))
    nlp, given = caught.value.args
    return nlp, given


@pytest.mark.parametrize("posed", POSED)
def test_derivatives_by_segment_are_those_of_the_whole(monkeypatch, posed):
    nlp, given = programme(monkeypatch, posed, "exact")
    x, p, f, g = (nlp[name] for name in "xpfg")
    factor, multipliers = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", g.numel())
    whole = ca.triu(ca.hessian(factor * f + ca.dot(multipliers, g), x)[0])
    truth = ca.Function("truth", [x, p, factor, multipliers], [g, ca.jacobian(g, x), whole])
    rng = np.random.default_rng(29)
    at = [rng.uniform(0.1, 1.0, e.shape) for e in (x, p, factor, multipliers)]
    ends, slopes, bent = (np.asarray(e) for e in truth(*at))
    assert np.abs(bent).max() > 0.0
    found_ends, found_slopes = (np.asarray(e) for e in given["jac_g"](*at[:2]))
    np.testing.assert_allclose(found_ends, ends, rtol=1e-10, atol=1e-10 * np.abs(ends).max(initial=0.0))
    np.testing.assert_allclose(found_slopes, slopes, rtol=1e-10, atol=1e-10 * np.abs(slopes).max(initial=0.0))
    found = np.asarray(given["hess_lag"](*at))
    np.testing.assert_allclose(found, bent, rtol=1e-10, atol=1e-12 * np.abs(bent).max())


def test_that_of_gauss_and_newton_leaves_the_multipliers_out(monkeypatch):
    """Truth: the Hessian of half the sum of squares of what is linear in the states alone: J'J."""
    nlp, given = programme(monkeypatch, "noise estimated", "gauss-newton")
    _, exact = programme(monkeypatch, "noise estimated", "exact")
    rng = np.random.default_rng(29)
    at = [rng.uniform(0.1, 1.0, nlp[name].shape) for name in "xp"]
    count = at[0].size - len(START)
    nothing = [1.0, np.zeros(nlp["g"].shape)]
    found, bent = (np.asarray(of["hess_lag"](*at, *nothing))[-count:, -count:] for of in (given, exact))
    # the model is linear in its states: in these alone the exact Hessian has no other part
    np.testing.assert_allclose(found, bent, rtol=1e-10, atol=1e-12 * np.abs(bent).max())
