"""Who flies: nobody (prepared inputs), a pilot with a delay and a remnant, or an autopilot that holds attitudes."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from problems.strips.planes import Plane

WAYS = ("open", "pilot", "autopilot")
_REACTS_S = 0.26  # a pilot, delay of eye and hand; D. McRuer's crossover models have 0.2 to 0.3 s
_PILOT = {"theta": 0.45, "q": 0.25, "phi": 0.35, "p": 0.15}
_AUTOPILOT = {"theta": 0.8, "q": 0.6, "phi": 0.6, "p": 0.3, "r": 0.5}
_REMNANT = 0.12  # of the amplitude of test inputs
_WASHOUT_S = 2.0
_SLOW = 54.0  # m/s


class Flyer:
    """Commands of one way of flying; `act` is called once a step, with the attitude and rates there."""

    def __init__(self, way: str, plane: Plane, shape: tuple[int, int], dt: float, seed: int) -> None:
        """`shape`: steps, records. Gains are those of a slow aircraft; a fast one answers to less."""
        self._way, self._dt, self._seen = way, dt, []
        self._gain, size = _SLOW / plane.V, plane.size
        self._washed = np.zeros(shape[1])
        white = np.random.default_rng([seed, 6]).standard_normal((shape[0] + 1, 2, shape[1]))
        stays, colour = np.exp(-dt / 0.35), np.zeros_like(white)
        for k in range(1, len(white)):
            colour[k] = stays * colour[k - 1] + np.sqrt(1.0 - stays**2) * white[k]
        self._remnant = _REMNANT * colour * np.array([size["delta_e"], size["delta_a"]])[:, None]

    def act(self, k: int, now: Mapping[str, np.ndarray]) -> np.ndarray:
        """(3, n) elevator, aileron, rudder beside the prepared inputs; phi, theta, p, q, r are from trim."""
        self._seen.append(dict(now))
        if self._way == "open":
            return np.zeros((3, self._washed.size))
        if self._way == "pilot":
            then = self._seen[max(k - round(_REACTS_S / self._dt), 0)]
            elevator, aileron = (
                self._gain * sum(_PILOT[name] * then[name] for name in pair) + remnant
                for pair, remnant in zip((("theta", "q"), ("phi", "p")), self._remnant[k], strict=True)
            )
            return np.stack([elevator, aileron, 0.0 * aileron])
        self._washed += self._dt / _WASHOUT_S * (now["r"] - self._washed)
        now = {**now, "r": now["r"] - self._washed}
        laws = (("theta", "q"), ("phi", "p"), ("r",))
        return np.stack([self._gain * sum(_AUTOPILOT[name] * now[name] for name in law) for law in laws])
