"""Tracked derivatives against the batch, weighted least squares written out, and changes in flight."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from estimation_cases import START, TRUTH, exact, matrices, short_period
from frequency_cases import BAND, T, flown, noisy, smooth_input

import casid as cs
from casid.errors import EstimationError, InputError
from casid.model.system import define_regression

MODEL = short_period(START)
OMEGA = np.arange(0.3, 12.0, 0.3)
MEASURED = {"alphadot": 0.01, "qdot": 0.02}


def last(record: cs.Record, **options) -> cs.TrackedDerivatives:
    return list(cs.track_derivatives(MODEL, record, **({"free": ["*"], "omega": OMEGA} | options)))[-1]


@pytest.mark.parametrize("recorded", [True, False], ids=["derivatives recorded", "by j omega"])
def test_its_end_is_the_batch(recorded: bool) -> None:
    """Without forgetting, at the frequencies of the batch: the same sums, the same estimates to rounding."""
    record = noisy(flown(), MEASURED, np.random.default_rng(3))
    record = record if recorded else record.without("alphadot", "qdot")
    batch = cs.solve(cs.Problem(MODEL, [record], free=["*"], cost=cs.FourierEquationError(band=BAND)))
    step = 2.0 * np.pi / (len(T) * record.dt)
    bins = step * np.arange(np.ceil(BAND[0] / step), np.floor(BAND[1] / step) + 1)
    end = last(record, omega=bins)
    assert end.t == T[-1]
    assert end.values == pytest.approx(batch.values, rel=1e-9)
    # the batch divides by degrees of freedom that equations share evenly, here each has its own
    assert [end.std[n] / batch[n].std for n in batch.values] == pytest.approx(np.ones(5), abs=0.02)


def test_with_forgetting_it_is_weighted_least_squares_written_out() -> None:
    record, memory = noisy(flown(), MEASURED, np.random.default_rng(4)), 6.0
    for now in cs.track_derivatives(MODEL, record, free=["M*"], omega=OMEGA, memory=memory, every=5.0):
        seen = record.between(0.0, now.t + 0.01)
        kernel = np.exp(-1j * np.outer(OMEGA, seen.t) - (now.t - seen.t) / memory)
        rows = np.concatenate([np.real(kernel), np.imag(kernel)])
        x = rows @ np.column_stack([seen.matrix(["alpha", "q", "delta_e"]), np.ones(len(seen))])
        gain = np.linalg.pinv(x)
        residual = rows @ seen["qdot"] - x @ (gain @ (rows @ seen["qdot"]))
        noise = rows @ rows.T
        variance = residual @ residual / np.trace((np.eye(len(x)) - x @ gain) @ noise)
        covariance = variance * gain @ noise @ gain.T
        assert list(now.values.values()) == pytest.approx((gain @ (rows @ seen["qdot"]))[:3], rel=1e-8)
        assert list(now.std.values()) == pytest.approx(np.sqrt(np.diagonal(covariance))[:3], rel=1e-6)


def test_an_exact_motion_is_found_by_j_omega_at_any_time_with_forgetting() -> None:
    """Straight lines of the input between samples are all that j omega does not know."""
    record = flown().without("alphadot", "qdot")
    found = list(cs.track_derivatives(MODEL, record, free=["*"], omega=OMEGA, memory=5.0))
    assert len(found) == 20
    for now in found[4:]:
        assert now.values == pytest.approx(TRUTH, rel=3e-3)


def test_a_change_in_flight_is_followed() -> None:
    """The elevator loses half of its effect at 20 s; 25 s later nothing is left of what was before."""
    t, memory = np.arange(0.0, 45.0, 0.02), 4.0
    u = smooth_input(t)
    before, after = t < 20.0, t >= 20.0
    broken = TRUTH | {"Mde": 0.5 * TRUTH["Mde"]}
    x, slopes = np.zeros((len(t), 2)), np.zeros((len(t), 2))
    for part, values in ((before, TRUTH), (after, broken)):
        a, b = matrices(values)
        begin = np.zeros(2) if values is TRUTH else x[before][-1]
        x[part] = exact(a, b, t[part], u[part, None], begin, "linear")
        slopes[part] = x[part] @ a.T + u[part, None] * b[:, 0]
    record = cs.Record(name="m", t=t, channels={"delta_e": u, "alpha": x[:, 0], "q": x[:, 1], "qdot": slopes[:, 1]})
    record = noisy(record.with_channels(alphadot=slopes[:, 0]), MEASURED, np.random.default_rng(5))
    found = list(cs.track_derivatives(MODEL, record, free=["M*"], omega=OMEGA, memory=memory))
    by_time = {round(now.t): now for now in found}
    assert by_time[19].values["Mde"] == pytest.approx(-6.0, abs=4.0 * by_time[19].std["Mde"])
    assert by_time[44].values["Mde"] == pytest.approx(-3.0, abs=4.0 * by_time[44].std["Mde"])
    assert by_time[44].std["Mde"] < 0.2
    everything = last(record, free=["M*"])
    assert abs(everything.values["Mde"] + 3.0) > 5.0 * by_time[44].std["Mde"]


def test_estimates_come_while_the_samples_do() -> None:
    record, taken = noisy(flown(), MEASURED, np.random.default_rng(6)), []

    def stream() -> Iterator[dict[str, float]]:
        for k in range(len(record)):
            taken.append(k)
            yield {"t": record.t[k], **{name: values[k] for name, values in record.channels.items()}}

    first = next(cs.track_derivatives(MODEL, stream(), free=["*"], omega=OMEGA, every=2.0))
    assert first.t == pytest.approx(2.0)
    assert len(taken) == 101


def test_constants_and_missing_samples_change_nothing_of_an_exact_motion() -> None:
    record = flown()
    missing = record["alpha"].copy()
    missing[200:230] = np.nan
    shifted = record.with_channels(alpha=missing + 0.1, qdot=record["qdot"] - 0.7, alphadot=record["alphadot"] + 2.0)
    assert last(shifted, memory=7.0).values == pytest.approx(TRUTH, rel=1e-8)
    with pytest.raises(InputError, match="t = 4 s"):
        last(shifted.without("alphadot", "qdot"))


def test_what_cannot_be_tracked_is_an_error() -> None:
    square = define_regression(
        "square",
        inputs=("alpha",),
        parameters={"a": 1.0, "b": 0.5},
        outputs=("q",),
        output=lambda s: {"q": s.b + s.a**2 * s.alpha},
    )
    record = flown()
    with pytest.raises(EstimationError, match="not linear in 'a'"):
        cs.track_derivatives(square, record, free=["a"], omega=OMEGA)
    with pytest.raises(EstimationError, match=r"fixed=\{'b': 0.5\}"):
        cs.track_derivatives(square, record, free=["b"], omega=OMEGA)
    with pytest.raises(InputError, match="omega"):
        cs.track_derivatives(MODEL, record, free=["*"], omega=[1.0])
    with pytest.raises(InputError, match="memory"):
        cs.track_derivatives(MODEL, record, free=["*"], omega=OMEGA, memory=-1.0)
    with pytest.raises(InputError, match="'delta_e'"):
        last(record.without("delta_e"))
    samples = [
        dict(zip(("t", *record.channels), row, strict=True)) for row in zip(T, *record.channels.values(), strict=True)
    ]
    thinned = [{k: v for k, v in s.items() if k not in ("alphadot", "qdot")} for s in samples[:300] + samples[300::3]]
    with pytest.raises(InputError, match="alphadot"):
        list(cs.track_derivatives(MODEL, thinned, free=["*"], omega=OMEGA))


@pytest.mark.slow
def test_intervals_hold_the_truth_at_all_times() -> None:
    """300 runs with forgetting, at four times each; frequencies are nearer than the memory resolves."""
    t = np.arange(0.0, 12.0, 0.05)
    clean, rng, hits = flown(t=t), np.random.default_rng(8), []
    for _ in range(300):
        record = noisy(clean, MEASURED, rng)
        for now in cs.track_derivatives(MODEL, record, free=["*"], omega=OMEGA, memory=4.0, every=3.0):
            hits.append([abs(now.values[n] - v) < 1.96 * now.std[n] for n, v in TRUTH.items()])
    assert 0.93 < np.mean(hits) < 0.97
