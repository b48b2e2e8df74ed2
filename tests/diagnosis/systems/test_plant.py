"""A subject in the aircraft's engine. Truth: faults that simulators of their own hide in five systems."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from casid.criterion import in_time
from casid.diagnosis.criteria import Criteria
from casid.diagnosis.evidence.evidence import weigh
from casid.diagnosis.evidence.missing_input import missing_inputs
from casid.diagnosis.evidence.screening import screen
from casid.diagnosis.flight.fit import fit
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.flight.ported import first_fit, ported
from casid.diagnosis.flight.subject import Subject
from problems.systems.count import SYSTEMS
from problems.systems.system import Fault

HIDDEN = {
    "quadruple tank": Fault(kind="missing_term", target="h3", term="sqrt(h3)", size=-0.04),
    "DC motor": Fault(kind="backlash", target="V", size=0.7),
    "pendulum on a cart": Fault(kind="sensor_lag", target="x", size=0.08),
    "two compartments": Fault(kind="sensor_bias", target="c1", size=0.6),
    "Lotka-Volterra": Fault(kind="sensor_delay", target="pred", size=0.4),
}


def subject_with(name: str, fault: Fault | None, seed: int = 11) -> Subject:
    system = SYSTEMS[name]
    return ported(system.model(), system.fly(seed, fault)[:3], system.ports(), system.library, Criteria())[0]


@pytest.mark.parametrize("name", HIDDEN)
def test_a_hidden_cause_is_ranked_first_and_fitted_to_its_size(name: str) -> None:
    """Or second: a lag and a delay resemble each other until they are fitted."""
    fault = HIDDEN[name]
    subject = subject_with(name, fault)
    refitted = first_fit(subject)
    first = [one for one in screen(weigh(refitted), subject.effects)[:2] if one.name == fault.name]
    assert first
    fitted = fit(subject, [first[0].attached], subject.noise(), refitted, extent=(25, 0.5))
    assert fitted.converged
    assert np.sum(fitted.white**2) < 1.1 * fitted.readings  # nothing but noise is left
    assert abs(fitted.attached[0].values["value"] - fault.size) < 0.05 * abs(fault.size)


def test_a_stuck_reading_tells_nothing_of_the_motion_from_its_onset_on() -> None:
    """The sensitivities of the reading to the state are zero there, so that its noise does not move the fit."""
    subject = subject_with(
        "Lotka-Volterra", Fault(kind="sensor_stuck", target="prey", size=1.0, records=("m2",), onset=12.0)
    )
    (effect,) = [one for one in subject.effects if one.name == "sensor_stuck(prey)"]
    one = Attached(effect=effect, values={"value": 1.0}, onsets={"m2": 12.0})
    fitted = fit(subject, [one], subject.noise(), first_fit(subject), extent=(25, 0.5))
    assert fitted.attached[0].values["value"] == pytest.approx(1.0, abs=0.02)
    after = fitted.batch.t[:, 1] > 12.1
    whole = np.abs(fitted.linear.C[:, 0, fitted.model.outputs.index("prey")]).max()
    assert np.abs(fitted.linear.C[after, 1, fitted.model.outputs.index("prey")]).max() < 0.03 * whole


def test_what_no_cause_describes_is_missing_where_it_enters() -> None:
    """A voltage that wanders by itself. It moves the current alone, so that the equation of that gains as much."""
    system, records = SYSTEMS["DC motor"], []
    for k, record in enumerate(system.fly(3, None)[:3]):
        rng = np.random.default_rng([3, k])
        wander = np.interp(record.t, np.arange(0.0, 9.0, 0.5), 0.4 * rng.standard_normal(18))
        records.append(record.with_channels(V=record["V"] - wander))
    subject = ported(system.model(), records, system.ports(), system.library, Criteria())[0]
    gains = {one.station: one.gain for one in missing_inputs(weigh(first_fit(subject)))}
    assert max(gains, key=lambda name: gains[name]) in ("d_V", "f_i")
    assert gains["d_V"] == pytest.approx(gains["f_i"], rel=1e-3)
    assert gains["d_V"] > 2.0 * gains["f_omega"]


def test_a_bias_is_sized_by_what_matters_at_its_port() -> None:
    """A port says that 0.02 matters: 0.1 is five times that."""
    subject = subject_with("pendulum on a cart", None)
    (effect,) = [one for one in subject.effects if one.name == "sensor_bias(x)"]
    assert subject.sizes.share_of(first_fit(subject), Attached(effect=effect, values={"value": 0.1})) == pytest.approx(
        5.0
    )


def test_times_of_criteria_are_as_long_as_the_records() -> None:
    """Numbers in seconds grow with the unit of time, all others stay."""
    before, after = ({row.name: row for row in one.rows} for one in (Criteria(), in_time(Criteria(), 10.0)))
    moved = {name for name, row in before.items() if row.value != after[name].value}
    assert moved == {name for name, row in before.items() if row.unit == "s"}
    assert np.allclose(after["numerics.events.step"].value, 10.0 * np.asarray(before["numerics.events.step"].value))


def test_a_system_in_hours_is_the_system_in_seconds() -> None:
    """The unit of time is a matter of taste: the ranking and its gains are the same."""
    system, fault = SYSTEMS["two compartments"], HIDDEN["two compartments"]
    records = system.fly(11, fault)[:3]
    plain = ported(system.model(), records, system.ports(), system.library, Criteria())[0]
    model, hour = system.model(), 3600.0
    slow = replace(model, f=model.f / hour)
    later = [replace(record, t=record.t * hour) for record in records]
    scaled = ported(slow, later, system.ports(), system.library, Criteria())[0]
    one, other = (screen(weigh(first_fit(subject)), subject.effects)[0] for subject in (plain, scaled))
    assert one.name == other.name
    assert one.statistic == pytest.approx(other.statistic, rel=1e-3)
