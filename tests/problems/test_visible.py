"""What counts as a fault that shows. Truth: sums of squares and thresholds that are written here."""

from __future__ import annotations

import numpy as np

from casid.records.record import Record
from problems.faults.fault import DataFault, with_fault
from problems.faults.score import score_causes
from problems.faults.visible import as_it_shows, judged


def _record(name: str, swing: float) -> Record:
    """A channel with noise of 0.01, that swings or stays."""
    t = np.arange(0.0, 20.0, 0.04)
    noise = 0.01 * np.random.default_rng(1).standard_normal(len(t))
    return Record(name=name, t=t, channels={"alpha": swing * np.sin(t) + noise})


def test_a_reading_that_is_held_where_nothing_moves_does_not_show() -> None:
    """Held for 0.12 s a swing of 200 noises shows; a constant changes by the noise of three samples."""
    held = {name: ((6.0, 6.12),) for name in ("still", "swinging")}
    fault = DataFault(kind="data_dropout", target="alpha", records=("still", "swinging"), intervals=held)
    healthy = [_record("still", 0.0), _record("swinging", 2.0)]
    shows = as_it_shows(fault, healthy, with_fault(fault, healthy, seed=1), {})
    assert shows is not None and shows.records == ("swinging",)


def test_a_size_below_the_smallest_detectable_one_need_not_be_named() -> None:
    fault = DataFault(kind="sensor_misalignment", target="inertial", term="z", records=("still",), value=0.04)
    healthy = [_record("still", 0.0)]
    assert as_it_shows(fault, healthy, healthy, {"sensor_misalignment(inertial:z)": 0.3}) is None
    assert as_it_shows(fault, healthy, healthy, {"sensor_misalignment(inertial:z)": 0.02}) is fault
    assert score_causes(fault, (), (), "adequate", None) == "quiet"
    assert score_causes(fault, (), (), "adequate", fault) == "wrong"


def test_of_a_group_those_instruments_count_that_were_judged() -> None:
    assert judged(("V", "alpha", "beta"), ("longitudinal motion",)) == ("beta",)
