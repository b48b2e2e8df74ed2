"""Cases A-H of the paper (Oezger, AIAA 2010-34, Table 1), and the records that each consists of."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType

from casid.errors import InputError
from problems.manoeuvres import MANOEUVRES

REALISATIONS = 5  # of the noise
VARIANTS = (1, 2, 3)  # of the nonlinear terms; 0 is linear


@dataclass(frozen=True, kw_only=True)
class Case:
    """What a case consists of; `origin` says in words which row of Table 1 it is."""

    nonlinear: bool
    destabilised: bool
    noisy: bool
    origin: str


CASES: Mapping[str, Case] = MappingProxyType(
    {
        "A": Case(nonlinear=False, destabilised=False, noisy=False, origin="linear"),
        "B": Case(nonlinear=False, destabilised=False, noisy=True, origin="linear, noise"),
        "C": Case(nonlinear=False, destabilised=True, noisy=False, origin="linear, destabilised"),
        "D": Case(nonlinear=False, destabilised=True, noisy=True, origin="linear, destabilised, noise"),
        "E": Case(nonlinear=True, destabilised=False, noisy=False, origin="nonlinear"),
        "F": Case(nonlinear=True, destabilised=False, noisy=True, origin="nonlinear, noise"),
        "G": Case(nonlinear=True, destabilised=True, noisy=False, origin="nonlinear, destabilised"),
        "H": Case(nonlinear=True, destabilised=True, noisy=True, origin="nonlinear, destabilised, noise"),
    }
)


@dataclass(frozen=True, kw_only=True, order=True)
class Condition:
    """One simulated record: case, manoeuvre 1-8, variant of the nonlinear terms (0: none), noise seed (0: none)."""

    case: str
    manoeuvre: int
    variant: int = 0
    seed: int = 0

    @property
    def name(self) -> str:
        """Short text that identifies the record, e.g. "H-m3-v2-s5"."""
        return f"{self.case}-m{self.manoeuvre}-v{self.variant}-s{self.seed}"


def conditions(cases: Iterable[str], manoeuvres: Iterable[int]) -> Iterator[Condition]:
    """The records of the named cases: with all cases and manoeuvres 8, 40, 8, 40, 24, 120, 24, 120 of them."""
    chosen = tuple(manoeuvres)
    for letter in cases:
        case = CASES[letter]
        for manoeuvre in chosen:
            for variant in VARIANTS if case.nonlinear else (0,):
                for seed in range(1, REALISATIONS + 1) if case.noisy else (0,):
                    yield Condition(case=letter, manoeuvre=manoeuvre, variant=variant, seed=seed)


def parse_cases(text: str) -> tuple[str, ...]:
    """Letters from "A..H", "A,C" or "ACH". Raises InputError for a letter that is no case."""
    first, dots, last = text.strip().upper().partition("..")
    if dots and first in CASES and last in CASES and first <= last:
        return tuple(letter for letter in CASES if first <= letter <= last)
    letters = [letter for letter in first.replace(" ", ",").replace(",", "")] if not dots else []
    if not letters or any(letter not in CASES for letter in letters):
        raise InputError(f"cases '{text}': expected letters of A to H, like A..H or A,C,F")
    return tuple(letter for letter in CASES if letter in letters)


def parse_manoeuvres(text: str) -> tuple[int, ...]:
    """Numbers from "1..8" or "1,3,5". Raises InputError for a number that is no manoeuvre."""
    first, dots, last = text.strip().partition("..")
    try:
        chosen = set(range(int(first), int(last) + 1)) if dots else {int(part) for part in first.split(",")}
    except ValueError:
        chosen = set()
    if not chosen or not chosen <= set(MANOEUVRES):
        raise InputError(f"manoeuvres '{text}': expected numbers of 1 to {max(MANOEUVRES)}, like 1..8 or 1,3")
    return tuple(sorted(chosen))
