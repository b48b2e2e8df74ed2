"""Truth: the peers' equations of motion, written by hand, are the model's; a peer's row is at the same optimum."""

from __future__ import annotations

import json
import sys

import casadi as ca
import numpy as np
import pytest

import casid as cs
from problems.bench.table import exponent
from problems.peers.casadi import casadi_ipopt_gn
from problems.peers.common import INPUTS, STATES, TRUTH, our_problem, outputs, rates, task
from problems.peers.small import SMALL


def test_equations_of_the_peers_are_those_of_the_model():
    problem, data, rng = our_problem(), task(), np.random.default_rng(5)
    model = problem.model
    assert model.states == STATES and model.inputs == INPUTS and problem.parameters == tuple(TRUTH)
    exact = ca.Function("exact", [model.x, model.u, model.p, model.w], [model.f, model.h])
    for k in (0, 300, 900):
        x = data.X[k] + 0.02 * rng.standard_normal(8)
        p = data.start * rng.uniform(0.5, 1.5, 16)
        f, h = exact(x, data.U[k], model.nominal_vector(dict(zip(TRUTH, p, strict=True))), 0)
        np.testing.assert_allclose(rates(x, data.U[k], p, np), f.full().ravel(), rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(outputs(x, np), h.full().ravel(), rtol=1e-12, atol=1e-14)


def test_a_peer_reaches_our_optimum_and_a_missing_one_is_said(load_script, monkeypatch, capsys, tmp_path):
    script = load_script("bench_peers")

    def missing(data):
        raise ModuleNotFoundError("No module named 'opty'")

    monkeypatch.setitem(script.PEERS, "opty", missing)
    path = tmp_path / "peers.json"
    arguments = ["--peers", "casadi_ipopt_gn", "opty", "--samples", "501", "--repeats", "1", "--json", str(path)]
    monkeypatch.setattr(sys, "argv", ["bench_peers.py", *arguments])
    script.main()
    assert "opty: No module named 'opty', left out; install" in capsys.readouterr().out
    (row,) = json.loads(path.read_text())["rows"]
    assert row["peer"] == "casadi_ipopt_gn" and row["cost"] == pytest.approx(row["ours_cost"], rel=1e-8)
    assert row["ratio"] == pytest.approx(row["seconds"] / row["ours_seconds"])
    assert row["away"] < 1e-3


@pytest.mark.parametrize("name", ["short_period", "lotka_volterra"])
def test_the_small_problems_have_one_optimum_for_all(name):
    """casid's own, and that of IPOPT with equations written by hand."""
    problem, data = SMALL[name]()
    fit = cs.solve(problem)
    parameters, cost = casadi_ipopt_gn(data)
    assert fit.converged and cost == pytest.approx(fit.cost, rel=1e-7)
    np.testing.assert_allclose(parameters, list(fit.values.values()), rtol=1e-5)


def test_exponent_of_a_power_law():
    assert exponent([1.0, 10.0, 1000.0], [3.0, 300.0, 3e6]) == pytest.approx(2.0)
