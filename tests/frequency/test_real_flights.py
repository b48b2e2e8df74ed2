"""Responses of real flights. Truth: derivatives of other programs, estimated from the same records over time."""

from __future__ import annotations

from pathlib import Path

import casid as cs
from problems.real import attas, hfb320


def test_the_roll_of_attas_is_that_of_its_published_derivatives(flight_data: Path) -> None:
    """The model takes the sideslip as an input: with rudder and sideslip taken off, the response to the aileron is
    nearer to it than alone."""
    records = attas.records_from(flight_data, "fAttasAilRud1")
    model = cs.linear_model(attas.lateral_model(), records, values=attas.LATERAL)
    costs = []
    for others in ((), ("delta_r", "beta")):
        found = cs.frequency_response(records, "delta_a", "p", other_inputs=others)
        compared = cs.compare_responses(found, {"published": model}, band=(1.5, 8.0))
        costs.append(compared.mismatches["published"].cost)
    alone, conditioned = costs
    assert conditioned < 0.5 * alone
    assert conditioned < 10.0


def test_the_pitch_of_the_hfb_is_that_of_its_published_derivatives(flight_data: Path) -> None:
    """In turbulence: the published model is nearer to flight than that of the values which an estimation starts from,
    and either costs less than the published one without its damping in pitch."""
    record = hfb320.record_from(flight_data / "hfb320_1_10.asc")
    found = cs.frequency_response(record, "delta_e", "q", windows=[20.0, 10.0, 5.0])
    wrong = hfb320.PUBLISHED | {"Cm_q": 0.0}
    values = {"published": hfb320.PUBLISHED, "start": hfb320.START, "undamped": wrong}
    models = {name: cs.linear_model(hfb320.model(), record, values=table) for name, table in values.items()}
    costs = {name: one.cost for name, one in cs.compare_responses(found, models).mismatches.items()}
    assert costs["published"] < costs["start"] < costs["undamped"]
    assert costs["published"] < 50.0
