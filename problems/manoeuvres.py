"""The eight manoeuvre types of the paper's experiments: sines and boxcars in pitch, roll and yaw.

The paper (Oezger, AIAA 2010-34, Table 1) names the kinds, "one after another or partly overlapping", but neither times
nor sizes; those here are ours. Stick in radians of surface, added to the trim.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from casid.errors import InputError

DURATION, RATE_HZ = 20.0, 50.0
AXES = MappingProxyType({"pitch": 0, "roll": 1, "yaw": 2})  # column of delta_e, delta_a, delta_r


@dataclass(frozen=True)
class Part:
    """Input on one axis: `cycles` alternations from `start` for `duration` [s], first to +amplitude [rad]."""

    axis: str
    shape: str
    start: float
    duration: float
    amplitude: float
    cycles: float

    def at(self, t: np.ndarray) -> np.ndarray:
        """(N,) stick of this part at times t [s]."""
        phase = self.cycles * (t - self.start) / self.duration
        wave = np.sin(2.0 * np.pi * phase)
        # the sample on which a boxcar switches must not depend on rounding of t
        values = np.where(np.floor(2.0 * phase + 1e-9) % 2 == 0, 1.0, -1.0) if self.shape == "boxcar" else wave
        inside = (t >= self.start - 1e-9) & (t < self.start + self.duration - 1e-9)
        return np.where(inside, self.amplitude * values, 0.0)


MANOEUVRES: Mapping[int, tuple[str, tuple[Part, ...]]] = MappingProxyType(
    {
        1: (
            "boxcars one after another",
            (
                Part("pitch", "boxcar", 1, 4, 0.030, 2),
                Part("roll", "boxcar", 6, 4, 0.050, 2),
                Part("yaw", "boxcar", 11, 4, 0.040, 2),
            ),
        ),
        2: (
            "sines one after another",
            (
                Part("pitch", "sine", 1, 5, 0.035, 3),
                Part("roll", "sine", 7, 5, 0.060, 3),
                Part("yaw", "sine", 13, 5, 0.045, 2),
            ),
        ),
        3: (
            "boxcars partly overlapping",
            (
                Part("pitch", "boxcar", 1, 6, 0.025, 3),
                Part("roll", "boxcar", 5, 6, 0.045, 2),
                Part("yaw", "boxcar", 9, 6, 0.035, 2),
            ),
        ),
        4: (
            "sines partly overlapping",
            (
                Part("pitch", "sine", 1, 8, 0.030, 5),
                Part("roll", "sine", 5, 8, 0.055, 4),
                Part("yaw", "sine", 9, 8, 0.040, 3),
            ),
        ),
        5: (
            "boxcars then sines",
            (
                Part("pitch", "boxcar", 1, 2, 0.030, 1),
                Part("roll", "boxcar", 4, 2, 0.050, 1),
                Part("yaw", "boxcar", 7, 2, 0.040, 1),
                Part("pitch", "sine", 10, 3, 0.030, 2),
                Part("roll", "sine", 13, 3, 0.050, 2),
                Part("yaw", "sine", 16, 3, 0.040, 1),
            ),
        ),
        6: (
            "yaw, roll, pitch: sine, boxcar, sine",
            (
                Part("yaw", "sine", 1, 6, 0.040, 2),
                Part("roll", "boxcar", 5, 5, 0.050, 2),
                Part("pitch", "sine", 9, 8, 0.030, 4),
            ),
        ),
        7: (
            "boxcars of three lengths, overlapping",
            (
                Part("pitch", "boxcar", 1, 3, 0.030, 1),
                Part("pitch", "boxcar", 5, 2, 0.030, 2),
                Part("roll", "boxcar", 3, 4, 0.050, 1),
                Part("roll", "boxcar", 8, 2, 0.050, 1),
                Part("yaw", "boxcar", 6, 5, 0.035, 1),
                Part("yaw", "boxcar", 12, 3, 0.035, 1),
            ),
        ),
        8: (
            "all axes at once: sines of different frequency",
            (
                Part("pitch", "sine", 1, 15, 0.025, 9),
                Part("roll", "sine", 1, 15, 0.045, 7),
                Part("yaw", "sine", 1, 15, 0.035, 4),
            ),
        ),
    }
)


def sample_times() -> np.ndarray:
    """(N,) time stamps [s] of every record."""
    return np.arange(int(DURATION * RATE_HZ) + 1) / RATE_HZ


def stick(manoeuvre: int, t: np.ndarray) -> np.ndarray:
    """(N, 3) pitch, roll and yaw stick [rad of delta_e, delta_a, delta_r] about trim.

    Raises InputError for a manoeuvre that does not exist.
    """
    if manoeuvre not in MANOEUVRES:
        raise InputError(f"manoeuvre {manoeuvre} does not exist; expected one of {', '.join(map(str, MANOEUVRES))}")
    out = np.zeros((len(t), 3))
    for part in MANOEUVRES[manoeuvre][1]:
        out[:, AXES[part.axis]] += part.at(t)
    return out
