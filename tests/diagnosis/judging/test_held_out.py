"""What held-out records keep of what was named. Truth: the rule, on gains written here."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from casid.diagnosis.judging import held_out
from casid.diagnosis.engine.held_out import best_on_held, held_gains, steps_to_keep


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


def _step(deviance: float, *attached: SimpleNamespace) -> SimpleNamespace:
    """A fit of these causes, and how likely it makes the held-out records."""
    fit = SimpleNamespace(attached=list(attached), readings=1000, noise=SimpleNamespace(coloured={}))
    return SimpleNamespace(fit=fit, deviance=deviance)


def _cause(name: str, nuisance: bool = False) -> SimpleNamespace:
    return SimpleNamespace(name=name, nuisance=nuisance)


@pytest.mark.parametrize(("loss", "kept"), [(170.0, ["cause"]), (600.0, [])])
def test_held_out_records_that_hardly_move_a_cause_do_not_refuse_it(monkeypatch, loss: float, kept: list[str]) -> None:
    """Truth: the chain rule. A cause has 560 to spare on the fitted records; what it loses on the others is less, or
    more."""
    on_held = [_step(0.0), _step(loss, _cause("cause"))]
    monkeypatch.setattr(held_out, "without", lambda fit, names: on_held[0].fit)
    monkeypatch.setattr(held_out, "predicted_on", lambda held, fit: on_held[0])
    steps = [one.fit for one in on_held]
    final, _, _ = best_on_held([], steps, on_held, held_gains(on_held), [560.0])  # pyright: ignore
    assert [one.name for one in final.attached] == kept


def test_what_loses_first_does_not_take_what_is_right_behind_it_with_it(monkeypatch) -> None:
    """A wrong term was named first and loses 280; behind it two causes gain 30 and 200. No first steps are better than
    none at all, and both causes without the term are."""
    term, vane, arm = _cause("term"), _cause("vane"), _cause("arm")
    on_held = [_step(0.0), _step(280.0, term), _step(250.0, term, vane), _step(50.0, term, vane, arm)]
    right = _step(-210.0, vane, arm)
    monkeypatch.setattr(held_out, "without", lambda fit, names: right.fit)
    monkeypatch.setattr(held_out, "predicted_on", lambda held, fit: right)
    steps = [one.fit for one in on_held]
    final, _, _ = best_on_held([], steps, on_held, held_gains(on_held), [7.0, 5.0, 5.0])  # pyright: ignore
    assert [one.name for one in final.attached] == ["vane", "arm"]


def test_an_event_that_is_not_in_the_held_out_records_is_not_judged_there() -> None:
    """Nor by the offset that was put in beside it: a shear in other records, and a bias that loses with it."""
    bias, scale = _cause("bias", nuisance=True), _cause("scale")
    on_held = [_step(0.0), _step(600.0, bias), _step(500.0, bias, scale)]
    assert held_gains(on_held) == [None, pytest.approx(0.05)]  # pyright: ignore
