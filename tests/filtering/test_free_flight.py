"""The error of the right model from a measured start. Truth: draws of the same noise through the same model, and what
covariances of a mean square are where they are known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

import casid as cs
from casid.filtering.free_flight import ChanceError, chance_error, free_flight_sigma
from casid.filtering.initial_state import measured_start
from casid.filtering.innovations import Linear, NoiseModel, PointFunctions, linearise, make_batch

DT, COUNT, SIGMA = 0.04, 250, {"place": 0.3, "speed": 0.2}


def pendulum() -> cs.Model:
    """Lightly damped, so that where it begins is seen to the end."""
    return cs.define_model(
        "pendulum",
        states=["x", "v"],
        inputs=["u"],
        parameters={"k": 1.5, "d": 0.05},
        outputs=["place", "speed"],
        dynamics=lambda s: {"x": s.v, "v": s.u - s.k * s.x - s.d * s.v},
        output=lambda s: {"place": s.x, "speed": s.v},
    )


def linear_of(model: cs.Model, record: cs.Record) -> Linear:
    batch = make_batch(model, [record])
    X = np.zeros((len(record), 1, len(model.states)))
    return linearise(PointFunctions(model, ()), batch, model.nominal_vector()[None], X)


def read(rng: np.random.Generator, colour: float) -> cs.Record:
    """Readings of rest: white noise, or a first-order process of the same 1-sigma."""
    t = np.arange(COUNT) * DT
    white = rng.standard_normal((2, COUNT + 200))
    noise = np.asarray(lfilter([np.sqrt(1.0 - colour**2)], [1.0, -colour], white))[:, 200:]
    channels = {name: sigma * one for (name, sigma), one in zip(SIGMA.items(), noise, strict=True)}
    return cs.Record(name="m", t=t, channels={**channels, "u": np.zeros(COUNT)})


@pytest.mark.parametrize("colour", [0.0, 0.7])
def test_the_mean_square_from_a_measured_start_and_its_spread(colour: float) -> None:
    """Of 400 draws; the error of a mean of few squares is some per cent. One in twenty is beyond the most of them, give
    or take four deviations of that count."""
    model, rng = pendulum(), np.random.default_rng(2)
    noise = NoiseModel(measurement=SIGMA)
    if colour:
        noise = replace(noise, colour=dict.fromkeys(SIGMA, (1.0, -DT / np.log(colour))))
    linear, squares = linear_of(model, read(rng, colour)), []
    for _ in range(400):
        record = read(rng, colour)
        x, outputs = measured_start(model, record, np.zeros(2)), []
        for k in range(COUNT):
            outputs.append(linear.C[k, 0] @ x)
            x = linear.A[k, 0] @ x if k < COUNT - 1 else x
        errors = np.stack([record[name] for name in SIGMA], axis=1) - outputs
        squares.append(np.mean(errors**2, axis=0))
    found = chance_error(linear, noise, 1.0)
    np.testing.assert_allclose(np.mean(squares, axis=0), found.noise + found.astray, rtol=0.06)
    beyond = np.sum(np.array(squares) > found.most(0.05), axis=0)
    assert np.all(np.abs(beyond - 20) < 4.0 * np.sqrt(20.0)) and np.all(found.freedom < 2.1)


def test_nothing_is_astray_where_the_start_is_known_and_inputs_have_no_noise() -> None:
    """Without readings in its beginning a start is not measured; then the noise of the readings is all there is."""
    linear = linear_of(pendulum(), read(np.random.default_rng(1), 0.0))
    noise, unread = NoiseModel(measurement=SIGMA), replace(linear, seen=linear.seen.copy())
    unread.seen[:30] = False
    found = chance_error(unread, noise, 1.0)
    np.testing.assert_allclose(np.sqrt(found.noise), list(SIGMA.values()))
    assert not found.astray.any()
    np.testing.assert_allclose(found.most(0.05), found.noise)
    np.testing.assert_allclose(free_flight_sigma(linear, noise)[5, 0], list(SIGMA.values()))


def test_one_random_number_is_beyond_two_sigmas_in_one_case_of_twenty() -> None:
    one = ChanceError(noise=np.array([1.0]), astray=np.array([4.0]), freedom=np.array([1.0]))
    assert one.most(0.05) == pytest.approx([1.0 + 4.0 * 1.959964**2])
    assert replace(one, astray=np.array([np.inf])).most(0.05) == [np.inf]
