"""The verdict on a fit. Truth: data of a known system, with and without what the model lacks."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from casid.estimation import Fit, OutputError, Problem, solve
from casid.estimation.usable import NOT_CONVERGED, NOT_IDENTIFIABLE, STRUCTURE_MISSING, USABLE
from casid.model.system import Model, define_model
from casid.records.record import Record

PACE = 1.5
NOISE = 0.02
T = np.arange(0.0, 20.0, 0.05)
U = np.repeat([0.0, 1.0, -1.0, 0.5, -0.5, 1.0, 0.0, -1.0], len(T) // 8)


def lag(**start: float) -> Model:
    """Return y' = a (g u - y), of which a and g can be free."""
    return define_model(
        "lag",
        states=("y",),
        inputs=("u",),
        parameters={"a": 1.0, "g": 1.0} | start,
        outputs=("y",),
        dynamics=lambda s: {"y": s.a * (s.g * s.u - s.y)},
        output=lambda s: {"y": s.y},
    )


def flown(seed: int, added: np.ndarray | float = 0.0) -> Record:
    """Return a response of the lag with g = 1 and noise, and `added` to what is read."""
    y = np.zeros(len(T))
    kept = np.exp(-PACE * (T[1] - T[0]))
    for k in range(1, len(T)):
        y[k] = kept * y[k - 1] + (1.0 - kept) * 0.5 * (U[k - 1] + U[k])
    noise = NOISE * np.random.default_rng(seed).standard_normal(len(T))
    return Record(name=f"r{seed}", t=T, channels={"u": U, "y": y + added + noise})


def fitted(record: Record, model: Model | None = None) -> Fit:
    return solve(Problem(model or lag(), [record], free=["*"], cost=OutputError()))


@given(seed=st.integers(0, 10_000))
@settings(max_examples=10, deadline=None)
def test_a_right_model_is_usable(seed: int) -> None:
    fit = fitted(flown(seed))
    assert (fit.verdict, fit.because) == (USABLE, ())


@given(seed=st.integers(0, 10_000), size=st.floats(0.8, 3.0))
@settings(max_examples=10, deadline=None)
def test_a_motion_that_the_model_cannot_make_is_missing_structure_or_no_solution(seed: int, size: float) -> None:
    fit = fitted(flown(seed, size * np.sin(2.0 * T)))
    assert fit.verdict in (STRUCTURE_MISSING, NOT_CONVERGED) and any("y:" in one for one in fit.because)


@given(seed=st.integers(0, 10_000), rate=st.floats(-3.0, 3.0), offset=st.floats(-5.0, 5.0))
@settings(max_examples=15, deadline=None)
def test_what_its_own_mean_explains_better_is_never_usable(seed: int, rate: float, offset: float) -> None:
    fit = fitted(flown(seed, offset + rate * T))
    assert fit.channels["y"].R2 * len(T) > -9.0 or fit.verdict == NOT_CONVERGED


def test_parameters_that_act_as_one_are_not_identifiable() -> None:
    model = define_model(
        "product",
        states=("y",),
        inputs=("u",),
        parameters={"a": 1.0, "b": 1.0},
        outputs=("y",),
        dynamics=lambda s: {"y": PACE * (s.a * s.b * s.u - s.y)},
        output=lambda s: {"y": s.y},
    )
    fit = fitted(flown(1), model)
    assert fit.verdict == NOT_IDENTIFIABLE and all(name in fit.because[0] for name in ("a", "b"))


def test_a_sign_against_the_file_is_among_the_reasons() -> None:
    fit = fitted(flown(2), lag(g=-1.0))
    assert any("g: of the opposite sign" in one for one in fit.because)


@pytest.mark.parametrize("added", [0.0, 1.0])
def test_text_and_json_begin_with_the_verdict(added: float) -> None:
    fit = fitted(flown(3, added * np.sin(2.0 * T)))
    told = json.loads(json.dumps(fit.to_dict()))
    assert str(fit).splitlines()[0] == told["verdict"] == fit.verdict
    assert told["because"] == list(fit.because)
    assert [line.strip() for line in str(fit).splitlines()[1 : 1 + len(fit.because)]] == list(fit.because)
