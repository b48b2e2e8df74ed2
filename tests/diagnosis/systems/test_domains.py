"""Models that have numbers in a part of the state space alone: roots, logarithms, reciprocals of a state near zero.

The truth is the simulation that made the records. Readings with noise lie outside of that part."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import casid as cs

# dynamics of the states that are read, and of the others, with parameters (nominal, true)
SYSTEMS: Mapping[str, tuple[Callable[[Any], Mapping[str, Any]], tuple[str, ...], Mapping[str, tuple[float, float]]]] = {
    "tanks with roots": (
        lambda s: {"h": s.b * s.u - s.k * np.sqrt(s.h), "low": s.k * np.sqrt(s.h) - s.m * np.sqrt(s.low)},
        ("h", "low"),
        {"k": (0.02, 0.026), "m": (0.015, 0.02), "b": (0.01, 0.0115)},
    ),
    "logarithm": (
        lambda s: {"x": -s.a * s.x * np.log(s.x) + s.b * (s.u - 1.0) * s.x},
        ("x",),
        {"a": (0.3, 0.5), "b": (0.1, 0.16)},
    ),
    "reciprocal": (lambda s: {"x": s.a / s.x - s.b * s.u * s.x}, ("x",), {"a": (0.02, 0.005), "b": (0.1, 0.16)}),
}
FOREIGN = re.compile(r"\b(aircraft|derivatives|fly|flies|flown|flight|mass properties)\b")  # to a system


def texts(found: Any) -> list[str]:
    if isinstance(found, str):
        return [found]
    parts = found.values() if isinstance(found, Mapping) else found if isinstance(found, list | tuple) else ()
    return [text for part in parts for text in texts(part)]


@settings(max_examples=4, deadline=None)
@given(
    name=st.sampled_from(sorted(SYSTEMS)),
    seed=st.integers(0, 1000),
    noise=st.sampled_from([0.001, 0.01, 0.03]),
    unread=st.booleans(),
)
def test_a_diagnosis_stays_where_the_model_has_numbers(name: str, seed: int, noise: float, unread: bool) -> None:
    """Only values are wrong: where an estimation of these converges, a diagnosis follows the records to the noise."""
    dynamics, states, values = SYSTEMS[name]
    read = states[-1:] if unread else states
    model = cs.define_model(
        name,
        states=states,
        inputs=["u"],
        parameters={n: nominal for n, (nominal, _) in values.items()},
        outputs=read,
        dynamics=dynamics,
        output=lambda s: {n: getattr(s, n) for n in read},
        prior_std={n: max(abs(true - nominal), 0.3 * nominal) for n, (nominal, true) in values.items()},
    )
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 120.0, 0.5)
    records = []
    for k in range(2):
        record = cs.Record(name=f"r{k}", t=t, channels={"u": np.repeat(rng.uniform(0.1, 1.0, 12), 20)})
        flown = cs.simulate(model, record, [0.05] * len(states), {n: true for n, (_, true) in values.items()})
        noisy = {n: flown.output(n) + rng.normal(0.0, noise, len(t)) for n in read}
        records.append(record.with_channels(**noisy))
    assume(cs.solve(cs.Problem(model, records, free=["*"], prior=True), starts=1).converged)
    found = cs.diagnose(model, records)
    for channel, one in found.held_out_extended.channels.items():
        assert one.rms < 1.5 * noise, channel
    said = [*str(found).splitlines(), *texts(found.to_dict())]
    assert not [text for text in said if FOREIGN.search(text)]


def test_a_system_without_numbers_anywhere_is_told_in_its_own_words() -> None:
    model = cs.define_model(
        "imaginary",
        states=["x"],
        inputs=["u"],
        parameters={"a": 1.0},
        outputs=["x"],
        dynamics=lambda s: {"x": s.u - s.a * np.sqrt(-1.0 - s.x**2)},
        output=lambda s: {"x": s.x},
    )
    t = np.arange(0.0, 20.0, 0.1)
    record = cs.Record(name="r", t=t, channels={"u": np.sin(t), "x": np.cos(t)})
    with pytest.raises(cs.EstimationError) as fault:
        cs.diagnose(model, [record, record.renamed("s").between(0.0, 15.0)])
    assert "imaginary" in str(fault.value)
    assert not FOREIGN.search(str(fault.value))
