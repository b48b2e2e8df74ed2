"""Figure of parameters fitted to frequency responses: gain and phase, measured and fitted."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from casid.frequency.response import gain_db, phase_deg
from casid.frequency.response_fit import ResponseFit
from casid.report.bode_figures import CURVES
from casid.report.style import MEASURED, settings, window

_WIDEST = 4  # responses side by side


def plot(fit: ResponseFit) -> Figure:
    """A column for each response: points measured, a line fitted."""
    labels = list(fit.responses)
    columns = min(len(labels), _WIDEST)
    rows = -(-len(labels) // columns)
    (colour, _), *_ = CURVES[1:]
    with settings():
        figure = window(4.2 * rows)
        axes = figure.subplots(2 * rows, columns, sharex=True, squeeze=False)
        for k, label in enumerate(labels):
            gain, phase = (axes[2 * (k // columns) + part, k % columns] for part in (0, 1))
            one, fitted = fit.responses[label], fit.fitted[label]
            turn = 360.0 * np.round(np.mean(phase_deg(one.response) - phase_deg(fitted)) / 360.0)
            for ax, measured, model in (
                (gain, gain_db(one.response), gain_db(fitted)),
                (phase, phase_deg(one.response), phase_deg(fitted) + turn),
            ):
                ax.plot(one.omega, measured, "o", ms=4.0, color=MEASURED, label="measured")
                ax.plot(one.omega, model, color=colour, lw=1.8, label="fitted")
            gain.set_title(f"{label} (J = {fit.costs[label]:.3g})")
            phase.set_xlabel("frequency [rad/s]")
            phase.set_xscale("log")
            phase.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            phase.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
            phase.xaxis.set_minor_locator(NullLocator())
            if k % columns == 0:
                gain.set_ylabel("gain [dB]")
                phase.set_ylabel("phase [deg]")
        figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=2)
    return figure
