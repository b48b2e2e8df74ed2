"""A flight record: one manoeuvre, its time stamps and channels in SI units. No dynamics here."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np

from casid.errors import InputError, unknown


@dataclass(frozen=True, eq=False, kw_only=True)
class Record:
    """One manoeuvre.

    t          (N,) time stamps [s], strictly increasing, not necessarily uniform
    channels   name -> (N,) samples in SI units; NaN marks a missing sample of a measured output
    hold       how inputs run between samples: "linear" (sampled continuous signal) or
               "held" (output of a digital control law, constant over the sample that follows)
    source     where it came from, for messages
    """

    name: str
    t: np.ndarray
    channels: Mapping[str, np.ndarray]
    hold: str = "linear"
    source: str = ""
    notes: tuple[str, ...] = field(default=())

    def __post_init__(self) -> None:
        t = np.asarray(self.t, dtype=float)
        channels = {name: np.asarray(values, dtype=float) for name, values in self.channels.items()}
        for name, values in channels.items():
            if values.shape != t.shape:
                raise InputError(f"record '{self.name}': channel '{name}' has shape {values.shape}, time {t.shape}")
        if self.hold not in ("linear", "held"):
            raise unknown("hold", self.hold, ("linear", "held"), f"record '{self.name}'")
        object.__setattr__(self, "t", t)
        object.__setattr__(self, "channels", MappingProxyType(channels))

    def __getitem__(self, channel: str) -> np.ndarray:
        if channel == "t":
            return self.t
        if channel not in self.channels:
            raise unknown("channel", channel, self.channels, f"record '{self.name}'")
        return self.channels[channel]

    def __contains__(self, channel: str) -> bool:
        return channel in self.channels

    def __len__(self) -> int:
        return len(self.t)

    @property
    def dt(self) -> float:
        """Median sampling interval [s]."""
        return float(np.median(np.diff(self.t)))

    @property
    def duration(self) -> float:
        """Time from first to last sample [s]."""
        return float(self.t[-1] - self.t[0])

    def matrix(self, names: Iterable[str]) -> np.ndarray:
        """(N, channels) of the named channels."""
        return np.stack([self[name] for name in names], axis=1)

    def with_channels(self, **channels: np.ndarray) -> Record:
        """The same record with channels added or replaced."""
        return replace(self, channels={**self.channels, **channels})

    def without(self, *names: str) -> Record:
        """The same record without the named channels."""
        return replace(self, channels={k: v for k, v in self.channels.items() if k not in names})

    def between(self, start: float, stop: float, name: str | None = None) -> Record:
        """The part with start <= t < stop [s], time stamps kept."""
        keep = (self.t >= start) & (self.t < stop)
        channels = {k: v[keep] for k, v in self.channels.items()}
        return replace(self, name=name or self.name, t=self.t[keep], channels=channels)
