"""A run with the aircraft's own file as the model loses nothing when it is killed."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import pytest

from scripts import own_models


def test_a_run_goes_on_where_an_earlier_one_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    flown: list[tuple[str, int]] = []

    def row(of: str, case: str, seed: int, folder: Path) -> dict[str, Any]:
        if len(flown) in (3, 7):
            flown.append(("killed", 0))
            raise KeyboardInterrupt
        flown.append((case, seed))
        return {"of": of, "case": case, "seed": seed, "first": True, "imitated": False, "named": "adequate"}

    monkeypatch.setattr(own_models, "_row", row)
    words = ["own_models.py", "--cases", "clean-1", "mass", "--seed", "5", "--out", str(tmp_path)]
    monkeypatch.setattr(sys, "argv", words)
    for _ in range(2):
        with pytest.raises(KeyboardInterrupt):
            own_models.main()
    kept = [(row["case"], row["seed"]) for row in json.loads((tmp_path / "rows.json").read_text())]
    assert kept == [("clean-1", 5), ("mass", 5), ("clean-1", 6), ("mass", 6), ("clean-1", 7), ("mass", 7)]
