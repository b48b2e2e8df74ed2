"""What held-out records keep of what was named. Truth: the rule, on gains written here."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from casid.diagnosis.criteria import Criteria
from casid.diagnosis.judging.held_out import best_on_held, held_gains, steps_to_keep


@pytest.mark.parametrize(
    ("gains", "kept"),
    [
        ((), 0),
        ((1.0, 0.5), 2),
        ((1.0, -0.5), 1),
        ((-0.2, 6.2, 1.3), 3),
        ((-0.2, 0.1), 0),
        ((None, None), 2),
        ((1.0, -0.1, None), 1),
    ],
)
def test_steps_that_lose_on_held_out_records_are_taken_back_unless_later_ones_make_up(gains, kept) -> None:
    assert steps_to_keep(gains) == kept


@pytest.mark.parametrize(("loss", "kept"), [(17.0, ["cause"]), (60.0, [])])
def test_held_out_records_that_hardly_move_a_cause_do_not_refuse_it(loss: float, kept: list[str]) -> None:
    """A cause that gains 600 in the fitted records and loses less than a twentieth of it, 30, in the others stays."""
    cause = SimpleNamespace(name="cause", nuisance=False)
    noise = SimpleNamespace(coloured={})
    bare = SimpleNamespace(attached=[], data_deviance=0.0, readings=1000, noise=noise, criteria=Criteria())
    more = SimpleNamespace(attached=[cause], data_deviance=loss, readings=1000, noise=noise)
    gains = held_gains([bare, more])  # pyright: ignore
    final, _ = best_on_held([], [bare, more], [bare, more], gains, [600.0])  # pyright: ignore
    assert [one.name for one in final.attached] == kept


def test_an_event_that_is_not_in_the_held_out_records_is_not_judged_there() -> None:
    """Nor by the offset that was put in beside it: a shear in other records, and a bias that loses with it."""
    bias, scale = SimpleNamespace(name="bias", nuisance=True), SimpleNamespace(name="scale", nuisance=False)
    noise = SimpleNamespace(coloured={})
    bare, event, cause = (
        SimpleNamespace(attached=attached, data_deviance=deviance, readings=1000, noise=noise)
        for attached, deviance in (([], 0.0), ([bias], 600.0), ([bias, scale], 500.0))
    )
    assert held_gains([bare, event, cause]) == [None, pytest.approx(0.05)]  # pyright: ignore
