"""scripts/justified_tests.py: what counts as a right cause of a loading that free derivatives imitate."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from problems.blind.case import Hidden
from scripts.justified_tests import told_by_values


@pytest.mark.parametrize(
    ("kind", "target", "records", "causes", "moved", "told"),
    [
        ("inertia", "Iyy", "m1 m2 m3 m4", [], ["Cm_q"], True),
        ("inertia", "Iyy", "m1 m2 m3 m4", [], ["Cl_p"], False),  # the moment of another axis
        ("inertia", "Iyy", "m1 m2", [], ["Cm_q"], False),  # records differ, so that it has a name
        ("inertia", "Iyy", "m1 m2 m3 m4", ["input_delay"], ["Cm_q"], False),  # a wrong name
        ("actuator_lag", "delta_e", "m1 m2 m3 m4", [], ["Cm_q"], False),  # derivatives do not imitate it
        ("cg_offset", "x", "m1 m2 m3 m4", [], ["Cm_alpha"], True),
    ],
)
def test_a_loading_of_all_records_is_told_by_the_values_of_its_rows(
    kind: str, target: str, records: str, causes: list[str], moved: list[str], told: bool
) -> None:
    hidden = Hidden(kind=kind, target=target, value=0.1, records=tuple(records.split()))
    found: Any = SimpleNamespace(causes=causes, to_dict=lambda: {"moved": [{"parameter": name} for name in moved]})
    assert told_by_values(hidden, found) is told
