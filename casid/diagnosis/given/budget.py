"""The error budget: the error on held-out records after each step from the file as given to the best model.

as given -> data corrected -> values of the file -> structure (causes) -> unexplained -> noise. A step that makes a
channel worse is a loss in the budget.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any, ClassVar

import numpy as np

from casid.above import ask_above
from casid.diagnosis.flight.noise import View, expected_error, most_by_chance
from casid.diagnosis.given.as_given import AsGiven
from casid.signals import label_of


@dataclass(frozen=True, kw_only=True)
class BudgetSteps:
    """R.m.s. of measured minus simulated after each step, in units of the channel's noise, which itself is 1.

    `expected` is the error that the right model would have: a free simulation cannot follow noise of the inputs and
    moving air. What `structure` has above it is unexplained. A simulation as given begins where the first readings
    are, and is led astray by their noise as well: `by_chance` is the error that the right values exceed in one case of
    twenty. Infinite if a simulation diverges.
    """

    as_given: float
    data_mended: float
    values: float
    structure: float
    noise: float = 1.0
    expected: float = 1.0
    by_chance: float = 1.0

    @property
    def floor(self) -> float:
        """The error that needs no explanation."""
        return max(self.noise, self.expected)

    def over(self, step: str) -> float:
        """Error after a step, in units of the error that the right model would have."""
        return getattr(self, step) / self.floor


@dataclass(frozen=True, kw_only=True)
class RecordError:
    """The error of one record, root mean square over its channels in units of their noise."""

    record: str  # its name
    held_out: bool  # whether no fit has seen it
    as_given: float  # as_given, left: error of the simulation as given, and of the best model
    left: float
    expected: float  # error that the right model would have
    worst: str  # the channel with the largest error as given


@dataclass(frozen=True, kw_only=True)
class Budget:
    """Channel -> its steps in open-loop simulation of `records`, which no fit has seen; and those of all channels
    together, root mean square over the channels. `labels` are words for channels, where these are an aircraft's.
    `by_record` has fitted records too."""

    in_json: ClassVar[str] = "records channels all=together"

    records: tuple[str, ...]
    channels: Mapping[str, BudgetSteps]
    together: BudgetSteps
    labels: Mapping[str, str] = field(default_factory=dict)
    by_record: tuple[RecordError, ...] = ()

    def plot(self) -> Any:
        """The steps of every channel as a waterfall, worst as given first.

        Returns a matplotlib figure, which pyplot has: a notebook shows it, and `plt.show()`.
        """
        return ask_above("Budget.plot", self)

    def worst(self, step: str = "as_given") -> list[str]:
        """The channels by their error after a step, in units of the error of the right model, worst first."""
        return sorted(self.channels, key=lambda name: -self.channels[name].over(step))


def budget_of(given: AsGiven, values: View, structure: View, fitted: View) -> Budget:
    """The budget on held-out records of the file as given, and of the simulations with re-estimated `values` and with
    extended `structure`; `fitted` is the latter on the fitted records.
    """
    views = {"as_given": given.held, "data_mended": given.mended[1], "values": values, "structure": structure}
    shared = [name for name in given.held.channels if all(name in view.channels for view in views.values())]
    sigma = {view: expected_error(view.fit) for view in (structure, fitted)}
    by_chance = most_by_chance(structure.fit)
    channels = {
        name: BudgetSteps(
            **{step: _in_noise(view, name, structure) for step, view in views.items()},
            expected=_of_recorded(sigma[structure], name, structure),
            by_chance=by_chance[name],
        )
        for name in shared
    }
    together = BudgetSteps(
        **{one.name: _mean([getattr(c, one.name) for c in channels.values()]) for one in fields(BudgetSteps)}
    )
    labels = {name: label_of(name) for name in shared} if given.held.fit.flight.coefficients else {}
    by_record = [
        *_by_record(given.fitted, fitted, sigma[fitted], held_out=False),
        *_by_record(given.held, structure, sigma[structure], held_out=True),
    ]
    return Budget(
        records=given.held.records, channels=channels, together=together, labels=labels, by_record=tuple(by_record)
    )


def _mean(errors: Sequence[float]) -> float:
    """Root mean square over channels."""
    return math.sqrt(math.fsum(one**2 for one in errors) / len(errors)) if errors else 0.0


def _in_noise(view: View, channel: str, best: View) -> float:
    """Error in units of the noise of the best model. Noise that is estimated from residuals differs between fits."""
    return view.channels[channel].rms / best.channels[channel].noise


def _of_recorded(sigma: np.ndarray, channel: str, view: View) -> float:
    """R.m.s. of a 1-sigma (N, R, ny) over the readings of a channel as recorded, in units of its noise."""
    fit = view.fit
    i = fit.model.outputs.index(channel)
    noise = fit.noise.measurement[channel]
    every = fit.flight.every
    seen = fit.seen[..., i]
    variance = float(np.mean(sigma[..., i][seen] ** 2)) if seen.any() else noise**2
    return math.sqrt((variance / noise**2 + every - 1) / every)


def _by_record(as_given: View, best: View, sigma: np.ndarray, *, held_out: bool) -> Iterator[RecordError]:
    """Errors of the records of two views."""
    for r, record in enumerate(best.records):
        given = _in_record(as_given, r, best)
        left = _in_record(best, r, best)
        shared = [name for name in given if name in left]
        if not shared or record not in as_given.records:
            continue
        outputs = best.fit.model.outputs
        noise = best.fit.noise.measurement
        every = best.fit.flight.every
        seen = best.fit.seen[:, r]
        variance = np.sum(np.where(seen, sigma[:, r] ** 2, 0.0), axis=0) / np.maximum(seen.sum(axis=0), 1)
        expected = [variance[outputs.index(name)] / noise[name] ** 2 for name in shared]
        yield RecordError(
            record=record,
            held_out=held_out,
            as_given=_mean([given[name] for name in shared]),
            left=_mean([left[name] for name in shared]),
            expected=_mean([math.sqrt((one + every - 1) / every) for one in expected]),
            worst=max(shared, key=lambda name: given[name]),
        )


def _in_record(view: View, r: int, best: View) -> dict[str, float]:
    """Channel -> error in a record, in units of the noise of the best model."""
    found = {}
    every = best.fit.flight.every
    for i, name in enumerate(view.fit.model.outputs):
        error = view.simulated.residual[:, r, i]
        if name in best.channels and not np.isnan(error).all():
            noise = best.fit.noise.measurement[name]
            with np.errstate(over="ignore"):  # of a simulation that departs
                found[name] = math.sqrt((float(np.nanmean((error / noise) ** 2)) + every - 1) / every)
    return found


@dataclass(frozen=True, kw_only=True)
class AccountStep:
    """One step from the simulation as given to the noise."""

    in_json: ClassVar[str] = "step from=before to=after share what grown_to"

    step: str  # "data", "values", "structure", "unexplained" or "noise"
    # before, after: error on the held-out records before and after it, r.m.s. over all channels in units of their
    # noise. A step that makes it worse leaves it where it was.
    before: float
    after: float
    # part of the error as given that it takes away, from 0 to 1; the shares of all steps add up to 1. NaN if the
    # simulation as given diverges.
    share: float
    what: tuple[str, ...] = ()  # its contributions in words, the largest first
    grown_to: float | None = None  # error after a step that makes it worse; None for any other


def account_of(budget: Budget, what: Mapping[str, Sequence[str]]) -> tuple[AccountStep, ...]:
    """The steps of a budget, the largest share first, what is left last; `what` has the contributions of each step."""
    steps = budget.together
    level = steps.as_given
    last = steps.as_given
    found = []
    whole = level if math.isfinite(level) and level > 0.0 else math.nan
    for name, reached in (("data", steps.data_mended), ("values", steps.values), ("structure", steps.structure)):
        after = min(level, reached)
        grown = reached if reached > last else None
        told = tuple(what.get(name, ()))
        share = (level - after) / whole
        found.append(AccountStep(step=name, before=level, after=after, share=share, what=told, grown_to=grown))
        level = after
        last = reached
    floor = min(steps.floor, level)
    told = tuple(what.get("unexplained", ()))
    left = [
        AccountStep(step="unexplained", before=level, after=floor, share=(level - floor) / whole, what=told),
        AccountStep(step="noise", before=floor, after=0.0, share=floor / whole, what=tuple(what.get("noise", ()))),
    ]
    return (*sorted(found, key=lambda one: -one.share if math.isfinite(one.share) else math.inf), *left)
