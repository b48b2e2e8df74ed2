"""Where in frequency: energy of the residual over that of the noise, per channel and band; and what looks alike."""

from __future__ import annotations

import numpy as np
from matplotlib.colors import LogNorm

from casid.diagnosis.flight.statistics import band_energy
from casid.diagnosis.result import Diagnosis
from casid.report.style import Picture, blank
from casid.report.words import effect_name, label

_EDGES = (0.0, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0)  # Hz
_MOST = 1e4


def heatmap(diagnosis: Diagnosis) -> Picture:
    """Channel by frequency, before and after."""
    fit = diagnosis.refitted.fit
    fastest = 0.5 / max(record.dt for record in fit.flight.records)
    edges = np.array([e for e in _EDGES if e < fastest])
    views = [("file as given", diagnosis.as_given), (diagnosis.best, diagnosis.extended)]
    outputs = fit.model.outputs
    figure = blank(0.27 * len(outputs) + 1.8)
    axes = figure.subplots(1, len(views), sharey=True, squeeze=False)[0]
    image, energies = None, []
    for ax, (title, view) in zip(axes, views, strict=True):
        ratio = band_energy(view.fit, view.simulated, edges)
        energies.append(ratio)
        image = ax.imshow(np.clip(ratio, 1.0, _MOST), aspect="auto", cmap="YlOrBr", norm=LogNorm(1.0, _MOST))
        ax.set_title(title)
        ax.set_yticks(range(len(outputs)), outputs)
        ax.set_xticks(np.arange(len(edges)) - 0.5, [f"{e:g}" for e in edges], rotation=0, fontsize=8.5)
        ax.set_xlabel("frequency [Hz]")
        ax.grid(visible=False)
    if image is not None:
        bar = figure.colorbar(image, ax=axes, location="bottom", aspect=40, pad=0.03, extend="both")
        bar.set_label("energy of the residual / energy of the noise")
    i, b = np.unravel_index(np.nanargmax(energies[0]), energies[0].shape)
    worst = f"{outputs[i]} at {edges[b]:g} to {edges[b + 1]:g} Hz"
    return Picture(
        name="heatmap",
        figure=figure,
        title="Which channels, which frequencies",
        caption="Palest: nothing but noise. Darkest: ten thousand times the energy of the noise. Fitted records.",
        alt=f"Heatmap of residual over noise energy, channel by frequency. Largest before: {worst}, "
        f"{energies[0][i, b]:.0f} times the noise; after: {energies[1][i, b]:.0f} times.",
    )


def ambiguity(diagnosis: Diagnosis) -> Picture | None:
    """|cos| between the fingerprints of the causes fitted in the first round; None for fewer than two."""
    trials = [t for t in diagnosis.rounds[0].trials if t.fingerprint.size] if diagnosis.rounds else []
    if len(trials) < 2:
        return None
    prints = np.stack([trial.fingerprint for trial in trials], axis=1).astype(float)
    prints /= np.maximum(np.linalg.norm(prints, axis=0), 1e-300)
    cosine = np.abs(prints.T @ prints)
    names = [effect_name(t.effect) for t in trials]
    figure = blank(0.42 * len(names) + 1.7)
    ax = figure.subplots()
    ax.imshow(cosine, vmin=0.0, vmax=1.0, cmap="Blues", aspect="auto")
    for i, row in enumerate(cosine):
        for j, value in enumerate(row):
            colour = "white" if value > 0.6 else "black"
            ax.text(j, i, f"{value:.2f}", ha="center", va="center", color=colour, fontsize=8)
    ax.set_yticks(range(len(names)), [label(f"{n}  ({chr(65 + i)})") for i, n in enumerate(names)])
    ax.set_xticks(range(len(names)), [chr(65 + i) for i in range(len(names))])
    ax.grid(visible=False)
    off = cosine - np.eye(len(names))
    i, j = np.unravel_index(np.argmax(off), off.shape)
    return Picture(
        name="ambiguity",
        figure=figure,
        title="How alike the causes look in these records",
        caption=(
            "|cos| of the angle between two fingerprints once the fitted derivatives have explained what they can: 1, "
            "the two cannot be told apart; 0, they have nothing in common."
        ),
        alt=f"Matrix of |cos| between {len(names)} causes; most alike are {names[i]} and {names[j]}, {off[i, j]:.2f}.",
    )
