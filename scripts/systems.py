"""Count how often hidden faults of dynamic systems other than aircraft are found.

    python scripts/systems.py [--seeds 1..10] [--systems "DC motor" ...] [--clean]

Every seed hides one fault in each system; `--clean` hides none. Prints a line per diagnosis and the counts.
"""

from __future__ import annotations

from casid.cli.start import run_script

import argparse
import time

from casid.errors import InputError, unknown
from problems.systems.count import SYSTEMS, outcome

SUMMARY = "found {1} of {0}, sized {2}, further names {3}, told as minor {4}"


def seeds_of(text: str) -> range:
    """ "1..10" as numbers."""
    first, _, last = text.partition("..")
    if not (first.isdigit() and (last or first).isdigit()):
        raise InputError(f"--seeds is '{text}'; expected A..B, like 1..10")
    return range(int(first), int(last or first) + 1)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=(__doc__ or "").split("\n", maxsplit=1)[0],
        epilog="Example: python scripts/systems.py --seeds 1..1",
    )
    parser.add_argument("--seeds", default="1..10")
    parser.add_argument("--systems", nargs="+", default=list(SYSTEMS))
    parser.add_argument("--clean", action="store_true")
    arguments = parser.parse_args()
    seeds = seeds_of(arguments.seeds)
    for name in arguments.systems:
        if name not in SYSTEMS:
            raise unknown("system", name, SYSTEMS)
    all_of_them = [0, 0, 0, 0, 0]
    for name in arguments.systems:
        counts = [0, 0, 0, 0, 0]
        for seed in seeds:
            begin = time.perf_counter()
            one = outcome(SYSTEMS[name], seed, arguments.clean)
            counts = [a + b for a, b in zip(counts, (1, one.found, one.sized, one.extras, one.minor), strict=True)]
            hidden = f"{one.fault.name} {one.fault.size:.4g}" if one.fault else "nothing"
            said = ", ".join(f"{c.name} {c.value:.4g}" for c in one.result.causes)
            minor = "".join(f", minor {c.kind}({c.target}) {c.value:.4g}" for c in one.result.minor)
            left = ", ".join(f"unexplained {u.place.name}" for u in one.result.unexplained)
            mark = "found" if one.found else "minor" if one.minor else "MISSED"
            seconds = time.perf_counter() - begin
            print(
                f"{name} {seed}: {mark:6} {hidden} -> {said or left or one.result.verdict}{minor} ({seconds:.1f} s)",
                flush=True,
            )
        print(f"{name}: {SUMMARY.format(*counts)}", flush=True)
        all_of_them = [a + b for a, b in zip(all_of_them, counts, strict=True)]
    print(f"all: {SUMMARY.format(*all_of_them)}")


if __name__ == "__main__":
    run_script(main)
