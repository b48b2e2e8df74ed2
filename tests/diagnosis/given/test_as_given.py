"""The file as it is given, flown through records as they are."""

from __future__ import annotations

import math

import numpy as np
import pytest
from diagnosis_flights import flights

from casid.diagnosis.flight.flight import prepare
from casid.diagnosis.given.as_given import fly_as_given
from casid.diagnosis.shown import simulated_of
from casid.keeping import plain
from problems.do328 import do328


@pytest.mark.parametrize("held", [0.0, 0.1])
def test_a_reading_that_never_changes_has_no_share_explained(held: float) -> None:
    """Truth: R2 divides by the variance, which is zero; r.m.s. and Theil's coefficient are what they are. (A bank
    angle that was frozen in the record held out ended the diagnosis in a ZeroDivisionError.)"""
    fitted, unseen = flights(seed=3, count=2, duration_s=8.0)
    unseen = unseen.with_channels(phi=np.full_like(unseen["phi"], held))
    _, view = fly_as_given(prepare(do328(), [fitted]), [unseen], ()).mended
    stuck = view.channels["phi"]
    assert math.isnan(stuck.R2)
    assert stuck.rms > 0.0
    assert 0.0 < stuck.theil <= 1.0
    assert plain(simulated_of(view))["channels"]["phi"]["R2"] is None
    assert view.channels["alpha"].R2 > 0.9
