"""Find faults in records of multirotors by comparing the commands of their rotors with the motion.

In flight the rotors carry what the accelerometer reads; on the ground it reads gravity whatever they do. Rolling and
pitching accelerations follow the commands by the places of the rotors, so that another numbering shows.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations, permutations

import numpy as np

from casid.data_check.reading import Finding
from casid.model.aircraft import Aircraft
from casid.model.rotors import Rotors, acting
from casid.records.channel_faults import stretches
from casid.records.record import Record
from casid.signals import GRAVITY

_CARRIED = 0.15  # part of the weight that the ground carries
_FOLLOWING = 0.05  # variation of thrust over force up to which one follows the other
_STEADY_S = 0.5  # over which thrust and specific force are compared: longer than a motor takes
_STANDS_S = 2.0  # a command that rests for longer, while others are driven
_DRIVEN = 0.01  # part of their mean by which commands of driven rotors vary
_MOST_PERMUTED = 4  # rotors, of which all numberings are tried; of more, pairs
_FOLLOWS = 0.3  # part of the variance of an angular acceleration that the right numbering explains at least
_CLEAR = 20.0  # log odds of another numbering


def rotor_faults(records: Sequence[Record], aircraft: Aircraft) -> list[Finding]:
    """Rotors that are not driven, another numbering than that of the file, and a battery that is not recorded; nothing
    of an aircraft without rotors."""
    rotors = aircraft.rotors
    if not rotors:
        return []
    return [one for record in records for one in (*standing(record, rotors), *_numbering(record, rotors))] + [
        Finding(
            kind="data_dropout",
            target=rotors.voltage.channel,
            records=(record.name,),
            handled="reported",
            sentence=f"{record.name} has no channel '{rotors.voltage.channel}', on which the thrust depends by "
            "[rotors] voltage: add it, or leave 'voltage' out.",
        )
        for record in records
        if rotors.voltage is not None and rotors.voltage.channel not in record
    ]


def airborne(record: Record, rotors: Rotors) -> tuple[float, float]:
    """First and last time [s] at which the rotors carry the aircraft; the whole record where that is unknown."""
    whole = float(record.t[0]), float(record.t[-1])
    if "az" not in record or not all(name in record for name in rotors.names):
        return whole
    if min(np.isfinite(record[name]).sum() for name in ("az", *rotors.names)) < 2:
        return whole
    thrust = sum(one.static_thrust(acting(one, record.t, _without_gaps(record, one.name))) for one in rotors.each)
    force = np.abs(_without_gaps(record, "az"))
    count = max(1, round(_STEADY_S / record.dt))
    thrust, force = (
        np.convolve(np.pad(x, count // 2, "edge"), np.ones(count) / count, "valid") for x in (thrust, force)
    )
    thrust = thrust[: len(record)]
    force = force[: len(record)]
    in_flight = thrust > 0.5 * np.max(thrust)
    by_force = float(np.median(thrust[in_flight] / np.maximum(force[in_flight], 1.0)))
    carried = force - thrust / max(by_force, 1e-12) < _CARRIED * GRAVITY
    at = np.flatnonzero(carried)
    ratio = thrust / np.maximum(force, 1.0) / max(by_force, 1e-12)
    if len(at) <= 2 * count:
        return whole
    first = int(at[0])
    last = int(at[-1])
    if _follows(ratio[:first]):
        first = 0
    if _follows(ratio[last + 1 :]):
        last = len(record) - 1
    return float(record.t[first]), float(record.t[last])


def _follows(ratio: np.ndarray) -> bool:
    """Return True if the specific force follows the thrust, by their ratio: so it does with another mass in flight, and
    not on the ground, which carries what the rotors leave, and more than half where these idle."""
    return len(ratio) > 0 and float(np.min(ratio)) > 0.5 and float(np.std(ratio)) < _FOLLOWING


def _without_gaps(record: Record, name: str) -> np.ndarray:
    seen = np.isfinite(record[name])
    return np.interp(record.t, record.t[seen], record[name][seen])


def ground(record: Record, rotors: Rotors) -> Iterator[str]:
    """Yield a sentence about a record that begins or ends on the ground."""
    first, last = airborne(record, rotors)
    parts = [f"up to {first:.4g} s"] if first > record.t[0] + _STEADY_S else []
    parts += [f"from {last:.4g} s on"] if last < record.t[-1] - _STEADY_S else []
    if parts:
        yield (
            f"{' and '.join(parts)} the ground carries it: the accelerometer reads gravity, whatever the rotors do; "
            "a diagnosis leaves that out"
        )


def until_one_stands(record: Record, rotors: Rotors) -> Record:
    """The record up to the time from which a rotor stands: its command shows neither why, nor what it still does."""
    begins = [begin for one in standing(record, rotors) for begin, _ in one.intervals_s[record.name]]
    first = min(begins, default=np.inf)
    return record if first - record.t[0] < _STANDS_S or not begins else record.between(float(record.t[0]), first)


def standing(record: Record, rotors: Rotors) -> Iterator[Finding]:
    """Commands that rest while those of the other rotors vary."""
    commands = {name: record[name] for name in rotors.names if name in record}
    for name, series in commands.items():
        others = [other for key, other in commands.items() if key != name]
        rests = np.append(np.diff(series) == 0.0, False)
        spans = []
        for first, last in stretches(rests):
            driven = [np.std(o[first : last + 1]) > _DRIVEN * abs(np.mean(o[first : last + 1])) for o in others]
            if record.t[last] - record.t[first] > _STANDS_S and sum(driven) > len(others) / 2:
                spans.append((float(record.t[first]), float(record.t[last])))
        if spans:
            begin, end = max(spans, key=lambda span: span[1] - span[0])
            level = float(series[np.searchsorted(record.t, begin)])
            yield Finding(
                kind="data_stuck",
                target=name,
                records=(record.name,),
                intervals_s={record.name: tuple(spans)},
                value=level,
                unit="1",
                handled="excluded",
                sentence=f"{name} stands at {level:.4g} from {begin:.4g} to {end:.4g} s in {record.name} while the "
                "other rotors are driven: a motor that failed, or a channel that did. A diagnosis leaves out what "
                "follows.",
            )


def _numbering(record: Record, rotors: Rotors) -> Iterator[Finding]:
    """Another assignment of channels to rotors, if the angular accelerations follow it and not that of the file."""
    if not all(name in record for name in ("p", "q", *rotors.names)):
        return
    names = rotors.names
    count = max(1, round(0.1 / record.dt))
    whole = len(record) // count * count

    def means(series: np.ndarray) -> np.ndarray:
        return series[:whole].reshape(-1, count).mean(axis=1)

    t = means(record.t)
    rates = [means(record[axis]) for axis in "pq"]
    turning = [np.gradient(rate, t) for rate in rates]
    used = np.isfinite(turning[0]) & np.isfinite(turning[1])
    thrusts = np.array(
        [[means(one.static_thrust(acting(one, record.t, record[n]))) for n in names] for one in rotors.each]
    )  # (rotor of the file, channel, time)
    arms = np.array([one.moment_arm[:2] for one in rotors.each])
    if used.sum() < 30:
        return

    own = tuple(range(len(names)))

    def explained(order: Sequence[int]) -> list[float]:
        found = []
        for axis in (0, 1):
            moment = (arms[:, axis] @ thrusts[own, order])[used]
            both = np.corrcoef(moment, turning[axis][used])[0, 1] if np.std(moment) > 0.0 else 0.0
            found.append(max(float(both), 0.0) ** 2)
        return found

    orders = list(permutations(own)) if len(own) <= _MOST_PERMUTED else [own]
    if len(own) > _MOST_PERMUTED:
        for a, b in combinations(own, 2):
            orders.append(tuple(b if i == a else a if i == b else i for i in own))
    shares = {order: explained(order) for order in orders}
    odds = {order: -0.5 * used.sum() / 2.0 * np.sum(np.log1p(-np.minimum(of, 0.999))) for order, of in shares.items()}
    best = max(odds, key=lambda order: odds[order])
    rivals = [order for order in odds if order != best and odds[best] - odds[order] < _CLEAR]
    if best == own or rivals or min(shares[best]) < _FOLLOWS:
        return
    moved = [i for i in own if best[i] != i]
    places = ", ".join(f"{names[best[i]]} drives the rotor of {names[i]}" for i in moved)
    yield Finding(
        kind="data_swap",
        target="+".join(names[i] for i in moved),
        records=(record.name,),
        handled="reported",
        odds=float(np.exp(min(odds[best] - odds[own], 50.0))),
        sentence=f"The rotors of {record.name} are numbered otherwise than in the file: {places} (rolling and pitching "
        f"accelerations follow the commands by {min(shares[best]):.0%} then, by {min(shares[own]):.0%} as it stands).",
    )
