"""Relations between channels that hold without any aerodynamics: kinematics of a rigid body in calm air.

Every relation gives two series that are equal except for noise: the rate of one channel, and its computation from other
channels. Flat earth, body axes, 3-2-1 Euler angles.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from casid.data_check.criteria import DataCriteria
from casid.data_check.reading import FEWEST_KNOWN, Read
from casid.model.path import GROUND, velocity_over_ground

Pair = tuple[np.ndarray, np.ndarray]
Errors = Callable[[Read, DataCriteria], list[np.ndarray]]


@dataclass(frozen=True, eq=False, kw_only=True)
class Relation:
    """needs: channels that it cannot do without; uses: all that enter; sides: the two series of a record.

    slow: to be seen through the longer window; errors: what ordinary errors of healthy instruments put in, 1-sigma
    each.
    """

    name: str
    needs: tuple[str, ...]
    uses: tuple[str, ...]
    sides: Callable[[Read, float], Pair]
    slow: bool = False
    errors: Errors = lambda c, criteria: []


def _bank(c: Read, g: float) -> Pair:
    phi = c.value("phi")
    theta = c.value("theta")
    return c.rate("phi"), c.value("p") + np.tan(theta) * (c.value("q") * np.sin(phi) + c.value("r") * np.cos(phi))


def _pitch(c: Read, g: float) -> Pair:
    phi = c.value("phi")
    return c.rate("theta"), c.value("q") * np.cos(phi) - c.value("r") * np.sin(phi)


def _heading(c: Read, g: float) -> Pair:
    phi = c.value("phi")
    return c.rate("psi"), (c.value("q") * np.sin(phi) + c.value("r") * np.cos(phi)) / np.cos(c.value("theta"))


def _gravity(c: Read, g: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Acceleration [m/s2] of the aircraft along body axes: specific force and gravity."""
    phi = c.value("phi")
    theta = c.value("theta")
    return (
        c.value("ax") - g * np.sin(theta),
        c.value("ay") + g * np.sin(phi) * np.cos(theta),
        c.value("az") + g * np.cos(phi) * np.cos(theta),
    )


def _speed(c: Read, g: float) -> Pair:
    alpha = c.value("alpha")
    beta = c.value("beta")
    x, y, z = _gravity(c, g)
    return c.rate("V"), np.cos(beta) * (np.cos(alpha) * x + np.sin(alpha) * z) + np.sin(beta) * y


def _attack(c: Read, g: float) -> Pair:
    alpha = c.value("alpha")
    beta = c.value("beta")
    x, _, z = _gravity(c, g)
    turned = c.value("q") - np.tan(beta) * (c.value("p") * np.cos(alpha) + c.value("r") * np.sin(alpha))
    return c.rate("alpha"), turned + (np.cos(alpha) * z - np.sin(alpha) * x) / (c.value("V") * np.cos(beta))


def _sideslip(c: Read, g: float) -> Pair:
    alpha = c.value("alpha")
    beta = c.value("beta")
    x, y, z = _gravity(c, g)
    turned = c.value("p") * np.sin(alpha) - c.value("r") * np.cos(alpha)
    across = np.cos(beta) * y - np.sin(beta) * (np.cos(alpha) * x + np.sin(alpha) * z)
    return c.rate("beta"), turned + across / c.value("V")


def _climb(c: Read, g: float) -> Pair:
    alpha, beta, phi, theta = (c.value(name) for name in ("alpha", "beta", "phi", "theta"))
    climbing = (
        np.cos(alpha) * np.cos(beta) * np.sin(theta)
        - np.sin(beta) * np.sin(phi) * np.cos(theta)
        - np.sin(alpha) * np.cos(beta) * np.cos(phi) * np.cos(theta)
    )
    return c.rate("altitude"), c.value("V") * climbing


def _over_ground(name: str) -> Callable[[Read, float], Pair]:
    """Rate of a velocity over ground, and the acceleration along that axis of the earth."""

    def sides(c: Read, g: float) -> Pair:
        attitude = {angle: c.value(angle) for angle in (*_ATTITUDE, "psi")}
        along = velocity_over_ground(attitude | dict(zip("uvw", _gravity(c, g), strict=True)))
        return c.rate(name), along[name].full().ravel()

    return sides


def _travelled(place: str, velocity: str) -> Callable[[Read, float], Pair]:
    return lambda c, g: (c.rate(place), c.value(velocity))


def _of_rate(rate: str) -> Callable[[Read, float], Pair]:
    return lambda c, g: (c.rate(rate), c.value(f"{rate}dot"))


def _vane(rates: tuple[str, ...], other: str) -> Errors:
    """Rates of a flow angle that a vane away from the c.g. senses, from rotation that gathers speed, and by the `other`
    angle, whose upwash or sidewash it reads, too."""

    def errors(c: Read, by: DataCriteria) -> list[np.ndarray]:
        arms = {"q": by.usual_span, "r": by.usual_span, "p": by.fair * by.usual_span}
        turning = [arms[name] * c.rate(name) / np.maximum(c.value("V"), 1.0) for name in rates if c.has(name)]
        return [*turning, *(by.fair * c.rate(name) for name in (other,) if c.has(name))]

    return errors


def _static_port(c: Read, by: DataCriteria) -> list[np.ndarray]:
    """Rates of an airspeed whose static pressure depends on the angle of attack."""
    return [by.fair * c.value("V") * c.rate("alpha")] if c.has("V", "alpha") else []


_ATTITUDE = ("phi", "theta")
_RATES = ("p", "q", "r")
_FORCES = ("ax", "ay", "az")
RELATIONS: tuple[Relation, ...] = (
    Relation(name="phi", needs=("phi", "p"), uses=(*_ATTITUDE, *_RATES), sides=_bank),
    Relation(name="theta", needs=("theta", "q"), uses=("theta", "phi", "q", "r"), sides=_pitch),
    Relation(name="psi", needs=("psi", "r", "phi"), uses=("psi", *_ATTITUDE, "q", "r"), sides=_heading),
    *(Relation(name=f"{r}dot", needs=(r, f"{r}dot"), uses=(r, f"{r}dot"), sides=_of_rate(r)) for r in _RATES),
    Relation(
        name="V",
        needs=("V", "ax", "theta"),
        uses=("V", "alpha", "beta", *_ATTITUDE, *_FORCES),
        sides=_speed,
        slow=True,
        errors=_static_port,
    ),
    Relation(
        name="alpha",
        needs=("alpha", "q", "az", "V", "theta"),
        uses=("V", "alpha", "beta", *_RATES, *_ATTITUDE, *_FORCES),
        sides=_attack,
        errors=_vane(("q",), "beta"),
    ),
    Relation(
        name="beta",
        needs=("beta", "r", "ay", "V", "phi"),
        uses=("V", "alpha", "beta", *_RATES, *_ATTITUDE, *_FORCES),
        sides=_sideslip,
        errors=_vane(("r", "p"), "alpha"),
    ),
    *(
        Relation(name=name, needs=needs, uses=needs, sides=_over_ground(name))
        for name, heading in zip(GROUND, (("psi",), ("psi",), ()), strict=True)
        for needs in [(name, *_FORCES, *_ATTITUDE, *heading)]
    ),
    *(
        Relation(name=place, needs=(place, velocity), uses=(place, velocity), sides=_travelled(place, velocity))
        for place, velocity in zip(("north", "east"), GROUND[:2], strict=True)
    ),
    Relation(
        name="altitude",
        needs=("altitude", "V", "theta", "alpha"),
        uses=("altitude", "V", "alpha", "beta", *_ATTITUDE),
        sides=_climb,
        slow=True,
    ),
)


@dataclass(frozen=True, kw_only=True)
class Agreement:
    """Covariance of two sides, each without its line, and the number of independent samples that it is from.

    `close` is the least that they have unlike, `scale` within which an instrument does not suggest another unit.
    `by_errors` is the log-likelihood of the other side by ordinary errors of instruments alone, without the channel."""

    left: float
    right: float
    both: float
    independent: float
    close: float
    scale: float
    by_errors: float = 0.0

    @property
    def unlike(self) -> float:
        """Part that no common signal of equal size explains: generalised variance over that of two unrelated series,
        from `close` to 1. With noise of their own the covariance of the sides lies between zero and the smaller
        variance, or is taken there."""
        best = min(self._at(gain) for gain in self._gains())
        return float(min(max(best, self.close), 1.0))

    def _gains(self) -> tuple[float, ...]:
        return (1.0, self.scale, 1.0 / self.scale)

    def _at(self, gain: float) -> float:
        left = self.left
        right = gain**2 * self.right
        both = gain * self.both
        if both <= 0.0 or left <= 0.0 or right <= 0.0:
            return 1.0
        if both <= min(left, right):
            return 1.0 - both**2 / (left * right)
        return (left + right - 2.0 * both) / max(left, right)

    @property
    def log_likelihood(self) -> float:
        """Log-likelihood of the samples, over that of two unrelated series; what ordinary errors explain without the
        channel says nothing of it, or a channel that is made small would always fit."""
        return max(-0.5 * self.independent * float(np.log(self.unlike)) - self.by_errors, 0.0)


def agreement(relation: Relation, record: Read, gravity: float, criteria: DataCriteria) -> Agreement | None:
    """Return the agreement of the sides of a relation in a record; None where it lacks a channel."""
    if not record.has(*relation.needs):
        return None
    at = record.known(*relation.uses)
    if at.sum() < FEWEST_KNOWN:
        return None
    rate, made = relation.sides(record, gravity)
    errors = np.reshape(relation.errors(record, criteria), (-1, len(rate)))
    every = int(at.sum() / max(record.independent, 1.0)) + 1
    made = _without_line(made[at])
    seen = _in_time(rate, made, errors, at, every, record.step, criteria)
    found = _agreement(seen, made, record.independent * float(at.mean()), criteria)
    if found is None or not len(errors) or not np.isfinite(errors).all():
        return found
    alone = _in_time(np.zeros(len(rate)), made, errors, at, every, record.step, criteria)
    by_errors = _agreement(alone, made, found.independent, criteria)
    return replace(found, by_errors=by_errors.log_likelihood if by_errors else 0.0)


def _agreement(rate: np.ndarray, made: np.ndarray, independent: float, criteria: DataCriteria) -> Agreement | None:
    """Return the agreement of two series without their lines; None where they are not finite."""
    left, right, both = (
        float(one @ other) / (len(made) - 1) for one, other in ((rate, rate), (made, made), (rate, made))
    )
    if not np.isfinite([left, right, both]).all():
        return None
    return Agreement(
        left=left,
        right=right,
        both=both,
        independent=independent,
        close=criteria.close,
        scale=criteria.own_scale,
    )


def _in_time(
    rate: np.ndarray, other: np.ndarray, errors: np.ndarray, at: np.ndarray, every: int, step: float, by: DataCriteria
) -> np.ndarray:
    """The one side where it is known, without its line and with the ordinary errors that bring it nearest to the other.

    `errors` of the instruments, a delay and a clock that drifts have their prior sizes; the last two are sought step by
    step, since a slope does not find large ones. `every` samples are one independent one.
    """
    if not np.isfinite(errors).all():
        return _without_line(rate[at])
    t = step * np.arange(len(rate))
    ahead = np.stack([np.full(len(t), by.late), by.close * t])  # [s] each in its 1-sigma
    size = np.zeros(2 + len(errors))
    least = max(by.close * float(np.var(rate[at])), 1e-300)
    slopes = np.concatenate([np.zeros((2, len(other))), -_without_line(errors[:, at])])
    shifted = rate
    for _ in range(by.steps):
        moved = _without_line(np.vstack([shifted, ahead * np.gradient(shifted, step)])[:, at])
        slopes[:2] = moved[1:]
        left = other - moved[0] + size[:2] @ slopes[:2]
        noise = max(float(left @ left) / len(left), least) * every
        before = size
        size = np.linalg.solve(slopes @ slopes.T / noise + np.eye(len(size)), slopes @ left / noise)
        shifted = np.interp(t + size[:2] @ ahead, t, rate)
        if np.abs(size - before).max() < by.close:  # 1-sigmas
            break
    return _without_line(shifted[at]) + size[2:] @ slopes[2:]


def _without_line(series: np.ndarray) -> np.ndarray:
    """Series (..., samples) without their mean and slope: the biases of instruments, and their drift."""
    x, square = _line(series.shape[-1])
    flat = series - series.mean(axis=-1, keepdims=True)
    return flat - (flat @ x / square)[..., None] * x


@lru_cache(maxsize=64)
def _line(count: int) -> tuple[np.ndarray, float]:
    """Return a line from -1 to 1, and the sum of its squares."""
    x = np.linspace(-1.0, 1.0, count)
    return x, float(x @ x)
