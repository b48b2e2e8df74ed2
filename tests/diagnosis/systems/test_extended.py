"""The extended model, simulated open loop on its prepared records, leaves little but noise where a fault was hidden."""

from __future__ import annotations

import numpy as np
import pytest

import casid as cs
from casid.diagnosis.criteria import Criteria
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.systems.extended import Extended
from casid.diagnosis.systems.plant import plant_of
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
    model = found.system.extended.model
    for record in records[:3]:
        ready = found.system.extended.prepared(record)
        flown = cs.simulate(model, ready, fit_initial_state(model, ready))
        for output, sigma in found.noise.items():
            off = ready[output] - flown.output(output)
            assert np.sqrt(np.nanmean(off**2)) < 1.25 * sigma


@pytest.mark.parametrize("first", ["sensor_delay", "sensor_stuck"])
def test_a_reading_that_is_late_and_stands_still_is_the_true_one_up_to_its_onset(first: str) -> None:
    """Truth: y(t) = t. The instrument stands still from t = 10 on and its reading arrives 0.5 later, as the fit has it,
    in whichever order the two were found."""
    system = SYSTEMS["two compartments"]
    records = system.fly(5, None)[:1]
    effects = {
        one.name: one for one in plant_of(system.model(), records, system.ports(), system.library, Criteria()).effects
    }
    late = Attached(effect=effects["sensor_delay(c2)"], values={"value": 0.5})
    still = Attached(effect=effects["sensor_stuck(c2)"], values={"value": 1.0}, onsets={records[0].name: 10.0})
    read = records[0].with_channels(c2=np.minimum(records[0].t - 0.5, 10.0))
    attached = (late, still) if first == "sensor_delay" else (still, late)
    ready = Extended(base=system.model(), attached=attached, terms={}).prepared(read)["c2"]
    np.testing.assert_allclose(ready, np.where(read.t < 10.0, read.t, np.nan), atol=1e-12)
