"""A file without a derivative is one that has it at zero. Truth: the value with which the records were flown."""

from __future__ import annotations

from dataclasses import replace

import pytest
from diagnosis_flights import flights

import casid as cs
from casid.model.usual_derivatives import missing_derivatives
from problems.do328 import do328

LEFT_OUT = ("Cm_alpha", "Cm_q", "Cl_p", "Cn_r")


def without(*names: str) -> cs.Aircraft:
    own = {name: value for name, value in do328().derivatives.items() if name not in names}
    return replace(do328(), derivatives=own)


@pytest.mark.slow
def test_what_the_file_lacks_is_estimated_and_told() -> None:
    """The static stability and three dampings are missing; no surface is reversed for it, and no cause invented."""
    records = flights(seed=11, count=4)
    found = cs.diagnose(without(*LEFT_OUT), records)
    assert found.verdict == "values wrong" and not found.causes
    told = {one.parameter: one for one in found.contradicted}
    truth = do328().derivatives
    for name in LEFT_OUT:
        one = found.flight[name]
        assert abs(one.value - truth[name]) < max(4.0 * one.std, 0.05 * abs(truth[name]))
        if abs(one.value) > 5.0 * one.std:
            assert told[name].given == 0.0
    assert {"Cl_p", "Cn_r", "Cm_alpha"} <= set(told)
    assert not any(one.reversed for one in found.contradicted)
    assert set(LEFT_OUT) <= set(found.extended_aircraft.derivatives)


def test_a_table_may_have_what_the_derivatives_lack() -> None:
    assert set(LEFT_OUT) <= set(missing_derivatives(without(*LEFT_OUT)))
    assert not {name for name in missing_derivatives(do328()) if name in do328().derivatives}
    own = replace(without(*LEFT_OUT), aerodynamics=lambda s: {})
    assert missing_derivatives(own) == {}
