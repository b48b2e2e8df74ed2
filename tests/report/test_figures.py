"""What the report says and draws. Truth: the hidden term of the flight, what is measured, the diagnosis in numbers."""

from __future__ import annotations

import json
import pickle
import re
import shutil
from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.text import Text
from small_flight import HIDDEN, aircraft_file, records

from casid.diagnosis.document import Document, Explanation
from casid.diagnosis.engine.trial import Trial
from casid.diagnosis.evidence.evidence import Evidence
from casid.diagnosis.evidence.screening import Candidate
from casid.diagnosis.flight.evaluation import FlightFit
from casid.diagnosis.flight.fit import fit
from casid.diagnosis.flight.flight import prepare
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.result import Diagnosis
from casid.diagnosis.shown import detectable_of, onset_profiles, titled
from casid.keeping import load
from casid.model.causes.air import gust
from casid.model.causes.controls import actuator_lag, effectiveness_change, input_delay
from casid.model.causes.instruments import sensor_bias
from casid.model.dynamics import aircraft_model
from casid.model.effect import Effect
from casid.model.effects import effect_named
from casid.model.simulate import simulate
from casid.model.vocabulary import title_of
from casid.report.evidence_figures import kinematic
from casid.report.figure import Bar, Curve, Picture, Span
from casid.report.history_figures import smooth, tracks
from casid.report.next_flight import next_flights
from casid.report.page import FIGURES, Report, lost
from casid.report.statements import statements
from casid.report.svg import paint, svg
from casid.report.tables import derivatives, shares, unseen
from casid.report.words import digits, percent, pretty, probability_in_words, quantity, with_std

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)


def test_gain_in_words_is_the_gain_in_numbers_and_names_what_got_worse(
    diagnosis: Diagnosis, document: Document
) -> None:
    ratios = diagnosis.to_dict()["gain"]["held_out"]["rms_ratio"]
    before, after = diagnosis.held_out_as_given.channels, diagnosis.held_out_extended.channels
    assert ratios == {o: pytest.approx(after[o].rms / before[o].rms) for o in before}
    assert bool(lost(document)) == (max(ratios.values()) > 1.005)
    worse = {o: replace(after[o], rms=k * before[o].rms) for k, o in ((3.0, "p"), (5.0, "V"))}
    view = replace(diagnosis.held_out_extended, channels={**after, **worse})
    told = lost(replace(document, rms_ratio=replace(diagnosis, held_out_extended=view).rms_ratio))
    assert told.replace("\u00a0", " ").startswith("true airspeed +400 %, roll rate +200 %")


def test_every_number_of_the_file_stands_beside_flight_what_it_contradicts_first(
    diagnosis: Diagnosis, wrong_in_all: Document
) -> None:
    table = derivatives(wrong_in_all)
    assert sorted(row[0] for row in table.rows) == sorted(one.name for one in diagnosis.parameters)
    assert table.rows[0][0] == "Cl_p" and set(table.marked) == {0}
    untold = sum(not one.flight.determined for one in diagnosis.parameters)
    assert sum(row[2] == "not identifiable from these records" for row in table.rows) == untold


def test_a_size_beyond_anything_plausible_is_not_detectable(document: Document) -> None:
    """The limit of a bias of an angle is 10 deg: 0.1 rad can be found, 4.85 rad cannot."""
    sizes = {"sensor_bias(theta)": 4.85, "sensor_bias(phi)": 0.1}
    found = replace(document, unseen=tuple(detectable_of(map(effect_named, sizes), sizes)))
    (row,) = unseen(found).rows
    assert row == ("sensor bias", "phi 5.7 deg", "theta")


def test_explanations_stand_side_by_side_and_add_up(document: Document) -> None:
    told = [(("actuator_lag(delta_e)",), 0.97), (("input_delay(delta_e)",), 0.02), ((), 0.001)]
    explanations = [
        Explanation(causes=names, titles=tuple(titled(name, {}) for name in names), probability=p) for names, p in told
    ]
    found = shares(replace(document, explanations=tuple(explanations)))
    said = ["elevator: actuator lag", "elevator: input delay", "other explanations"]
    assert [(what, probability_in_words(p)) for what, p in found] == list(
        zip(said, ["97 %", "2 %", "1 %"], strict=True)
    )
    assert shares(replace(document, explanations=())) == []


def test_channels_are_drawn_in_all_records_with_what_was_left_out(diagnosis: Diagnosis, wrong_in_all: Document) -> None:
    """Measured lines are the records, one after the other; the frozen second is shaded on its own channel alone."""
    pictures_ = {one.name: one for one in tracks(wrong_in_all)}
    assert set(pictures_) == {"tracks_longitudinal", "tracks_lateral"}
    panels = {panel.y.label.split(" ")[0]: panel for panel in pictures_["tracks_lateral"].figure.panels}
    assert list(panels)[:2] == ["delta_a", "delta_r"] and {"beta", "p", "r", "phi", "ay"} <= set(panels)
    assert len(panels["beta"].of(Span)) == len(panels["p"].of(Span)) + 1  # beside the shade of the held-out record
    measured = panels["beta"].of(Curve)[0]
    record = diagnosis.as_given.fit.flight.records[0]
    assert np.allclose(measured.y[: len(record)], np.degrees(record["beta"]))
    assert np.isnan(measured.y[len(record)]), "a gap between records"


# -- the figures -------------------------------------------------------------------------------------------------------


def undrawn(figure: Figure) -> set[Text]:
    """Labels of ticks beyond the limits of their axis, which matplotlib keeps but does not draw."""
    found = set()
    for axis in (axis for axes in figure.axes for axis in (axes.xaxis, axes.yaxis)):
        low, high = sorted(axis.get_view_interval())
        ticks = [*axis.get_major_ticks(), *axis.get_minor_ticks()]
        found |= {label for t in ticks if not low <= t.get_loc() <= high for label in (t.label1, t.label2)}
    return found


def test_no_text_is_cut_off_at_the_edge(shown: dict[str, Picture], drawn: dict[str, bytes]) -> None:
    assert set(drawn) == set(shown)
    for picture in shown.values():
        figure = paint(picture.figure)
        figure.draw_without_rendering()
        edge = figure.bbox.padded(1.0)
        for text in set(figure.findobj(Text)) - undrawn(figure):
            if text.get_visible() and text.get_text().strip():
                corners = text.get_window_extent().corners()
                assert all(edge.contains(x, y) for x, y in corners), (picture.name, text.get_text())


def test_figures_are_the_same_bytes_each_time(folder: Path, drawn: dict[str, bytes]) -> None:
    for name, text in drawn.items():
        assert text == (folder / FIGURES / f"{name}.svg").read_bytes(), name


def test_reconstructed_moment_follows_the_hidden_parabola(shown: dict[str, Picture]) -> None:
    """The dots were made without knowing the term; they must lie about HIDDEN alpha^2."""
    dots = next(one for one in shown["shape"].figure.panels[0].of(Curve) if one.look.name.startswith("reconstructed"))
    parabola = HIDDEN * np.radians(dots.x) ** 2
    assert np.corrcoef(dots.y, parabola)[0, 1] > 0.8
    assert np.polyfit(parabola, dots.y, 1)[0] == pytest.approx(1.0, abs=0.35)


def test_without_a_cause_the_page_shows_the_simulation(document: Document) -> None:
    view, held = document.refitted, document.held_out_refitted
    plain = replace(document, verdict="adequate", causes=(), extended=view, held_out_extended=held, missing_after={})
    names = list(Report.of(plain).pictures)
    assert names[0] == "worst" and "shape" not in names and "budget" in names


def test_what_stays_unexplained_has_a_figure(wrong_in_all: Document) -> None:
    """An input as large as the rolling moment itself, at the station of the rolling moment."""
    plain = replace(wrong_in_all, verdict="unexplained", causes=(), extended=wrong_in_all.refitted)
    assert "rolling moment Cl" in Report.of(plain).pictures["unexplained"].title


def test_onset_profile_peaks_where_the_surface_failed() -> None:
    """The elevator loses 40 % at t = 1.3 s, in the middle of a pulse."""
    failed, aircraft = 1.3, aircraft_file()
    pulses = records()[0]
    lost = np.where(pulses.t >= failed, -0.4, 0.0) * pulses["delta_e"]
    model = aircraft_model(aircraft)
    flown = simulate(model, pulses, model.guess(pulses)[0], disturbances={"d_delta_e": lost})
    rng = np.random.default_rng(11)
    noise = {name: rng.normal(0.0, 1e-3, len(pulses)) for name in ("V", "alpha", "beta", "p", "q", "r", "phi", "theta")}
    record = pulses.without("ax", "ay", "az").with_channels(**{n: flown.output(n) + e for n, e in noise.items()})
    flight = prepare(aircraft, [record])
    cause = Attached(effect=effectiveness_change("delta_e"), values={"value": -0.4}, onsets={record.name: 1.0})
    t, statistic = onset_profiles(fit(flight, [], flight.noise()), cause)[record.name]
    assert t[np.argmax(statistic)] == pytest.approx(failed, abs=0.3)


def parts_of(value: object, seen: set[int]) -> Iterator[object]:
    """A value and all that it holds."""
    if id(value) in seen or isinstance(value, (str, bytes, np.ndarray, type)):
        return
    seen.add(id(value))
    yield value
    inside = list(value.items()) if isinstance(value, Mapping) else list(value) if isinstance(value, Collection) else []
    for one in (*inside, *getattr(value, "__dict__", {}).values()):
        yield from parts_of(one, seen)


def test_a_document_has_no_fit_in_it_and_is_drawn_from_a_file(document: Document, drawn: dict[str, bytes]) -> None:
    held = {type(one) for part in vars(document).values() for one in parts_of(part, set())}
    assert not held & {FlightFit, Evidence, Effect, Attached, Candidate, Trial}
    again = Report.of(pickle.loads(pickle.dumps(document))).pictures
    assert {name: svg(picture.figure) for name, picture in again.items()} == drawn


# -- words and numbers -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (with_std(0.12345, 0.0021, "s"), "0.1235 ± 0.0021 s"),
        (with_std(-np.pi / 180.0, 0.1 * np.pi / 180.0, "rad"), "−1.00 ± 0.10 deg"),
        (with_std(3.0, 0.0, "1/rad2"), "3.00 1/rad²"),
        (with_std(12345.0, 678.0, "kg"), "12340 ± 680 kg"),
        (with_std(-1.45126, 0.01134, "1"), "−1.451 ± 0.011"),
        (percent(-1.45126, -3.2, 0.01134), "−54.65 %"),
        (percent(1.003, 1.0, 0.2), "0 %"),
        (percent(1.0, 0.0, 0.2), "–"),
        (quantity(0.05, "rad/s"), "2.9 deg/s"),
        (quantity(-0.3, "1"), "−0.30"),
        (digits(0.0), "0"),
        (digits(1234.5, 3), "1234"),
        (digits(1.5e-9, 2), "1.5e−09"),
        (pretty("alpha^2*beta by 3 1/rad2 in m2 at 1 m/s2"), "alpha²·beta by 3 1/rad² in m2 at 1 m/s²"),
    ],
)
def test_numbers_as_a_person_writes_them(text: str, expected: str) -> None:
    assert text == expected


def test_smoothing_keeps_a_constant_and_skips_gaps() -> None:
    values = np.full(100, 2.5)
    values[30:35] = np.nan
    assert smooth(values, dt=0.02) == pytest.approx(np.full(100, 2.5))
    assert np.isnan(smooth(np.full(50, np.nan), dt=0.02)).all()


def test_a_diagnosis_becomes_a_data_frame_and_a_notebooks_table(diagnosis: Diagnosis) -> None:
    table = diagnosis.to_frame()
    assert len(table) == len(diagnosis.causes) + len(diagnosis.minor)
    assert table.loc["aero_term(Cm:alpha^2)", "value"] == diagnosis.causes[0].value
    assert not table.loc["aero_term(Cm:alpha^2)", "minor"]
    page = diagnosis._repr_html_()
    assert diagnosis.verdict in page and "aero_term(Cm:alpha^2)" in page
    assert len(repr(diagnosis)) < 300 and diagnosis.verdict in repr(diagnosis)


def test_a_diagnosis_is_read_as_it_was_saved(diagnosis: Diagnosis, drawn: dict[str, bytes], tmp_path: Path) -> None:
    diagnosis.save(tmp_path / "found.casid")
    samples = sum(map(len, records()))
    assert (tmp_path / "found.casid").stat().st_size < 5000 * samples, "more than 20 MB for the demonstration"
    found = load(tmp_path / "found.casid")
    assert str(found) == str(diagnosis) and json.dumps(found.to_dict()) == json.dumps(diagnosis.to_dict())
    assert found.extended_aircraft == diagnosis.extended_aircraft
    assert {name: svg(picture.figure) for name, picture in Report.of(found.document()).pictures.items()} == drawn


def test_the_next_flight_would_separate_what_stayed_ambiguous(diagnosis: Diagnosis) -> None:
    """A delay of the rudder that might be a lag: the manoeuvre promises more than the records hold, within the
    deflections that they flew."""
    lag = actuator_lag("delta_r")
    alike = {"kind": lag.kind, "target": lag.target, "term": None, "title": title_of(lag), "value": 0.05}
    cause = replace(diagnosis.causes[0], effect=input_delay("delta_r"), value=0.05, indistinguishable_from=(alike,))
    ambiguous = replace(diagnosis, causes=(cause,), contradicted=()).document()
    (claim,) = statements(ambiguous, {"ambiguity"})["causes"]
    assert claim.text.endswith("or rudder: actuator lag") and claim.figures == ("ambiguity",)
    first, *_ = next_flights(ambiguous).proposals
    assert "rudder: input delay" in first.open and "rudder: actuator lag" in first.open
    now, before = (float(x) for x in re.findall(r"(?:expected is|same measure,) ([\d.]+)", first.tells))
    assert now > before > 0.0
    flown = max(np.abs(r["delta_r"] - np.median(r["delta_r"])).max() for r in diagnosis.refitted.fit.flight.records)
    assert np.abs(first.record["delta_r"] - first.record["delta_r"][0]).max() <= flown * 1.001
    assert "--separate 'input_delay(delta_r)=0.05' 'actuator_lag(delta_r)=0.05'" in first.command


def test_what_no_manoeuvre_separates_is_said(diagnosis: Diagnosis) -> None:
    """A gust comes when it comes."""
    bias = sensor_bias("q")
    alike = {"kind": bias.kind, "target": bias.target, "term": None, "title": title_of(bias), "value": 0.001}
    cause = replace(diagnosis.causes[0], effect=gust("z"), value=1.0, indistinguishable_from=(alike,))
    found = next_flights(replace(diagnosis, causes=(cause,), contradicted=()).document())
    assert "no manoeuvre can bring it about" in found.beyond[0]
    assert not any("--separate" in one.command for one in found.proposals)


def test_the_kinematic_check_says_how_many_bars_it_draws(document: Document) -> None:
    """The instruments of its title, or the number of those that are drawn."""
    picture = kinematic(document)
    assert picture is not None
    (cleared, among) = map(int, re.findall(r"\d+", picture.title))
    drawn = len(picture.figure.panels[0].of(Bar))
    assert cleared <= among
    assert drawn == among or str(drawn) in re.findall(r"\d+", picture.caption)


def test_the_json_is_the_document_with_or_without_the_curves_of_figures(
    diagnosis: Diagnosis, document: Document
) -> None:
    told = document.to_dict()
    assert json.dumps(told, allow_nan=False) == json.dumps(diagnosis.to_dict(), allow_nan=False)
    assert [one["sentence"] for one in told["causes"]] == [one.sentence for one in document.causes]
    assert list(told["parameters"]) == [one.name for one in document.parameters]


def test_no_record_is_turbulent_where_the_air_is_calm(diagnosis: Diagnosis) -> None:
    """The strength of turbulence is estimated in every diagnosis; it is told of a record only where it is named."""
    assert not diagnosis.turbulence.named and diagnosis.turbulence.records
    assert [one["turbulent"] for one in diagnosis.to_dict()["records"]] == [False] * len(records())
