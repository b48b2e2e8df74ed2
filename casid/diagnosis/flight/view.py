"""A model and how it explains a set of records: what figures, tables and the document show of it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from casid.diagnosis.flight.evaluation import FlightFit
from casid.diagnosis.flight.statistics import ChannelStatistics, SimulatedRecords, channel_fits, free_simulation


@dataclass(frozen=True, eq=False, kw_only=True)
class View:
    """A fitted model and how it explains a set of records."""

    fit: FlightFit
    simulated: SimulatedRecords
    channels: Mapping[str, ChannelStatistics]

    @property
    def log_likelihood(self) -> float:
        """ln L of the innovations, with its constant."""
        samples = self.fit.readings
        return -0.5 * (self.fit.data_deviance + samples * math.log(2.0 * math.pi))

    @property
    def samples(self) -> int:
        return self.fit.readings

    @property
    def records(self) -> tuple[str, ...]:
        """Names of its records."""
        return self.fit.flight.names

    def to_dict(self) -> dict[str, Any]:
        """`as_given`, `refitted` or `extended` of diagnosis.json."""
        channels = {
            name: {"rms": c.rms, "noise": c.noise, "whiteness_p": c.whiteness_p, "theil": c.theil, "R2": c.R2}
            for name, c in self.channels.items()
        }
        return {"channels": channels, "log_likelihood": self.log_likelihood}


def view_of(fit: FlightFit, start: np.ndarray | None = None) -> View:
    """The view of a fit; its simulation begins at the fitted initial states, or at `start` (R, states)."""
    simulated = free_simulation(fit, start)
    return View(fit=fit, simulated=simulated, channels=channel_fits(fit, simulated))
