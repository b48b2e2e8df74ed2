"""The result of the diagnosis of a dynamic system, in words and as the document of diagnosis.json."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from casid.diagnosis.decision import Trace
from casid.diagnosis.given.account import AccountStep
from casid.diagnosis.given.budget import Budget
from casid.diagnosis.systems.extended import Extended
from casid.diagnosis.systems.flown import Flown
from casid.keeping import whole_file
from casid.model.port import ModelPort as Port
from casid.model.system import Model
from casid.records.record import Record

SCHEMA = "casid.diagnosis/3"


def name_of(kind: str, target: str, term: str | None) -> str:
    """Name of a cause, as "actuator_lag(voltage)" or "missing_term(speed:speed^2)"."""
    return f"{kind}({target}:{term})" if term else f"{kind}({target})"


@dataclass(frozen=True, kw_only=True)
class SystemCause:
    """A named cause.

    Attributes
    ----------
    value, std
        Its size in `unit`, and the 1-sigma by Cramer-Rao.
    probability
        Of the cause or one of those that cannot be separated from it.
    alone
        Probability of the cause itself.
    log_odds
        Of the best fitted model with the cause against the best one without it.
    held_out_gain
        Log likelihood per reading on the held-out records that is lost when the cause is left out.
    onset_s
        Record -> time [s] of the onset; None: it always acts.
    share
        Its size in units of the smallest one that matters at its port or in an output, whichever is larger.

    Examples
    --------
    >>> import casid as cs
    >>> found = cs.diagnose(model, records, hold_out=unseen)  # doctest: +SKIP
    >>> [(cause.sentence, cause.probability) for cause in found.causes]  # doctest: +SKIP
    """

    kind: str
    target: str
    term: str | None
    value: float
    std: float
    unit: str
    records: tuple[str, ...]
    onset_s: Mapping[str, float] | None
    probability: float
    alone: float
    log_odds: float
    held_out_gain: float | None
    indistinguishable_from: tuple[tuple[str, float], ...]
    sentence: str
    share: float

    @property
    def name(self) -> str:
        """As "input_lag(voltage)"."""
        return name_of(self.kind, self.target, self.term)

    def to_dict(self) -> dict[str, Any]:
        """One entry of `causes` or `minor` of diagnosis.json.

        Returns
        -------
        dict
            Numbers, texts, lists and tables, as JSON holds them.
        """
        others = [{"name": name, "probability": p} for name, p in self.indistinguishable_from]
        return {
            "kind": self.kind,
            "target": self.target,
            "term": self.term,
            "value": self.value,
            "std": self.std,
            "unit": self.unit,
            "records": list(self.records),
            "onset_s": {r: [t, t] for r, t in self.onset_s.items()} if self.onset_s else None,
            "probability": self.probability,
            "log_odds": self.log_odds,
            "held_out_gain": self.held_out_gain,
            "indistinguishable_from": others,
            "sentence": self.sentence,
            "share": self.share,
        }


@dataclass(frozen=True, kw_only=True)
class Unexplained:
    """A latent input at a port: its probability, and its size in units of the size that matters."""

    port: Port
    probability: float

    @property
    def sentence(self) -> str:
        """In words."""
        return f"Something that no cause of the library explains enters at {self.port.words}."


@dataclass(frozen=True, kw_only=True)
class ParameterValue:
    """A parameter of the model: nominal, fitted and in the extended model, each fit with its 1-sigma."""

    name: str
    unit: str
    nominal: float
    prior_std: float
    refitted: float
    refitted_std: float
    extended: float
    extended_std: float

    @property
    def contradicted(self) -> bool:
        """Whether the records are inconsistent with the nominal value: the difference exceeds its stated uncertainty
        (10 % if none is stated), and three standard deviations of the fit."""
        margin = self.prior_std if math.isfinite(self.prior_std) else 0.1 * abs(self.nominal)
        return abs(self.extended - self.nominal) > max(margin, 3.0 * self.extended_std)

    def to_dict(self) -> dict[str, Any]:
        """One entry of `parameters`."""
        return {
            "unit": self.unit,
            "a_priori": self.nominal,
            "refitted": {"value": self.refitted, "std": self.refitted_std},
            "extended": {"value": self.extended, "std": self.extended_std},
        }

    def contradiction(self) -> dict[str, Any]:
        """One entry of `contradicted`."""
        return {
            "parameter": self.name,
            "unit": self.unit,
            "given": self.nominal,
            "flight": self.extended,
            "std": self.extended_std,
            "sentence": f"{self.name} is {self.nominal:.4g} in the model; the records say {self.extended:.4g} "
            f"+- {self.extended_std:.2g}.",
        }


@dataclass(frozen=True, eq=False, kw_only=True)
class SystemDiagnosis:
    """The verdict on a simulation of any dynamic system, and the evidence behind it.

    Attributes
    ----------
    verdict
        "adequate", "values wrong", "explained", "partly explained" or "unexplained".
    model
        As it was given.
    extended
        With the named causes and fitted values: `extended.model`, whose records are `extended.prepared(record)`, and
        `values` of its parameters.
    causes, minor
        Named, and real but too small to matter; strongest first.
    unexplained
        Ports at which something enters that no cause explains.
    explanations
        Sets of causes that were fitted -> probability.
    as_given, refitted, extension
        Open-loop simulations of the held-out records: r.m.s. over noise of each output.
    budget
        The same as a table of steps.
    noise
        Output -> 1-sigma of the noise.
    held_out
        The records of these simulations, which no fit has seen.
    seconds
        Wall time.
    account
        Shares of the error on the held-out records that values and structure take away, the largest first.
    trace
        The decisions on every cause that was fitted, see `why` and `why_not`.

    Examples
    --------
    >>> import casid as cs
    >>> found = cs.diagnose(model, records, hold_out=unseen)  # doctest: +SKIP
    >>> found.verdict, found.extended.values  # doctest: +SKIP
    """

    verdict: str
    sentence: str
    model: Model
    extended: Extended
    values: Mapping[str, float]
    causes: tuple[SystemCause, ...]
    minor: tuple[SystemCause, ...]
    unexplained: tuple[Unexplained, ...]
    explanations: Mapping[frozenset[str], float]
    parameters: tuple[ParameterValue, ...]
    as_given: Flown
    refitted: Flown
    extension: Flown
    budget: Budget
    noise: Mapping[str, float]
    held_out: tuple[Record, ...]
    seconds: float
    trace: Trace = Trace()
    account: tuple[AccountStep, ...] = ()

    def why(self, cause: str) -> Trace:
        """The decisions on a cause that was fitted, as of `Diagnosis.why`.

        Parameters
        ----------
        cause
            Name of the cause.

        Returns
        -------
        Trace
            The gates of the cause.
        """
        return self.trace.of(cause)

    def why_not(self, cause: str) -> Trace:
        """The decisions that kept a cause from being named, as of `Diagnosis.why_not`.

        Parameters
        ----------
        cause
            Name of the cause.

        Returns
        -------
        Trace
            The gates that the cause did not pass.
        """
        return self.trace.against(cause)

    @property
    def contradicted(self) -> tuple[ParameterValue, ...]:
        """Values of the model that are inconsistent with the records."""
        return tuple(one for one in self.parameters if one.contradicted)

    def __str__(self) -> str:
        lines = [f"verdict: {self.verdict}", self.sentence]
        lines += [f"  - {one.sentence} (probability {one.probability:.2f})" for one in self.causes]
        lines += [f"  - minor: {one.sentence}" for one in self.minor]
        lines += [f"  - {one.sentence} (probability {one.probability:.2f})" for one in self.unexplained]
        lines += [f"  - {one.contradiction()['sentence']}" for one in self.contradicted]
        steps = self.budget.together
        lines.append(
            f"held-out {', '.join(self.budget.records)}: residual over noise {steps.as_given:.3g} as given, "
            f"{steps.values:.3g} refitted, {steps.structure:.3g} extended"
        )
        return "\n".join(lines)

    def to_dict(self) -> dict[str, Any]:
        """The document of diagnosis.json, as far as it speaks of any system.

        Returns
        -------
        dict
            Numbers, texts, lists and tables, as JSON holds them.
        """
        before, after = self.as_given, self.extension
        ratio = {name: after.rms[name] / rms for name, rms in before.rms.items() if rms > 0.0}
        return {
            "schema": SCHEMA,
            "system": self.model.name,
            "verdict": self.verdict,
            "sentence": self.sentence,
            "not_judged": [],
            "data": [],
            "account": [one.to_dict() for one in self.account],
            "contradicted": [one.contradiction() for one in self.contradicted],
            "causes": [one.to_dict() for one in self.causes],
            "minor": [one.to_dict() for one in self.minor],
            "unexplained": [
                {"port": one.port.name, "kind": one.port.kind, "probability": one.probability, "sentence": one.sentence}
                for one in self.unexplained
            ],
            "decisions": [one.to_dict() for one in self.trace.decisions],
            "explanations": [{"causes": sorted(names), "probability": p} for names, p in self.explanations.items()],
            "budget": self.budget.to_dict(),
            "as_given": _channels(self.as_given, self.noise),
            "refitted": _channels(self.refitted, self.noise),
            "extended": _channels(self.extension, self.noise),
            "gain": {
                "held_out": {
                    "records": list(before.records),
                    "rms_ratio": dict(sorted(ratio.items(), key=lambda item: -item[1])),
                    "log_likelihood_per_sample": after.log_likelihood - before.log_likelihood,
                }
            },
            "parameters": {one.name: one.to_dict() for one in self.parameters},
            "seconds": {"all": self.seconds},
        }

    def write(self, path: str | Path) -> None:
        """Write diagnosis.json whole or not at all; a number that is not finite becomes null.

        Parameters
        ----------
        path
            Name of the file.
        """
        with whole_file(path) as temporary:
            temporary.write_text(json.dumps(_plain(self.to_dict()), indent=1, allow_nan=False), encoding="utf-8")


def _channels(flown: Flown, noise: Mapping[str, float]) -> dict[str, Any]:
    channels = {name: {"rms": rms * noise[name], "noise": noise[name]} for name, rms in flown.rms.items()}
    return {"channels": channels, "log_likelihood": flown.log_likelihood * flown.readings}


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(v) for v in value]
    if isinstance(value, (bool, str, int)) or value is None:
        return value
    return float(value) if math.isfinite(value) else None
