"""Every estimation problem of this folder by name: what two solvers have to agree on.

The Do 328 in the cases A-H of the paper by each of its three estimators (open loop: a general solver does not take the
control law in the loop), the embedded flights of a Fokker 50, and the records of Jategaonkar's book.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

from casid.estimation import CombinedError, EquationError, OutputError, Problem
from casid.estimation.cost import Cost
from casid.model.aircraft import Aircraft
from casid.model.flown_records import default_free, flown_records
from casid.records.readers import read_records
from problems import unstable_short_period
from problems.paper.cases import CASES, Condition, conditions
from problems.paper.estimation import paper_problem
from problems.paper.truth import fly
from problems.real import attas, hfb320

DEMO = Path(__file__).resolve().parent.parent / "casid" / "cli" / "demo"
COSTS: dict[str, Cost] = {"output": OutputError(), "equation": EquationError(), "combined": CombinedError()}


def every_problem(flight_data: Path | None = None, whole: bool = False) -> Iterator[tuple[str, Callable[[], Problem]]]:
    """(name, what makes the problem).

    flight_data   folder with hfb320_1_10.asc, fAttasElv1.mat ...; None leaves those out
    whole         all 384 records of the Do 328 instead of one of each case
    """
    chosen = conditions(CASES, range(1, 9)) if whole else _one_of_each_case()
    for condition in chosen:
        for name, cost in COSTS.items():
            yield f"do328 {condition.name} {name}", partial(_do328, condition, cost)
    yield "demo", demo_problem
    if flight_data is not None:
        yield "hfb320", lambda: hfb320.problem(hfb320.record_from(flight_data / "hfb320_1_10.asc"))
        yield "attas lateral", lambda: attas.lateral_problem(attas.records_from(flight_data, "fAttasAilRud1"))
        yield (
            "attas longitudinal",
            lambda: attas.longitudinal_problem(
                [*attas.records_from(flight_data, "fAttasElv1"), *attas.records_from(flight_data, "fAttasElv2")]
            ),
        )
        yield (
            "unstable short period",
            lambda: unstable_short_period.problem(unstable_short_period.record_from(flight_data / "unStabAC_sim.asc")),
        )


def _one_of_each_case() -> Iterator[Condition]:
    for letter, case in CASES.items():
        yield Condition(case=letter, manoeuvre=5, variant=int(case.nonlinear), seed=int(case.noisy))


def _do328(condition: Condition, cost: Cost) -> Problem:
    return paper_problem(fly(condition), cost)


def demo_problem() -> Problem:
    """Two of the embedded flights: all derivatives that move the aircraft, with the file's priors; noise estimated."""
    records = read_records([str(DEMO / "m1.csv"), str(DEMO / "m2.csv")])
    applied = flown_records(Aircraft.read(DEMO / "aircraft.toml"), records)
    return Problem(applied.model, applied.records, free=default_free(applied), prior=True)
