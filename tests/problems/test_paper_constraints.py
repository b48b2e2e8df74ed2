"""Constraints on a poorly excited record: they rescue the estimate, both solvers agree, multipliers are prices."""

from __future__ import annotations

from functools import cache

import pytest

from casid.errors import InputError
from problems.do328 import STABLE
from problems.paper.constraints import ALPHA_LIMIT, estimate, experiments, flight, truth_of, worst_error

solved = cache(estimate)


QUICK = ("bounds", "static margin", "tied")  # the others by IPOPT are a campaign


@pytest.mark.parametrize("name", [pytest.param(n, marks=[] if n in QUICK else pytest.mark.slow) for n in experiments()])
def test_both_solvers_find_the_same_constrained_optimum(name: str) -> None:
    first, second = solved(name), solved(name, "IPOPT")
    assert first.converged and second.converged
    for parameter, e in first.parameters.items():
        # an interior-point method stops a little inside an active limit
        assert second[parameter].value == pytest.approx(e.value, abs=1e-6 * abs(truth_of(parameter)))


@pytest.mark.parametrize("name", [n for n, e in experiments().items() if e.constraints and n != "path"])
def test_a_multiplier_is_the_price_of_its_limit(name: str) -> None:
    """Truth: dJ/d(limit) = - multiplier (envelope theorem), by central differences of the optimal cost."""
    fit = solved(name)
    for i, multiplier in enumerate(fit.multipliers):
        shift = 1e-3 / max(abs(multiplier), 1.0)
        above, below = (solved(name, shift=side * shift, only=i).cost for side in (1, -1))
        assert (below - above) / (2 * shift) == pytest.approx(multiplier, rel=1e-3, abs=1e-5)


def test_without_constraint_the_poor_record_is_not_enough() -> None:
    assert worst_error(solved("none")) > 0.4
    assert worst_error(solved("none, roll")) > 2.0


@pytest.mark.parametrize(("name", "below"), [("bounds", 0.35), ("static margin", 0.1), ("tied", 0.05)])
def test_what_is_known_rescues_the_estimate(name: str, below: float) -> None:
    """Truth: the derivatives that the record was simulated with."""
    assert worst_error(solved(name)) < below


def test_a_sign_constraint_puts_a_wrong_sign_right() -> None:
    assert solved("none, roll")["Cl_r"].value < 0.0 < STABLE["Cl_r"]
    fit = solved("signs")
    assert fit["Cl_r"].value == pytest.approx(0.0, abs=1e-12) and fit.multipliers[2] < 0.0
    assert worst_error(fit) < 0.5 * worst_error(solved("none, roll"))


def test_path_constraint_holds_where_the_free_estimate_breaks_it() -> None:
    assert flight("poor").exact["alpha"].max() < ALPHA_LIMIT < solved("none").predictions["poor"][:, 0].max()
    fit = solved("path")
    assert fit.converged and fit.predictions["poor"][:, 0].max() <= ALPHA_LIMIT + 1e-9


def test_tied_parameters_are_equal_and_the_others_are_not() -> None:
    fit = solved("tied")
    for name in ("Cm_alpha", "Cm_q"):
        assert fit[f"{name}[poor]"].value == pytest.approx(fit[f"{name}[good]"].value, abs=1e-12)
    assert fit["Cm_delta_e[poor]"].value != fit["Cm_delta_e[good]"].value


def test_unknown_experiment_is_named() -> None:
    with pytest.raises(InputError, match="did you mean 'tied'"):
        estimate("tie")
