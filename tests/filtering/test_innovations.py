"""Truth: white innovations of the right model, dense Gaussian algebra, simulation differences, the true trajectory."""

from __future__ import annotations

import os
from dataclasses import replace

import numpy as np
import pytest
from estimation_cases import NOISE, TRUTH, flight, short_period
from filter_cases import DT, GUSTY, filtered, gusty_flight, gusty_short_period
from scipy.linalg import expm

from casid.filtering.innovations import (
    Linear,
    NoiseModel,
    ParameterFunctions,
    PointFunctions,
    inject,
    linearise,
    make_batch,
)
from casid.filtering.kalman import augmented, kalman_filter, residual_about, residual_column
from casid.filtering.kernel import filter_kernel
from casid.model.dynamics import aircraft_model
from casid.model.port import ports_of, with_ports
from casid.model.simulate import simulate
from casid.model.system import define_model
from casid.model.trim import trim
from casid.records.record import Record
from problems.do328 import do328


def autocorrelation(series: np.ndarray, lag: int) -> float:
    return float(series[lag:] @ series[:-lag] / (series @ series))


def test_innovations_of_the_right_model_are_white_with_unit_variance():
    """And those of a filter that knows nothing of the gust are not."""
    records = [gusty_flight(11), gusty_flight(12, "m2")]
    _, _, white = filtered(gusty_short_period(), records, GUSTY)
    count = white[20:].size
    assert np.mean(white[20:] ** 2) == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / count))
    for r in range(2):
        for i in range(2):
            series = white[20:, r, i]
            assert abs(series.mean()) < 4.0 / np.sqrt(len(series))
            for lag in (1, 2, 5, 25):
                assert abs(autocorrelation(series, lag)) < 4.0 / np.sqrt(len(series))
    _, _, coloured = filtered(gusty_short_period(), records, NoiseModel(measurement=NOISE))
    assert np.mean(coloured[20:] ** 2) > 2.0 and autocorrelation(coloured[20:, 0, 0], 1) > 0.5


def test_sensitivities_in_stretches_are_those_of_the_whole_record():
    """Whitened one stretch after the other, and along a direction, as from the matrices of all samples at once."""
    model, records = gusty_short_period(), [gusty_flight(11, samples=400), gusty_flight(12, "m2", samples=300)]
    batch, P = make_batch(model, records), np.tile(model.nominal_vector(), (2, 1))
    X = 0.01 * np.random.default_rng(3).standard_normal((400, 2, 2))
    W = 0.01 * np.random.default_rng(4).standard_normal((400, 2, len(model.disturbances)))
    linear = linearise(PointFunctions(model, model.parameters), batch, P, X, W)
    kalman, sensitive = kalman_filter(linear, GUSTY), ParameterFunctions(model, model.parameters)
    count = len(model.parameters)
    found = kalman.whiten_in_stretches(sensitive.in_stretches(batch, P, X, W), count)
    assert found == pytest.approx(kalman.whiten(linear.Dp, linear.Bp), rel=1e-9, abs=1e-9)
    direction = np.random.default_rng(5).standard_normal((2, count))
    for at, Dp, Bp in sensitive.in_stretches(batch, P, X, W, direction):
        assert Dp[..., 0] == pytest.approx(np.einsum("krip,rp->kri", linear.Dp[at], direction), abs=1e-12)
        whole = np.einsum("krip,rp->kri", linear.Bp[at], direction)
        assert Bp[..., 0] == pytest.approx(whole, abs=1e-12)


def test_likelihood_is_that_of_the_dense_gaussian():
    """Sum of squares and log determinant against the covariance of all samples together, built column by column."""
    record = gusty_flight(13, samples=60)
    model = gusty_short_period()
    linear, kalman, white = filtered(model, [record], GUSTY)
    N, nx = 60, 2
    A, B0, B1 = linear.A[:, 0], linear.Bw0[:, 0], linear.Bw1[:, 0]
    C, D = linear.C[:, 0], linear.Dw[:, 0]
    phi = np.exp(-DT / 0.5)
    system = (A, B0, B1, C, D, phi)
    # independent sources: initial state, initial gust, gust drive and pitch per step, each through the linear system
    sources = [np.r_[5.0 * s * np.eye(nx)[i], 0.0] for i, s in enumerate(model.scale_vector())]
    columns = [_respond(source, system, {}) for source in [*sources, np.r_[0.0, 0.0, 0.01]]]
    driven = 0.01 * np.sqrt(1.0 - phi**2)
    for k in range(N - 1):
        columns.append(_respond(np.zeros(3), system, {k: ("gust", driven)}))
        columns.append(_respond(np.zeros(3), system, {k: ("pitch", 0.2)}))
    F = np.stack([np.ravel(c) for c in columns], axis=1)
    covariance = F @ F.T + np.diag(np.tile([NOISE["alpha"] ** 2, NOISE["q"] ** 2], N))
    drift = np.zeros((N, nx))
    for k in range(N - 1):
        drift[k + 1] = A[k] @ drift[k] + linear.defect[k, 0]
    residual = (linear.residual[:, 0] - np.einsum("kij,kj->ki", C, drift)).ravel()
    expected = float(residual @ np.linalg.solve(covariance, residual)) + float(np.linalg.slogdet(covariance)[1])
    assert np.sum(white**2) + kalman.log_determinant.sum() == pytest.approx(expected, rel=1e-8)


def _respond(start, system, kick) -> np.ndarray:
    """(N, ny) outputs of [state; gust] from a start, with one kick of a source over one sample."""
    A, B0, B1, C, D, phi = system
    x, gust = start[:2].copy(), start[2]
    out = [C[0] @ x + D[0, :, 0] * gust]
    for k in range(len(A)):
        name, size = kick.get(k, ("", 0.0))
        after = phi * gust + (size if name == "gust" else 0.0)
        x = A[k] @ x + B0[k, :, 0] * gust + B1[k, :, 0] * after
        if name == "pitch":
            x = x + (B0[k, :, 1] + B1[k, :, 1]) * size
        gust = after
        out.append(C[k + 1] @ x + D[k + 1, :, 0] * gust)
    return np.array(out)


def test_without_process_noise_it_is_output_error():
    """Whitened parameter columns, with the initial state known: differences of simulated outputs over sigma."""
    model = short_period(
        disturbances=("unused",), state_scale={"alpha": 1e-7, "q": 1e-7}
    )  # prior of the initial state: practically fixed
    record = flight(t=0.005 * np.arange(400), x0=(0.0, 0.0))
    path = simulate(model, record, np.zeros(2))
    batch = make_batch(model, [record])
    functions = PointFunctions(model, model.parameters)
    linear = linearise(functions, batch, model.nominal_vector()[None], path.states[:, None])
    assert np.abs(linear.defect).max() < 1e-15
    columns = kalman_filter(linear, NoiseModel(measurement=NOISE)).whiten(linear.Dp, linear.Bp)[:, 0]
    sigma = np.array([NOISE[o] for o in model.outputs])
    for i, name in enumerate(model.parameters):
        step = 1e-5 * abs(TRUTH[name])
        sides = [simulate(model, record, np.zeros(2), {name: TRUTH[name] + s * step}).outputs for s in (1, -1)]
        expected = (sides[0] - sides[1]) / (2 * step) / sigma
        # step matrices are second-order in dt
        np.testing.assert_allclose(columns[..., i], expected, atol=2e-3 * np.abs(expected).max(), err_msg=name)


def test_disturbance_columns_are_differences_of_simulations():
    """The aircraft: a history at every station, as the filter sees it and as the simulator flies it."""
    aircraft = do328()
    level = trim(aircraft, V=144.0, thrust=10e3)
    t = 0.01 * np.arange(300)
    record = Record(name="m1", t=t, channels={n: np.full(len(t), v) for n, v in level.inputs.items()})
    model = aircraft_model(aircraft)
    path = simulate(model, record, level.state)
    batch = make_batch(model, [path.as_record()])
    linear = linearise(PointFunctions(model, ()), batch, model.nominal_vector()[None], path.states[:, None])
    tiny = {"d_thrust": 100.0, "wind_x": 0.1, "wind_y": 0.1, "wind_z": 0.1}
    shape = np.sin(2.0 * t) * np.minimum(t, 1.0)
    for i, station in enumerate(model.disturbances):
        size = tiny.get(station, 1e-3)
        Y, F = inject(linear, [i], (size * shape)[:, None, None])
        x = np.zeros(len(model.states))
        found = [linear.C[0, 0] @ x + Y[0, 0, :, 0]]
        for k in range(len(t) - 1):
            x = linear.A[k, 0] @ x + F[k, 0, :, 0]
            found.append(linear.C[k + 1, 0] @ x + Y[k + 1, 0, :, 0])
        sides = [simulate(model, record, level.state, disturbances={station: s * size * shape}) for s in (1.0, -1.0)]
        expected = (sides[0].outputs - sides[1].outputs) / 2.0
        scale = np.abs(expected).max(axis=0)
        error = np.abs(np.array(found) - expected).max(axis=0)
        # a channel that moves by rounding alone (lateral ones of a longitudinal station) is no reference
        assert (error <= 5e-3 * scale + 1e-9).all(), station


def test_smoothing_of_noise_free_data_gives_the_true_trajectory():
    """From a wrong nominal trajectory of a linear system, in one step."""
    record = flight(t=0.005 * np.arange(800))
    model = short_period(disturbances=("unused",))
    batch = make_batch(model, [record])
    truth = record.matrix(("alpha", "q"))
    wrong = truth + 0.02 * np.random.default_rng(14).standard_normal(truth.shape)
    linear = linearise(PointFunctions(model, ()), batch, model.nominal_vector()[None], wrong[:, None])
    smoothed = wrong + kalman_filter(linear, NoiseModel(measurement=NOISE)).smooth(*residual_column(linear))[0][:, 0]
    assert np.abs(wrong - truth).max() > 0.05
    assert np.abs(smoothed - truth).max() < 1e-5


def test_missing_samples_take_no_part():
    """A channel without any sample equals a model that does not have the channel; a gap is a gap."""
    record = gusty_flight(15, samples=300)
    hidden = record.with_channels(q=np.full(300, np.nan))
    _, kalman, white = filtered(gusty_short_period(), [hidden], GUSTY)
    # the first guess of q differs, its prior is the same: compare the filter, which looks at no data
    _, alone, _ = filtered(gusty_short_period(("alpha",)), [record], replace(GUSTY, measurement={"alpha": 0.002}))
    np.testing.assert_allclose(kalman.gain[1:, :, :, :1], alone.gain[1:], rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(kalman.log_determinant, alone.log_determinant, rtol=1e-9)
    assert not white[..., 1].any()
    gap = record["q"].copy()
    gap[100:120] = np.nan
    _, _, white = filtered(gusty_short_period(), [record.with_channels(q=gap)], GUSTY)
    assert not white[100:120, 0, 1].any() and white[120:, 0, 1].all()


def test_a_shorter_record_beside_a_longer_one_gives_its_own_innovations():
    model, whole, short = gusty_short_period(), gusty_flight(15, samples=300), gusty_flight(16, "m2", samples=200)
    _, _, alone = filtered(model, [short], GUSTY)
    _, kalman, together = filtered(model, [whole, short], GUSTY)
    np.testing.assert_allclose(together[:200, 1], alone[:, 0], rtol=1e-9, atol=1e-9)
    assert not together[200:, 1].any() and not kalman.log_determinant[200:, 1].any()


def test_compiled_recursions_equal_the_plain_ones_to_rounding() -> None:
    """Three records of unequal length, one with held inputs, missing samples, coloured and white disturbances."""
    records = [
        gusty_flight(1, "m1", 400),
        gusty_flight(2, "m2", 300),
        replace(gusty_flight(3, "m3", 350), hold="linear"),
    ]
    gappy = records[1]["q"].copy()
    gappy[[0, 7, 8, 120, 299]] = np.nan
    records[1] = records[1].with_channels(q=gappy)
    linear, fast, _ = filtered(gusty_short_period(), records, GUSTY)
    plain = kalman_filter(linear, GUSTY, plain=True)
    assert fast.kernel is not None and plain.kernel is None
    for name in ("gain", "inverse_root", "P", "log_determinant"):
        np.testing.assert_allclose(getattr(fast, name), getattr(plain, name), rtol=1e-9, atol=1e-12, err_msg=name)
    column, gusts = residual_column(linear), np.random.default_rng(4).standard_normal((400, 3, 37))
    stations, first = [0, 1] * 18 + [0], [0, 1, 4, 20, 21, 36]
    gusts[:150, :, 21:] = 0.0  # a tile of columns that begin later
    for got, expected in (
        (fast.whiten(*column), plain.whiten(*column)),
        (fast.whiten(linear.Dp, linear.Bp), plain.whiten(linear.Dp, linear.Bp)),
        (fast.whiten_histories(stations, gusts), plain.whiten_histories(stations, gusts)),
        (fast.whiten_histories(stations, gusts, first), plain.whiten_histories(stations, gusts, first)),
        (fast.smooth(*column)[0], plain.smooth(*column)[0]),
        *zip(
            *(
                one.entrances([1, 0], np.stack([gusts, gusts[..., ::-1]], axis=2).swapaxes(0, 1).copy())
                for one in (fast, plain)
            ),
            strict=True,
        ),
    ):
        np.testing.assert_allclose(got, expected, rtol=0, atol=1e-10 * np.abs(expected).max())


def test_the_number_of_processors_changes_no_digit(monkeypatch: pytest.MonkeyPatch) -> None:
    model, records = gusty_short_period(), [gusty_flight(seed, f"m{seed}", 200) for seed in (1, 2, 3)]
    batch = make_batch(model, records)
    X = np.random.default_rng(5).normal(0.0, 0.1, (200, 3, 2))
    series = np.random.default_rng(6).normal(size=(200, 3, 40))
    P = np.tile(model.nominal_vector(), (3, 1))
    found = []
    for threads in ("1", "2", "5"):
        monkeypatch.setenv("OMP_NUM_THREADS", threads)
        monkeypatch.setattr(os, "sched_getaffinity", lambda process: range(8), raising=False)
        linear = linearise(PointFunctions(model, model.parameters), batch, P, X)
        fitted = kalman_filter(linear, GUSTY)
        Y, F = residual_column(linear)
        found.append((linear.A, fitted.gain, fitted.whiten_histories([0] * 40, series), fitted.smooth(Y, F)[0]))
    for one, two, five in zip(*found, strict=True):
        np.testing.assert_array_equal(one, two)
        np.testing.assert_array_equal(one, five)


@pytest.mark.parametrize("jumps", [False, True])
def test_compiled_step_matrices_equal_the_plain_ones_to_rounding(jumps: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    records = [gusty_flight(1, "m1", 60), replace(gusty_flight(2, "m2", 40), hold="linear")]
    model, rng = gusty_short_period(), np.random.default_rng(5)
    batch, X, W = make_batch(model, records), rng.normal(0.0, 0.1, (60, 2, 2)), rng.normal(0.0, 0.1, (60, 2, 2))
    P, functions = np.tile(model.nominal_vector(), (2, 1)), PointFunctions(model, model.parameters)
    news = rng.normal(0.0, 0.1, (59, 2, 2)) if jumps else None
    ends = (X[1:] + 0.05, W[1:] - 0.05) if jumps else None

    def made() -> list[np.ndarray]:
        linear = linearise(functions, batch, P, X, W, news)
        stretches = functions.by_parameters(model.parameters).in_stretches(batch, P, X, W, ends=ends)
        sensitivities = (np.concatenate(parts) for parts in list(zip(*stretches, strict=True))[1:])
        return [getattr(linear, name) for name in ("A", "Bp", "Bw0", "Bw1", "C", "Dp", "Dw")] + list(sensitivities)

    compiled = made()
    monkeypatch.setattr("casid.filtering.innovations.filter_kernel", lambda *sizes: None)
    for i, (found, plain) in enumerate(zip(compiled, made(), strict=True)):
        np.testing.assert_allclose(found, plain, rtol=1e-12, atol=1e-15, err_msg=str(i))


@pytest.mark.parametrize("plain", [True, False])
def test_step_matrices_of_a_resonance_are_those_of_its_motion(plain: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Truth: the matrix exponential, of an undamped oscillator with nine samples per cycle, which must not grow."""
    monkeypatch.setattr("casid.filtering.innovations.filter_kernel", (lambda *sizes: None) if plain else filter_kernel)
    model = define_model(
        "swing",
        states=("x", "v"),
        inputs=("u",),
        parameters={"b": 1.0},
        outputs=("y",),
        dynamics=lambda s: {"x": s.v, "v": s.b * s.u - s.x},
        output=lambda s: {"y": s.x},
    )
    model = with_ports(model, [port for port in ports_of(model) if port.kind == "state derivative"])
    h = 2.0 * np.pi / 9.0
    record = Record(name="m1", t=h * np.arange(5), channels={"u": np.ones(5), "y": np.zeros(5)})
    batch = make_batch(model, [record])
    linear = linearise(PointFunctions(model, ("b",)), batch, np.ones((1, 1)), np.zeros((5, 1, 2)))
    J = np.array([[0.0, 1.0], [-1.0, 0.0]])
    assert linear.A[1, 0] == pytest.approx(expm(h * J), abs=2e-3)  # a step of fourth order: h^5 / 120
    assert np.abs(np.linalg.eigvals(linear.A[1, 0])).max() < 1.0
    constant = np.linalg.solve(J, expm(h * J) - np.eye(2))
    assert linear.Bp[1, 0, :, 0] == pytest.approx(constant[:, 1], abs=3e-3)
    assert linear.Bw0[1, 0] + linear.Bw1[1, 0] == pytest.approx(constant, abs=1e-2)  # third order


def test_histories_linearised_about_change_nothing_of_a_linear_model() -> None:
    """Deviance and smoothed motion are those of the posterior, which does not depend on where a linear model is
    linearised: about still air or about any history of gusts and states."""
    model, records = gusty_short_period(), [gusty_flight(1, "m1", 200), gusty_flight(2, "m2", 150)]
    records[1] = replace(records[1], hold="linear")
    batch = make_batch(model, records)
    functions = PointFunctions(model, model.parameters)
    P = np.tile(model.nominal_vector(), (2, 1))
    rng = np.random.default_rng(3)
    found = []
    for scale in (0.0, 1.0):
        X, gust = scale * rng.normal(0.0, 0.01, (200, 2, 2)), scale * rng.normal(0.0, 0.01, (200, 2, 1))
        W = np.concatenate([gust, np.zeros((200, 2, 1))], axis=2)
        linear = linearise(functions, batch, P, X, W)
        column = residual_about(linear, GUSTY, gust)
        kalman = kalman_filter(linear, GUSTY)
        moved = kalman.smooth(*column)[0][..., 0:3]
        plain = kalman_filter(linear, GUSTY, plain=True)
        np.testing.assert_allclose(plain.whiten(*column), kalman.whiten(*column), rtol=0, atol=1e-9)
        found.append((float(np.sum(kalman.whiten(*column) ** 2)), X + moved[..., :2], gust + moved[..., 2:]))
    (squares, X, gust), (squares_about, X_about, gust_about) = found
    # the step matrices are of second order in the step, the simulation of fourth
    assert squares_about == pytest.approx(squares, rel=1e-3)
    np.testing.assert_allclose(X_about[batch.live], X[batch.live], rtol=0, atol=2e-5)
    np.testing.assert_allclose(gust_about[batch.live], gust[batch.live], rtol=0, atol=2e-4)


def test_a_held_filter_predicts_as_the_other_model_does() -> None:
    """Truth: the predictor of the other model with this gain, sample by sample. What is left of the difference is of
    second order in the change, and the slopes along what is predicted are those of the errors: along the most likely
    motion, which contains later samples, they are others, and a fit of a derivative that the gust moves has no zero
    gradient at the truth. The determinant stays."""
    model, record = gusty_short_period(), replace(gusty_flight(1, samples=300), hold="linear")
    batch, functions = make_batch(model, [record]), PointFunctions(model, model.parameters)
    first, kalman, _ = filtered(model, [record], GUSTY)
    smooth = kalman.smooth(*residual_column(first))[0]
    X, gust, nominal = first.X + smooth[..., :2], smooth[..., 2:], model.nominal_vector()

    def along(P: np.ndarray, X: np.ndarray, gust: np.ndarray) -> Linear:
        W = np.concatenate([gust, np.zeros((300, 1, 1))], axis=2)
        return linearise(functions, batch, P[None], X, W)

    kalman = kalman_filter(along(nominal, X, gust), GUSTY)

    def of(P: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Errors of the held filter, and of the model's own predictor with its gain."""
        linear = along(P, X, gust)
        held = kalman.along(linear, GUSTY)
        np.testing.assert_array_equal(held.log_determinant, kalman.log_determinant)
        found, _ = held.predicted(*residual_about(linear, GUSTY, gust, through=held.through))
        A, C, *_ = augmented(linear, GUSTY)
        (Y, F, E), exact = residual_about(linear, GUSTY, gust), []
        for k in range(300):
            e = C[k] @ E + Y[k]
            exact.append((kalman.inverse_root[k] @ e)[..., 0])
            E = A[k] @ E - kalman.gain[k] @ e + F[k] if k < 299 else E
        return found, np.array(exact)

    white, moved = kalman.predicted(*residual_about(kalman.linear, GUSTY, gust))
    predicted = along(nominal, X + moved[..., :2], gust + moved[..., 2:])
    slopes, smoothed = (kalman.whiten(one.Dp, one.Bp) for one in (predicted, kalman.linear))
    for i, value in enumerate(nominal):
        change = value * np.eye(len(nominal))[i]
        apart = [np.abs(np.subtract(*of(nominal + part * change))).max() for part in (0.01, 0.02)]
        assert apart[1] < 4.2 * apart[0] + 1e-9, model.parameters[i]
        assert apart[1] < 0.1 * np.abs(of(nominal + 0.02 * change)[0] - white).max(), model.parameters[i]
        slope = (white - of(nominal + 1e-4 * change)[0]) / (1e-4 * value)
        off = [np.linalg.norm(one[..., i] - slope) / np.linalg.norm(slope) for one in (slopes, smoothed)]
        # the sensitivities are of second order in the step, the simulation of fourth
        assert off[0] < 0.05 and off[0] < 0.5 * off[1] + 0.01, model.parameters[i]
    by_errors = [abs(float(np.sum(white * one[..., 0]))) for one in (slopes, smoothed)]
    assert by_errors[1] > 2.0 * by_errors[0]


def test_a_held_filter_goes_through_the_model_that_it_is_of() -> None:
    """Nothing of a model with the same states is new to it; readings that the other lacks tell nothing."""
    linear, kalman, _ = filtered(gusty_short_period(), [gusty_flight(2, samples=200)], GUSTY)
    there = replace(linear, A=0.9 * linear.A)
    held = kalman.along(there, GUSTY)
    np.testing.assert_array_equal(held.A, augmented(held.through, GUSTY)[0])
    assert held.A is kalman.A and held.linear is there
    later = replace(there, seen=there.seen & (np.arange(200) > 3)[:, None, None])
    assert not kalman.along(later, GUSTY).C[:4].any() and kalman.C[:4].any()


@pytest.mark.parametrize("plain", [False, True])
def test_what_is_predicted_does_not_know_later_samples(plain: bool) -> None:
    """Other readings from sample 100 on: until then the same is predicted, and the most likely motion is another one.
    Outputs by what is predicted are off by the innovations."""
    linear, _, white = filtered(gusty_short_period(), [gusty_flight(2, samples=200)], GUSTY)
    kalman = kalman_filter(linear, GUSTY, plain=plain)
    other = linear.residual + np.where(np.arange(200) < 100, 0.0, 0.01)[:, None, None]
    found = [kalman.predicted(*residual_column(one)) for one in (linear, replace(linear, residual=other))]
    np.testing.assert_allclose(found[0][0], white, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(found[0][1][:101], found[1][1][:101])
    assert np.abs(found[0][1][101:] - found[1][1][101:]).max() > 1e-4
    later = [kalman.smooth(*residual_column(one))[0] for one in (linear, replace(linear, residual=other))]
    assert np.abs(later[0][:100] - later[1][:100]).max() > 1e-5
    off = linear.residual - np.einsum("krij,krj->kri", kalman.C, found[0][1])
    np.testing.assert_allclose(np.einsum("krij,krj->kri", kalman.inverse_root, off), white, rtol=0, atol=1e-9)


def test_a_held_filter_weighs_readings_at_other_times_as_its_model_does() -> None:
    """Truth: the filter of its own model with these readings, two samples earlier every fourth: gain, weights and
    determinant. With the gain that it had for others, a late reading that comes seldom would never be used."""
    model, record = gusty_short_period(), gusty_flight(2, samples=200)
    batch, functions = make_batch(model, [record]), PointFunctions(model, model.parameters)
    P, X, W = model.nominal_vector()[None], np.zeros((200, 1, 2)), np.zeros((200, 1, 2))

    def at(first: int, factor: float) -> Linear:
        seldom = np.where((np.arange(200) % 4 == first)[:, None, None], batch.Z, np.nan)
        return linearise(functions, replace(batch, Z=np.r_["2", seldom[..., :1], batch.Z[..., 1:]]), factor * P, X, W)

    held = kalman_filter(at(2, 1.0), GUSTY).along(at(0, 1.1), GUSTY)
    same = kalman_filter(at(0, 1.0), GUSTY)
    for name in ("gain", "inverse_root", "P", "log_determinant"):
        np.testing.assert_allclose(getattr(held, name), getattr(same, name), rtol=1e-9, atol=1e-12, err_msg=name)
    assert np.abs(held.gain[::4, :, :, 0]).max() > 0.0


def test_a_held_filter_takes_up_further_states_and_leaves_out_others() -> None:
    """The model that it is of: nothing changes. Without the gust as a state, and with it again: a state that the filter
    does not know is not moved by any sample, so that whitening an output differs only by what the gust told."""
    linear, kalman, white = filtered(gusty_short_period(), [gusty_flight(2, samples=200)], GUSTY)
    same = kalman.along(linear, GUSTY)
    np.testing.assert_allclose(same.whiten(*residual_column(linear))[..., 0], white, rtol=0, atol=1e-12)
    still = kalman.along(linear, replace(GUSTY, coloured={}))
    again = still.along(linear, GUSTY)
    assert (still.gain.shape[2], again.gain.shape[2]) == (2, 3)
    assert not again.gain[:, :, 2].any() and not again.P[:, :, 2].any()
    np.testing.assert_array_equal(again.gain[:, :, :2], kalman.gain[:, :, :2])


@pytest.mark.parametrize("plain", [False, True])
def test_the_transposed_filter_gives_the_products_of_whitened_histories(plain: bool) -> None:
    """Truth: the histories whitened one by one, and multiplied by the columns; also by what a colour leaves of them."""
    noise = replace(GUSTY, colour={"q": (1.3, 0.4)})
    linear, _, _ = filtered(gusty_short_period(), [gusty_flight(1, "m1", 200), gusty_flight(2, "m2", 150)], noise)
    kalman = kalman_filter(linear, noise, plain=plain)
    rng = np.random.default_rng(8)
    columns, series = rng.standard_normal((200, 2, 2, 5)), rng.standard_normal((200, 2, 3))
    entering, read = kalman.entrances([1, 0], columns.swapaxes(0, 1).copy())
    Y = np.zeros((200, 2, 2, 3))
    Y[:, :, 1] = series
    stations, first = [0, 1, 0], np.array([0, 2])
    np.testing.assert_allclose(
        kalman.squares_of_histories(stations, series, first),
        np.sum(kalman.whiten_histories(stations, series, first) ** 2, axis=(0, 2)),
        rtol=1e-11,
    )
    for white, by in (
        (kalman.whiten_histories([0] * 3, series), entering[1]),
        (kalman.whiten_histories([1] * 3, series), entering[0]),
        (kalman.whiten(Y, np.zeros((199, 2, 2, 3))), read[1]),
    ):
        expected = np.einsum("krih,kric->rch", white, columns)
        found = by.swapaxes(1, 2) @ series.swapaxes(0, 1)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-11 * np.abs(expected).max())


@pytest.mark.parametrize("noise", [GUSTY, replace(GUSTY, colour={"q": (1.3, 0.4)})])
def test_histories_whitened_in_parts_are_those_whitened_at_once(noise: NoiseModel) -> None:
    """Also of columns that begin after the first part, in records of unequal length."""
    linear, _, _ = filtered(gusty_short_period(), [gusty_flight(1, "m1", 200), gusty_flight(2, "m2", 150)], noise)
    series = np.random.default_rng(9).standard_normal((200, 2, 21))
    series[:130, :, 17:] = 0.0
    kalman = kalman_filter(linear, noise)
    parts = list(kalman.histories_in_parts([0, 1, *[0] * 19], series, 64))
    together = np.concatenate([part for _, part in parts], axis=1).swapaxes(0, 1)
    np.testing.assert_allclose(together, kalman.whiten_histories([0, 1, *[0] * 19], series), rtol=0, atol=1e-13)
    assert [first for first, _ in parts] == ([0] if noise.colour else [0, 64, 128, 192])
