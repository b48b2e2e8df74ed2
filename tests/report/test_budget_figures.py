"""The waterfall of the error. Truth: the numbers of the budget, which its bars must join."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest
from matplotlib import pyplot as plt

from casid.diagnosis.given.budget import Budget, BudgetSteps
from casid.report.budget_figures import budget
from casid.report.figure import Bar

Q = BudgetSteps(as_given=18.0, data_mended=12.0, values=4.0, structure=1.5)
LABELS = {"q": "pitch rate", "p": "roll rate", "V": "true airspeed"}
LOST = BudgetSteps(as_given=2.0, data_mended=2.0, values=5.0, structure=1.0)  # a refit that makes it worse
GONE = BudgetSteps(as_given=math.inf, data_mended=math.inf, values=3.0, structure=1.2)


def bars(row: int) -> list[Bar]:
    """Bars of a row: all channels, then by the error as given."""
    found = Budget(records=("m4",), channels={"q": Q, "p": LOST, "V": GONE}, together=Q, labels=LABELS)
    (panel,) = budget(found).figure.panels
    assert panel.y.names == ("all channels", "true airspeed V", "pitch rate q", "roll rate p")
    return [bar for bar in panel.of(Bar) if abs(bar.at - row) < 0.5]


def test_bars_join_the_file_as_given_to_the_noise() -> None:
    ends = [(bar.low, bar.high) for bar in bars(2)]
    left = (Q.as_given, Q.data_mended, Q.values, Q.structure, Q.noise)
    assert ends == [pytest.approx((low, high)) for high, low in pairwise(left)]


def test_a_step_that_makes_it_worse_is_hatched() -> None:
    hatched = [bar for bar in bars(3) if bar.look.hatch]
    assert [(bar.low, bar.high) for bar in hatched] == [pytest.approx((2.0, 5.0))]


def test_a_simulation_that_diverges_is_drawn_and_said() -> None:
    assert all(math.isfinite(bar.high - bar.low) for bar in bars(1))


def test_a_budget_draws_itself_where_pyplot_finds_it() -> None:
    """Channels without a label, as those of a system that is no aircraft, keep their names."""
    found = Budget(records=("m4",), channels={"q": Q, "p": LOST}, together=Q)
    figure = found.plot()
    assert plt.fignum_exists(figure.number)
    assert [label.get_text() for label in figure.axes[0].get_yticklabels()][1:] == ["q", "p"]
    plt.close(figure)
