"""
Eight cases, three costs: Table 5
=================================

E. Özger (AIAA 2010-34) compares equation, output and combined error on a Do 328: linear or not, stable or destabilised,
with noise or without. One record of each kind is simulated here and estimated from 0.7 times the truth;
`scripts/table5.py` does all 384.
"""

import matplotlib.pyplot as plt
import numpy as np

from problems.paper.cases import CASES, Condition
from problems.paper.estimation import ESTIMATORS, estimate
from problems.paper.truth import fly

# %%
# The error of a derivative is relative to its true value; the median of all moment derivatives is shown.
errors = {estimator: [] for estimator in ESTIMATORS}
print(f"{'case':34} " + " ".join(f"{estimator:>18}" for estimator in ESTIMATORS))
for letter, case in CASES.items():
    flight = fly(Condition(case=letter, manoeuvre=1, variant=int(case.nonlinear), seed=int(case.noisy)))
    row = []
    for estimator in ESTIMATORS:
        fit = estimate(flight, estimator, "multiple-open")
        off = [
            abs(value / flight.derivatives[name] - 1.0)
            for name, value in fit.values.items()
            if flight.derivatives[name]
        ]
        errors[estimator].append(float(np.median(off)))
        row.append(f"{100.0 * np.median(off):.2g} %" + ("" if fit.converged else " *"))
    print(f"{letter + ': ' + case.origin:34} " + " ".join(f"{cell:>18}" for cell in row))
print("* not converged")

# %%
# Without noise and linear (A, C) all three are exact. With noise (B, D) output error is nearest. What the model does
# not have (E to H) no cost can repair.
figure, axis = plt.subplots(figsize=(7, 3.5), layout="constrained")
for k, (estimator, values) in enumerate(errors.items()):
    axis.bar(np.arange(8) + 0.27 * (k - 1), np.maximum(values, 1e-9), width=0.25, label=estimator)
axis.set_yscale("log")
axis.set_xticks(range(8), list(CASES))
axis.set_ylabel("median error of a derivative")
axis.legend()
plt.show()
