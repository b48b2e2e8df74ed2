"""Which share of the processor's peak does the compiled kernel reach?

Question     how far is a linearisation from what one core can do, and how much of an iteration is the kernel?
Set-up       stable Do 328, 1001 samples, 40 segments of 25 samples and one more. Peak: fused multiply-adds in 16
             independent chains of vectors, measured here and now. The kernel's arithmetic is counted from its source,
             a sine, a root or a division as one operation; lanes that only fill up the last vector do not count.
Expectation  about a fifth to a third of the peak; best of many calls, since another process can only take time away.

    python benchmarks/bench_peak.py [--calls 300] [--json FILE]
"""

from __future__ import annotations

from casid.cli.start import run_script

from casid.errors import InputError
from casid.estimation import MultipleShooting
from casid.estimation.attempt import build_objective
from casid.estimation.transcriptions.kernel import pack, shooting_offer
from casid.estimation.transcriptions.steps import stage_functions
from problems.bench.peak import linearise_operations, operations, peak_gflops
from problems.bench.table import parser, publish, seconds_of
from problems.peers.common import our_problem


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--calls", type=int, default=300, help="calls of which the best counts")
    given = options.parse_args()
    problem = our_problem()
    functions = plain, linear = stage_functions(problem.model, problem.free_index, ())
    offer = shooting_offer(problem.model.name, lambda: functions, 0)
    offer.spent = float("inf")
    kernel = offer.get()
    if kernel is None:
        raise InputError("bench_peak: no compiled kernel; install gcc or clang")
    objective = build_objective(problem, MultipleShooting())
    point, packed = objective.start(), pack(objective.layout, kernel.sizes, kernel.lanes)
    parameters, weights = objective.parameters(point.theta), objective.whitening(objective.noise.levels)
    samples = objective.layout.segments * objective.layout.length
    value = objective.value(point)
    works = {
        "simulate": (operations(plain), lambda: kernel.simulate(packed, point.nodes, parameters)),
        "linearise": (
            linearise_operations(linear),
            lambda: kernel.linearise(packed, point.nodes, parameters, weights, weights[:0]),
        ),
        "linearise and step": (
            linearise_operations(linear),
            lambda: objective.step(point, value, objective.linearise(point, value), 0.0),
        ),
    }
    peak, rows = peak_gflops(), []
    for name, (count, work) in works.items():
        seconds = min(seconds_of(work, given.calls))
        gflops = count * samples / seconds * 1e-9
        rows.append(
            {
                "work": name,
                "operations_per_sample": count,
                "microseconds": seconds * 1e6,
                "gflops": gflops,
                "peak_gflops": peak,
                "share": gflops / peak,
                "lanes": kernel.lanes,
            }
        )
    publish(rows, given.json)


if __name__ == "__main__":
    run_script(main)
