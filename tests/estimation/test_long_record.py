"""Memory of a long record: a million samples of a small model below 1 GB, of which the imports take 130 MB."""

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
