"""Which causes records can show. Truth: which variables were held still, and which axes left out."""

from __future__ import annotations

import numpy as np
import pytest
from small_flight import aircraft_file, records

from casid.diagnosis.flight.flight import prepare
from casid.diagnosis.flight.subject import Subject
from casid.model.terms import IN_PLANE, OUT_OF_PLANE, parse_term


def variables(flight: Subject) -> set[str]:
    """Of all terms that are offered."""
    return {v for e in flight.effects if e.regressor for v in parse_term(e.regressor).variables}


def test_a_surface_that_rests_is_in_no_term() -> None:
    """A rudder 0.6 deg off and its noise: q*delta_r would be a yawing moment of q, which symmetry forbids."""
    still = [r.with_channels(delta_r=0.01 + 3e-4 * np.random.default_rng(7).standard_normal(len(r))) for r in records()]
    assert "delta_r" in variables(prepare(aircraft_file(), records()))
    assert "delta_r" not in variables(prepare(aircraft_file(), still))


@pytest.mark.parametrize(("axes", "left_out"), [("longitudinal", OUT_OF_PLANE), ("lateral", IN_PLANE)])
def test_variables_of_axes_that_are_not_judged_are_in_no_term(axes: str, left_out: tuple[str, ...]) -> None:
    assert not variables(prepare(aircraft_file(), records(), axes=axes)) & set(left_out)


def test_a_term_has_two_variables_at_most() -> None:
    offered = [parse_term(e.regressor) for e in prepare(aircraft_file(), records()).effects if e.regressor]
    assert max(len(term.factors) for term in offered) == 2
    assert "alpha*beta^2" in {term.name for term in offered}
