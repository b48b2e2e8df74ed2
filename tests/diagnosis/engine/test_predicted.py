"""How likely held-out records are. Truth: the chain rule, p(held-out | fitted) = p(all) / p(fitted)."""

from __future__ import annotations

import numpy as np
from diagnosis_flights import flights, rough_file

from casid.diagnosis.engine.held_out import judge_on, predicted
from casid.diagnosis.evidence.evidence import Evidence, weigh
from casid.diagnosis.flight.fit import fit
from casid.diagnosis.flight.flight import prepare
from casid.diagnosis.flight.hypothesis import Attached
from casid.model.causes.controls import stuck


def _marginal(evidence: Evidence) -> float:
    """-2 ln p(readings), derivatives integrated out, up to what does not depend on the readings."""
    return evidence.deviance + float(np.linalg.slogdet(evidence.sums.gram)[1])


def test_it_is_what_the_records_add_to_the_evidence_of_all(monkeypatch) -> None:
    """Only the beginning of a record is fitted, so that little is known of the rudder, and another is held out. By the
    values of the fit alone that is less likely, for they are not known as well as that takes them to be."""
    monkeypatch.setattr("casid.diagnosis.engine.held_out.weigh", lambda fit: weigh(fit, discrepancy=False))
    whole, held_out = flights(seed=5, count=2)
    seen = [whole.between(0.0, 9.0)]
    noise = prepare(rough_file(), [whole, held_out]).noise()
    before, after = (
        weigh(fit(prepare(rough_file(), records), (), noise, extent="settled"), discrepancy=False)
        for records in (seen, [*seen, held_out])
    )
    by_values = judge_on([held_out], before.fit)
    expected = _marginal(after) - _marginal(before)
    found = predicted(by_values, before).deviance
    assert abs(found - expected) < 0.1 * abs(by_values.data_deviance - expected)


def test_an_event_whose_end_no_record_holds_has_a_density(monkeypatch) -> None:
    """On the held-out record it lasts beyond the end, so that its duration is known of neither before nor there."""
    monkeypatch.setattr("casid.diagnosis.engine.held_out.weigh", lambda fit, **_: weigh(fit, discrepancy=False))
    seen, held_out = flights(seed=5, count=2)
    begun, values = prepare(rough_file(), [seen]), {"value": 1.0, "duration": 100.0}
    late = {one.name: float(one.t[-1]) - 1.0 for one in (seen, held_out)}
    event, again = (
        Attached(effect=stuck("delta_e"), values=values, onsets={one.name: late[one.name]}) for one in (seen, held_out)
    )
    fitted = fit(begun, (event,), begun.noise(), extent="settled")
    known = weigh(fitted, discrepancy=False)
    base = judge_on([held_out], known.fit)
    there = fit(base.flight, (again,), base.noise, base, free="states", extent="settled")
    assert np.isfinite(predicted(there, known).deviance)
