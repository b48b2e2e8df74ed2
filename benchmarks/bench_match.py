"""What does a proof of match cost?

Question     How long does it take to judge eight channels, with and without an extended aircraft?
Set-up       A held-out record of the demonstration, 26 s at 50 Hz, with two inputs of the elevator; tolerances of eight
             channels at both. First the aircraft file alone; then an extended one beside it, with a lag of the elevator
             and other numbers of six coefficients, each of which is taken out in turn: nine simulations of each
             manoeuvre. Seconds: the least of the repetitions, processor time, models made anew and kernels compiled
             before.
Expectation  Less than 1 s in all.

    python benchmarks/bench_match.py [--repeats 10] [--json FILE]
"""

from __future__ import annotations

from casid.cli.start import run_script

import casid as cs
from casid.acceptance.tolerances import Standard, StandardTest, Tolerance
from casid.cli.options import DEMO
from casid.signals import si_factor
from problems.bench.table import parser, processor_seconds_of, publish

LIMITS = {name: (2.0, "deg") for name in ("alpha", "beta", "theta", "phi")}
LIMITS |= {name: (2.0, "deg/s") for name in ("p", "q", "r")} | {"V": (3.0, "kt")}


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--repeats", type=int, default=10, help="runs, of which the fastest counts")
    given = options.parse_args()
    aircraft, record = cs.Aircraft.read(DEMO / "aircraft.toml"), cs.read_record(DEMO / "m4.csv")
    extended, table = _extended(aircraft), _standard()
    rows = []
    for name, further in (("aircraft file", None), ("and an extended one with 7 parts", extended)):

        def prove(further: cs.Aircraft | None = further) -> cs.ProofOfMatch:
            return cs.proof_of_match(aircraft, record, extended=further, tolerances=table)

        proof = prove()
        sides = [side for test in proof.tests for side in test.sides.values()]
        rows.append(
            {
                "judged": name,
                "manoeuvres": len(proof.tests),
                "channels": len(table.tests["E"].tolerances),
                "comparisons": sum(len(side.checks) for side in sides),
                "parts": max(len(test.costs) for test in proof.tests),
                "seconds": min(processor_seconds_of(prove, given.repeats)),
            }
        )
    publish(rows, given.json)


def _standard() -> Standard:
    rows = tuple(
        Tolerance(channel=name, absolute=limit * si_factor(unit, "", name), unit=unit)
        for name, (limit, unit) in LIMITS.items()
    )
    test = StandardTest(id="E", title="Eight channels", manoeuvre="elevator input", paragraph="1", tolerances=rows)
    return Standard(name="Eight channels", edition="1", source="this benchmark", tests={"E": test})


def _extended(aircraft: cs.Aircraft) -> cs.Aircraft:
    """With a lag of the elevator and other numbers of all six coefficients."""
    named = ("CL_alpha", "CD_alpha", "CY_beta", "Cl_p", "Cm_q", "Cn_beta")
    lag = cs.EffectValue(kind="actuator_lag", target="delta_e", value=0.12, unit="s")
    return aircraft.with_derivatives({n: 1.1 * aircraft.derivatives[n] for n in named}).with_effects([lag])


if __name__ == "__main__":
    run_script(main)
