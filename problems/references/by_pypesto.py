"""pyPESTO's minimum of a PEtab problem within a time, in a Python of its own: nothing of casid is imported here.

    PYTHON -P problems/references/by_pypesto.py FILE START SECONDS

FILE is the YAML file of the problem, START a JSON object of its estimated parameters. The objective is AMICI's, with
its sensitivities; the optimiser is Fides, from START and from draws of pyPESTO's own between the bounds for SECONDS
by the clock. Generating and compiling AMICI's model are none of it. Prints {"cost", "values", "starts", "seconds"}.
"""

from __future__ import annotations

import contextlib
import json
import logging
import os
import sys
import time
from pathlib import Path

import numpy as np


def main() -> None:
    file, start, seconds = sys.argv[1], json.loads(sys.argv[2]), float(sys.argv[3])
    with open(os.devnull, "w") as nowhere, contextlib.redirect_stdout(nowhere):
        found = minimum(file, start, seconds)
    print(json.dumps(found))


def minimum(file: str, start: dict[str, float], seconds: float) -> dict:
    """The best end of all starts; within a start only what Fides accepted counts."""
    import fides  # pyright: ignore[reportMissingImports]
    import petab.v1 as petab  # pyright: ignore[reportMissingImports]
    import yaml
    from pypesto.optimize import FidesOptimizer, minimize  # pyright: ignore[reportMissingImports]
    from pypesto.petab import PetabImporter  # pyright: ignore[reportMissingImports]

    content = yaml.safe_load(Path(file).read_text())
    for part in content["problems"]:
        part.pop("visualization_files", None)  # plots, whose tables need not be there
    table = petab.Problem.from_yaml(content, base_path=str(Path(file).parent))
    problem = PetabImporter(table, model_name=Path(file).stem).create_problem()
    logging.disable(logging.CRITICAL)
    low, high = (np.array([bound[i] for i in problem.x_free_indices]) for bound in (problem.lb_full, problem.ub_full))
    rng, ends = np.random.default_rng(0), []
    at, begin = np.array([table.scale_parameters(start)[name] for name in table.x_free_ids]), time.perf_counter()
    while (left := seconds - (time.perf_counter() - begin)) > 0.0:
        optimiser = FidesOptimizer(verbose=logging.CRITICAL, options={fides.Options.MAXTIME: left})
        problem.set_x_guesses([at])
        ends.append(minimize(problem, optimiser, n_starts=1, progress_bar=False, filename=None).optimize_result[0])
        at = rng.uniform(low, high)
    best = min(ends, key=lambda end: end.fval)
    named = dict(zip(problem.x_names, map(float, best.x), strict=True))
    return {
        "cost": float(best.fval),
        "values": {n: table.unscale_parameters({n: v})[n] for n, v in named.items() if n in start},
        "starts": len(ends),
        "seconds": time.perf_counter() - begin,
    }


if __name__ == "__main__":
    main()
