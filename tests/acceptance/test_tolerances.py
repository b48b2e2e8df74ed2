"""Tolerance tables. Truth: the printed table A2A, and files with one fault each."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import casid as cs
from casid.errors import InputError

KNOT, FOOT, DEG, G = 1852.0 / 3600.0, 0.3048, np.pi / 180.0, 9.80665

# 14 CFR Part 60 (1-1-14 edition), appendix A, table A2A, pages 53 to 58: test, row -> (absolute SI, relative)
PRINTED = {
    ("2.b.4", "q"): (0.15 * DEG, 0.20),
    ("2.b.5", "p"): (0.15 * DEG, 0.20),
    ("2.b.6", "r"): (0.15 * DEG, 0.20),
    **{(test, "calibrated_airspeed"): (3.0 * KNOT, None) for test in ("2.c.1", "2.c.2", "2.c.3", "2.c.4")},
    **{(test, "altitude"): (100.0 * FOOT, None) for test in ("2.c.1", "2.c.2", "2.c.3", "2.c.4")},
    **{(test, "theta"): (1.5 * DEG, 0.20) for test in ("2.c.1", "2.c.2", "2.c.3", "2.c.4")},
    ("2.c.9", "period of theta"): (None, 0.10),
    ("2.c.9", "time_to_half of theta"): (None, 0.10),
    ("2.c.9", "damping of theta"): (0.02, None),
    ("2.c.10", "theta"): (1.5 * DEG, None),
    ("2.c.10", "q"): (2.0 * DEG, None),
    ("2.c.10", "az"): (0.10 * G, None),
    ("2.d.2", "p"): (2.0 * DEG, 0.10),
    ("2.d.4", "phi"): (2.0 * DEG, 0.10),
    ("2.d.6", "r"): (2.0 * DEG, 0.10),
    ("2.d.7", "period of beta"): (0.5, 0.10),
    ("2.d.7", "time_to_half of beta"): (None, 0.10),
    ("2.d.7", "damping of beta"): (0.02, None),
    ("2.d.7", "time_between_peaks of phi and beta"): (1.0, 0.20),
}


def test_part_60_is_as_it_is_printed() -> None:
    tests = cs.Standard.read("part60").tests
    rows = {(test.id, row.name): row for test in tests.values() for row in test.tolerances}
    assert set(rows) == set(PRINTED)
    for key, (absolute, relative) in PRINTED.items():
        assert rows[key].absolute == (None if absolute is None else pytest.approx(absolute, rel=1e-12))
        assert rows[key].relative == relative
    assert all(test.id in test.paragraph and "page" in test.paragraph for test in tests.values())
    assert {rows["2.c.10", name].either for name in ("theta", "q")} == {"pitch"}
    assert rows["2.c.10", "az"].either is None


def test_the_less_restrictive_of_two_holds() -> None:
    """Truth: 10 % of 30 deg/s is 3 deg/s, of 5 deg/s less than 2 deg/s."""
    (row,) = cs.Standard.read("part60").tests["2.d.2"].tolerances
    limit = row.limit(np.radians([-30.0, 5.0]), np.radians(30.0))
    assert np.allclose(np.degrees(limit), [3.0, 2.0])


OWN = """
[standard]
name = "House rules"
edition = "2"
source = "desk"

[[test]]
id = "T1"
title = "Pull-up"
manoeuvre = "elevator input"
paragraph = "4.2"
[[test.tolerance]]
channel = "alpha"
absolute = 0.5
unit = "deg"
"""

FAULTS = [
    ('paragraph = "4.2"', "", "paragraph"),
    ('channel = "alpha"', 'channel = "alpa"', "alpha"),
    ('unit = "deg"', 'unit = "kt"', "kt"),
    ('unit = "deg"', "", "unit"),
    ("absolute = 0.5", "", "relative"),
    ("absolute = 0.5", "absolute = -0.5", "positive"),
    ("absolute = 0.5", "absolut = 0.5", "absolute"),
    ('manoeuvre = "elevator input"', 'manoeuvre = "elevator inputs"', "elevator input"),
    ('edition = "2"', "", "edition"),
    ('channel = "alpha"', 'channel = "alpha"\nquantity = "perio"', "period"),
    ('channel = "alpha"', 'channel = "alpha"\nquantity = "time_between_peaks"', "reference"),
    ('channel = "alpha"', 'channel = "alpha"\nfrom_s = 3.0\nto_s = 2.0', "from_s"),
    ("[[test.tolerance]]", "[[test.tolerances]]", "tolerance"),
]


def test_a_table_of_ones_own(tmp_path: Path) -> None:
    (tmp_path / "own.toml").write_text(OWN)
    (row,) = cs.Standard.read(tmp_path / "own.toml").tests["T1"].tolerances
    assert row.absolute == pytest.approx(0.5 * DEG) and str(row) == "0.5 deg"


@pytest.mark.parametrize(("good", "bad", "named"), FAULTS)
def test_a_fault_of_a_table_is_named_in_one_line(tmp_path: Path, good: str, bad: str, named: str) -> None:
    assert good in OWN
    (tmp_path / "own.toml").write_text(OWN.replace(good, bad, 1))
    with pytest.raises(InputError) as caught:
        cs.Standard.read(tmp_path / "own.toml")
    assert named in str(caught.value) and "own.toml" in str(caught.value) and "\n" not in str(caught.value)


def test_an_unknown_table_is_named() -> None:
    with pytest.raises(InputError, match="part60"):
        cs.Standard.read("part6")
