"""What one channel shows alone. Truth: the fault that was put into a motion whose every sample is known."""

from __future__ import annotations

import numpy as np
import pytest

from casid.records.channel_faults import channel_faults, not_moving, without_faults
from casid.records.channel_ranges import channel_table
from casid.records.record import Record

T = np.arange(1001) / 50.0
AT = np.arange(len(T))


def motion(noise: float = 0.002, quantum: float = 0.0, seed: int = 1) -> np.ndarray:
    """A damped oscillation of 0.1 rad after 4 s, with noise, in steps of a quantum."""
    rng = np.random.default_rng(seed)
    x = 0.1 * np.exp(-0.15 * (T - 4.0)) * np.sin(2.0 * (T - 4.0)) * (T > 4.0) + noise * rng.standard_normal(len(T))
    return np.round(x / quantum) * quantum if quantum else x


def record(values: np.ndarray, name: str = "beta", label: str = "m") -> Record:
    return Record(name=label, t=T, channels={"delta_r": motion(seed=5), name: values, "r": motion(seed=6)})


def found(values: np.ndarray, name: str = "beta") -> dict[str, np.ndarray]:
    return {fault.kind: fault.at for fault in channel_faults(record(values, name)) if fault.target == name}


HEALTHY = [(0.002, 0.0), (0.0, 0.0), (0.0005, 0.001), (0.0, 0.005), (0.002, 0.0002)]


@pytest.mark.parametrize(("noise", "quantum"), HEALTHY)
def test_a_healthy_channel_keeps_quiet(noise: float, quantum: float) -> None:
    """Whether it has noise or none, and fine or coarse steps, in which it rests for seconds."""
    channels = {name: motion(noise, quantum, seed) for seed, name in enumerate(("delta_r", "beta", "r"))}
    assert not channel_faults(Record(name="m", t=T, channels=channels))


def test_held_values_are_a_dropout_and_nothing_else() -> None:
    x, held = motion(), np.zeros(len(T), dtype=bool)
    for start in (220, 400, 700):
        held[start + 1 : start + 26] = True
    faults = found(x[np.maximum.accumulate(np.where(held, 0, AT))])
    assert set(faults) == {"data_dropout"}
    assert (faults["data_dropout"] == held).all()


@pytest.mark.parametrize("start", [300, 850])
def test_a_value_that_rests_to_the_end_is_stuck(start: int) -> None:
    x = motion()
    x[start:] = x[start]
    faults = found(x)
    assert set(faults) == {"data_stuck"}
    assert faults["data_stuck"][start + 1 :].all()


def test_rails_on_both_sides_are_clipping() -> None:
    x = np.clip(motion(), -0.05, 0.06)
    faults = found(x)
    assert set(faults) == {"data_clipped"}
    assert (faults["data_clipped"] == ((x == -0.05) | (x == 0.06))).all()


@pytest.mark.parametrize("size", [0.08, -999.0, 9999.0])
def test_isolated_outliers_and_codes_are_found_exactly(size: float) -> None:
    x, at = motion(), np.zeros(len(T), dtype=bool)
    at[[40, 333, 512, 777, 900]] = True
    x[at] = x[at] + size if abs(size) < 1.0 else size
    faults = found(x, "ay")
    assert set(faults) == {"data_spikes"}
    assert (faults["data_spikes"] == at).all()


def test_a_staircase_of_a_slower_recorder_is_no_fault() -> None:
    """1 Hz beside 50 Hz."""
    assert not found(motion()[AT // 50 * 50])
    row = next(row for row in channel_table([record(motion()[AT // 50 * 50])]) if row.name == "beta")
    assert row.rate_hz == pytest.approx(1.0)


def test_surfaces_may_rest_and_outliers_in_them_are_interpolated() -> None:
    x = np.where((T > 5.0) & (T < 8.0), 0.05, 0.0)
    x[700] = 0.3
    whole = Record(name="m", t=T, channels={"delta_e": x, "q": motion()})
    faults = channel_faults(whole)
    assert [(fault.kind, fault.target) for fault in faults] == [("data_spikes", "delta_e")]
    assert without_faults(whole, faults)["delta_e"][700] == 0.0


def test_outputs_that_are_not_to_be_believed_become_missing() -> None:
    x = motion()
    x[333] = -999.0
    whole = record(x, "ay")
    mended = without_faults(whole, channel_faults(whole))
    assert np.flatnonzero(np.isnan(mended["ay"])).tolist() == [333]


def test_a_channel_that_rests_in_one_record_of_several_is_stuck_there() -> None:
    frozen, healthy = record(np.full(len(T), 0.01), label="m1"), record(motion(), label="m2")
    assert [(f.kind, f.target, f.record) for f in not_moving([frozen, healthy])] == [("data_stuck", "beta", "m1")]
    assert not not_moving([frozen])  # one record alone may not have measured it


def test_an_angle_of_zero_beside_motion_was_not_measured() -> None:
    still = record(np.zeros(len(T)), label="m1")
    assert [(f.kind, f.target) for f in not_moving([still])] == [("data_stuck", "beta")]
    rests = Record(name="m", t=T, channels={"delta_r": motion(seed=5), "beta": np.zeros(len(T)), "r": np.zeros(len(T))})
    assert not not_moving([rests])  # a simulation of the other axis


def test_what_is_commanded_and_what_nobody_knows_may_rest_jump_and_saturate() -> None:
    """A motor that stops, a throttle at its stop, a mode that is a number: what was commanded is known exactly."""
    x = np.clip(motion(), -0.5, 0.4)
    x[300:600] = 0.0
    x[800] = 5.0
    named = {name: x for name in ("m1", "throttle", "delta_e_command", "mode", "output_3")}
    assert not channel_faults(Record(name="log", t=T, channels={"q": motion(seed=8), **named}))
    assert channel_faults(record(x, "ay"))


def test_the_table_is_in_degrees() -> None:
    row = next(row for row in channel_table([record(np.radians(np.linspace(-2.0, 3.0, len(T))))]) if row.name == "beta")
    assert (row.unit, row.least, row.median, row.most) == (
        "deg",
        pytest.approx(-2.0),
        pytest.approx(0.5),
        pytest.approx(3.0),
    )


@pytest.mark.parametrize("pause", [3.0, 6.0, 12.0])
def test_a_rate_gyro_at_its_rail_in_short_bursts_is_clipped(pause: float) -> None:
    """Rolls of 0.5 s one way and the other at up to 3.5 rad/s, between pauses, by a gyro that ends at 2 rad/s (114.59
    deg/s): 23 samples in a row. What moves little for most of the time made them look like held values."""
    t = np.arange(1500) / 50.0
    roll = np.zeros(len(t))
    for start in np.arange(1.0, t[-1] - 2.0, pause):
        for begin, sign in ((start, 1.0), (start + 0.6, -1.0)):
            answer = [np.where(t >= at, -np.expm1(-np.maximum(t - at, 0.0) / 0.08), 0.0) for at in (begin, begin + 0.5)]
            roll += sign * 3.5 * (answer[0] - answer[1])
    roll += 0.01 * np.random.default_rng(1).standard_normal(len(t))
    p = np.clip(roll, -2.0, 2.0)
    flown = Record(name="m", t=t, channels={"delta_a": 0.02 * np.sin(t), "p": p})
    (fault,) = (one for one in channel_faults(flown) if one.target == "p")
    assert fault.kind == "data_clipped" and (fault.at == (np.abs(p) == 2.0)).all()


def test_what_answers_a_surface_by_the_file_is_no_outlier() -> None:
    """One sample of az that an elevator moved from -6 to +4 deg makes at once, known to within a third."""
    az = motion(0.02)
    jump = np.zeros(len(T))
    jump[500] = 0.8
    flown = record(az + jump, "az")
    (alone,) = channel_faults(flown)
    assert alone.kind == "data_spikes" and alone.at[500]
    for part in (0.7, 1.0, 1.3):
        assert not channel_faults(flown, answers={"az": part * jump})
    assert channel_faults(flown, answers={"az": -jump})


@pytest.mark.parametrize("every", [0, 5, 10])
def test_an_attitude_that_a_filter_corrects_in_steps(every: int) -> None:
    """Pitch integrated from a gyro that drifts, and set back to the truth every n-th sample, with noise; without such
    corrections, and where the recorder is slower, nothing is wrong."""
    rng = np.random.default_rng(3)
    t = np.arange(1000) / 50.0
    truth = 0.1 * np.sin(0.8 * t) + 0.04 * np.sin(3.0 * t)
    since = np.arange(len(t)) % every if every else np.zeros(len(t), dtype=int)
    drift = 3e-4 * np.repeat(rng.standard_normal(len(t)), every or 1)[: len(t)] * since
    theta = truth + drift + 2e-5 * rng.standard_normal(len(t))
    found = [(one.kind, one.target) for one in channel_faults(Record(name="m1", t=t, channels={"theta": theta}))]
    assert found == ([("data_steps", "theta")] if every else [])
    slower = Record(name="m1", t=t, channels={"theta": np.repeat(truth[::5] + 1e-4 * rng.standard_normal(200), 5)})
    assert not [one for one in channel_faults(slower) if one.kind == "data_steps"]


@pytest.mark.parametrize("code", [-999.0, 9999.0])
def test_codes_are_found_at_the_ends_beside_gaps_and_in_runs(code: float) -> None:
    """Truth: the samples that were replaced. A code has an edge on both sides that exist; what climbs there is none."""
    for places in ([0], [len(T) - 1], [0, 1, 2], [400, 401, 402, 403], [250, 700]):
        x, at = motion(), np.zeros(len(T), dtype=bool)
        at[places] = True
        x[at] = code
        assert (found(x, "ay")["data_spikes"] == at).all(), places
    x, at = motion(), np.zeros(len(T), dtype=bool)
    x[499:503], at[500:502] = [np.nan, code, code, np.nan], True
    assert (found(x, "ay")["data_spikes"] == at).all()


@pytest.mark.parametrize("lost", [0, 100, 700])
def test_the_table_has_the_part_of_the_samples_that_is_missing(lost: int) -> None:
    """What is missing in one record is missing in the same part of two alike."""
    gone = record(np.where(lost > AT, np.nan, motion()))
    for records in ([gone], [gone, gone]):
        row = next(row for row in channel_table(records) if row.name == "beta")
        assert row.missing == pytest.approx(lost / len(T)) and row.records == len(records)
