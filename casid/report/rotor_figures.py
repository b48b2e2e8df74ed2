"""Pictures of an aircraft with rotors."""

from __future__ import annotations

import math

import numpy as np

from casid.diagnosis.document import Document
from casid.model.rotors import acting, effectiveness, thrust_of
from casid.model.station import control
from casid.report import looks
from casid.report.figure import Axis, Curve, Figure, Note, Panel, Part, Picture, stacked
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
    moved = {one.parameter: one for one in document.moved}
    told = []
    low = np.inf
    high = -np.inf
    turn = np.linspace(0.0, 2.0 * np.pi, 49)
    parts: list[Part] = []
    for (x, y), one in zip(places, rotors.each, strict=True):
        thrust = np.concatenate([one.static_thrust(acting(one, r.t, r[one.name])) for r in records])
        mean = one.effectiveness * float(np.mean(thrust))
        name = effectiveness(one.name)
        says = document.flight[name]
        cause = named.get(one.name)
        left = moved.get(name)  # the figure has the number of the sentence, and none that no sentence has
        extended = left.extended if left else one.effectiveness
        value, std = (cause.value, cause.std) if cause else (extended / one.effectiveness - 1.0, says.std)
        changed = 100.0 * value
        wide = 100.0 * std / (1.0 if cause else one.effectiveness)
        look = looks.Look(colour=looks.ORANGE if cause or name in against else looks.BLUE, width=2.0)
        arm = max(1.0 - 0.42 * size / max(math.hypot(x, y), 1e-9), 0.0)
        parts.append(
            Curve(
                look=looks.Look(colour=looks.FAINT, width=3.0), x=np.array([0.0, arm * x]), y=np.array([0.0, arm * y])
            )
        )
        circle = x + 0.42 * size * np.cos(turn), y + 0.42 * size * np.sin(turn)
        parts.append(Curve(look=look, x=circle[0], y=circle[1]))
        deviation = f"{changed:+.0f} ± {digits(wide, 1)} %".replace("-", "−")
        stated = not (cause or left)
        if stated:
            deviation = "as given"
        text = f"{one.name}\n{digits(mean, 3)} N\n{deviation}"
        parts.append(Note(text=text, x=float(x), y=float(y), align="center"))
        told.append(f"{one.name} {'as given' if stated else f'{changed:+.0f} per cent'}")
        low = min(low, y)
        high = max(high, y)
    top = high + 0.62 * size
    parts.append(
        Curve(look=looks.Look(colour=looks.INK), x=np.zeros(2), y=np.array([top - 0.4 * size, top - 0.1 * size]))
    )
    tip = looks.Look(colour=looks.INK, dash="", marker="^", size=7.0)
    parts.append(Curve(look=tip, x=np.zeros(1), y=np.array([top - 0.1 * size])))
    parts.append(Note(text="front", x=0.0, y=top + 0.04 * size, align="center"))
    panel = Panel(
        parts=tuple(parts),
        x=Axis(low=-1.6 * size, high=1.6 * size),
        y=Axis(low=low - 0.6 * size, high=top + 0.1 * size),
        height=4.2,
        square=True,
        bare=True,
    )
    return Picture(
        name="rotors",
        figure=Figure(rows=((panel,),)),
        title="The rotors from above",
        caption="Mean thrust by the file of the commands that were flown, and by how much the true one differs, with "
        "±1σ; as given: the value stays as it is in the file. Orange: named, or inconsistent with the "
        "file. A rotor that is weak needs larger commands in hover.",
        alt=f"Top view of {len(rotors.each)} rotors with their thrust against the file: {', '.join(told)}.",
    )


def response_of_axes(document: Document) -> Picture | None:
    """The answers to a step about each axis, by the file and by the records."""
    found = document.axis_responses
    if found is None:
        return None
    told = []
    panels = []
    for axis, given in found.as_given.items():
        scale, unit = (1.0, "m/s") if axis == "climb" else (math.degrees(1.0), "deg/s")
        curves = (
            Curve(look=looks.GIVEN, x=1e3 * found.t, y=scale * given),
            Curve(look=looks.EXTENDED.called("by the records"), x=1e3 * found.t, y=scale * found.extended[axis]),
        )
        panels.append(Panel(parts=curves, x=Axis(label="time [ms]"), y=Axis(label=f"{axis} [{unit}]"), height=1.7))
        told.append(f"{axis} {100.0 * (found.extended[axis][-1] / given[-1] - 1.0):+.0f} per cent")
    return Picture(
        name="axes",
        figure=Figure(rows=stacked(panels, 2)),
        title="Response of each axis",
        caption="Rate after a step of the commands that, by the file, turns or lifts with 1 rad/s² or 1 m/s²; "
        "about the mean commands of these records, with lag and delay of the rotors.",
        alt=f"Answers to a step about each axis; half a second later, against the file: {', '.join(told)}.",
    )
