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
from html import escape
from html.parser import HTMLParser
from pathlib import Path

import pytest
from small_flight import HIDDEN, NAMES

from casid.diagnosis.document import Document
from casid.diagnosis.first_screen import FirstScreen
from casid.diagnosis.given.scope import NotJudged
from casid.diagnosis.result import Diagnosis
from casid.errors import InputError
from casid.model.aircraft import Aircraft
from casid.report.figure import Picture
from casid.report.folder import provenance, whole_folder
from casid.report.next_flight import NextFlights
from casid.report.page import FIGURES, write_report
from casid.report.words import pretty

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)


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
    assert document["schema"] == "casid.diagnosis/4"
    assert document["verdict"] == "explained"
    assert {"moved", "combinations", "claims", "held_out_is_new"} <= set(document)
    by_record = dict.fromkeys(("as_given", "left", "expected"), NUMBER) | {"record": str, "worst": str, "causes": list}
    assert [one["record"] for one in document["records"]] == list(NAMES)
    assert all(has(one, by_record) for one in document["records"])
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
    decided = {one["cause"]: one for one in document["decisions"] if one["outcome"] == "named"}
    assert len(decided) == len(document["causes"])
    assert all(gate["passed"] for one in decided.values() for gate in one["gates"])
    steps = dict.fromkeys(("as_given", "data_mended", "values", "structure", "noise"), NUMBER)
    assert document["budget"]["records"] == [NAMES[1]]
    assert set(document["budget"]["channels"]) == set(document["as_given"]["channels"])
    assert all(has(one, steps) for one in (*document["budget"]["channels"].values(), document["budget"]["all"]))
    assert isinstance(held["log_likelihood_per_sample"], NUMBER) and isinstance(document["gain"]["bic"], NUMBER)


def test_extended_aircraft_is_read_back_and_has_the_hidden_term(folder: Path, diagnosis: Diagnosis) -> None:
    extended = Aircraft.read(folder / "extended.toml")
    assert extended == diagnosis.extended_aircraft
    told = {one.name: one.flight.std for one in diagnosis.parameters if one.flight.determined}
    assert told and {name: extended.std[name] for name in told} == told
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
    assert not list(tags.named("iframe", "object", "embed"))  # scripts have no source elsewhere, see the links
    style = page[page.index("<style>") : page.index("</style>")]
    assert "url(" not in style and "@import" not in style
    targets = {a["id"] for _, a in tags.found if "id" in a}
    assert {link[1:] for link in links if link.startswith("#")} <= targets


def test_every_figure_has_words_and_a_file_of_its_own(folder: Path, shown: dict[str, Picture]) -> None:
    tags = Tags((folder / "report.html").read_text(encoding="utf-8"))
    images = list(tags.named("img"))
    assert len(images) == len(list(tags.named("figure"))) == len(list(tags.named("figcaption")))
    assert {f"figure-{name}" for name in shown} <= {figure["id"] for figure in tags.named("figure")}
    assert all(len(image["alt"] or "") > 20 for image in images)
    files = {path.read_bytes() for path in (folder / FIGURES).glob("*.svg")}
    embedded = {base64.b64decode((image["src"] or "").partition(",")[2]) for image in images}
    assert embedded == files
    for svg in files:
        assert ElementTree.fromstring(svg).tag.endswith("svg")


def test_page_opens_with_verdict_cause_shares_worst_channel_and_what_to_do(folder: Path, document: Document) -> None:
    page = (folder / "report.html").read_text(encoding="utf-8")
    screen = FirstScreen.of(document)
    said = [screen.verdict, *(one.sentence for one in screen.found)]
    parts = [*map(pretty, said), 'class="bar"', 'id="figure-worst"', 'id="next"', "<details"]
    assert sorted(parts, key=page.index) == parts
    opened = page[: page.index("<details")]
    assert opened.count("<img ") == 1
    assert all(escape(pretty(one.text)) in opened and escape(one.command) in opened for one in document.next)


def test_page_tells_of_data_values_structure_unseen_data_and_what_was_not_judged(folder: Path) -> None:
    page = (folder / "report.html").read_text(encoding="utf-8")
    heads = [f"<dt>{head}</dt>" for head in ("Data", "Values", "Structure", "By record", "Not judged")]
    at = [page.index(head) for head in heads]
    end = page.index("</dl>", at[-1])
    assert at == sorted(at)
    assert "no channel psi" in page[at[-1] : end]
    assert "Cm: alpha²" in page[at[2] : at[3]]


@pytest.mark.usefixtures("undrawn")
def test_every_claim_has_a_figure_that_links_back_to_it(wrong_in_all: Document, tmp_path: Path) -> None:
    """Data, values, causes and the unexplained: from the statement to a figure, and from that to the statement."""
    write_report(wrong_in_all, tmp_path, provenance(seed=0))
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    ids = {a["id"] for _, a in Tags(page).found if "id" in a}
    figures = {m[1]: m[0] for m in re.finditer(r'<figure id="([^"]+)".*?</figure>', page, flags=re.DOTALL)}
    anchors = {"data-1", "value-Cl_p", "unexplained-1", *(f"cause-{k + 1}" for k in range(len(wrong_in_all.causes)))}
    assert anchors <= ids
    for anchor in anchors:
        statement = page[page.index(f'id="{anchor}"') :].partition("</p>")[0]
        shown = re.findall(r'href="#(figure-[^"]+)"', statement)
        assert shown, anchor
        assert all(f'href="#{anchor}"' in figures[name] for name in shown), anchor


def test_a_picture_that_fails_is_noted_and_costs_nothing_else(
    document: Document, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object) -> Picture:
        raise ValueError("no such axes")

    monkeypatch.setattr("casid.report.page.heatmap", broken)
    failed = write_report(document, tmp_path, provenance(seed=0))
    assert len(failed) == 1 and "ValueError: no such axes" in failed[0]
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "no such axes" in page and 'id="figure-budget"' in page and 'id="figure-heatmap"' not in page


@pytest.mark.usefixtures("undrawn")
def test_a_name_with_markup_is_only_text(
    document: Document,
    wrong_in_all: Document,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    nothing = NextFlights(proposals=(), beyond=())
    monkeypatch.setattr("casid.report.page.next_flights", lambda named: nothing)
    evil = "<script>alert(1)</script> & $gain {{ 7 * 7 }}"
    stuck = replace(wrong_in_all.data[0], records=(evil,), sentence=f"In {evil}.")
    open_ = NotJudged(what=evil, because=evil)
    named = replace(document, name=evil, data=(stuck,), not_judged=(open_,))
    write_report(named, tmp_path, provenance(seed=0) | {"command": ["casid", "diagnose", evil]})
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    escaped = "&lt;script&gt;alert(1)&lt;/script&gt; &amp; $gain {{ 7 * 7 }}"
    assert page.count(escaped) >= 6 and "<script>alert(1)" not in page
    assert all(set(tag) <= {"type"} for tag in Tags(page).named("script"))  # those that draw the figures, and no other


# -- in a browser ------------------------------------------------------------------------------------------------------

PROBE = """<script>addEventListener('load', () => { const d = document.documentElement;
document.querySelectorAll('details').forEach(one => { one.open = true; });
const seen = i => i.closest('figure.live')?.querySelector('canvas') ?? i;
d.dataset.images = JSON.stringify(
  [...document.images].map(i => [i.naturalWidth, seen(i).clientWidth, seen(i).clientHeight]));
d.dataset.bar = JSON.stringify([...document.querySelectorAll('.bar i')].map(i => i.getBoundingClientRect().width));
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
    """Nothing on the console, every image drawn or its curves in its place, nothing wider than the window."""
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
    parts = json.loads(root["data-bar"] or "[]")
    told = [int(share) for share in re.findall(r"flex-grow: (\d+)", page)]
    assert parts and [100.0 * part / sum(parts) for part in parts] == pytest.approx(told, abs=1.0)
