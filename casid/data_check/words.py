"""Write the sentences about faults of the data."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from casid.signals import CHANNELS, SURFACES, label_of, unit_of

_LABELS = {"t": "time"}


def named(target: str) -> str:
    """Labels of the channels of a target, `pitch angle and bank angle`."""
    labels = [_LABELS.get(name, label_of(name)) for name in target.split("+")]
    return labels[0] if len(labels) == 1 else f"{', '.join(labels[:-1])} and {labels[-1]}"


def _where(records: Sequence[str], every: bool) -> str:
    return "every record" if every else ", ".join(records)


def of_channel(kind: str, target: str, records: Sequence[str], every: bool, share: float, level: str) -> str:
    """A fault that one channel shows alone; `share` of the samples of the records concerned, `level` of a rail."""
    where = _where(records, every)
    part = _part(share)
    label = named(target)
    if kind == "data_stuck":
        return f"The recorded {label} is frozen{level} in {where}: {part} are left out."
    if kind == "data_dropout":
        return f"The recorded {label} holds its last value now and then in {where}: {part} are left out."
    if kind == "data_steps":
        return (
            f"The recorded {label} is corrected in steps in {where}, at {part}, as by a filter: its rate and timing "
            "tell nothing."
        )
    if kind == "data_clipped":
        return f"The recorded {label} is at a rail{level} in {where}: {part} are left out."
    return f"The recorded {label} has isolated outliers in {where}: {part} are left out."


def of_alternative(
    kind: str, target: str, value: float | None, unit: str | None, records: Sequence[str], every: bool
) -> str:
    """A sign, a unit or a swap, as a statement; `unit` of axes is the convention found."""
    if kind == "axes":
        usual = "FRD: forward, right, down" if target == "body" else "NED: north, east, down"
        heading = "; a constant of the heading does not show" if unit and ("NWU" in unit or "ENU" in unit) else ""
        return f"The {target} axes of {_where(records, every)} are {unit}, not the usual ones ({usual}{heading})"
    where = _where(records, every)
    label = named(target)
    plural = "+" in target
    if target in SURFACES and kind == "data_sign":
        return f"{target}: sign convention opposite to the file in {where}"
    if kind == "data_sign":
        return f"The recorded {label} has the wrong sign in {where}"
    if kind == "data_swap":
        names = target.split("+")
        pairs = zip(names[::2], names[1::2], strict=True)
        return f"The records of {', and of '.join(map(named, map('+'.join, pairs)))} are interchanged in {where}"
    if kind == "data_gravity":
        return f"The recorded {label} does not contain gravity in {where}"
    if target == "t":
        stands = f"in {unit}" if unit and "SI" not in unit else f"off by a factor of {1.0 / (value or 1.0):.3g}"
        return f"The time is {stands} in {where}"
    si = unit_of(target.split("+", 1)[0]) if target.split("+", 1)[0] in CHANNELS else "SI"
    stands = f"{'are' if plural else 'is'} in {unit}, not in {si}" if unit else "have another unit"
    if unit and unit.startswith("SI"):
        other = unit.rsplit(" ", 1)[-1]
        stands = f"{'are' if plural else 'is'} {1.0 / (value or 1.0):.3g} times too large: {si} taken for {other}"
    return f"The recorded {label} {stands} in {where}"


def handled_as(
    kind: str, value: float | None, rivals: Sequence[str], undone: bool, refused: bool, log_odds: float
) -> str:
    """Return the end of a sentence: what corrects the fault, or why nothing is changed. `refused`: another kind of
    correction concerns the channel. `log_odds`: of the fault, against records without fault."""
    if rivals:
        return f"; or else {' or '.join(rivals[:3])}: these data do not decide, and nothing was changed."
    if refused:
        return (
            "; but something else is turned, or the channel has another kind of fault, too: two corrections at once "
            "are not made."
        )
    if undone:
        return "; nothing was changed, as asked."
    odds = f"odds of {math.exp(log_odds):.0e} to 1".replace("e+0", "e").replace("e+", "e")
    if kind == "data_swap":
        return f"; changing them back corrects it ({odds})."
    if kind == "axes":
        return f"; converting all channels of that frame corrects it ({odds})."
    if kind == "data_gravity":
        return f"; taking 1 g off corrects it ({odds})."
    return f"; multiplying the values by {value:.4g} corrects it ({odds})."


def of_pauses(record: str, pauses: Sequence[tuple[float, float]]) -> str:
    """Long pauses in the time of a record: begin and end [s]."""
    begin, end = max(pauses, key=lambda pause: pause[1] - pause[0])
    more = f" and in {len(pauses) - 1} more places" if len(pauses) > 1 else ""
    return (
        f"Rows are missing in {record} for {end - begin:.4g} s after t = {begin:.6g} s{more}: split the record there, "
        "for inputs are interpolated across it."
    )


def of_nothing(channel: str, records: Sequence[str], every: bool) -> str:
    """A channel without any sample."""
    return f"{channel} has no sample at all in {_where(records, every)}: it is left out."


def of_the_file(said: str, rivals: Sequence[str]) -> str:
    """Another meaning of numbers of the aircraft file, with others that these data do not tell from it."""
    others = f" (or else {' or '.join(rivals[:2])})" if rivals else ""
    return f"{said}, most likely{others}: flight agrees with the derivatives of the file then, and not as it stands."


def of_no_input(surfaces: Sequence[str], records: Sequence[str]) -> str:
    """Records without any input."""
    return f"No surface moves ({', '.join(surfaces)}) in {', '.join(records)}: nothing can be identified from these."


def of_rest(why: Mapping[str, str]) -> str:
    """Records of an aircraft that does not fly, with the reason for each."""
    return f"{'; '.join(f'{name}: {reason}' for name, reason in why.items())}: nothing can be identified there."


def _part(share: float) -> str:
    percent = 100.0 * share
    return f"{percent:.0f} % of its samples" if percent >= 10.0 else f"{percent:.2g} % of its samples"
