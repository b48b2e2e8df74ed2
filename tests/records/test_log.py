"""Series of several rates on one clock. Truth: how many samples were taken."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from casid.records.log import of_log


@pytest.mark.parametrize(("part", "complete"), [(0.95, True), (0.85, False)])
def test_nine_tenths_of_the_samples_are_the_rate_of_the_clock(part: float, complete: bool) -> None:
    """A channel that loses a sample now and then is joined; a slower one keeps its own samples and no others."""
    clock, slower = np.linspace(0.0, 10.0, 1001), np.linspace(0.0, 10.0, round(1001 * part))
    table = of_log(Path("m.ulg"), {"p": (clock, np.sin(clock)), "q": (slower, np.cos(slower))})
    q = table.values[:, [name.partition(" ")[0] for name in table.names or ()].index("q")]
    assert np.isfinite(q).sum() == (len(clock) if complete else len(slower))
