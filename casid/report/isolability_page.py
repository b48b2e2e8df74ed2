"""Isolability, which cause is confused with which: as a figure, as text, as a page."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from casid.acceptance.isolability import Addition, Isolability, IsolableCause
from casid.errors import InputError
from casid.model.effects import effect_named
from casid.report.figure import WIDE, Axis, Cells, Figure, Note, Panel, Picture, Scale
from casid.report.result_page import Answer, write_result
from casid.report.sections import ReportTable, Section
from casid.report.svg import shown
from casid.report.words import effect_name, pretty, probability_in_words, quantity
from casid.signals import label_of

_SHOWN = 0.02  # probability of confusion from which a cause is in the matrix
_GAIN = 5e-4  # of the probability of being right, which is told to a tenth of a per cent
# of flights: rightly named above, detected below
_SURE = 0.95
_HARDLY = 0.05
_APART = "Detected and rightly named in more than 95 % of flights"
_UNSEEN = "Detected in less than 5 % of flights at the size that matters; in brackets the smallest size that shows"
_NO_SIZE = 1e6  # of the size that matters
_MOST = 48  # causes in the matrix: more cannot be read


def plot(found: Isolability) -> Any:
    """Return the matrix for a notebook."""
    return shown(matrix(found).figure)


def matrix(found: Isolability) -> Picture:
    """Return which cause, when it is there at the size that matters, is taken for which."""
    chosen = _shown(found)
    side = 0.19 * len(chosen) + 0.07 * max((len(_label(name)) for name in chosen), default=0)
    pairs = [(a, b, p) for a, one in found.causes.items() for b, p in one.confusion.items()]
    worst = max(pairs, key=lambda pair: pair[2], default=None)
    said = f" Most alike: {_label(worst[0])} and {_label(worst[1])}, {100.0 * worst[2]:.0f} %." if worst else ""
    return Picture(
        name="isolability",
        figure=Figure(rows=((_matrix(found, chosen, 0.6 + side),),), width=min(WIDE, 0.9 + side)),
        title="What can be taken for what",
        caption="Row: the cause that is there, at the size that matters. Column: what explains the data better, in per "
        "cent of such flights; 50 is a toss of a coin. Only causes that are detected in most flights and that may be "
        "taken for another one are in the matrix.",
        alt=f"Matrix of the probability of confusion between {len(chosen)} causes.{said}",
    )


def text(found: Isolability) -> str:
    """State what is separated, what is confused with what, what does not show, and what would add most."""
    apart, between, unseen = _groups(found)
    lines = [
        f"{found.aircraft}: {', '.join(found.manoeuvres)}; channels {', '.join(found.channels)}",
        sentence(found),
        "",
    ]
    if apart:
        lines += [f"{_APART} ({len(apart)}):", *_wrapped(_by_place(apart)), ""]
    if between:
        lines.append(_table(between).text())
    if unseen:
        lines += ["", f"{_UNSEEN} ({len(unseen)}):", *_wrapped(_by_place(unseen, sizes=True))]
    if found.additions:
        lines += ["", "What would add most:", *(f"  {one}" for one in additions_in_words(found))]
    if found.left_out:
        lines += ["", *_wrapped([f"Not judged: {', '.join(map(_label, found.left_out))}."])]
    return "\n".join(lines)


def sentence(found: Isolability) -> str:
    """State how many causes are detected, and how often one is rightly named."""
    seen = sum(one.detection > 0.5 for one in found.causes.values())
    return (
        f"{seen} of {len(found.causes)} causes are detected at the size that matters in more than half of the flights. "
        f"On average a cause is rightly named in {100.0 * found.told:.1f} % of flights."
    )


def _groups(found: Isolability) -> tuple[list[IsolableCause], list[IsolableCause], list[IsolableCause]]:
    """Split the causes into those that are separated, those in between, and those that do not show; best first."""
    ordered = sorted(found.causes.values(), key=lambda one: -one.told)
    apart = [one for one in ordered if one.told > _SURE]
    unseen = [one for one in ordered if one.detection < _HARDLY]
    return apart, [one for one in ordered if one not in apart and one not in unseen], unseen


def _by_place(causes: Sequence[IsolableCause], sizes: bool = False) -> list[str]:
    """A line for each place with its causes, by the words that the picture has; with the smallest size that is
    detected."""
    found: dict[str, list[str]] = {}
    for one in causes:
        place, colon, what = _label(one.name).partition(": ")
        size = f" ({smallest(one)})" if sizes else ""
        found.setdefault(place if colon else "", []).append(f"{what if colon else place}{size}")
    return [f"{place}: {'; '.join(what)}" if place else "; ".join(what) for place, what in sorted(found.items())]


def _wrapped(lines: Iterable[str]) -> list[str]:
    """Lines no longer than a terminal is wide."""
    wrap = textwrap.TextWrapper(118, initial_indent="  ", subsequent_indent="    ", break_on_hyphens=False)
    return [part for line in lines for part in wrap.wrap(line)]


def smallest(one: IsolableCause) -> str:
    """Say the smallest size that is detected."""
    return quantity(one.smallest, one.unit) if one.smallest < _NO_SIZE * one.matters else "at no size"


def rivals(one: IsolableCause) -> str:
    """Name what a cause is taken for, the three most alike."""
    return ", ".join(f"{_label(name)} ({100.0 * p:.0f}\u00a0%)" for name, p in list(one.confusion.items())[:3])


def additions_in_words(found: Isolability) -> list[str]:
    """The five additions that gain most, a sentence each; or one that none does."""
    said = [addition(one, found.told) for one in found.additions[:5] if one.told - found.told >= _GAIN]
    if found.additions and not said:
        return [f"none of the {len(found.additions)} channels and manoeuvres that were tried adds anything"]
    return said


def addition(one: Addition, told: float) -> str:
    """An addition in words, with what it gains."""
    surface, colon, moves = one.what.partition(": ")
    what = f"channel {one.what}" if one.kind == "channel" else label_of(surface) + colon + moves
    return f"{what}: right in {100.0 * one.told:.1f} instead of {100.0 * told:.1f} % of flights"


def _shown(found: Isolability) -> list[str]:
    """Causes that are detected in most flights and may be taken for another such one, the most alike of all; each next
    to those that it is taken for."""
    seen = {name for name, one in found.causes.items() if one.detection > 0.5}
    alike = {n: max((p for r, p in found.causes[n].confusion.items() if r in seen), default=0.0) for n in seen}
    chosen = sorted((n for n in found.causes if alike.get(n, 0.0) >= _SHOWN), key=lambda n: -alike[n])[:_MOST]
    taken = {r for n in chosen for r, p in found.causes[n].confusion.items() if r in seen and p >= _SHOWN}
    left = [name for name in found.causes if name in {*chosen, *taken}]
    ordered: list[str] = []
    while left:
        name = max(left, key=lambda n: found.causes[ordered[-1]].confusion.get(n, 0.0)) if ordered else left[0]
        ordered.append(name)
        left.remove(name)
    return ordered


def _matrix(found: Isolability, chosen: Sequence[str], height: float) -> Panel:
    if not chosen:
        note = Note(text="every cause is told apart from all others", x=0.5, y=0.5, align="center")
        return Panel(parts=(note,), x=Axis(low=0.0, high=1.0), y=Axis(low=0.0, high=1.0), bare=True)
    names = list(found.causes)
    at = [names.index(name) for name in chosen]
    table = 100.0 * found.confusion[np.ix_(at, at)]
    told = {(i, j): f"{value:.0f}" for (i, j), value in np.ndenumerate(table) if i != j and value >= 100.0 * _SHOWN}
    labels = tuple(_label(name) for name in chosen)
    return Panel(
        parts=(Cells(values=table, scale=Scale(low=0.0, high=60.0, colours="Blues"), texts=told),),
        x=Axis(label="taken for", names=labels),
        y=Axis(label="there, at the size that matters", names=labels),
        height=height,
        square=True,
    )


def _label(name: str) -> str:
    """The short name of a cause; of one that is not in the register, such as a user's own, as it is."""
    try:
        effect = effect_named(name)
    except InputError:
        return name
    return effect_name(effect) + (f", {effect.variant}" if effect.variant else "")


def write_isolability(found: Isolability, folder: str | Path) -> None:
    """Write `isolability.html` and `isolability_figures/*.svg` into `folder`, which is made."""
    apart, between, unseen = _groups(found)
    alike = ["; ".join(map(_label, one)) for one in found.sets if len(one) > 1]
    left_out = f"Not judged: {', '.join(map(_label, found.left_out))}." if found.left_out else ""
    parts = [
        f"Channels: {', '.join(found.channels)}.",
        Section(title="What would add most", parts=([pretty(one) for one in additions_in_words(found)],), open=True),
        Section(title="What looks alike", parts=(alike,), open=True),
        _table(between),
        matrix(found),
        Section(title=_APART, parts=(_by_place(apart),), open=True),
        Section(title=_UNSEEN, parts=(_by_place(unseen, sizes=True),), open=True),
        left_out,
    ]
    title = f"What the flight will tell: {found.aircraft}, {', '.join(found.manoeuvres)}"
    answer = Answer(badge="", sentence=sentence(found))
    write_result(folder, "isolability", title, answer, parts, "isolability_figures")


def _table(causes: Sequence[IsolableCause]) -> ReportTable:
    rows = []
    for one in causes:
        sizes = quantity(one.matters, one.unit), smallest(one)
        cells = (*sizes, probability_in_words(one.detection), probability_in_words(one.told))
        rows.append((_label(one.name), *(cell.replace(" ", "\N{NO-BREAK SPACE}") for cell in cells), rivals(one)))
    return ReportTable(
        head=("cause", "matters from", "smallest", "detected", "right", "taken for"),
        rows=rows,
        caption="Matters from: the smallest size that an engineer would want to know of. Smallest: what is detected in "
        "90 % of flights. Detected, right: at the size that matters. Taken for: how often a rival explains the data "
        "better.",
    )
