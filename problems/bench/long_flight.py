"""A flight of any length for benchmarks: the stable Do 328, the sticks of a manoeuvre of the paper over and over.

The manoeuvre is flown 2.5 times as fast, so that 5 s contain something of every axis. Pitch and bank are held by a
digital law, so that twenty minutes stay in the air; the recorded surfaces contain what it does. Truth is integrated by
the estimator's own step, noise is that of the paper's record.
"""

from __future__ import annotations

from functools import cache

import casadi as ca
import numpy as np

from casid.estimation import InitialState, OutputError, Problem
from casid.estimation.transcriptions.steps import step_function
from casid.model.feedback import SampledFeedback
from casid.records.record import Record
from problems.do328 import MOMENT_DERIVATIVES, STABLE
from problems.manoeuvres import stick
from problems.paper.cases import Condition
from problems.paper.estimation import INITIAL_STD, START_FACTOR, estimation_model
from problems.paper.truth import OUTPUTS, SURFACES, fly, noise_sigma, trim_point

RATE_HZ, HASTE, PERIOD = 50.0, 2.5, 20.0
_PITCH_GAIN, _BANK_GAIN = 0.4, 0.3  # rad of surface per rad


@cache
def _law() -> SampledFeedback:
    model, level = estimation_model(), trim_point()
    x = dict(zip(model.states, ca.vertsplit(model.x), strict=True))
    received = ca.SX(model.u)
    received[model.inputs.index("delta_e")] += _PITCH_GAIN * (x["theta"] - level.theta)
    received[model.inputs.index("delta_a")] += _BANK_GAIN * x["phi"]
    return SampledFeedback(model=model, received=received)


def long_record(samples: int, name: str = "long", seed: int = 0) -> Record:
    """Measured surfaces, held between samples, and measured outputs at 50 Hz."""
    model, law, level = estimation_model(), _law(), trim_point()
    t = np.arange(samples) / RATE_HZ
    commands = np.tile([level.inputs[n] for n in model.inputs], (samples, 1))
    commands[:, [model.inputs.index(n) for n in SURFACES]] += stick(5, np.mod(HASTE * t, PERIOD))
    p = model.nominal_vector(STABLE)
    chain = step_function(model, law).mapaccum("chain", samples - 1)
    after = chain(level.state, commands[:-1].T, commands[:-1].T, np.diff(t)[None], np.tile(p[:, None], samples - 1))
    states = np.vstack([level.state, after.full().T])
    plant = ca.Function("plant", [model.x, model.u], [law.received])
    surfaces = plant.map(samples)(states.T, commands.T).full().T
    outputs = ca.Function("outputs", [model.x, model.u, model.p, model.w], [model.h])
    nothing = np.zeros((len(model.disturbances), 1))
    y = outputs.map(samples)(states.T, surfaces.T, np.tile(p[:, None], samples), np.tile(nothing, samples)).full().T
    rng, sigma = np.random.default_rng((11, seed)), noise()
    channels = dict(zip(model.inputs, surfaces.T, strict=True))
    channels |= {n: y[:, i] + sigma[n] * rng.standard_normal(samples) for i, n in enumerate(OUTPUTS)}
    named = dict(zip(model.states, states.T, strict=True))
    channels |= {"V": np.sqrt(named["u"] ** 2 + named["v"] ** 2 + named["w"] ** 2)}
    channels |= {angle: named[angle] for angle in ("phi", "theta")}
    return Record(name=name, t=t, channels=channels, hold="held")


@cache
def noise() -> dict[str, float]:
    """1-sigma of the outputs in the paper's record (case B, manoeuvre 5)."""
    sigma = noise_sigma(fly(Condition(case="B", manoeuvre=5, seed=1)).exact)
    return {name: sigma[name] for name in OUTPUTS}


def long_problem(samples: int, records: int = 1) -> Problem:
    """16 moment derivatives from 0.7 x truth, known noise; `records` of `samples` each."""
    return Problem(
        estimation_model(),
        [long_record(samples, f"m{i}", seed=i) for i in range(records)],
        free=list(MOMENT_DERIVATIVES),
        start={n: START_FACTOR * STABLE[n] for n in MOMENT_DERIVATIVES},
        cost=OutputError(),
        noise=noise(),
        initial_state=InitialState(std=INITIAL_STD),
    )
