"""The ranges of criteria within which decisions come out the same, against replaying the decisions themselves."""

import math
import tomllib

import numpy as np
import pytest

from casid.diagnosis.cause import NAMED, Decision
from casid.diagnosis.comparisons import Gate, all_passed
from casid.diagnosis.criteria import Criteria
from problems.blind.ablation import moved, same_decisions, use_of

NOW = 0.3
FORMS = (
    lambda c: c,
    lambda c: 1.0 / c,
    lambda c: 1.0 - c,
    math.sqrt,
    lambda c: 1234.5 * c,  # a multiple
    lambda c: c / NOW,  # a value in units of the criterion
)


def drawn(rng: np.random.Generator):
    """A criterion -> decision, with gates of this criterion in all forms, of others, and alternatives."""

    def gate(depth: int):
        form, least = FORMS[rng.integers(len(FORMS))], bool(rng.integers(2))
        mine = rng.random() < 0.6
        value = form(NOW) * rng.uniform(0.3, 3.0)
        others = [gate(depth + 1) for _ in range(rng.integers(3))] if depth < 2 else []
        return lambda c: Gate(
            gate="",
            value=value,
            threshold=form(c if mine else NOW),
            criterion="mine" if mine else "other",
            least=least,
            or_else=tuple(other(c) for other in others),
        )

    gates = [gate(0) for _ in range(rng.integers(1, 4))]
    return lambda c: Decision(cause="x", round=1, outcome=NAMED, gates=tuple(one(c) for one in gates))


@pytest.mark.parametrize("seed", range(20))
def test_decisions_come_out_the_same_within_a_range_and_one_changes_beyond_either_end(seed):
    rng = np.random.default_rng(seed)
    decisions = [drawn(rng) for _ in range(4)]
    low, high = same_decisions([one(NOW) for one in decisions], "mine", NOW)

    def outcomes(value: float):
        return [all_passed(one(value).gates) for one in decisions]

    assert low <= NOW <= high
    inside = np.linspace(low, min(high, 100.0), 103)[1:-1]
    assert all(outcomes(value) == outcomes(NOW) for value in inside)
    assert low == 0.0 or outcomes(low * (1 - 1e-9)) != outcomes(NOW)
    assert high == math.inf or outcomes(high * (1 + 1e-9)) != outcomes(NOW)


def test_a_gate_is_pivotal_that_failed_alone():
    failed, passed = (Gate(gate="", value=v, threshold=1.0, criterion=c) for v, c in ((0.5, "a"), (2.0, "b")))
    both = Gate(gate="", value=0.5, threshold=1.0, criterion="b")
    alone, together = (
        Decision(cause="x", round=1, outcome="refused", gates=gates) for gates in ((failed, passed), (failed, both))
    )
    use = use_of([alone, together])
    assert (use.pivotal["a"], use.pivotal["b"]) == (1, 0)
    assert (use.asked["b"], use.failed["b"]) == (2, 1)


def test_moved_numbers_are_those_without_a_gate_and_the_inverse_factor_moves_them_back():
    one, other = (tomllib.loads(moved({"naming.alike_sigmas"}, factor, seed=1)) for factor in (1.25, 0.8))
    default = {row.name: row.value for row in Criteria().rows if isinstance(row.value, float)}
    assert "alike_sigmas" not in one.get("naming", {}) and "numerics" not in one
    for name, value in Criteria().with_values(one).changes.items():
        group, number = name.split(".")
        low, high = sorted((float(str(value)), other[group][number]))
        assert low < default[name] < high
