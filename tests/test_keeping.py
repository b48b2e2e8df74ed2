"""Results kept in files and sent between processes: the same numbers, and what they can do goes on. Truth: before."""

from __future__ import annotations

import math
import pickle
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

import casadi as ca
import numpy as np
import pytest
from estimation_cases import NOISE, START, elevator, flight, short_period
from small_flight import aircraft_file, records

import casid as cs
from casid.keeping import by_fields, plain
from casid.model.causes.air import gust
from casid.model.causes.controls import actuator_lag
from casid.model.effect import Effect


@pytest.fixture(scope="module")
def fit() -> cs.Fit:
    record = flight(noise=NOISE, rng=np.random.default_rng(0))
    limits = [cs.limit_parameter("Mq", upper=0.0)]
    return cs.solve(cs.Problem(short_period(), [record], free=["*"], start=START, constraints=limits))


def again(thing):
    return pickle.loads(pickle.dumps(thing))


def test_a_fit_is_read_as_it_was_saved(fit: cs.Fit, tmp_path: Path) -> None:
    fit.save(tmp_path / "fit.casid")
    found = cs.load(tmp_path / "fit.casid")
    assert str(found) == str(fit) and found.to_dict() == fit.to_dict()
    np.testing.assert_array_equal(found.covariance_corrected, fit.covariance_corrected)
    other = flight("m2", gain=0.5)
    np.testing.assert_array_equal(found.predict(other).outputs, fit.predict(other).outputs)
    assert cs.solve(found.problem).values == pytest.approx(fit.values, rel=1e-6)
    assert [p.name for p in tmp_path.iterdir()] == ["fit.casid"]


def test_what_cannot_be_kept_or_read_is_one_line(fit: cs.Fit, tmp_path: Path) -> None:
    guessed = cs.Problem(short_period(guess=lambda r: r.matrix(["alpha", "q"])), fit.problem.records, free=["Mq"])
    with pytest.raises(cs.InputError, match="define such functions at the top of a module"):
        cs.solve(guessed).save(tmp_path / "fit.casid")
    with pytest.raises(cs.InputError, match="cannot be written"):
        fit.save(tmp_path / "no" / "fit.casid")
    assert list(tmp_path.iterdir()) == []
    whole = tmp_path / "whole.casid"
    fit.save(whole)
    content = whole.read_bytes()
    for change, words in (
        (b"t,alpha\n0,1\n", "no result of casid"),
        (content.replace(b"result/", b"result/9", 1), "casid.result/9"),
        (content[: len(content) // 2], "damaged"),
        (content[:-9] + bytes([content[-9] ^ 1]) + content[-8:], "damaged"),
    ):
        whole.write_bytes(change)
        with pytest.raises(cs.InputError, match=words):
            cs.load(whole)
    with pytest.raises(cs.InputError, match="No such file"):
        cs.load(tmp_path / "other.casid")


def test_records_aircraft_and_models_travel() -> None:
    """Between processes: a record's channels stay read-only, an aircraft is equal, a model has the same equations."""
    record, plane = records()[0], aircraft_file()
    found = again(record)
    assert found.notes == record.notes and again(plane) == plane
    with pytest.raises(TypeError):
        found.channels["alpha"] = record["alpha"]
    ready = cs.flight_inputs(plane, record)
    model = cs.aircraft_model(plane)
    copy = again(model)
    start = model.guess(ready)[0]
    np.testing.assert_array_equal(copy.guess(ready)[0], start)
    flown, same = cs.simulate(model, ready, start), cs.simulate(copy, ready, start)
    np.testing.assert_array_equal(same.outputs, flown.outputs)
    assert model.equation is not None and copy.equation is not None
    values = np.random.default_rng(0).uniform(0.5, 1.5, len(model.equation.channels))
    for part in ("target", "prediction"):
        one, two = (
            ca.Function("f", [m.equation.m, m.p], [getattr(m.equation, part)])(values, m.nominal_vector()).full()
            for m in (model, copy)
        )
        np.testing.assert_array_equal(one, two)


def test_a_control_law_travels_with_its_model() -> None:
    model = short_period()
    law = cs.SampledFeedback(model=model, received=model.u - 0.1 * model.x[1])
    problem = cs.Problem(model, [flight()], free=["M*"], feedback=law)
    copy = again(problem)
    assert copy.feedback.model is copy.model
    at = ca.Function("at", [copy.model.x, copy.model.u], [copy.feedback.received])
    assert float(at([0.3, 0.2], [float(elevator(np.array([1.5]))[0])])) == pytest.approx(0.05 - 0.02)


@pytest.mark.parametrize("effect", [actuator_lag("delta_e"), gust("z")], ids=lambda e: e.name)
def test_effects_travel_by_their_name(effect: Effect) -> None:
    copy = again(effect)
    assert (
        copy.name == effect.name and copy.further.grid == effect.further.grid and copy.size.limit == effect.size.limit
    )
    assert (copy.change is None, copy.series is None) == (effect.change is None, effect.series is None)


@dataclass(frozen=True, kw_only=True)
class _Step:
    """With the names that JSON has: "from" is none of Python, `own` is not told, and `double` is no field."""

    in_json: ClassVar[str] = "from=before double values"

    before: float = math.inf
    own: str = "not told"
    values: np.ndarray = field(default_factory=lambda: np.array([[1.0, math.nan], [0.5, 2.0]]))

    @property
    def double(self) -> int:
        return 2

    to_dict = by_fields


@dataclass(frozen=True, kw_only=True)
class _Steps:
    steps: tuple[_Step, ...] = (_Step(),)
    by_name: dict[str, _Step] = field(default_factory=lambda: {"first": _Step(before=1.0)})


def test_a_result_becomes_json_by_its_fields() -> None:
    """Truth: JSON has null for what is not finite, lists for arrays, and the names that a class states."""
    one = {"from": None, "double": 2, "values": [[1.0, None], [0.5, 2.0]]}
    assert _Step().to_dict() == plain(_Step()) == one
    assert plain(_Steps()) == {"steps": [one], "by_name": {"first": one | {"from": 1.0}}}
    assert plain(_Step(), "before") == {"before": None}
