"""The linearised innovations that the score weighs, and what an explanation is.

Nothing here knows of aircraft: any dynamic system may ask.

A fit is linearised, and what is left of every reading is whitened, so that

    y  =  nuisance a  +  small b  +  sum of histories h at ports  +  causes  +  white noise of unit variance

in every record. Whoever asks hands over `WhitenedInnovations`: the columns of all that could be in y, with priors.

    a        what is fitted anyhow (parameters, initial values, offsets): Gaussian, one precision each, 0 where flat
    b        small errors of structure: Gaussian, with the inverse covariance `small_information` at a scale of one. The
             terms of one owner share a scale, which is inferred
    h        an unknown time history at a port, by its values at nodes of time, straight lines between them. Its
             prior is Gaussian with covariance v^2 exp(-|t|/tau), by record, v in units of what matters there
    causes   whitened responses to the named causes that compete, each with a Gaussian amplitude. Of one name there is a
             column for every shape that it may have (onset, grid point of a non-linear size, set of records), and an
             explanation has one of them at most

An explanation is a set of causes and of ports at which something unknown enters. `casid.diagnosis.explanations.search`
goes through them, `posterior` says what follows.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

Unknown = tuple[str, float, float]  # name of it, level v in units of what matters, correlation time [s]


@dataclass(frozen=True, eq=False, kw_only=True)
class RecordColumns:
    """One record, whitened; rows are readings in the order of time.

    residual   (rows,)            y
    nuisance   (rows, k)          response to a unit of each nuisance
    small      (rows, m)          response to each small term
    histories  per port (rows, n) response to a unit at each node; single precision is enough
    shapes     (rows, j)          responses to causes, which `CauseColumn.shape` picks from
    nodes      (n,) time [s] of the nodes of this record
    """

    residual: np.ndarray
    nuisance: np.ndarray
    small: np.ndarray
    histories: tuple[np.ndarray, ...]
    shapes: np.ndarray
    nodes: np.ndarray


@dataclass(frozen=True, kw_only=True)
class HistoryPort:
    """A place where something unknown may enter; `matters`: the level, in the unit of its columns, that matters."""

    name: str
    matters: float


@dataclass(frozen=True, kw_only=True)
class Entrance:
    """Something unknown that enters at one port, or at several of them alike; `log_prior` of its odds."""

    name: str
    ports: tuple[str, ...]
    log_prior: float


@dataclass(frozen=True, eq=False, kw_only=True)
class CauseColumn:
    """A cause in one of its shapes.

    name, kind   of the cause; columns of one name exclude each other
    shape        record number -> column of that record's `shapes`; records that are not there do not have it
    mean, scales of the amplitude: N(mean, s^2) with equal odds for each of the scales
    log_prior    of the odds that the cause is there in this shape
    matters      the amplitude, of either sign, from which it matters
    value        the size of the cause at unit amplitude
    alike        tag of what it may be exchanged with; "": whatever has a response like its own
    """

    name: str
    kind: str
    shape: Mapping[int, int]
    mean: float = 0.0
    scales: tuple[float, ...]
    log_prior: float
    matters: float
    value: float = 1.0
    alike: str = ""


@dataclass(frozen=True, eq=False, kw_only=True)
class WhitenedInnovations:
    """What the score weighs; see the head of this module.

    precision, pull    (k,) of the nuisance: its prior is N(-pull/precision, 1/precision), flat where that is 0
    small_information  (m, m) inverse of the prior covariance of the small terms at a scale of one
    owners             (m,) who owns each of them
    entrances          where something unknown may enter; ports of none only have the base level
    log_determinant    -2 log of what whitening did to the density, so that evidence of different fits compares
    """

    records: tuple[RecordColumns, ...]
    precision: np.ndarray
    pull: np.ndarray
    small_information: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    owners: tuple[str, ...] = ()
    ports: tuple[HistoryPort, ...] = ()
    entrances: tuple[Entrance, ...] = ()
    causes: tuple[CauseColumn, ...] = ()
    log_determinant: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Element:
    """A cause in one of its shapes, its amplitude at one of its scales, in an explanation."""

    column: int
    scale: float


@dataclass(frozen=True, kw_only=True)
class Setting:
    """What every explanation stands on: the base level of the histories at all ports, in units of what matters, and the
    scales of the small terms by owner."""

    level: float
    scales: tuple[tuple[str, float], ...]


@dataclass(frozen=True, kw_only=True)
class Explanation:
    """What may be wrong, as a whole.

    amplitudes  posterior mean and 1-sigma of the amplitude of each element
    large       of each unknown the probability that its history is, in the mean square, as large as matters
    names       of all that it says: causes, and entrances of what is unknown and more likely large than not
    log         of its posterior weight: log evidence and log prior, up to a constant that all have in common
    evidence    its log evidence alone, log p(y | explanation)
    """

    setting: Setting
    unknown: tuple[Unknown, ...]
    elements: tuple[Element, ...]
    amplitudes: tuple[tuple[float, float], ...]
    large: tuple[float, ...]
    names: frozenset[str]
    log: float
    evidence: float
