"""Pictures of an aircraft with rotors."""

from __future__ import annotations

import math

import numpy as np

from casid.diagnosis.document import Document, ReportedCause
from casid.model.rotors import Rotor, acting, effectiveness, thrust_of
from casid.model.station import control
from casid.report import looks
from casid.report.figure import Axis, Curve, Figure, Note, Panel, Part, Picture, stacked
from casid.report.words import digits, shown_unit

_ARM = looks.Look(colour=looks.FAINT, width=3.0)
_RIGHT = looks.Look(colour=looks.BLUE, width=2.0)
_WRONG = looks.Look(colour=looks.ORANGE, width=2.0)
_FRONT = looks.Look(colour=looks.INK)
_TIP = looks.Look(colour=looks.INK, dash="", marker="^", size=7.0)


def rotors_from_above(document: Document) -> Picture | None:
    """The rotors in a top view, with the thrust that the file makes of their commands and that of flight."""
    rotors = document.aircraft.rotors if document.aircraft else None
    if rotors is None:
        return None
    thrusts = {control(thrust_of(name)) for name in rotors.names}  # the ports at which the thrust of a rotor enters
    named = {one.target: one for one in document.causes if one.enters in thrusts}
    against = {one.parameter for one in document.contradicted}
    places = np.array([(one.position[1], one.position[0]) for one in rotors.each])
    size = max(float(np.max(np.hypot(*places.T))), 1e-6)
    radius = 0.42 * size
    turn = np.linspace(0.0, 2.0 * np.pi, 49)
    told = []
    parts: list[Part] = []
    for (x, y), one in zip(places, rotors.each, strict=True):
        thrust = np.concatenate([one.static_thrust(acting(one, r.t, r[one.name])) for r in document.as_given.records])
        mean = one.effectiveness * float(np.mean(thrust))
        cause = named.get(one.name)
        deviation, in_words = _deviation(document, one, cause)
        told.append(f"{one.name} {in_words}")
        circle = _WRONG if cause or effectiveness(one.name) in against else _RIGHT
        arm = max(1.0 - radius / max(math.hypot(x, y), 1e-9), 0.0)
        parts += [
            Curve(look=_ARM, x=np.array([0.0, arm * x]), y=np.array([0.0, arm * y])),
            Curve(look=circle, x=x + radius * np.cos(turn), y=y + radius * np.sin(turn)),
            Note(text=f"{one.name}\n{digits(mean, 3)} N\n{deviation}", x=float(x), y=float(y), align="center"),
        ]
    low = places[:, 1].min()
    top = places[:, 1].max() + 0.62 * size
    parts += [
        Curve(look=_FRONT, x=np.zeros(2), y=np.array([top - 0.4 * size, top - 0.1 * size])),
        Curve(look=_TIP, x=np.zeros(1), y=np.array([top - 0.1 * size])),
        Note(text="front", x=0.0, y=top + 0.04 * size, align="center"),
    ]
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


def _deviation(document: Document, rotor: Rotor, cause: ReportedCause | None) -> tuple[str, str]:
    """Return by how much a rotor differs from the file, for the figure and in words: the number of the sentence that
    states it, and none that no sentence has."""
    name = effectiveness(rotor.name)
    moved = {one.parameter: one.extended for one in document.moved}
    if cause:
        changed = cause.value
        std = cause.std
    elif name in moved:
        changed = moved[name] / rotor.effectiveness - 1.0
        std = document.flight[name].std / rotor.effectiveness
    else:
        return "as given", "as given"
    percent = f"{100.0 * changed:+.0f}"
    return f"{percent} ± {digits(100.0 * std, 1)} %".replace("-", "−"), f"{percent} per cent"


def response_of_axes(document: Document) -> Picture | None:
    """The answers to a step about each axis, by the file and by the records."""
    found = document.axis_responses
    if found is None:
        return None
    told = []
    panels = []
    for axis, given in found.as_given.items():
        scale, unit = shown_unit("m/s" if axis == "climb" else "rad/s")
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
