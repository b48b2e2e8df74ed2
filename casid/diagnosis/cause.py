"""A cause as a diagnosis reports it."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, ClassVar

from casid.diagnosis.comparisons import FINAL, Gate, clause
from casid.errors import InputError, nearest, unknown
from casid.keeping import by_fields
from casid.model.effect import Effect
from casid.model.effect_value import EffectValue
from casid.model.effects import effect_named
from casid.model.vocabulary import title_of
from casid.signals import label_of

NAMED = "named"
IN_A_SET = "in a set"
MINOR = "minor"
REFUSED = "refused"
NOT_TRIED = "not tried"
_OUTCOMES = {NAMED: "named", IN_A_SET: "cannot be told apart", MINOR: "too small to matter"}
OUTCOMES = (NAMED, IN_A_SET, MINOR, REFUSED, NOT_TRIED)


@dataclass(frozen=True, kw_only=True)
class Decision:
    """The decision on one cause in one round.

    Attributes
    ----------
    cause
        Its name, as "actuator_lag(delta_e)".
    round
        Round of the search, from 1 on; 0 for an effect that was in the model before the first round.
    outcome
        "named", "in a set" (equivalent to a named cause), "minor", "refused" or "not tried".
    gates
        The comparisons, in the order in which they were made.
    against
        Names of the causes that it was compared with.
    statistic
        Its likelihood-ratio statistic in this round, 2 ln L; NaN where it was not fitted.

    Examples
    --------
    >>> import casid as cs
    >>> gate = cs.Gate(gate="share", value=0.4, threshold=1.0, criterion="naming.share", least=True)
    >>> decision = cs.Decision(cause="actuator_lag(delta_e)", round=1, outcome="refused", gates=(gate,))
    >>> [one.gate for one in decision.failed]
    ['share']
    """

    cause: str
    round: int
    outcome: str
    gates: tuple[Gate, ...]
    against: tuple[str, ...] = ()
    statistic: float = math.nan

    @property
    def title(self) -> str:
        """A short name of the cause for a person; its own name where it is none of the catalogue."""
        with suppress(InputError):
            effect = effect_named(self.cause)
            return f"{title_of(effect)} ({effect.variant})" if effect.variant else title_of(effect)
        return self.cause

    @property
    def failed(self) -> tuple[Gate, ...]:
        """The gates that failed."""
        return tuple(gate for gate in self.gates if not gate.passed)

    def __str__(self) -> str:
        lines = [f"{self.cause}: {self.outcome}" + (f", round {self.round}" if self.round else "")]
        lines += [f"  {'passed' if gate.passed else 'FAILED'}  {gate}" for gate in self.gates]
        if self.against:
            lines.append(f"  compared with {', '.join(self.against)}")
        return "\n".join(lines)

    to_dict = by_fields

    @classmethod
    def from_dict(cls, entry: Mapping[str, Any]) -> Decision:
        """The decision of an entry of ``decisions`` in diagnosis.json."""
        gates = tuple(Gate.from_dict(gate) for gate in entry["gates"])
        return cls(
            cause=entry["cause"],
            round=entry["round"],
            outcome=entry["outcome"],
            gates=gates,
            against=tuple(entry.get("against", ())),
            statistic=math.nan if entry.get("statistic") is None else float(entry["statistic"]),
        )


@dataclass(frozen=True, repr=False, kw_only=True)
class Trace:
    """The decisions of a diagnosis, by cause and round, in the order in which they were made.

    Examples
    --------
    >>> from casid.diagnosis.cause import Decision, Trace
    >>> from casid.diagnosis.comparisons import GAIN
    >>> gate = GAIN.of(12.0, 31.4, "significance.search")
    >>> trace = Trace(decisions=(Decision(cause="mass", round=1, outcome="refused", gates=(gate,)),))
    >>> print(trace.of("mass"))
    mass: refused, round 1
      FAILED  gain: 12 >= 31.4 [significance.search]
    """

    decisions: tuple[Decision, ...] = field(default=())

    def of(self, cause: str) -> Trace:
        """The decisions of one cause: "actuator_lag(delta_e)", "actuator_lag delta_e", or a kind with all its targets.

        A person's words find it too: "aileron lag" is actuator_lag(delta_a).

        Parameters
        ----------
        cause
            Kind with or without target; a target without its term selects all terms.

        Raises
        ------
        InputError
            For a cause that was not considered, with the nearest one that was.
        """
        wanted = cause.replace(" ", "(", 1) + ")" if " " in cause.strip() and "(" not in cause else cause
        found = [one for one in self.decisions if wanted in (one.cause, one.cause.partition("(")[0])]
        begun = tuple(wanted.removesuffix(")") + mark for mark in ":,")  # a target without its term or variant
        found = found or [one for one in self.decisions if one.cause.startswith(begun)]
        causes = dict.fromkeys(one.cause for one in self.decisions)
        by_words = {} if found or "(" in cause else _most_alike(cause, causes)  # a name in its form is no words
        found = found or [one for one in self.decisions if by_words.get(one.cause, 0.0) == 1.0]
        if not found:
            kinds = {name.partition("(")[0] for name in causes}  # a list of all causes would fill a screen
            raise unknown("cause", cause, by_words or (causes if nearest(cause, causes) else kinds), "why")
        return Trace(decisions=tuple(found))

    def against(self, cause: str) -> Trace:
        """The decisions that kept a cause from being named.

        Raises
        ------
        InputError
            For a cause that was not considered, and for one that was named.
        """
        refused = tuple(one for one in self.of(cause).decisions if one.outcome != NAMED)
        if not refused:
            raise InputError(f"why_not: {cause} was named; diagnosis.why('{cause}') says by which gates")
        return Trace(decisions=refused)

    @property
    def not_tried(self) -> tuple[Decision, ...]:
        """The decisions on causes that were screened and not fitted."""
        return tuple(one for one in self.decisions if one.outcome == NOT_TRIED)

    @property
    def outcome(self) -> Mapping[str, str]:
        """Cause -> its best outcome, in the order of `OUTCOMES`."""
        best: dict[str, str] = {}
        for one in self.decisions:
            best[one.cause] = min(best.get(one.cause, NOT_TRIED), one.outcome, key=OUTCOMES.index)
        return best

    @property
    def deciding(self) -> tuple[Decision, ...]:
        """One decision for each cause: that with its best outcome, and of several such the one with the most gates."""
        best = {}
        outcome = self.outcome
        for one in self.decisions:
            before = best.get(one.cause)
            if one.outcome == outcome[one.cause] and (before is None or len(one.gates) > len(before.gates)):
                best[one.cause] = one
        return tuple(sorted(best.values(), key=lambda one: (OUTCOMES.index(one.outcome), one.round)))

    def reason(self, decision: Decision) -> str:
        """Return why a cause was named or not, as a sentence: the gate that it failed, or else those that it passed."""
        first = next((one for one in self.decisions if one.cause in decision.against), None)
        same = [one for one in self.decisions if first and one.cause == first.cause and one.round == decision.round]
        behind = same[0].statistic - decision.statistic if same else math.nan
        of = {gate.gate.removesuffix(FINAL): gate for gate in decision.failed[:1] or decision.gates}
        told = sorted(of.values(), key=lambda gate: not gate.gate.startswith("gain"))
        title = first.title if first else ""
        said = [clause(gate, title, behind) for gate in told]
        text = "; ".join(dict.fromkeys(one for one in said if one))
        return f"{text[0].upper()}{text[1:]}." if text else ""

    def summary(self, most: int = 6) -> str:
        """A line for each cause that was named or came near, and `most` of those that were fitted and not named."""
        chosen = [one for one in self.deciding if one.outcome in (NAMED, IN_A_SET, MINOR)]
        rest = [one for one in self.deciding if one.outcome == REFUSED and one.failed and one.title != one.cause]
        rest.sort(key=lambda one: -one.statistic if math.isfinite(one.statistic) else math.inf)
        lines = [f"{_OUTCOMES[one.outcome]}: {one.title} [{one.cause}]. {self.reason(one)}" for one in chosen]
        lines += [f"not named: {one.title} [{one.cause}]. {self.reason(one)}" for one in rest[:most]]
        more = len(self.deciding) - len(lines)
        return "\n".join(
            [*lines, *([f"And {more} more that were not named, of which each has its reason."] if more else [])]
        )

    def __str__(self) -> str:
        return "\n".join(str(one) for one in self.decisions)

    def __repr__(self) -> str:
        return f"<{len(self.decisions)} decisions on {len(self.outcome)} causes; print it for the gates>"


# what people say -> the word of a kind or label
_SAID = {"offset": "bias", "offsets": "bias", "late": "delay", "latency": "delay", "gain": "scale", "wing": "aileron"}
_EMPTY = frozenset({"a", "an", "and", "at", "in", "of", "on", "the"})


def _most_alike(said: str, causes: Iterable[str]) -> dict[str, float]:
    """Return the causes that have most words of a person in their kind and the labels of their channels, and which part
    of the words these are."""
    wanted = [_SAID.get(word, word) for word in _words(said) if word not in _EMPTY]
    parts = {}
    for cause in causes:
        own = {
            word
            for name in re.findall(r"\w+", cause)
            for word in (name.lower(), *_words(name), *_words(label_of(name)))
        }
        has = [word in own or (len(word) > 2 and any(one.startswith(word) for one in own)) for word in wanted]
        parts[cause] = sum(has) / max(len(wanted), 1)
    most = max(parts.values(), default=0.0)
    return {cause: part for cause, part in parts.items() if part == most > 0.0}


def _words(text: str) -> list[str]:
    return re.findall(r"[a-z0-9]+", text.lower().replace("_", " "))


def trace_of(document: Mapping[str, Any]) -> Trace:
    """The decision trace of a document of diagnosis.json.

    raises  InputError for a document of `casid.diagnosis/2` or before, which has no decisions
    """
    if "decisions" not in document:
        schema = document.get("schema", "no schema")
        raise InputError(
            f"no decisions in this diagnosis (of {schema}, casid.diagnosis/3 has them); run casid diagnose again"
        )
    return Trace(decisions=tuple(Decision.from_dict(entry) for entry in document["decisions"]))


def merged(decisions: Sequence[Decision]) -> tuple[Decision, ...]:
    """The decisions with only the last "not tried" of each cause, and none for a cause that was tried."""
    last = {one.cause: one for one in decisions if one.outcome == NOT_TRIED}
    tried = {one.cause for one in decisions if one.outcome != NOT_TRIED}
    return tuple(
        one for one in decisions if one.outcome != NOT_TRIED or (one.cause not in tried and last[one.cause] is one)
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class Cause:
    """A named cause, or a minor one.

    Attributes
    ----------
    effect
        What acts: its kind, target, term and unit.
    std
        Standard deviation of the value, corrected for model discrepancy and for differences between stretches of
        record.
    statistic
        Likelihood-ratio statistic: decrease of the deviance when the cause is added and everything is estimated again,
        with `dof` parameters. The model without the cause has the same scale of model discrepancy as the model with it.
    held_out_gain
        Increase of the log likelihood per reading of the held-out records; None for an event that does not recur there.
    onset_s
        Record -> interval [s] that contains the onset with 95 % probability or more; None for a cause that always acts.
    end_s
        The same for the end; None for a cause that does not end.
    indistinguishable_from
        The other causes of its ambiguity set: kind, target, term, title, value, unit, gain and probability of each.
    share
        Its size, in units of the smallest size that matters.
    on_readings
        Largest r.m.s. change of a reading by the cause in a simulation, in units of its noise as recorded; infinite
        where it was not computed.
    gates
        Its acceptance gates beside all other causes and on the held-out records.
    probability
        Probability that this cause or one of its ambiguity set is present.
    alone
        Probability that this cause itself is present.
    log_odds
        Log odds against all explanations without it.

    Examples
    --------
    >>> import casid as cs
    >>> found = cs.diagnose("aircraft.toml", cs.read_records("flight/m*.csv"))  # doctest: +SKIP
    >>> [(cause.kind, cause.target, cause.value, cause.std) for cause in found.causes]  # doctest: +SKIP
    """

    in_json: ClassVar[str] = (
        "name kind target term value std unit statistic dof probability alone log_odds held_out_gain sentence share "
        "records onset_s end_s indistinguishable_from parameters"
    )

    effect: Effect
    value: float
    std: float
    records: tuple[str, ...]
    statistic: float
    sentence: str
    meaningful: bool
    share: float
    on_readings: float = math.inf
    onset_s: Mapping[str, tuple[float, float]] | None = None
    end_s: Mapping[str, tuple[float, float]] | None = None
    dof: int = 1
    held_out_gain: float | None = None
    indistinguishable_from: tuple[Mapping[str, Any], ...] = ()
    parameters: Mapping[str, float] = field(default_factory=dict)
    gates: tuple[Gate, ...] = ()
    probability: float | None = None
    alone: float | None = None
    log_odds: float | None = None

    @property
    def kind(self) -> str:
        """Kind of its effect, as "actuator_lag"."""
        return self.effect.kind

    @property
    def target(self) -> str:
        """Port where it acts, as "delta_e"."""
        return self.effect.target

    @property
    def term(self) -> str | None:
        """The term that is missing; None for most kinds."""
        return self.effect.term

    @property
    def entry(self) -> EffectValue:
        """The cause as an entry of an aircraft file, which any model takes too (`Model.with_effects`)."""
        return EffectValue(
            kind=self.kind,
            target=self.target,
            term=self.term,
            value=self.value,
            std=self.std,
            records=self.records,
            onset_s=dict(self.onset_s) if self.onset_s else None,
            parameters=dict(self.parameters),
            sentence=self.sentence,
        )

    @property
    def unit(self) -> str:
        """Unit of `value` and `std`."""
        return self.effect.unit

    @property
    def key(self) -> tuple[str, str, str | None]:
        """Kind, target and term."""
        return self.effect.key

    @property
    def name(self) -> str:
        """Name in the decisions, as "actuator_lag(delta_e)"."""
        return self.effect.name

    @property
    def title(self) -> str:
        """A short name for a person, as "elevator: actuator lag"."""
        return title_of(self.effect)

    @property
    def statement(self) -> str:
        """Its sentence, and the other causes of its ambiguity set."""
        others = dict.fromkeys(one["title"] for one in self.indistinguishable_from)  # variants of a kind share a title
        alike = f" These data cannot tell that apart from {' or '.join(others)}." if others else ""
        return self.sentence + alike

    to_dict = by_fields
