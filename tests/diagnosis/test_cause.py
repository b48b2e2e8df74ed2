"""A cause in words. Truth: the titles of the kinds, as the report has them."""

from __future__ import annotations

from casid.diagnosis.cause import Cause


def test_what_it_cannot_be_told_from_is_told_by_titles() -> None:
    others = (
        {"kind": "aero_term", "target": "CL", "term": "alpha^2"},
        {"kind": "input_delay", "target": "delta_e", "term": None},
    )
    cause = Cause(
        kind="actuator_lag",
        target="delta_e",
        term=None,
        value=0.1,
        std=0.01,
        unit="s",
        records=("m1",),
        onset_s=None,
        statistic=100.0,
        dof=1,
        held_out_gain=0.1,
        indistinguishable_from=others,
        sentence="The elevator lags.",
        parameters={},
        meaningful=True,
        share=2.0,
    )
    told = "The elevator lags. These data cannot tell that apart from CL: alpha^2 or elevator: input delay."
    assert cause.statement == told
