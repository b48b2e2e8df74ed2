"""What a diagnosis found, as data: the contents of diagnosis.json, and the evidence behind it for the report."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from casid.diagnosis.evaluation import Fit
from casid.diagnosis.kinematic_check import KinematicCheck
from casid.diagnosis.kinematics import Turbulence
from casid.diagnosis.missing_input import MissingInput
from casid.diagnosis.screening import Candidate
from casid.diagnosis.statistics import ChannelFit, Simulated
from casid.model.aircraft import Aircraft
from casid.model.effect import Effect

SCHEMA = "casid.diagnosis/1"


@dataclass(frozen=True, eq=False, kw_only=True)
class Cause:
    """A named cause, or one that is real but minor.

    std            1-sigma of the value, small terms of the structure and unlike stretches of record allowed for
    statistic      drop of the deviance (2 ln L) when it is added and everything is fitted again, `dof` its parameters;
                   the model without it is given no more bent coefficients than are left beside it
    held_out_gain  log likelihood per sample gained on records never used; None for an event, which does not recur
    onset_s        record -> interval [s] that contains the onset with 95 % probability, for a cause that sets in
    share          its part of the variation of the coefficient it adds to, or of its smallest size that matters
    """

    kind: str
    target: str
    term: str | None
    value: float
    std: float
    unit: str
    records: tuple[str, ...]
    onset_s: Mapping[str, tuple[float, float]] | None
    statistic: float
    dof: int
    p_value: float
    held_out_gain: float | None
    indistinguishable_from: tuple[Mapping[str, Any], ...]
    sentence: str
    parameters: Mapping[str, float]
    meaningful: bool
    share: float

    @property
    def told(self) -> str:
        """Its sentence, and what these data cannot tell it apart from."""
        others = []
        for one in self.indistinguishable_from:
            inside = ":".join(str(part) for part in (one["target"], one["term"]) if part)
            others.append(f"{one['kind']}({inside})" if inside else str(one["kind"]))
        alike = f" These data cannot tell that apart from {' or '.join(others)}." if others else ""
        return self.sentence + alike


@dataclass(frozen=True, eq=False, kw_only=True)
class Trial:
    """A cause that was fitted, or refuted at once; then its values, gain and 1-sigma are the predicted ones.

    candidate    with the fitted values; `std` of its value
    fit          the whole fit, kept of a round's winner only
    fingerprint  its whitened sensitivity, projected off the derivatives fitted beside it; none when refuted at once
    gain         drop of the deviance; `net` is less its price; `excess` what it would gain besides if the coefficients
                 were as little bent without it as they are beside it; `total` both
    exact        drop of the deviance with the structure taken as exact
    where        (N, R) part of the gain that is made at each sample; empty when refuted at once
    share        its size in units of the smallest that matters; `meaningful` when it matters and is plausible
    check        what kinematics say of it; `given_up` when they refuted it, or it could not fly, before it was fitted
    """

    candidate: Candidate
    std: float
    fit: Fit | None
    fingerprint: np.ndarray
    gain: float
    net: float
    excess: float
    exact: float
    where: np.ndarray
    meaningful: bool
    share: float
    check: KinematicCheck = KinematicCheck()
    given_up: bool = False

    @property
    def effect(self) -> Effect:
        return self.candidate.attached.effect

    @property
    def refuted(self) -> bool:
        """Whether kinematics contradict it."""
        return self.given_up or self.check.refuted

    @property
    def confirmed(self) -> bool:
        """Whether kinematics find it with this size."""
        return self.check.confirmed

    @property
    def total(self) -> float:
        """By how much it explains better than the model without it, in the structure that it leaves: what bends a
        coefficient less leaves less to explain."""
        return self.net + self.excess


@dataclass(frozen=True, eq=False, kw_only=True)
class Round:
    """One round of naming: all candidates by predicted net gain, what was fitted of them, best first, and which
    trials cannot be told from the winner."""

    candidates: tuple[Candidate, ...]
    trials: tuple[Trial, ...]
    equivalents: tuple[Trial, ...]
    named: bool

    @property
    def winner(self) -> Fit:
        """The fit with the named cause; only a round that named one has it."""
        fit = self.trials[0].fit
        if fit is None:
            raise ValueError("this round named no cause")
        return fit


@dataclass(frozen=True, eq=False, kw_only=True)
class View:
    """A fitted model and how it explains a set of records."""

    fit: Fit
    simulated: Simulated
    channels: Mapping[str, ChannelFit]

    @property
    def log_likelihood(self) -> float:
        """ln L of the innovations, with its constant."""
        samples = self.fit.readings
        return -0.5 * (self.fit.data_deviance + samples * math.log(2.0 * math.pi))

    @property
    def samples(self) -> int:
        return self.fit.readings


@dataclass(frozen=True, eq=False, kw_only=True)
class Diagnosis:
    """The verdict and everything it rests on.

    baseline, extended            on the records that were fitted; `held_out_*` on records never used
    missing_before, missing_after anonymous inputs: where something is missing, before and after naming, the structure
                                  taken as exact (the verdict allows for small terms besides)
    unexplained                   what of it gains and matters still, small terms allowed for
    kinematic                     instrument and air causes scored with forces left free, empty when not available
    detectable                    cause name -> smallest size that these records would show
    seconds                       wall time per stage
    """

    verdict: str
    sentence: str
    aircraft: Aircraft
    extended_aircraft: Aircraft
    causes: tuple[Cause, ...]
    minor: tuple[Cause, ...]
    ranking: tuple[Candidate, ...]
    rounds: tuple[Round, ...]
    baseline: View
    extended: View
    held_out_baseline: View | None
    held_out_extended: View | None
    missing_before: tuple[MissingInput, ...]
    missing_after: tuple[MissingInput, ...]
    unexplained: tuple[MissingInput, ...]
    kinematic: tuple[Candidate, ...]
    turbulence: Turbulence
    detectable: Mapping[str, float]
    seconds: Mapping[str, float]

    @property
    def bic(self) -> float:
        """Change of the Bayesian information criterion by the named causes; negative is better."""
        parameters = sum(cause.dof for cause in self.causes)
        return self.extended.fit.deviance - self.baseline.fit.deviance + parameters * math.log(self.baseline.samples)

    def __str__(self) -> str:
        lines = [f"verdict: {self.verdict}", self.sentence]
        lines += [f"  - {cause.sentence} (gain {cause.statistic:.0f})" for cause in self.causes]
        lines += [f"  - minor: {cause.sentence}" for cause in self.minor]
        return "\n".join(lines)

    def to_dict(self) -> dict[str, Any]:
        """The document of diagnosis.json."""
        return {
            "schema": SCHEMA,
            "verdict": self.verdict,
            "sentence": self.sentence,
            "causes": [_cause(cause) for cause in self.causes],
            "minor": [_cause(cause) for cause in self.minor],
            "ranking": [_rank(candidate) for candidate in self.ranking],
            "baseline": _view(self.baseline),
            "extended": _view(self.extended),
            "gain": {"held_out": self._held_out(), "bic": self.bic},
            "missing": {
                "before": {m.station: m.gain for m in self.missing_before},
                "after": {m.station: m.gain for m in self.missing_after},
            },
            "smallest_detectable": dict(self.detectable),
            "seconds": dict(self.seconds),
        }

    def _held_out(self) -> dict[str, Any]:
        before, after = self.held_out_baseline, self.held_out_extended
        if before is None or after is None:
            return {"records": [], "rms_ratio": {}, "log_likelihood_per_sample": None}
        return {
            "records": list(before.fit.flight.names),
            "rms_ratio": {o: after.channels[o].rms / c.rms for o, c in before.channels.items() if c.rms > 0},
            "log_likelihood_per_sample": (after.log_likelihood - before.log_likelihood) / before.samples,
        }

    def write(self, path: str | Path) -> None:
        """Write diagnosis.json whole or not at all."""
        target = Path(path)
        temporary = target.with_suffix(".tmp")
        temporary.write_text(json.dumps(_plain(self.to_dict()), indent=1, allow_nan=False), encoding="utf-8")
        temporary.replace(target)


def _cause(cause: Cause) -> dict[str, Any]:
    return {
        "kind": cause.kind, "target": cause.target, "term": cause.term, "value": cause.value, "std": cause.std,
        "unit": cause.unit, "records": list(cause.records),
        "onset_s": {r: list(i) for r, i in cause.onset_s.items()} if cause.onset_s else None,
        "statistic": cause.statistic, "dof": cause.dof, "p_value": cause.p_value,
        "held_out_gain": cause.held_out_gain,
        "indistinguishable_from": [dict(other) for other in cause.indistinguishable_from],
        "sentence": cause.sentence, "parameters": dict(cause.parameters), "share": cause.share,
    }  # fmt: skip


def _rank(candidate: Candidate) -> dict[str, Any]:
    effect = candidate.attached.effect
    return {
        "kind": effect.kind, "target": effect.target, "term": effect.term, "statistic": candidate.statistic,
        "p_value": candidate.p_value, "value": candidate.value, "std": candidate.std,
        "surviving": candidate.surviving,
    }  # fmt: skip


def _view(view: View) -> dict[str, Any]:
    return {
        "channels": {
            name: {"rms": c.rms, "noise": c.noise, "whiteness_p": c.whiteness_p, "theil": c.theil, "R2": c.R2}
            for name, c in view.channels.items()
        },
        "log_likelihood": view.log_likelihood,
    }


def _plain(value: Any) -> Any:
    """Numbers and containers that JSON knows; a number that is not finite becomes null."""
    if isinstance(value, Mapping):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(v) for v in value]
    if isinstance(value, (bool, str)) or value is None:
        return value
    if isinstance(value, (int, np.integer)):
        return int(value)
    number = float(value)
    return number if math.isfinite(number) else None
