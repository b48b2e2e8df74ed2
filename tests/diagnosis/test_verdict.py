"""What a diagnosis is told by in the end. Truth: the sentences that went in."""

from __future__ import annotations

import pytest

from casid.data_check.reading import Finding
from casid.diagnosis.verdict import named_in_errors
from casid.errors import InputError


@pytest.mark.parametrize(("most", "more"), [(1, "And 3 more."), (3, "And 1 more."), (4, None)])
def test_errors_state_as_many_findings_as_the_criterion_says(most: int, more: str | None) -> None:
    findings = [
        Finding(kind="data_sign", target=name, records=("m1",), handled="reported", sentence=f"{name} is reversed.")
        for name in ("p", "q", "r", "ay")
    ]
    with pytest.raises(InputError) as error, named_in_errors(findings, (), most):
        raise InputError("nothing can be fitted")
    assert str(error.value).count("is reversed") == most
    assert str(error.value).endswith(more or "ay is reversed.")
