"""Pictures of an aircraft with rotors."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.patches import Circle

from casid.diagnosis.document import Document
from casid.model.rotors import acting, effectiveness, thrust_of
from casid.model.station import control
from casid.report.style import BASELINE, EXTENDED, FAINT, MEASURED, Picture, blank, settings
from casid.report.words import digits


def rotors_from_above(document: Document) -> Picture | None:
    """The rotors in a top view, with the thrust that the file makes of their commands and that of flight."""
    rotors = document.aircraft.rotors if document.aircraft else None
    if rotors is None:
        return None
    thrusts = {control(thrust_of(name)) for name in rotors.names}  # the ports at which the thrust of a rotor enters
    named = {one.target: one for one in document.causes if one.enters in thrusts}
    records = document.as_given.records
    places = np.array([(one.position[1], one.position[0]) for one in rotors.each])
    size = max(float(np.max(np.hypot(*places.T))), 1e-6)
    against = {one.parameter for one in document.contradicted}
    told = []
    low = np.inf
    high = -np.inf
    with settings():
        figure = blank(4.6)
        ax = figure.subplots()
        for (x, y), one in zip(places, rotors.each, strict=True):
            thrust = np.concatenate([one.static_thrust(acting(one, r.t, r[one.name])) for r in records])
            mean = one.effectiveness * float(np.mean(thrust))
            name = effectiveness(one.name)
            says = document.flight[name]
            cause = named.get(one.name)
            value, std = (cause.value, cause.std) if cause else (says.value / one.effectiveness - 1.0, says.std)
            changed = 100.0 * value
            wide = 100.0 * std / (1.0 if cause else one.effectiveness)
            colour = BASELINE if cause or name in against else EXTENDED
            ax.plot([0.0, x], [0.0, y], color=FAINT, lw=3, zorder=1)
            ax.add_patch(Circle((x, y), 0.42 * size, facecolor="white", edgecolor=colour, lw=2, zorder=2))
            deviation = f"{changed:+.0f} ± {digits(wide, 1)} %".replace("-", "−")
            if not (cause or says.determined):
                deviation = "as stated"
            text = f"{one.name}\n{digits(mean, 3)} N\n{deviation}"
            ax.text(x, y, text, ha="center", va="center", fontsize=10.5, color=MEASURED, zorder=3)
            told.append(f"{one.name} {f'{changed:+.0f} per cent' if cause or says.determined else 'as stated'}")
            low = min(low, y)
            high = max(high, y)
        top = high + 0.62 * size
        ax.annotate("front", (0.0, top), (0.0, top - 0.4 * size), arrowprops={"arrowstyle": "->"}, ha="center")
        ax.set_xlim(-1.6 * size, 1.6 * size)
        ax.set_ylim(low - 0.6 * size, top + 0.1 * size)
        ax.set_aspect("equal")
        ax.axis("off")
    return Picture(
        name="rotors",
        figure=figure,
        title="The rotors from above",
        caption="Mean thrust by the file of the commands that were flown, and by how much the true one differs, with "
        "±1σ; as stated: these records do not tell it better than the file. Orange: named, or inconsistent with the "
        "file. A rotor that is weak needs larger commands in hover.",
        alt=f"Top view of {len(rotors.each)} rotors with their thrust against the file: {', '.join(told)}.",
    )


def response_of_axes(document: Document) -> Picture | None:
    """The answers to a step about each axis, by the file and by the records."""
    found = document.axis_responses
    if found is None:
        return None
    with settings():
        figure = blank(4.6)
        panels = figure.subplots(2, 2, sharex=True).flat
        told = []
        for ax, (axis, given) in zip(panels, found.as_given.items(), strict=True):
            scale, unit = (1.0, "m/s") if axis == "climb" else (math.degrees(1.0), "deg/s")
            ax.plot(1e3 * found.t, scale * given, "--", color=BASELINE, label="as given")
            ax.plot(1e3 * found.t, scale * found.extended[axis], color=EXTENDED, label="by the records")
            ax.set_ylabel(f"{axis} [{unit}]")
            told.append(f"{axis} {100.0 * (found.extended[axis][-1] / given[-1] - 1.0):+.0f} per cent")
        figure.axes[0].legend(loc="upper left")
        for ax in figure.axes[2:]:
            ax.set_xlabel("time [ms]")
    return Picture(
        name="axes",
        figure=figure,
        title="Response of each axis",
        caption="Rate after a step of the commands that, by the file, turns or lifts with 1 rad/s² or 1 m/s²; "
        "about the mean commands of these records, with lag and delay of the rotors.",
        alt=f"Answers to a step about each axis; half a second later, against the file: {', '.join(told)}.",
    )
