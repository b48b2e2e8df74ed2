"""Low-order equivalent systems: recovered from their own responses, from simulations, against scipy, with coverage."""

from __future__ import annotations

import time

import numpy as np
import pytest
from estimation_cases import TRUTH, exact, matrices
from scipy.optimize import curve_fit

import casid as cs
from casid.errors import InputError
from casid.frequency.transfer_function import LOW_ORDER

OMEGA = np.geomspace(0.5, 12.0, 20)
SHORT_PERIOD = {
    "K_q": -8.0,
    "1/T_theta2": 1.1,
    "zeta_sp": 0.55,
    "omega_sp": 3.2,
    "tau_q": 0.12,
    "K_az": 60.0,
    "tau_az": 0.08,
}
VALUES = {
    "short period": SHORT_PERIOD | {"K_theta": -8.0, "tau_theta": 0.1, "K_alpha": -7.0, "tau_alpha": 0.05},
    "roll": {"K_p": -5.0, "1/T_roll": 2.3, "tau_p": 0.07, "K_phi": -5.0, "tau_phi": 0.09},
    "roll and dutch roll": {
        "K_p": -5.0,
        "1/T_roll": 2.3,
        "zeta_phi": 0.2,
        "omega_phi": 1.8,
        "zeta_dr": 0.12,
        "omega_dr": 2.2,
        "tau_p": 0.07,
    },
    "dutch roll": {
        "K_beta": 2.0,
        "zeta_dr": 0.12,
        "omega_dr": 2.2,
        "tau_beta": 0.05,
        "K_r": -1.5,
        "1/T_r": 0.4,
        "tau_r": 0.06,
    },
}


def measured(form: str, outputs: tuple[str, ...], values: dict[str, float], **options) -> list[cs.MeasuredResponse]:
    return [
        cs.MeasuredResponse(
            input="delta", output=o, omega=OMEGA, response=LOW_ORDER[form][o].response(OMEGA, values), **options
        )
        for o in outputs
    ]


def noisy(clean: list[cs.MeasuredResponse], error: np.ndarray, rng: np.random.Generator) -> list[cs.MeasuredResponse]:
    """With random errors of gain and phase as large as `error` (frequencies,)."""
    return [
        cs.MeasuredResponse(
            input=one.input,
            output=one.output,
            omega=one.omega,
            response=one.response * np.exp(error * (rng.standard_normal(20) + 1j * rng.standard_normal(20))),
            coherence=one.coherence,
        )
        for one in clean
    ]


@pytest.mark.parametrize("form", list(LOW_ORDER))
def test_a_response_of_the_form_gives_its_parameters_to_rounding(form: str) -> None:
    fit = cs.fit_transfer_functions(measured(form, tuple(LOW_ORDER[form]), VALUES[form]), form)
    assert fit.converged
    assert fit.values == pytest.approx(VALUES[form], rel=1e-8)
    assert fit.cost < 1e-15


@pytest.mark.parametrize("form", list(LOW_ORDER))
def test_slopes_are_those_of_differences(form: str) -> None:
    for one in LOW_ORDER[form].values():
        _, slopes = one.with_slopes(OMEGA, VALUES[form])
        for name in one.names:
            step = 1e-6 * abs(VALUES[form][name])
            up, down = (one.response(OMEGA, VALUES[form] | {name: VALUES[form][name] + d}) for d in (step, -step))
            assert slopes[name] == pytest.approx(np.log(up / down) / (2.0 * step), rel=1e-6, abs=1e-7)


def test_unstable_and_non_minimum_phase_systems_are_found() -> None:
    values = VALUES["short period"] | {"zeta_sp": -0.2, "1/T_theta2": -0.6}
    fit = cs.fit_transfer_functions(measured("short period", ("q", "az"), values), "short period")
    assert {n: fit.values[n] for n in SHORT_PERIOD} == pytest.approx({n: values[n] for n in SHORT_PERIOD}, rel=1e-7)


def test_what_is_fixed_stays_and_is_not_estimated() -> None:
    fit = cs.fit_transfer_functions(
        measured("short period", ("q",), SHORT_PERIOD), "short period", fixed={"1/T_theta2": 1.1}
    )
    assert set(fit.parameters) == {"K_q", "zeta_sp", "omega_sp", "tau_q"}
    assert fit.values == pytest.approx({n: SHORT_PERIOD[n] for n in fit.parameters}, rel=1e-8)
    assert fit.fixed == {"1/T_theta2": 1.1}


def test_low_coherence_and_other_bands_have_no_part() -> None:
    clean = measured("roll", ("p",), VALUES["roll"])[0]
    wrong = np.where((OMEGA > 8.0) | (OMEGA < 0.7), 3.0, 1.0)
    coherence = np.where(OMEGA > 8.0, 0.5, 0.9)
    spoilt = cs.MeasuredResponse(
        input="delta", output="p", omega=OMEGA, response=wrong * clean.response, coherence=coherence
    )
    fit = cs.fit_transfer_functions(spoilt, "roll", band=(0.7, 20.0))
    assert fit["1/T_roll"].value == pytest.approx(VALUES["roll"]["1/T_roll"], rel=1e-8)


def test_the_cost_is_that_of_the_comparison_of_responses() -> None:
    """J = 20/n sum of W (dB^2 + 0.01745 deg^2), written out."""
    clean = measured("short period", ("q",), SHORT_PERIOD, coherence=np.linspace(0.95, 0.7, 20))
    found = noisy(clean, np.full(20, 0.1), np.random.default_rng(2))[0]
    fit = cs.fit_transfer_functions(found, "short period")
    ratio = fit.fitted["q/delta"] / found.response
    weight = (1.58 * (1.0 - np.exp(-found.coherence))) ** 2
    cost = np.mean(weight * ((20.0 * np.log10(np.abs(ratio))) ** 2 + 0.01745 * np.degrees(np.angle(ratio)) ** 2)) * 20
    assert fit.costs["q/delta"] == pytest.approx(cost, rel=1e-9)


def test_the_short_period_of_an_exact_motion_has_the_eigenvalues_of_its_matrix() -> None:
    """From records: multisine flown through matrix exponentials, with a delay of two samples of the elevator."""
    a, b = matrices(TRUTH)
    t = np.arange(0.0, 120.0, 0.02)
    rng = np.random.default_rng(4)
    w = np.arange(0.3, 12.0, 0.17)
    u = 0.01 * np.sin(np.outer(t, w) + rng.uniform(0.0, 6.3, len(w))).sum(axis=1)
    x = exact(a, b, t, np.concatenate([np.zeros(2), u[:-2]])[:, None], np.zeros(2), "linear")
    noise = rng.standard_normal((len(t), 2)) * [1e-3, 2e-3]
    record = cs.Record(
        name="m", t=t, channels={"delta_e": u, "alpha": x[:, 0] + noise[:, 0], "q": x[:, 1] + noise[:, 1]}
    )
    flight = [cs.frequency_response(record, "delta_e", o, omega=np.geomspace(0.6, 10.0, 30)) for o in ("q", "alpha")]
    form = dict(LOW_ORDER["short period"])
    form["alpha"] = cs.TransferFunction(
        gain="K_alpha", zeros=["1/T_alpha"], pole_pairs=[("zeta_sp", "omega_sp")], delay="tau_alpha"
    )
    fit = cs.fit_transfer_functions(flight, form)
    root = np.linalg.eigvals(a)[0]
    assert fit["omega_sp"].value == pytest.approx(abs(root), abs=4.0 * fit["omega_sp"].std)
    assert fit["zeta_sp"].value == pytest.approx(-root.real / abs(root), abs=4.0 * fit["zeta_sp"].std)
    assert fit["tau_q"].value == pytest.approx(0.04, abs=4.0 * fit["tau_q"].std)
    assert fit["omega_sp"].std < 0.01 * abs(root)
    zero = -TRUTH["Za"] + TRUTH["Ma"] * TRUTH["Zde"] / TRUTH["Mde"]  # numerator Mde s + Ma Zde - Za Mde, over Mde
    assert fit["1/T_theta2"].value == pytest.approx(zero, abs=4.0 * fit["1/T_theta2"].std)


def test_it_finds_what_scipy_finds(record_property) -> None:
    """Peer: scipy.optimize.curve_fit with differences, from the truth, on the same rows with the same weights."""
    clean = measured("short period", ("q", "az"), SHORT_PERIOD, coherence=np.full(20, 0.9))
    found = noisy(clean, np.full(20, 0.05), np.random.default_rng(6))

    def rows(_, *p):
        table, out = dict(zip(SHORT_PERIOD, p, strict=True)), []
        for one in found:
            error = np.log(LOW_ORDER["short period"][one.output].response(OMEGA, table) / one.response)
            out += [20.0 / np.log(10.0) * np.real(error), np.sqrt(0.01745) * np.degrees(np.imag(error))]
        return np.concatenate(out)

    begin = time.process_time()
    theirs, covariance = curve_fit(rows, np.zeros(80), np.zeros(80), p0=list(SHORT_PERIOD.values()), xtol=1e-14)
    middle = time.process_time()
    fit = cs.fit_transfer_functions(found, "short period", start=SHORT_PERIOD)
    record_property("seconds", {"scipy": middle - begin, "casid": time.process_time() - middle})
    assert list(fit.values.values()) == pytest.approx(theirs, rel=1e-5)
    # the same residuals, whose errors scipy takes as equally large in dB and in weighted deg
    assert [one.std for one in fit.parameters.values()] == pytest.approx(np.sqrt(np.diagonal(covariance)), rel=0.2)


def test_wrong_names_and_responses_are_errors() -> None:
    q = measured("short period", ("q",), SHORT_PERIOD)[0]
    with pytest.raises(InputError, match="short period"):
        cs.fit_transfer_functions(q, "short periods")
    with pytest.raises(InputError, match="1/T_theta2"):
        cs.fit_transfer_functions(q, "short period", fixed={"1/T_theta": 1.0})
    with pytest.raises(InputError, match="each once"):
        cs.fit_transfer_functions([q, q], "short period")
    with pytest.raises(InputError, match="unknown output 'q'"):
        cs.fit_transfer_functions(q, "roll")
    with pytest.raises(InputError, match="0 usable frequencies"):
        cs.fit_transfer_functions(q, "short period", band=(20.0, 30.0))
    with pytest.raises(InputError, match="shape"):
        cs.MeasuredResponse(input="u", output="y", omega=OMEGA, response=np.ones(3))


@pytest.mark.slow
def test_intervals_hold_the_truth_as_often_as_they_say() -> None:
    """300 sets of two responses with the random errors of their coherence, in 8 averages."""
    coherence = np.clip(0.97 - 0.3 * (np.log(OMEGA / 3.0) / 2.0) ** 2, 0.65, 0.99)
    error = np.sqrt((1.0 - coherence) / (2.0 * coherence * 8.0))
    clean = measured("short period", ("q", "az"), SHORT_PERIOD, coherence=coherence)
    rng, hits = np.random.default_rng(11), []
    for _ in range(300):
        fit = cs.fit_transfer_functions(noisy(clean, error, rng), "short period", start=SHORT_PERIOD)
        hits.append([abs(fit[n].value - v) < 1.96 * fit[n].std for n, v in SHORT_PERIOD.items()])
    assert 0.93 < np.mean(hits) < 0.97


@pytest.mark.slow
def test_intervals_of_responses_from_records_hold_the_truth() -> None:
    """200 records with white noise on what is measured; neighbouring frequencies share their windows."""
    a, b = matrices(TRUTH)
    t = np.arange(0.0, 90.0, 0.04)
    w = np.arange(0.3, 10.0, 0.11)
    u = 0.01 * np.sin(np.outer(t, w) + np.arange(len(w)) ** 2).sum(axis=1)
    x = exact(a, b, t, u[:, None], np.zeros(2), "linear")
    rng, hits, root = np.random.default_rng(12), [], np.linalg.eigvals(a)[0]
    for _ in range(200):
        record = cs.Record(name="m", t=t, channels={"delta_e": u, "q": x[:, 1] + 0.03 * rng.standard_normal(len(t))})
        flight = cs.frequency_response(record, "delta_e", "q", omega=np.geomspace(0.7, 9.0, 40))
        fit = cs.fit_transfer_functions(flight, "short period")
        truth = {"omega_sp": abs(root), "zeta_sp": -root.real / abs(root), "tau_q": 0.0}
        hits.append([abs(fit[n].value - v) < 1.96 * fit[n].std for n, v in truth.items()])
    assert 0.90 < np.mean(hits) < 0.99


def test_the_table_has_every_parameter_and_the_figure_every_response() -> None:
    fit = cs.fit_transfer_functions(measured("short period", ("q", "az"), SHORT_PERIOD), "short period")
    assert all(name in str(fit) for name in SHORT_PERIOD)
    titles = [ax.get_title(loc="left") for ax in fit.plot().axes]
    assert all(any(label in title for title in titles) for label in fit.responses)
