"""Which causes held-out records bear out. Truth: the chain rule, on deviances of models written here."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import chain, combinations
from types import SimpleNamespace

import numpy as np
import pytest

from casid.diagnosis.criteria import Criteria
from casid.diagnosis.engine import held_out
from casid.diagnosis.engine.held_out import keep
from casid.errors import InputError

READINGS = 1000


def model(*names: str) -> SimpleNamespace:
    """A fitted model with these causes."""
    effects = {name: SimpleNamespace(key=name, timed=False) for name in names}
    attached = [SimpleNamespace(name=name, nuisance=False, effect=effect) for name, effect in effects.items()]
    return SimpleNamespace(attached=attached, readings=READINGS, noise=SimpleNamespace(coloured={}))


def kept(
    monkeypatch: pytest.MonkeyPatch,
    deviances: Mapping[tuple[str, ...], float],
    spare: Mapping[str, float],
    not_repeated: Sequence[str] = (),
) -> tuple[list[str], Mapping[str, float | None]]:
    """(causes that are kept, gains per reading) of a search that named those of `spare`, when held-out records have
    these deviances by set of causes."""
    table = {frozenset(names): value for names, value in deviances.items()}

    def names_of(fit: SimpleNamespace) -> list[str]:
        return [one.name for one in fit.attached]

    def predicted_on(held: object, known: SimpleNamespace) -> SimpleNamespace:
        names = names_of(known.fit)
        if not np.isfinite(table[frozenset(names)]):
            raise InputError("'Do 328' diverges along the records")
        return SimpleNamespace(
            fit=model(*(name for name in names if name not in not_repeated)),
            deviance=table[frozenset(names)],
            flown=True,
        )

    def without(fit: SimpleNamespace, names: set[str]) -> SimpleNamespace:
        return model(*(name for name in names_of(fit) if name not in names))

    monkeypatch.setattr(held_out, "predicted_on", predicted_on)
    monkeypatch.setattr(held_out, "without", without)
    monkeypatch.setattr(held_out, "weigh", lambda fit: SimpleNamespace(fit=fit))
    effect = SimpleNamespace(of_an_instrument=False, size=SimpleNamespace(stated=False))
    required = Criteria().significance.search
    rounds = [
        SimpleNamespace(
            leader=SimpleNamespace(
                candidate=SimpleNamespace(name=name),
                gain=SimpleNamespace(net=required + more),
                effect=effect,
                confirmed=False,
            )
        )
        for name, more in spare.items()
    ]
    baseline = SimpleNamespace(
        calm=model(), structured=model(), start=model(), structure=[], turbulence=SimpleNamespace(named=False)
    )
    final = model(*spare)
    state = SimpleNamespace(
        baseline=baseline,
        fit=final,
        evidence=SimpleNamespace(fit=final),
        standing=rounds,
        criteria=Criteria(),
    )
    found = keep([], state)  # pyright: ignore
    assert all(gate.passed == (name in names_of(found.fit)) for name, gate in found.gates.items())  # pyright: ignore
    return names_of(found.fit), found.gains  # pyright: ignore


@pytest.mark.parametrize(("loss", "names"), [(170.0, ["cause"]), (600.0, [])])
def test_what_a_cause_loses_is_taken_from_what_it_has_to_spare(monkeypatch, loss: float, names: list[str]) -> None:
    """A cause has 560 to spare on the fitted records; what it loses on the others is less, or more."""
    assert kept(monkeypatch, {(): 0.0, ("cause",): loss}, {"cause": 560.0})[0] == names


def test_a_wrong_cause_does_not_take_right_ones_with_it(monkeypatch) -> None:
    """A wrong term loses 280; beside it two causes gain 30 and 200."""
    deviances = {
        (): 0.0,
        ("term",): 280.0,
        ("vane",): -30.0,
        ("arm",): -180.0,
        ("term", "vane"): 250.0,
        ("term", "arm"): 80.0,
        ("vane", "arm"): -210.0,
        ("term", "vane", "arm"): 50.0,
    }
    assert kept(monkeypatch, deviances, {"term": 7.0, "vane": 5.0, "arm": 5.0})[0] == ["vane", "arm"]


def test_an_event_that_is_not_in_the_held_out_records_is_not_judged_there(monkeypatch) -> None:
    """Its gain is unknown, and it stays by what it gains on the fitted records."""
    deviances = {(): 0.0, ("event",): 40.0, ("scale",): -100.0, ("event", "scale"): -60.0}
    names, gains = kept(monkeypatch, deviances, {"event": 5.0, "scale": 5.0}, not_repeated=["event"])
    assert names == ["event", "scale"]
    assert gains == {"event": None, "scale": pytest.approx(0.05)}


@pytest.mark.parametrize("seed", range(30))
def test_a_model_that_cannot_be_flown_on_held_out_records_loses_against_all_others(monkeypatch, seed: int) -> None:
    """Truth: each of four causes adds its own gain, and models with some of them diverge on the held-out record: those
    that hold one of two bad causes, or both of them. What is kept flies, and lacks no more than it must."""
    rng = np.random.default_rng(seed)
    gains = dict(zip("abcd", rng.uniform(20.0, 500.0, 4), strict=True))
    bad = set(rng.choice(list(gains), rng.integers(1, 3), replace=False))
    together = bool(rng.integers(2))  # whether they diverge only together
    sets = list(chain.from_iterable(combinations(gains, k) for k in range(5)))

    def flies(names: Sequence[str]) -> bool:
        return not (bad <= set(names) if together else bad & set(names))

    deviances = {names: -sum(gains[n] for n in names) if flies(names) else np.inf for names in sets}
    names, told = kept(monkeypatch, deviances, dict.fromkeys(gains, 5.0))
    assert set(names) == set(gains) - ({max(bad)} if together else bad)  # of two, the one that was named later
    assert all(gain is None or np.isfinite(gain) for gain in told.values())


def test_a_file_that_cannot_be_flown_on_held_out_records_is_one_line(monkeypatch) -> None:
    with pytest.raises(InputError, match="diverges"):
        kept(monkeypatch, {(): np.inf, ("cause",): np.inf}, {"cause": 5.0})
