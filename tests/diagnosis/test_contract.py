"""The contract of what a diagnosis says, over random systems. Truth: numbers of the result, and the drawn truth."""

from __future__ import annotations

from collections.abc import Sequence

import pytest

from casid.diagnosis.diagnose import diagnose
from problems.blind.independent import aircraft_of, records_of
from problems.independent.effects import CASES
from problems.independent.flights import fly_set
from problems.random_systems.contract import broken, diagnosed, general, refuses_copies
from problems.random_systems.world import HELD_OUT, KINDS, TRUTHS, draw

_PER_TEST = 10
_QUICK = 60
_CAMPAIGN = 3000


@pytest.mark.parametrize("first", range(0, _QUICK, _PER_TEST))
def test_no_result_says_more_than_it_knows(first: int) -> None:
    assert not _broken(range(first, first + _PER_TEST))


@pytest.mark.slow
@pytest.mark.parametrize("first", range(_QUICK, _CAMPAIGN, 10 * _PER_TEST))
def test_no_result_of_a_campaign_says_more_than_it_knows(first: int) -> None:
    assert not _broken(range(first, first + 10 * _PER_TEST))


@pytest.mark.slow
@pytest.mark.parametrize("case", [case for case in CASES if case not in ("clean-2", "clean-3", "clean-4")][:12])
def test_no_result_of_an_aircraft_says_more_than_it_knows(case: str) -> None:
    """A dozen sets of a simulator that shares no code with casid."""
    given = fly_set(case, 4101)
    assert not general(diagnose(aircraft_of(given), list(records_of(given))))


def _broken(seeds: Sequence[int]) -> dict[int, list[str]]:
    """Seed -> the points that its result breaks."""
    found = {seed: broken(world, diagnosed(world)) for seed, world in zip(seeds, map(draw, seeds), strict=True)}
    return {seed: what for seed, what in found.items() if what}


@pytest.mark.parametrize("seed", range(3))
def test_a_copy_of_a_fitted_record_is_no_held_out_record(seed: int) -> None:
    assert not refuses_copies(draw(seed))


def test_the_world_is_drawn_from_all_structures() -> None:
    drawn = [draw(seed) for seed in range(60)]
    for names, of in ((KINDS, "kind"), (TRUTHS, "truth"), (HELD_OUT, "held_out")):
        assert {getattr(one, of) for one in drawn} == set(names)
