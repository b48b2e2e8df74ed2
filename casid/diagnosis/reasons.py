"""What a gate says of a cause, in the words of an engineer: one clause for each comparison of `gates`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType

from casid.model.numbers import digits

# begin of the name of a gate -> the clause for a cause that fails it, and for one that passes it. {v}: the value, {t}:
# the threshold, {p}: the value in per cent, {first}: the cause that came first, {behind}: by how much it fits better,
# {rest}: the rest of the name of the gate.
_CLAUSES: Mapping[str, tuple[str, str]] = MappingProxyType(
    {
        "odds against records that are well": ("the odds against records without a fault are {v} to 1", ""),
        "predicted statistic beside turbulence": (
            "turbulence explains as much: {v} in 2 ln L is predicted, and {t} is needed to try it",
            "",
        ),
        "predicted statistic, of what it needs": ("it would reach {p} of what a name needs", ""),
        "predicted statistic": ("it would improve the fit by {v} in 2 ln L, and {t} is needed to try it", ""),
        "predicted size": ("its predicted size is {v} of the size that matters", ""),
        "predicted clearness": ("its predicted size is too uncertain to be tried", ""),
        "places left": ("others are predicted to explain more, and only the best few are fitted", ""),
        "found by kinematics at half its size": ("the kinematics, which need no aerodynamics, do not show it", ""),
        "found by kinematics": (
            "the kinematics, which need no aerodynamics, do not find it ({p} of its size)",
            "the kinematics, which need no aerodynamics, find it too",
        ),
        "records that can be simulated with it": ("the simulation diverges with it", ""),
        "time left": ("no time was left to fit it", ""),
        "gain of the jump over a slow change": ("a slow change explains as much as a sudden one", ""),
        "gain of the gust over those": ("gusts at other times explain as much", ""),
        "gain of one drifting reading": ("the drift of a single reading explains as much", ""),
        "gain of earlier inputs": ("earlier inputs improve it by {v} in 2 ln L, and {t} is needed", ""),
        "gain of an input of any shape": (
            "an unknown input there improves the fit by {v} in 2 ln L, and {t} is needed",
            "an unknown input there improves the fit by {v} in 2 ln L",
        ),
        "gain, of what any input gains there": ("an unknown input at its place explains more", ""),
        "gain with held-out records": ("the held-out records contradict it", "the held-out records agree"),
        "gain on held-out records": ("the held-out records contradict it", "the held-out records agree"),
        "gain where noise is slow": ("slow noise explains as much", ""),
        "gain behind the first": ("it fits worse than {first}{behind}", "it fits as well as {first}"),
        "gain still missing": ("{v} in 2 ln L is still missing where it acts", ""),
        "gain": (
            "it improves the fit by {v} in 2 ln L, and {t} is needed",
            "it improves the fit by {v} in 2 ln L, and {t} was needed",
        ),
        "smallest possible": ("its size, {v}, is below the smallest possible, {t}", ""),
        "largest possible": ("its size, {v}, is above the largest possible, {t}", ""),
        "size, of what matters": (
            "its size is {v} of the size that matters",
            "its size is {v} times the one that matters",
        ),
        "size, in corrected standard deviations": (
            "its size is {v} standard deviations from zero, and {t} are needed",
            "its size is {v} standard deviations from zero",
        ),
        "size still missing at its port": ("{v} times the size that matters is still missing where it acts", ""),
        "size newly missing at": ("with it, something else is missing{rest}", ""),
        "clearness": ("its size is too uncertain", ""),
        "lag of a state": ("its lag is shorter than the time between samples", ""),
        "onset after the beginning": ("it begins with the record, and is no event", ""),
        "contradicted size": ("the kinematics contradict its size", ""),
        "opposed by kinematics": ("the kinematics contradict its size", ""),
        "predicted kinematic gain": (
            "only the kinematics could show it, and these records are too short of motion",
            "",
        ),
        "kinematic gain": ("the kinematics contradict it", ""),
        "part still missing": (
            "{p} of what was missing is still missing with it",
            "{p} of what was missing is left with it",
        ),
        "largest gain still missing": ("more is missing elsewhere than it explains", ""),
        "confirmed by kinematics": ("the kinematics do not confirm it", ""),
        "refused causes of its set": ("another cause of its set was refused{rest}", ""),
        "best of the forms": ("another form of it explains more", ""),
        "decided before": ("a fault that is too small to matter explains more: {rest}", ""),
        "first of its set is named": ("the cause that leads its set was not named{rest}", ""),
        "still in the model": ("later causes made it unnecessary", ""),
        "expected of any aircraft": ("every aircraft has it, and it is no larger than usual", ""),
        "left beside causes": ("named causes, slow noise and turbulence explain it", ""),
        "odds against single errors": ("single errors explain as much", ""),
        "never recorded": ("it was never recorded, and is not judged", ""),
    }
)
_ORDERED = sorted(_CLAUSES, key=len, reverse=True)


def clause(gate: str, passed: bool, numbers: tuple[float, float], first: str, behind: float) -> str:
    """Return what a comparison says of a cause; empty where it says nothing to an engineer.

    Parameters
    ----------
    gate
        Name of the comparison.
    passed
        Whether the cause passed it.
    numbers
        The value and its threshold.
    first
        The cause that explains most in this round.
    behind
        By how much that one fits better, in 2 ln L; NaN where it is not known.
    """
    begin = next((one for one in _ORDERED if gate.startswith(one)), "")
    if not begin:
        return "" if passed else gate
    value, threshold = numbers
    by = f" by {digits(behind, 2)} in 2 ln L" if math.isfinite(behind) and behind > 0.0 else ""
    words = {
        "v": digits(value, 3) if math.isfinite(value) else "any number",
        "t": digits(threshold, 3),
        "p": f"{100.0 * value:.0f} %",
        "rest": gate.removeprefix(begin).removesuffix(", in the final model").removeprefix(",").rstrip(),
        "first": first or "the first",
        "behind": by,
    }
    return _CLAUSES[begin][passed].format(**words)
