"""The report and what is written beside it. Truth: formats of the files, the hidden term of the flight, HTML rules."""

from __future__ import annotations

import base64
import json
import re
import shutil
import subprocess
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.text import Text
from small_flight import HIDDEN, NAMES, aircraft_file, records

from casid.diagnosis.data.finding import Finding
from casid.diagnosis.diagnose import diagnose
from casid.diagnosis.evidence.missing_input import MissingInput
from casid.diagnosis.flight.fit import fit
from casid.diagnosis.flight.flight import prepare
from casid.diagnosis.flight.hypothesis import Attached
from casid.diagnosis.given.contradicted import Contradiction
from casid.diagnosis.given.not_judged import NotJudged
from casid.diagnosis.result import Diagnosis
from casid.errors import InputError
from casid.keeping import load
from casid.model.aircraft import Aircraft
from casid.model.causes import effectiveness_change
from casid.model.dynamics import aircraft_model
from casid.model.simulate import simulate
from casid.report.folder import provenance, whole_folder
from casid.report.gained import gained
from casid.report.lead import pictures
from casid.report.onset import onset_profiles
from casid.report.page import FIGURES, write_report
from casid.report.shares import shares
from casid.report.style import Picture, settings, smooth
from casid.report.tables import derivatives, unseen
from casid.report.tracks import tracks
from casid.report.words import digits, pretty, quantity, with_std

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)


@pytest.fixture(scope="module")
def diagnosis() -> Diagnosis:
    return diagnose(aircraft_file(), records())


@pytest.fixture(scope="module")
def shown(diagnosis: Diagnosis) -> dict[str, Picture]:
    return pictures(diagnosis)


@pytest.fixture(scope="module")
def drawn(shown: dict[str, Picture]) -> dict[str, bytes]:
    return {name: picture.svg() for name, picture in shown.items()}


@pytest.fixture(scope="module")
def folder(diagnosis: Diagnosis, tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("report")
    diagnosis.write(place / "diagnosis.json")
    diagnosis.extended_aircraft.write(place / "extended.toml")
    write_report(diagnosis, place, provenance(seed=3))
    return place


# -- what programs read ------------------------------------------------------------------------------------------------

NUMBER = (int, float)
CAUSE = {
    "kind": str,
    "target": str,
    "value": NUMBER,
    "std": NUMBER,
    "unit": str,
    "records": list,
    "statistic": NUMBER,
    "dof": int,
    "indistinguishable_from": list,
    "sentence": str,
}
CHANNEL = dict.fromkeys(("rms", "noise", "whiteness_p", "theil", "R2"), NUMBER)
RANK = {"kind": str, "target": str, "statistic": NUMBER}


def has(table: dict, types: dict) -> bool:
    return all(isinstance(table[key], kind) for key, kind in types.items())


def test_json_has_the_published_keys(folder: Path) -> None:
    document = json.loads((folder / "diagnosis.json").read_text(encoding="utf-8"))
    assert document["schema"] == "casid.diagnosis/2"
    assert document["verdict"] == "explained"
    assert {"not_judged", "data", "contradicted", "unexplained"} <= set(document)
    assert document["causes"] and all(has(cause, CAUSE) for cause in document["causes"])
    assert all({"term", "onset_s", "held_out_gain"} <= set(cause) for cause in document["causes"])
    assert all(has(minor, {"kind": str, "target": str, "value": NUMBER, "std": NUMBER}) for minor in document["minor"])
    assert document["ranking"] and all(has(rank, RANK) for rank in document["ranking"])
    for view in ("as_given", "refitted", "extended"):
        assert isinstance(document[view]["log_likelihood"], NUMBER)
        assert all(has(channel, CHANNEL) for channel in document[view]["channels"].values())
    held = document["gain"]["held_out"]
    assert held["records"] == [NAMES[1]] and set(held["rms_ratio"]) == set(document["as_given"]["channels"])
    assert list(held["rms_ratio"].values()) == sorted(held["rms_ratio"].values(), reverse=True)
    steps = dict.fromkeys(("as_given", "data_mended", "values", "structure", "noise"), NUMBER)
    assert document["budget"]["records"] == [NAMES[1]]
    assert set(document["budget"]["channels"]) == set(document["as_given"]["channels"])
    assert all(has(one, steps) for one in (*document["budget"]["channels"].values(), document["budget"]["all"]))
    assert isinstance(held["log_likelihood_per_sample"], NUMBER) and isinstance(document["gain"]["bic"], NUMBER)


def test_extended_aircraft_is_read_back_and_has_the_hidden_term(folder: Path, diagnosis: Diagnosis) -> None:
    extended = Aircraft.read(folder / "extended.toml")
    assert extended == diagnosis.extended_aircraft
    effect = next(e for e in extended.effects if (e.kind, e.target, e.term) == ("aero_term", "Cm", "alpha^2"))
    assert abs(effect.value - HIDDEN) < 4.0 * effect.std + 0.02 * HIDDEN


def test_a_folder_is_written_whole_or_not_at_all(tmp_path: Path) -> None:
    place = tmp_path / "results"
    with pytest.raises(RuntimeError), whole_folder(place) as inside:
        (inside / "half.txt").write_text("half")
        raise RuntimeError
    assert not place.exists()
    for text in ("first", "second"):
        with whole_folder(place) as inside:
            (inside / "a.txt").write_text(text)
            (inside / FIGURES).mkdir()
            (inside / FIGURES / f"{text}.svg").write_text(text)
        (place / "of the user.txt").write_text("stays")
    assert sorted(p.name for p in place.rglob("*")) == ["a.txt", "of the user.txt", FIGURES, "second.svg"]
    assert (place / "a.txt").read_text() == "second"


def test_a_folder_that_cannot_be_written_is_refused_before_the_work(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(InputError, match="cannot be written"), whole_folder(tmp_path / "file"):
        pytest.fail("the block must not run")


# -- the page ----------------------------------------------------------------------------------------------------------


class Tags(HTMLParser):
    """Every start tag with its attributes."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, dict(attrs)))

    def named(self, *tags: str) -> Iterator[dict[str, str | None]]:
        return (attributes for tag, attributes in self.found if tag in tags)


def test_page_is_self_contained(folder: Path) -> None:
    page = (folder / "report.html").read_text(encoding="utf-8")
    tags = Tags(page)
    links = [a[key] or "" for _, a in tags.found for key in ("src", "href", "srcset", "data", "poster") if key in a]
    assert links and all(link.startswith(("data:", "#")) for link in links)
    assert not list(tags.named("script", "iframe", "object", "embed"))
    style = page[page.index("<style>") : page.index("</style>")]
    assert "url(" not in style and "@import" not in style
    targets = {a["id"] for _, a in tags.found if "id" in a}
    assert {link[1:] for link in links if link.startswith("#")} <= targets


def test_every_figure_has_words_and_a_file_of_its_own(folder: Path, shown: dict[str, Picture]) -> None:
    tags = Tags((folder / "report.html").read_text(encoding="utf-8"))
    images = list(tags.named("img"))
    assert len(images) == len(list(tags.named("figure"))) == len(list(tags.named("figcaption"))) == len(shown)
    assert all(len(image["alt"] or "") > 20 for image in images)
    files = {path.read_bytes() for path in (folder / FIGURES).glob("*.svg")}
    embedded = {base64.b64decode((image["src"] or "").partition(",")[2]) for image in images}
    assert embedded == files
    for svg in files:
        assert ElementTree.fromstring(svg).tag.endswith("svg")


def test_page_opens_with_the_verdict_and_the_shape_of_what_is_missing(folder: Path, diagnosis: Diagnosis) -> None:
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert page.index(pretty(diagnosis.headline)) < page.index('id="figure-shape"') < page.index("What it gains</h2>")


def test_page_opens_with_data_values_structure_unseen_data_and_what_was_not_judged(
    folder: Path, diagnosis: Diagnosis
) -> None:
    page = (folder / "report.html").read_text(encoding="utf-8")
    heads = [f"<dt>{head}</dt>" for head in ("Data", "Values", "Structure", "Unseen data", "Not judged")]
    at = [page.index(head) for head in heads]
    first = page.index('id="figure-shape"')
    assert at == sorted(at) and at[-1] < first
    assert "no channel psi" in page[at[-1] : first]
    assert "Cm: alpha²" in page[at[2] : at[3]]


def wrong_in_all(diagnosis: Diagnosis) -> Diagnosis:
    """With a fault of the data, a contradicted value and something unexplained beside the cause."""
    history = {name: (t, 0.02 * np.sin(t), 0.001 + 0.0 * t) for name, (t, _, _) in missing(diagnosis).history.items()}
    loud = replace(missing(diagnosis), station="dCl", gain=1e4, history=history)
    stuck = Finding(
        kind="data_stuck",
        target="beta",
        records=(NAMES[0],),
        intervals_s={NAMES[0]: ((2.0, 3.0),)},
        handled="excluded",
        sentence="The sideslip angle is frozen.",
    )
    against = Contradiction(
        parameter="Cl_p",
        unit="1",
        given=-0.9,
        flight=-0.5,
        std=0.01,
        reversed=False,
        impossible=False,
        sentence="Cl_p.",
    )
    return replace(diagnosis, data=(stuck,), contradicted=(against,), unexplained=(loud,))


def missing(diagnosis: Diagnosis) -> MissingInput:
    return diagnosis.missing_after[0]


def test_every_claim_has_a_figure_that_links_back_to_it(diagnosis: Diagnosis, tmp_path: Path) -> None:
    """Data, values, causes and the unexplained: from the statement to a figure, and from that to the statement."""
    write_report(wrong_in_all(diagnosis), tmp_path, provenance(seed=0))
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    ids = {a["id"] for _, a in Tags(page).found if "id" in a}
    figures = {m[1]: m[0] for m in re.finditer(r'<figure id="([^"]+)".*?</figure>', page, flags=re.DOTALL)}
    anchors = {"data-1", "value-Cl_p", "unexplained-1", *(f"cause-{k + 1}" for k in range(len(diagnosis.causes)))}
    assert anchors <= ids
    for anchor in anchors:
        statement = page[page.index(f'id="{anchor}"') :].partition("</p>")[0]
        shown = re.findall(r'href="#(figure-[^"]+)"', statement)
        assert shown, anchor
        assert all(f'href="#{anchor}"' in figures[name] for name in shown), anchor


def test_a_name_with_markup_is_only_text(
    diagnosis: Diagnosis,
    shown: dict[str, Picture],
    drawn: dict[str, bytes],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert set(drawn) == set(shown)
    monkeypatch.setattr("casid.report.page.pictures", lambda named: shown)
    evil = "<script>alert(1)</script> & $gain {{ 7 * 7 }}"
    stuck = replace(wrong_in_all(diagnosis).data[0], records=(evil,), sentence=f"In {evil}.")
    open_ = NotJudged(what=evil, because=evil)
    named = replace(diagnosis, aircraft=replace(diagnosis.aircraft, name=evil), data=(stuck,), not_judged=(open_,))
    write_report(named, tmp_path, provenance(seed=0) | {"command": ["casid", "diagnose", evil]})
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    escaped = "&lt;script&gt;alert(1)&lt;/script&gt; &amp; $gain {{ 7 * 7 }}"
    assert page.count(escaped) >= 6 and not list(Tags(page).named("script"))


def test_gain_in_words_is_the_gain_in_numbers_and_names_what_got_worse(diagnosis: Diagnosis) -> None:
    ratios = diagnosis.to_dict()["gain"]["held_out"]["rms_ratio"]
    before, after = diagnosis.held_out_as_given.channels, diagnosis.held_out_extended.channels
    assert ratios == {o: pytest.approx(after[o].rms / before[o].rms) for o in before}
    told = gained(diagnosis)
    assert f"{100.0 * (min(ratios.values()) - 1.0):+.0f} %".replace("-", "−") in told.better
    lost = {o: replace(after[o], rms=k * before[o].rms) for k, o in ((3.0, "p"), (5.0, "V"))}
    view = replace(diagnosis.held_out_extended, channels={**after, **lost})
    worse = gained(replace(diagnosis, held_out_extended=view)).worse
    assert worse.startswith("true airspeed +400 %, roll rate +200 %")


def test_every_number_of_the_file_stands_beside_flight_what_it_contradicts_first(diagnosis: Diagnosis) -> None:
    rows = derivatives(wrong_in_all(diagnosis)).rows
    assert sorted(row.cells[0] for row in rows) == sorted(one.name for one in diagnosis.parameters)
    assert rows[0].cells[0] == "Cl_p" and [row.marked for row in rows] == [True] + [False] * (len(rows) - 1)
    untold = sum(not one.flight.told for one in diagnosis.parameters)
    assert sum(row.cells[2] == "not told by these records" for row in rows) == untold


def test_a_size_beyond_anything_plausible_is_not_detectable(diagnosis: Diagnosis) -> None:
    """The limit of a bias of an angle is 10 deg: 0.1 rad can be found, 4.85 rad cannot."""
    found = replace(diagnosis, detectable={"sensor_bias(theta)": 4.85, "sensor_bias(phi)": 0.1})
    (row,) = unseen(found).rows
    assert row.cells == ("sensor bias", "phi 5.7 deg", "theta")


def test_explanations_stand_side_by_side_and_add_up(diagnosis: Diagnosis) -> None:
    told = [(("actuator_lag(delta_e)",), 0.97), (("input_delay(delta_e)",), 0.02), ((), 0.001)]
    found = shares(replace(diagnosis, explanations=tuple(told)))
    said = ["elevator: actuator lag", "elevator: input delay", "other explanations"]
    assert [one.what for one in found] == said and [one.percent for one in found] == ["97 %", "2 %", "1 %"]
    assert shares(replace(diagnosis, explanations=())) == []


def test_channels_are_drawn_in_all_records_with_what_was_left_out(diagnosis: Diagnosis) -> None:
    """Measured lines are the records, one after the other; the frozen second is shaded on its own channel alone."""
    pictures_ = {one.name: one for one in tracks(wrong_in_all(diagnosis))}
    assert set(pictures_) == {"tracks_longitudinal", "tracks_lateral"}
    axes = {axis.get_ylabel().split("\n")[0]: axis for axis in pictures_["tracks_lateral"].figure.axes}
    assert list(axes)[:2] == ["delta_a", "delta_r"] and {"beta", "p", "r", "phi", "ay"} <= set(axes)
    assert len(axes["beta"].patches) == len(axes["p"].patches) + 1  # beside the shade of the held-out record
    measured = axes["beta"].lines[0]
    record = diagnosis.as_given.fit.flight.records[0]
    assert np.allclose(np.asarray(measured.get_ydata()), np.degrees(record["beta"]))


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
        with settings():
            picture.figure.draw_without_rendering()
        edge = picture.figure.bbox.padded(1.0)
        for text in set(picture.figure.findobj(Text)) - undrawn(picture.figure):
            if text.get_visible() and text.get_text().strip():
                corners = text.get_window_extent().corners()
                assert all(edge.contains(x, y) for x, y in corners), (picture.name, text.get_text())


def test_figures_are_the_same_bytes_each_time(folder: Path, drawn: dict[str, bytes]) -> None:
    for name, svg in drawn.items():
        assert svg == (folder / FIGURES / f"{name}.svg").read_bytes(), name


def test_reconstructed_moment_follows_the_hidden_parabola(shown: dict[str, Picture]) -> None:
    """The dots were made without knowing the term; they must lie about HIDDEN alpha^2."""
    lines = {str(line.get_label()): line for line in shown["shape"].figure.axes[0].lines}
    dots = next(line for label, line in lines.items() if label.startswith("reconstructed"))
    x, y = np.array(dots.get_data(), dtype=float)
    parabola = HIDDEN * np.radians(x) ** 2
    assert np.corrcoef(y, parabola)[0, 1] > 0.8
    assert np.polyfit(parabola, y, 1)[0] == pytest.approx(1.0, abs=0.35)


def test_without_a_cause_the_page_shows_the_simulation(diagnosis: Diagnosis) -> None:
    view, held = diagnosis.refitted, diagnosis.held_out_refitted
    plain = replace(diagnosis, verdict="adequate", causes=(), extended=view, held_out_extended=held, missing_after=())
    names = list(pictures(plain))
    assert names[0] == "histories" and "shape" not in names and {"budget", "gain"} <= set(names)


def test_what_stays_unexplained_opens_the_page(diagnosis: Diagnosis) -> None:
    """An input as large as the rolling moment itself, at the station of the rolling moment."""
    plain = replace(wrong_in_all(diagnosis), verdict="unexplained", causes=(), extended=diagnosis.refitted)
    first = next(iter(pictures(plain).values()))
    assert first.name == "unexplained" and "rolling moment Cl" in first.title


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


# -- words and numbers -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (with_std(0.12345, 0.0021, "s"), "0.1235 ± 0.0021 s"),
        (with_std(-np.pi / 180.0, 0.1 * np.pi / 180.0, "rad"), "−1.00 ± 0.10 deg"),
        (with_std(3.0, 0.0, "1/rad2"), "3.00 1/rad²"),
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


# -- in a browser ------------------------------------------------------------------------------------------------------

PROBE = """<script>addEventListener('load', () => { const d = document.documentElement;
d.dataset.images = JSON.stringify([...document.images].map(i => [i.naturalWidth, i.clientWidth, i.clientHeight]));
d.dataset.wide = d.scrollWidth - d.clientWidth; });</script>"""


def browse(page: Path, width: int, tmp_path: Path, *options: str) -> subprocess.CompletedProcess[str]:
    assert CHROMIUM is not None
    command = [
        CHROMIUM,
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        "--disable-background-networking",
        "--disable-component-update",
        "--disable-sync",
        "--no-first-run",
        f"--user-data-dir={tmp_path / 'profile'}",
        f"--window-size={width},2000",
        "--enable-logging=stderr",
        *options,
        page.as_uri(),
    ]
    return subprocess.run(command, capture_output=True, text=True, timeout=120.0, check=True)


@pytest.mark.parametrize("width", [1100, 500])
def test_page_in_a_browser(folder: Path, tmp_path: Path, width: int) -> None:
    """Nothing on the console, every image drawn, nothing wider than the window."""
    if CHROMIUM is None:
        pytest.skip("no chromium on the PATH: the page was not looked at in a browser")
    probe = tmp_path / "probe.html"
    page = (folder / "report.html").read_text(encoding="utf-8")
    probe.write_text(page.replace("</body>", PROBE + "</body>"), encoding="utf-8")
    done = browse(probe, width, tmp_path, "--dump-dom")
    assert "CONSOLE" not in done.stderr
    root = next(Tags(done.stdout).named("html"))
    sizes = json.loads(root["data-images"] or "[]")
    assert len(sizes) == len(re.findall("<img ", page)) and all(min(size) > 0 for size in sizes)
    assert int(root["data-wide"] or "0") == 0


def test_a_diagnosis_becomes_a_data_frame_and_a_notebooks_table(diagnosis: Diagnosis) -> None:
    table = diagnosis.to_frame()
    assert len(table) == len(diagnosis.causes) + len(diagnosis.minor)
    assert table.loc["aero_term(Cm:alpha^2)", "value"] == diagnosis.causes[0].value
    assert not table.loc["aero_term(Cm:alpha^2)", "minor"]
    page = diagnosis._repr_html_()
    assert diagnosis.verdict in page and "aero_term(Cm:alpha^2)" in page
    assert len(repr(diagnosis)) < 300 and diagnosis.verdict in repr(diagnosis)


def test_a_diagnosis_is_read_as_it_was_saved(diagnosis: Diagnosis, tmp_path: Path) -> None:
    diagnosis.save(tmp_path / "found.casid")
    found = load(tmp_path / "found.casid")
    assert str(found) == str(diagnosis) and json.dumps(found.to_dict()) == json.dumps(diagnosis.to_dict())
    assert found.extended_aircraft == diagnosis.extended_aircraft
    assert {name: picture.svg() for name, picture in pictures(found).items()} == {
        name: picture.svg() for name, picture in pictures(diagnosis).items()
    }
