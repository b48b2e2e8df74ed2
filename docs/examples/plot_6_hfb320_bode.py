"""
A real aircraft as gain and phase: HFB-320
==========================================

The elevator 3-2-1-1 and pulse of the HFB-320 (R. V. Jategaonkar, *Flight Vehicle System Identification*), by frequency:
the response of the pitch rate to the elevator with its coherence, and how far two sets of values are from it.

The record is not part of casid. It is in the supplement 10.2514/4.102790 of AIAA; `CASID_DATA` names its folder.
Without it the gallery leaves this example out.
"""

import os
from pathlib import Path

import matplotlib.pyplot as plt

import casid as cs
from problems.real import hfb320

file = Path(os.environ["CASID_DATA"]) / "hfb320_1_10.asc"

# %%
# One record of 60 s at 10 Hz. The windows are 20, 10 and 5 s long: the longest has two periods of 0.63 rad/s, and five
# of them are independent. Grey bands, where there are any, have a coherence below 0.6.
record = hfb320.record_from(file)
flight = cs.frequency_response(record, "delta_e", "q", windows=[20.0, 10.0, 5.0])
print(flight)
flight.plot()
plt.show()

# %%
# The model, linearised at the medians of the record: with the values that an estimation starts from, and with those
# that were published. J is the cost of Tischler and Remple; as guidelines of their book, 100 is called acceptable, and
# 50 nearly indistinguishable from flight.
model = hfb320.model()
models = {
    "start values": cs.linear_model(model, record),
    "published": cs.linear_model(model, record, values=hfb320.PUBLISHED),
}
compared = cs.compare_responses(flight, models)
print(compared)
for name, linear in models.items():
    print(f"{name}: eigenvalues {', '.join(f'{root:.3f}' for root in linear.eigenvalues)}")
compared.plot()
plt.show()
