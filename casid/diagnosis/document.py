"""The document of a diagnosis: words, numbers and arrays, of which a page is drawn without a fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from casid.data_check.reading import Finding
from casid.design.next_flight import NextFlights, Untold
from casid.diagnosis.cause import Trace
from casid.diagnosis.criteria import Criteria
from casid.diagnosis.facts import Parameter
from casid.diagnosis.flight.noise import ChannelStatistics
from casid.diagnosis.given.budget import Budget
from casid.diagnosis.given.contradicted import Contradiction, FlightValue
from casid.diagnosis.given.scope import NotJudged
from casid.diagnosis.given.shape import Shape
from casid.frequency.response import FrequencyResponse
from casid.model.aircraft import Aircraft
from casid.records.record import Record


@dataclass(frozen=True, eq=False, kw_only=True)
class Simulated:
    """Open-loop simulation of some records by one model, with its statistics."""

    records: tuple[Record, ...]
    outputs: tuple[str, ...]
    inputs: tuple[str, ...]
    units: Mapping[str, str]  # of the outputs of a system; those of an aircraft are known by name
    channels: Mapping[str, ChannelStatistics]
    output: np.ndarray  # (N, R, outputs)
    residual: np.ndarray  # (N, R, outputs) measured minus simulated, NaN where not measured
    white: np.ndarray  # (N, R, outputs) whitened innovations of the fit
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
    parameters: Mapping[str, float]
    indistinguishable_from: tuple[Mapping[str, Any], ...]
    onset_s: Mapping[str, tuple[float, float]] | None
    end_s: Mapping[str, tuple[float, float]] | None
    held_out_gain: float | None
    probability: float | None
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
class Suspect:
    """An instrument or a motion of the air that the kinematics judge: its strongest fault."""

    title: str
    kind: str
    value: float
    unit: str
    statistic: float


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

    station: str
    called: str  # the port in words, where these are not those of the station
    fitted: bool  # whether it enters in fitted records
    probability: float | None
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


@dataclass(frozen=True, eq=False, kw_only=True)
class Document:
    """What a page of a diagnosis shows."""

    # what was diagnosed: its name; the words for its values, and for what speaks against them
    name: str
    source: str
    witness: str
    aircraft: Aircraft | None  # as given; None for another system
    # the verdict, and its sentences
    verdict: str
    headline: str
    sentence: str
    opening: str
    values_told: str
    moved: tuple[str, ...]
    left: str  # what is left; "" if nothing that matters is
    best: str  # the name of the extended model
    no_cause: str  # the words for causes of which none explains what is left
    not_judged: tuple[NotJudged, ...]
    # data, values and causes
    data: tuple[Finding, ...]
    contradicted: tuple[Contradiction, ...]
    parameters: tuple[Parameter, ...]
    flight: Mapping[str, FlightValue]
    causes: tuple[ReportedCause, ...]
    minor: tuple[ReportedCause, ...]
    explanations: tuple[tuple[tuple[str, ...], float], ...]  # titles of causes, and their probability together
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
    # the search: fitted causes round by round, and |cos| between the fingerprints of those of the first
    tried: tuple[Tried, ...]
    alike: tuple[tuple[str, ...], np.ndarray]
    missing_before: Mapping[str, float]  # port -> statistic of a latent input
    missing_after: Mapping[str, float]
    unexplained: tuple[Unexplained, ...]
    shapes: tuple[Shape, ...]
    suspects: tuple[Suspect, ...]
    turbulent: bool
    gusts: Gusts | None
    axis_responses: AxisResponses | None  # of an aircraft with rotors
    detectable: tuple[Detectable, ...]
    criteria: Criteria
    seconds: Mapping[str, float]
    # what to fly next, and values that more of the same motion would not tell
    next_flights: NextFlights
    limited: tuple[Untold, ...]
    failed: tuple[str, ...]  # what of this could not be computed, with the error

    @property
    def of_aeroplane(self) -> bool:
        """Whether an aircraft without rotors was diagnosed: its coefficients have figures and tables of their own."""
        return self.aircraft is not None and self.aircraft.rotors is None
