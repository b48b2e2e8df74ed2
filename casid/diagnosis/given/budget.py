"""The error budget: the error on held-out records after each step from the file as given to the best model.

as given -> data corrected -> values of the file -> structure (causes) -> unexplained -> noise. A step that makes a
channel worse is a loss in the budget.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from typing import Any

from casid.diagnosis.flight.statistics import View
from casid.diagnosis.given.as_given import AsGiven
from casid.signals import label_of
from casid.views import view


@dataclass(frozen=True, kw_only=True)
class BudgetSteps:
    """R.m.s. of measured minus simulated after each step, in units of the channel's noise, which itself is 1. The
    difference between `structure` and `noise` is unexplained. Infinite if a simulation diverges.
    """

    as_given: float
    data_mended: float
    values: float
    structure: float
    noise: float = 1.0

    @property
    def unexplained(self) -> float:
        """What no step takes away."""
        return self.structure - self.noise


@dataclass(frozen=True, kw_only=True)
class Budget:
    """Channel -> its steps in open-loop simulation of `records`, which no fit has seen; and those of all channels
    together, root mean square over the channels. `labels` are words for channels, where these are an aircraft's."""

    records: tuple[str, ...]
    channels: Mapping[str, BudgetSteps]
    together: BudgetSteps
    labels: Mapping[str, str] = field(default_factory=dict)

    def plot(self) -> Any:
        """The steps of every channel as a waterfall, worst as given first.

        Returns a matplotlib figure, which pyplot has: a notebook shows it, and `plt.show()`.
        """
        return view("budget.plot")(self)

    def to_dict(self) -> dict[str, Any]:
        """`budget` of diagnosis.json."""
        return {
            "records": list(self.records),
            "channels": {name: asdict(steps) for name, steps in self.channels.items()},
            "all": asdict(self.together),
        }


def budget_of(given: AsGiven, values: View, structure: View) -> Budget:
    """The budget on held-out records of the file as given, and of the simulations with re-estimated `values` and with
    extended `structure`.
    """
    views = {"as_given": given.held, "data_mended": given.mended[1], "values": values, "structure": structure}
    shared = [name for name in given.held.channels if all(name in view.channels for view in views.values())]
    channels = {
        name: BudgetSteps(**{step: _in_noise(view, name, structure) for step, view in views.items()}) for name in shared
    }
    together = {
        one.name: math.sqrt(math.fsum(getattr(steps, one.name) ** 2 for steps in channels.values()) / len(channels))
        for one in fields(BudgetSteps)
    }
    labels = {name: label_of(name) for name in shared}
    return Budget(records=given.held.records, channels=channels, together=BudgetSteps(**together), labels=labels)


def _in_noise(view: View, channel: str, best: View) -> float:
    """Error in units of the noise of the best model. Noise that is estimated from residuals differs between fits."""
    return view.channels[channel].rms / best.channels[channel].noise
