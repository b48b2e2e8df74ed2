"""What got better and what got worse on records that no fit has seen, in words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from casid.diagnosis.result import Diagnosis
from casid.report.words import digits
from casid.signals import label_of

_SAME = 0.005  # a change that is no per cent


@dataclass(frozen=True, kw_only=True)
class Gained:
    """The error of all channels together, before and after; and the change of every channel that got worse, and of
    every one that got better, worst first."""

    together: str
    worse: str
    better: str


def gained(diagnosis: Diagnosis) -> Gained:
    """Of the open-loop simulation, from the file as given to the best model."""
    steps, ratio = diagnosis.budget.together, diagnosis.rms_ratio
    gusts = " Gusts are new in every record, so that its error need not shrink." if diagnosis.turbulence.named else ""

    def told(channels: Sequence[str]) -> str:
        return ", ".join(f"{label_of(o)} {100.0 * (ratio[o] - 1.0):+.0f}\u00a0%".replace("-", "−") for o in channels)

    return Gained(
        together=(
            f"On {', '.join(diagnosis.budget.records)}, which no fit has seen, the simulation is off by "
            f"{digits(steps.as_given, 2)} times the noise with the file as given, and by "
            f"{digits(steps.structure, 2)} times with the {diagnosis.best}.{gusts}"
        ),
        worse=told([o for o in ratio if ratio[o] > 1.0 + _SAME]),
        better=told([o for o in ratio if ratio[o] < 1.0 - _SAME]),
    )
