"""scripts/systems.py: bad input is one line that says what was expected."""

from __future__ import annotations

import sys

import pytest

from casid.errors import InputError
from scripts import systems


@pytest.mark.parametrize(
    ("arguments", "says"),
    [(["--seeds", "1-3"], r"expected A\.\.B"), (["--systems", "DC moto"], "did you mean 'DC motor'")],
)
def test_bad_input_is_said(monkeypatch: pytest.MonkeyPatch, arguments: list[str], says: str) -> None:
    monkeypatch.setattr(
        sys, "argv", ["systems.py", *arguments, *(["--seeds", "1"] if "--systems" in arguments else [])]
    )
    with pytest.raises(InputError, match=says):
        systems.main()


def test_seeds_are_a_range_that_has_its_end() -> None:
    assert list(systems.seeds_of("3..5")) == [3, 4, 5]
    assert list(systems.seeds_of("7")) == [7]
