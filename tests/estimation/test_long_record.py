"""Memory: a million samples of a small model below 1 GB, of which the imports take 130 MB; 50 states below 1.5 GB."""

from __future__ import annotations

import subprocess
import sys

import pytest

SHORT, LONG = 20_000, 120_000
BYTES = 870.0  # (1000 - 130) MB over a million samples

CODE = f"""
import numpy as np, casid as cs
from pathlib import Path

def peak(samples):
    rng, t = np.random.default_rng(0), 0.02 * np.arange(samples)
    model = cs.define_model(
        "short period", states=["alpha", "q"], inputs=["de"],
        parameters={{"Za": -1.2, "Ma": -4.0, "Mq": -1.8, "Mde": -6.0}}, outputs=["alpha", "q"],
        dynamics=lambda s: {{"alpha": s.Za * s.alpha + s.q, "q": s.Ma * s.alpha + s.Mq * s.q + s.Mde * s.de}},
        output=lambda s: {{"alpha": s.alpha, "q": s.q}},
    )
    record = cs.Record(name="r", t=t, channels={{"de": np.repeat(rng.standard_normal(samples // 50), 50)}}, hold="held")
    flown = cs.simulate(model, record, [0.0, 0.0]).as_record()
    noisy = {{name: flown[name] + 0.05 * rng.standard_normal(samples) for name in model.outputs}}
    fit = cs.solve(cs.Problem(model, [flown.with_channels(**noisy)], free=["*"], start={{"Ma": -3.0, "Mde": -4.0}}))
    assert fit.converged and abs(fit["Ma"].value + 4.0) < 4.0 * fit["Ma"].std
    return float(Path("/proc/self/status").read_text().partition("VmHWM:")[2].split()[0])

print(peak({SHORT}), peak({LONG}))
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="the peak is read from /proc")
def test_a_long_record_takes_little_memory() -> None:
    """What samples add to the peak of a process that simulates them, estimates and has all standard errors."""
    ran = subprocess.run([sys.executable, "-c", CODE], capture_output=True, text=True, check=True)
    short, long = map(float, ran.stdout.split())
    assert (long - short) * 1024.0 / (LONG - SHORT) < BYTES


CHAIN = """
import numpy as np, casid as cs
from pathlib import Path

rng, t, truth = np.random.default_rng(0), 0.02 * np.arange(5000), {"k": 5.0, "c": 0.2, "b": 1.5}
names = [f"x{i}" for i in range(50)]

def chain(s):
    x = [0.0, *(getattr(s, name) for name in names), 0.0]
    push = [s.b * s.u] + [0.0] * 49
    return {n: s.k * (x[i] + x[i + 2] - 2.0 * x[i + 1]) - s.c * x[i + 1] + push[i] for i, n in enumerate(names)}

model = cs.define_model(
    "chain", states=names, inputs=["u"], parameters={"k": 4.0, "c": 0.3, "b": 2.0}, outputs=names[::10],
    dynamics=chain, output=lambda s: {name: getattr(s, name) for name in names[::10]},
)
record = cs.Record(name="r", t=t, channels={"u": np.sign(np.sin(0.7 * t)) + 0.3 * np.sin(3.0 * t)})
flown = cs.simulate(model, record, np.zeros(50), truth)
read = {name: flown.state(name) + 0.01 * rng.standard_normal(5000) for name in names[::10]}
fit = cs.solve(cs.Problem(model, [record.with_channels(**read)], free=["*"]))
assert fit.converged, fit.status
assert all(abs(fit[name].value - value) < 4.0 * fit[name].std for name, value in truth.items())
print(float(Path("/proc/self/status").read_text().partition("VmHWM:")[2].split()[0]))
"""


@pytest.mark.slow
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="the peak is read from /proc")
def test_fifty_states_that_are_hardly_read_take_little_memory() -> None:
    """Peak of a process that estimates a chain of 50 states, 5 of them read, from 5000 samples: 1.5 GB."""
    ran = subprocess.run([sys.executable, "-c", CHAIN], capture_output=True, text=True, check=True)
    assert float(ran.stdout) * 1024.0 < 1.5e9
