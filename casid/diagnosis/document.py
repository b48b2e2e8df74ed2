"""The document of a diagnosis, words, numbers and arrays: it is diagnosis.json, and its page is drawn without a fit."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from casid.data_check.reading import Finding
from casid.design.next_flight import NextFlights, Untold
from casid.diagnosis.cause import Cause, Decision, Trace
from casid.diagnosis.claims import Claim
from casid.diagnosis.criteria import Criteria
from casid.diagnosis.facts import ChangedValue, Combination, Parameter
from casid.diagnosis.flight.noise import ChannelStatistics
from casid.diagnosis.given.budget import AccountStep, Budget
from casid.diagnosis.given.contradicted import Contradiction, FlightValue
from casid.diagnosis.given.factors import Factor
from casid.diagnosis.given.scope import NotJudged
from casid.diagnosis.given.shape import Shape
from casid.frequency.response import FrequencyResponse
from casid.keeping import plain
from casid.model.aircraft import Aircraft
from casid.records.record import Record

SCHEMA = "casid.diagnosis/4"


@dataclass(frozen=True, eq=False, kw_only=True)
class Simulated:
    """Open-loop simulation of some records by one model, with its statistics."""

    in_json: ClassVar[str] = "channels log_likelihood"

    records: tuple[Record, ...]
    outputs: tuple[str, ...]
    inputs: tuple[str, ...]
    units: Mapping[str, str]  # of the outputs of a system; those of an aircraft are known by name
    channels: Mapping[str, ChannelStatistics]
    output: np.ndarray  # (N, R, outputs)
    residual: np.ndarray  # (N, R, outputs) measured minus simulated, NaN where not measured
    white: np.ndarray  # (N, R, outputs) whitened innovations of the fit
    log_likelihood: float  # ln L of the innovations, with its constant
    samples: int  # readings
    bands: np.ndarray  # (bands + 1,) edges of bands of frequency [Hz]
    energy: np.ndarray  # (outputs, bands) energy of the residual over that of the noise

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the records."""
        return tuple(record.name for record in self.records)

    def index(self, channels: Sequence[str]) -> list[int]:
        """Columns of these outputs."""
        return [self.outputs.index(name) for name in channels]


@dataclass(frozen=True, eq=False, kw_only=True)
class History:
    """A latent input in one record: times of its nodes [s], mean and 1-sigma there, and what the named causes put
    there at these times (zero where none was named)."""

    record: str
    t: np.ndarray
    mean: np.ndarray
    sigma: np.ndarray
    named: np.ndarray


@dataclass(frozen=True, eq=False, kw_only=True)
class Term:
    """The missing coefficient beside the term that was named."""

    # record -> (nodes, 3): the variable, the coefficient less the changes of the other derivatives, its 1-sigma
    points: Mapping[str, np.ndarray]
    variable: str  # the variable of the term; the term itself if it has several


@dataclass(frozen=True, eq=False, kw_only=True)
class Answer:
    """Frequency response of flight at a cause, and the same of the simulations as given and extended (None where they
    give none)."""

    flight: FrequencyResponse
    given: np.ndarray | None
    extended: np.ndarray


@dataclass(frozen=True, eq=False, kw_only=True)
class ReportedCause:
    """A named or minor cause with what its figures show; None or empty for what it does not have."""

    in_json: ClassVar[str] = Cause.in_json

    name: str
    kind: str
    target: str
    term: str | None
    title: str
    sentence: str
    statement: str
    value: float
    std: float
    unit: str
    records: tuple[str, ...]
    statistic: float
    dof: int
    share: float
    parameters: Mapping[str, float]
    indistinguishable_from: tuple[Mapping[str, Any], ...]
    onset_s: Mapping[str, tuple[float, float]] | None
    end_s: Mapping[str, tuple[float, float]] | None
    held_out_gain: float | None
    probability: float | None
    alone: float | None
    log_odds: float | None
    enters: str  # the port where it enters; "" if it has none
    regressor: str | None  # of an aerodynamic term
    stochastic: bool  # of turbulence
    shape: Term | None = None
    onsets: Mapping[str, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)  # record -> times [s], statistic
    answer: Answer | None = None
    histories: tuple[History, ...] = ()

    @property
    def key(self) -> tuple[str, str, str | None]:
        """Kind, target and term."""
        return self.kind, self.target, self.term


@dataclass(frozen=True, kw_only=True)
class Tried:
    """A cause that was fitted in a round of the search."""

    round: int  # from 1
    name: str
    title: str
    key: tuple[str, str, str | None]
    value: float
    unit: str
    statistic: float
    named: bool
    refuted: bool  # by the kinematics
    meaningful: bool


@dataclass(frozen=True, kw_only=True)
class Ranked:
    """A cause with the size that one linearisation predicts."""

    in_json: ClassVar[str] = "kind target term statistic value std surviving"

    title: str
    kind: str
    target: str
    term: str | None
    value: float
    std: float
    unit: str
    statistic: float
    surviving: float  # share of the fingerprint that fitted derivatives cannot reproduce


@dataclass(frozen=True, kw_only=True)
class Explanation:
    """Causes that explain the records together, none where nothing is wrong: names, titles, and their probability."""

    in_json: ClassVar[str] = "causes probability"

    causes: tuple[str, ...]
    titles: tuple[str, ...]
    probability: float


@dataclass(frozen=True, kw_only=True)
class Detectable:
    """The smallest size of a cause that the records would have shown; nothing plausible exceeds `limit`."""

    kind: str
    label: str
    size: float
    unit: str
    limit: float


@dataclass(frozen=True, eq=False, kw_only=True)
class Unexplained:
    """A latent input that no cause explains."""

    in_json: ClassVar[str] = "port kind probability share gain sentence"

    station: str
    called: str  # the port in words, where these are not those of the station
    port: str
    kind: str  # of the port
    fitted: bool  # whether it enters in fitted records
    probability: float | None
    share: float  # r.m.s. over the variation at its port
    gain: float  # likelihood-ratio statistic
    sentence: str
    histories: tuple[History, ...]


@dataclass(frozen=True, eq=False, kw_only=True)
class Gusts:
    """Moving air of the most turbulent record: port -> reconstructed velocity [m/s] at the times of the record."""

    record: Record
    velocity: Mapping[str, np.ndarray]
    sigma: float  # the r.m.s. velocity that was named [m/s]


@dataclass(frozen=True, eq=False, kw_only=True)
class AxisResponses:
    """Answers of an aircraft with rotors to steps about an axis: axis -> rate [rad/s], or climb [m/s], at times t."""

    t: np.ndarray
    as_given: Mapping[str, np.ndarray]
    extended: Mapping[str, np.ndarray]


@dataclass(frozen=True, kw_only=True)
class Called:
    """Command line of a diagnosis, as words."""

    records: str = "RECORD ..."
    aircraft: str = "FILE"
    out: str = "OUT"

    @property
    def folder(self) -> str:
        """The folder of the results."""
        return shlex.quote(self.out)

    def inside(self, name: str) -> str:
        """The path of something in that folder."""
        return shlex.quote(f"{self.out}/{name}")


@dataclass(frozen=True, kw_only=True)
class NextStep:
    """Next step, and the command that does it; empty where no command does."""

    in_json: ClassVar[str] = "text command"

    text: str
    command: str = ""

    def __str__(self) -> str:
        return f"next: {self.text}" + (f"\n    {self.command}" if self.command else "")


@dataclass(frozen=True, eq=False, kw_only=True)
class Document:
    """Content of diagnosis.json, and what its page shows."""

    in_json: ClassVar[str] = (
        "verdict sentence next not_judged data notes account factors contradicted moved combinations claims records "
        "held_out_is_new causes minor ranking decisions unexplained shapes explanations believed nothing budget "
        "as_given refitted extended gain parameters=by_name missing smallest_detectable detectable seconds "
        "seconds_of_processor"
    )

    # what was diagnosed: its name; the words for its values, and for what contradicts them
    name: str
    source: str
    witness: str
    aircraft: Aircraft | None  # as given; None for another system
    coefficients: tuple[str, ...]  # of the aerodynamics, which have figures and tables of their own; empty without any
    # the verdict, and its sentences
    verdict: str
    headline: str
    sentence: str
    opening: str
    values_told: str
    account: tuple[AccountStep, ...]
    factors: tuple[Factor, ...]
    moved: tuple[ChangedValue, ...]
    combinations: tuple[Combination, ...]
    claims: tuple[Claim, ...]
    held_out_is_new: bool | str  # true, or why the held-out records are no flights of their own
    left: str  # what is left; "" if nothing that matters is
    best: str  # the name of the extended model
    no_cause: str  # the words for what is left: that no cause explains it, of those that were tried
    not_judged: tuple[NotJudged, ...]
    # data, values and causes
    data: tuple[Finding, ...]
    contradicted: tuple[Contradiction, ...]
    parameters: tuple[Parameter, ...]
    flight: Mapping[str, FlightValue]
    causes: tuple[ReportedCause, ...]
    minor: tuple[ReportedCause, ...]
    ranking: tuple[Ranked, ...]
    explanations: tuple[Explanation, ...]
    believed: Mapping[str, float]  # name of a cause -> probability that it is present and matters
    nothing: float | None  # probability that nothing that matters is wrong
    trace: Trace
    # simulations of fitted and of held-out records
    as_given: Simulated
    refitted: Simulated
    extended: Simulated
    held_out_as_given: Simulated
    held_out_refitted: Simulated
    held_out_extended: Simulated
    budget: Budget
    rms_ratio: Mapping[str, float]
    bic: float  # change of the Bayesian information criterion by the extension
    # the search: fitted causes round by round, and |cos| between the fingerprints of those of the first
    tried: tuple[Tried, ...]
    alike: tuple[tuple[str, ...], np.ndarray]
    missing_before: Mapping[str, float]  # port -> statistic of a latent input
    missing_after: Mapping[str, float]
    unexplained: tuple[Unexplained, ...]
    shapes: tuple[Shape, ...]
    suspects: tuple[Ranked, ...]  # instruments and motions of the air that the kinematics judge
    turbulent: tuple[str, ...]  # records in which the air is turbulent
    gusts: Gusts | None
    axis_responses: AxisResponses | None  # of an aircraft with rotors
    unseen: tuple[Detectable, ...]
    smallest_detectable: Mapping[str, float]  # name of a cause -> size
    detectable: Mapping[str, Mapping[str, float]]  # channel -> kind of fault -> size
    criteria: Criteria
    seconds: Mapping[str, float]
    seconds_of_processor: float
    # what to fly next, and values that more of the same motion would not determine
    next_flights: NextFlights
    limited: tuple[Untold, ...]
    failed: tuple[str, ...]  # what of this could not be computed, with the error
    next: tuple[NextStep, ...] = ()  # what to do now, the most useful first

    @property
    def notes(self) -> dict[str, list[str]]:
        """Record -> notes of its reader; the fitted records, then those held out."""
        return {one.name: list(one.notes) for one in (*self.refitted.records, *self.held_out_as_given.records)}

    @property
    def records(self) -> list[dict[str, Any]]:
        """The errors of every record, and the causes that act in it and not in all."""
        of_some = [one for one in self.causes if len(one.records) < len(self.extended.names)]
        return [
            plain(one)
            | {
                "causes": [cause.name for cause in of_some if one.record in cause.records],
                "turbulent": one.record in self.turbulent,
            }
            for one in self.budget.by_record
        ]

    @property
    def decisions(self) -> tuple[Decision, ...]:
        """The decisions on every cause that was considered."""
        return self.trace.decisions

    @property
    def by_name(self) -> dict[str, Parameter]:
        """The parameters by their names."""
        return {one.name: one for one in self.parameters}

    @property
    def missing(self) -> dict[str, Mapping[str, float]]:
        """Statistics of latent inputs, before and after the causes were named."""
        return {"before": self.missing_before, "after": self.missing_after}

    @property
    def gain(self) -> dict[str, Any]:
        """Gain of the extended model on the held-out records, and by the information criterion."""
        before = self.held_out_as_given
        after = self.held_out_extended
        per_sample = (after.log_likelihood - before.log_likelihood) / before.samples
        held_out = {"records": before.names, "rms_ratio": self.rms_ratio, "log_likelihood_per_sample": per_sample}
        return {"held_out": held_out, "bic": self.bic}

    def to_dict(self) -> dict[str, Any]:
        """The content of diagnosis.json."""
        return {"schema": SCHEMA} | ({} if self.aircraft else {"system": self.name}) | plain(self, self.in_json)
