"""The rationale of a test that was out of tolerance: why it was, what was changed, and the proof of the change."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from casid.acceptance.checks import EXTENDED, GIVEN, Cost, MatchedTest, in_words
from casid.diagnosis.result import Diagnosis
from casid.errors import InputError
from casid.records.limits import read_json, sound

_TOLD = 3  # parts that are listed where no single one decides
DIAGNOSIS = "the folder that casid diagnose --out wrote"  # what an error expects


@dataclass(frozen=True, kw_only=True)
class Findings:
    """Findings of a diagnosis, as far as a rationale quotes them."""

    # cause, as in tables `actuator_lag(delta_e)` -> its sentence, with the probability of the cause
    sentences: Mapping[str, str] = field(default_factory=dict)
    fitted: tuple[str, ...] = ()  # fitted, held_out: names of the records that were fitted, and of those that were not
    held_out: tuple[str, ...] = ()
    # channel -> r.m.s. error on the held-out records, extended over as given.
    ratios: Mapping[str, float] = field(default_factory=dict)
    extended: Any = None  # file of the extended aircraft

    def was_fitted(self, record: str) -> bool | None:
        """Say whether a record was fitted; None: the diagnosis does not name it."""
        return True if record in self.fitted else False if record in self.held_out else None


@dataclass(frozen=True, kw_only=True)
class Rationale:
    """The rationale of a test that was out of tolerance."""

    differs: tuple[str, ...]  # what differed, a sentence for each row out of tolerance
    why: tuple[str, ...]  # the causes, a sentence each
    changed: tuple[str, ...]  # what was changed in the simulation, part by part
    proof: tuple[str, ...]  # the same test with the change, records that no fit has used, and every other test again
    accepted: bool  # whether the test is in tolerance now and no other test was lost


def findings_of(diagnosis: Diagnosis | str | Path) -> Findings:
    """Read a diagnosis, or the folder that `casid diagnose` wrote."""
    if isinstance(diagnosis, Diagnosis):
        return _findings(diagnosis.to_dict(), diagnosis.extended_aircraft)
    folder = Path(diagnosis)
    file = folder / "diagnosis.json"
    told = read_diagnosis(file)
    with sound(file, DIAGNOSIS):
        return _findings(told, folder / "extended.toml")


def read_diagnosis(file: Path) -> dict[str, Any]:
    """Read a diagnosis.json. Raises InputError for any other file."""
    told = read_json(file, DIAGNOSIS)
    if not str(told.get("schema", "")).startswith("casid.diagnosis/"):
        raise InputError(f"{file}: no diagnosis; expected {DIAGNOSIS}")
    return told


def _findings(told: Mapping[str, Any], extended: Any) -> Findings:
    gain = (told.get("gain") or {}).get("held_out") or {}
    held_out = tuple(map(str, gain.get("records") or ()))
    causes = told.get("causes") or []
    named = [name for one in (*causes, *(told.get("data") or [])) for name in one.get("records") or []]
    records = set(map(str, (*(told.get("notes") or {}), *named)))
    return Findings(
        sentences={str(one["name"]): _with_probability(one) for one in causes},
        fitted=tuple(sorted(records - set(held_out))),
        held_out=held_out,
        ratios={str(name): float(ratio) for name, ratio in (gain.get("rms_ratio") or {}).items() if ratio is not None},
        extended=extended,
    )


def _with_probability(cause: Mapping[str, Any]) -> str:
    probability = cause.get("probability")
    if not isinstance(probability, (int, float)):
        return str(cause["sentence"])
    return f"{cause['sentence']} Probability {100.0 * probability:.0f} %, among the causes that were considered."


def rationale_of(
    one: MatchedTest, tests: Sequence[MatchedTest], lost: Sequence[MatchedTest], findings: Findings | None
) -> Rationale | None:
    """Write the rationale of a test that the given aircraft fails; None: it does not, or nothing was changed."""
    if not one.costs or one.sides[GIVEN].passed is not False:
        return None
    findings = findings or Findings()
    out = [check for check in one.sides[GIVEN].checks if check.passed is False]
    parts = _decisive(one)
    sentences = [findings.sentences[c.subject] for c in parts if c.subject in findings.sentences]
    rows = [c.part.removeprefix("numbers of ") for c in parts if not c.subject]
    changed = tuple(f"{c.part}: {', '.join(c.changes)}" if c.changes else c.part for c in parts)
    moved = [f"Values of {', '.join(rows)} in the file do not fit this flight; they were re-estimated."] if rows else []
    return Rationale(
        differs=tuple(f"{_capital(check.tolerance.words)}: {in_words(check)}." for check in out),
        why=(*sentences, *moved) or ("No part of the extended aircraft explains it alone.",),
        changed=changed or ("No part of it changes this test by itself.",),
        proof=(_same_test(one), _unused_records(findings), _other_tests(one, tests, lost)),
        accepted=one.sides[EXTENDED].passed is True and not lost,
    )


def _decisive(one: MatchedTest) -> list[Cost]:
    """Parts without which a tolerance is lost; where no single one decides, those whose removal uses most of it."""
    needed = [cost for cost in one.costs if cost.lost]
    if needed:
        return needed
    last = {check.tolerance.name: check.used for check in list(one.sides.values())[-1].checks}

    def added(cost: Cost) -> float:
        rises = [used - last.get(name, math.nan) for name, used in cost.used.items()]
        return max((rise for rise in rises if math.isfinite(rise)), default=0.0)

    return sorted((cost for cost in one.costs if added(cost) > 0.0), key=added, reverse=True)[:_TOLD]


def _same_test(one: MatchedTest) -> str:
    side = one.sides[EXTENDED]
    rows = "; ".join(f"{check.tolerance.words} {in_words(check)}" for check in side.checks)
    used = {True: "This record was fitted.", False: "No fit used this record.", None: ""}[one.fitted]
    return f"Same test with the change: {rows}. {used}".rstrip()


def _unused_records(findings: Findings) -> str:
    if not findings.ratios:
        return "No record was held back: the change has not been tried on records that the fit did not use."
    ratios = sorted(findings.ratios.items(), key=lambda item: item[1])
    told = ", ".join(f"{name} {ratio:.2f}" for name, ratio in ratios)
    grown = [name for name, ratio in ratios if ratio > 1.0]
    worse = f" It grows in {', '.join(grown)}." if grown else ""
    names = ", ".join(findings.held_out)
    return f"On {names}, which no fit used, the r.m.s. error becomes this part of what it was: {told}.{worse}"


def _other_tests(one: MatchedTest, tests: Sequence[MatchedTest], lost: Sequence[MatchedTest]) -> str:
    before = [other for other in tests if other is not one and other.sides[GIVEN].passed is True]
    if not lost and not before:
        return "No other test was in tolerance before, so that none could be lost."
    if not lost:
        return f"Every other test again: all {len(before)} tests that were in tolerance before still are."
    names = ", ".join(f"{other.test.id} in {other.record.name}" for other in lost)
    return f"Every other test again: NOT accepted, out of tolerance now and in tolerance before: {names}."


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]
