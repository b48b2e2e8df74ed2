"""The extended model, simulated open loop on the records, leaves little but noise where a fault was hidden."""

from __future__ import annotations

import numpy as np
import pytest

import casid as cs
from casid.filtering.initial_state import fit_initial_state
from problems.systems.count import SYSTEMS
from problems.systems.system import Fault

FAULTS = {
    "an input operator": ("DC motor", Fault(kind="dead_zone", target="V", size=1.0)),
    "a lag of a reading, a state": ("Lotka-Volterra", Fault(kind="sensor_lag", target="pred", size=0.4)),
    "a late reading": ("two compartments", Fault(kind="sensor_delay", target="c2", size=0.7)),
    "a parameter of one record": (
        "Lotka-Volterra",
        Fault(kind="parameter_change", target="a", size=0.2, records=("m2",)),
    ),
    "a stuck reading": (
        "two compartments",
        Fault(kind="sensor_stuck", target="c2", size=1.0, records=("m2",), onset=20.0),
    ),
}


@pytest.mark.parametrize("case", FAULTS)
def test_it_follows_the_records(case: str) -> None:
    name, fault = FAULTS[case]
    system = SYSTEMS[name]
    records = system.fly(5, fault)
    found = cs.diagnose(system.model(), records, ports=system.ports(), library=system.library)
    assert [one.name for one in found.causes] == [fault.name]
    model = found.system.extended
    for record in records[:3]:
        flown = cs.simulate(model, record, fit_initial_state(model, model.ready(record)))
        for output, sigma in found.noise.items():
            off = (record[output] - flown.output(output))[record.t > 1.0]  # late readings begin before the record
            assert np.sqrt(np.nanmean(off**2)) < 1.25 * sigma
