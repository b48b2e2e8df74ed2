"""Write what the report states, with the figures that show it: data, values, causes, and what stays unexplained."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace

from casid.diagnosis.document import Document
from casid.report.words import digits, place, pretty, probability_in_words, with_std

# a figure of a cause or of what is unexplained is named with the number of that behind it, from the second on
_OF_A_CAUSE = ("shape", "wind", "onset", "bode", "missing_history")
_OF_THE_UNEXPLAINED = ("unexplained", "missing")
_IN_GENERAL = ("residuals",)  # shows what the model with all causes explains


@dataclass(frozen=True, kw_only=True)
class Statement:
    """Something that the report states: the `anchor` of its statement, what it is about in a few words, the statement,
    and the names of the figures that show it, the most telling one first."""

    anchor: str
    head: str
    text: str
    figures: tuple[str, ...]
    probability: float | None = None

    @property
    def sure(self) -> str:
        """Probability in words; "" where there is none."""
        return "" if self.probability is None else f", {probability_in_words(self.probability)} probable"


def about_value(parameter: str) -> str:
    """Anchor of the statement that flight contradicts a number of the file."""
    return "value-" + re.sub(r"[^\w.-]+", "-", parameter).strip("-")


def numbered(name: str, number: int) -> str:
    """Name of a figure about the cause, or the unexplained place, with this number."""
    return name if number == 1 else f"{name}-{number}"


def statements(document: Document, figures: Collection[str]) -> dict[str, list[Statement]]:
    """Those under `data`, `values`, `causes` and `unexplained`; `figures` are the names of those that there are."""
    found = {"data": _data, "values": _values, "causes": _causes, "unexplained": _unexplained}
    return {
        kind: [replace(one, figures=tuple(name for name in one.figures if name in figures)) for one in made(document)]
        for kind, made in found.items()
    }


def _data(document: Document) -> Iterator[Statement]:
    for number, one in enumerate(document.data, 1):
        head = f"{one.kind.removeprefix('data_').replace('_', ' ')}: {one.target}"
        yield Statement(anchor=f"data-{number}", head=head, text=pretty(one.sentence), figures=("check",))


def _values(document: Document) -> Iterator[Statement]:
    for one in document.contradicted:
        if one.impossible:
            text = one.sentence
        else:
            flown = with_std(one.flight, one.std, "1")
            text = f"{one.parameter}: {digits(one.given)} in the {document.source}, {flown} by {document.witness}"
        yield Statement(
            anchor=about_value(one.parameter), head=one.parameter, text=pretty(text), figures=("derivatives",)
        )


def _causes(document: Document) -> Iterator[Statement]:
    for number, one in enumerate(document.causes, 1):
        own = tuple(numbered(name, number) for name in _OF_A_CAUSE)
        alike = [pretty(o["title"]) for o in one.indistinguishable_from]
        also = f", or {' or '.join(alike)}" if alike else ""
        head = pretty(one.title)
        yield Statement(
            anchor=f"cause-{number}",
            head=head,
            text=f"{head} ({with_std(one.value, one.std, one.unit)}){also}",
            figures=(
                *own,
                *_IN_GENERAL,
                *(("ladder",) if any(trial.key == one.key for trial in document.tried) else ()),
                *(("ambiguity",) if alike else ()),
            ),
            probability=one.probability,
        )


def _unexplained(document: Document) -> Iterator[Statement]:
    for number, one in enumerate(document.unexplained, 1):
        (own, general), where = _OF_THE_UNEXPLAINED, one.called or place(one.station)
        yield Statement(
            anchor=f"unexplained-{number}",
            head=f"unexplained at {where}",
            text=f"Something enters at {where} that {document.no_cause}",
            figures=(numbered(own, number), general),
            probability=one.probability,
        )
