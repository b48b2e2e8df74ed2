"""The yardstick (`problems.blind.greedy`) and the diagnosis on the same blind sets, a table of both.

    python -m problems.blind.yardstick --seed 6001 --minutes 35 --out out/yardstick

Sets are flown in a fixed order: of do328, jsbsim and strips in turn an effect, nothing, and further effects. None is
begun after so many minutes. What estimates is given the folder with records and aircraft file; answers are opened when
all is done. The same command goes on with the sets that DIR does not have yet.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import casid as cs
from casid.errors import CasidError
from casid.model.effect_value import EffectValue
from problems.blind.case import Answer
from problems.blind.greedy import search
from problems.blind.score import Score, score
from problems.blind.sets import CASES, hide, set_name
from problems.blind.solve import shortened

_KINDS = [case for case in CASES if "-" not in case][:22]  # with one effect of the catalogue
CHOSEN: Mapping[str, list[str]] = {
    "do328": [_KINDS[0], "clean-1", *_KINDS[4:12:4], "clean-2", *_KINDS[12::4]],
    "jsbsim": [_KINDS[1], "clean-1", *_KINDS[5:13:4], "clean-2", *_KINDS[13::4]],
    "strips": ["one-1", "clean-1", "one-2", "one-3", "clean-2", "one-4", "one-5", "one-6"],
}


def by_yardstick(folder: Path, seconds: float) -> dict[str, Any]:
    """What the yardstick finds, in the words of a shortened diagnosis."""
    begin = time.process_time()
    aircraft = cs.Aircraft.read(folder / "aircraft.toml")
    sets = search(aircraft, cs.read_records([folder / "m*.csv"]))
    causes = [{**_words(*one[0]), "indistinguishable_from": [_words(*other) for other in one[1:]]} for one in sets]
    spent = {"all": time.process_time() - begin}
    return {"verdict": "causes" if causes else "adequate", "causes": causes, "contradicted": [], "seconds": spent}


def _words(one: EffectValue, odds: float) -> dict[str, Any]:
    place = {"records": list(one.records), "onset_s": one.onset_s, "std": 0.0, "statistic": odds}
    return {"kind": one.kind, "target": one.target, "term": one.term, "value": one.value, **place}


def by_diagnosis(folder: Path, seconds: float) -> dict[str, Any]:
    """What `cs.diagnose` finds within so many seconds."""
    begin = time.process_time()
    found = cs.diagnose(
        cs.Aircraft.read(folder / "aircraft.toml"), cs.read_records([folder / "m*.csv"]), seconds=seconds
    )
    return shortened(found) | {"seconds": {"all": time.process_time() - begin}}


WAYS: Mapping[str, Callable[[Path, float], dict[str, Any]]] = {"yardstick": by_yardstick, "diagnosis": by_diagnosis}


def main() -> None:
    parser = argparse.ArgumentParser(description="The yardstick and the diagnosis on the same blind sets.")
    parser.add_argument("--seed", type=int, default=6001)
    parser.add_argument("--minutes", type=float, default=35.0, help="no set is begun after that")
    parser.add_argument("--seconds", type=float, default=60.0, help="of wall time that a diagnosis may take")
    parser.add_argument("--out", type=Path, default=Path("out/yardstick"), metavar="DIR")
    given = parser.parse_args()
    end = time.monotonic() + 60.0 * given.minutes
    done: list[tuple[str, str, str]] = []
    for i in range(len(CHOSEN["strips"])):
        for of, cases in CHOSEN.items():
            name = set_name(of, cases[i], given.seed)
            files = [given.out / way / f"{name}.json" for way in WAYS]
            if not all(file.exists() for file in files):
                if time.monotonic() > end:
                    break
                hide(of, cases[i], given.seed, given.out / "sets", given.out / "answers")
                for find, file in zip(WAYS.values(), files, strict=True):
                    if not file.exists():
                        _write(file, find, given.out / "sets" / name, given.seconds)
            done.append((of, cases[i], name))
    scores = {way: [(of, case, _scored(given.out, way, name)) for of, case, name in done] for way in WAYS}
    for way, every in scores.items():
        for of, case, (one, found) in every:
            told = [
                " = ".join(
                    f"{c['kind']}({c['target']}{':' + c['term'] if c['term'] else ''})"
                    for c in (cause, *cause["indistinguishable_from"])
                )
                for cause in found.get("causes", ())
            ]
            hidden = [f"{h.kind}({h.target}{':' + h.term if h.term else ''}) {h.value:.3g}" for h in one.answer.hidden]
            print(
                f"{way} {of} {case}: hidden {hidden}; told {told}; first {one.first}, wrong {one.wrong}, {one.verdict}"
            )
    print(table({way: [(of, one) for of, _, (one, _) in every] for way, every in scores.items()}))


def _write(file: Path, find: Callable[[Path, float], dict[str, Any]], folder: Path, seconds: float) -> None:
    try:
        found = find(folder, seconds)
    except (CasidError, ArithmeticError, ValueError, IndexError) as fault:
        found = {"failed": f"{type(fault).__name__}: {fault}"}
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(json.dumps(found, default=float), encoding="utf-8")


def _scored(out: Path, way: str, name: str) -> tuple[Score, dict[str, Any]]:
    found = json.loads((out / way / f"{name}.json").read_text(encoding="utf-8"))
    return score(Answer.read(out / "answers" / f"{name}.json"), found), found


def table(scores: Mapping[str, list[tuple[str, Score]]]) -> str:
    """Rates of every generator in Markdown, of the ways side by side."""
    lines = [f"| | {' | '.join(scores)} |", "|---|" + "---|" * len(scores)]
    for of in CHOSEN:
        cells = [[one for name, one in every if name == of] for every in scores.values()]
        effect = [[one for one in every if one.answer.hidden] for every in cells]
        clean = [[one for one in every if not one.answer.hidden] for every in cells]
        rows = {
            "one effect: first or in its set": [f"{sum(s.first for s in e)} of {len(e)}" for e in effect],
            "found at all": [f"{sum(s.hits > 0 for s in e)} of {len(e)}" for e in effect],
            "sets with a wrong name": [f"{sum(s.wrong > 0 for s in e)} of {len(e)}" for e in cells],
            "wrong names": [str(sum(s.wrong for s in e)) for e in cells],
            "clean: no name": [f"{sum(s.wrong == 0 for s in e)} of {len(e)}" for e in clean],
            "processor time of a set, median [s]": [_median([s.seconds for s in e]) for e in cells],
        }
        lines += [f"| {of}: {what} | {' | '.join(told)} |" for what, told in rows.items()]
    return "\n".join(lines)


def _median(seconds: list[float]) -> str:
    return f"{sorted(seconds)[len(seconds) // 2]:.0f}" if seconds else "-"


if __name__ == "__main__":
    main()
