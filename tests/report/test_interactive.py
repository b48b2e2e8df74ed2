"""Figures that a reader can zoom, and the same for print. Truth: the arrays, and a browser that is asked."""

from __future__ import annotations

import base64
import html
import json
import re
import subprocess
from pathlib import Path

import numpy as np
import pytest

from casid.acceptance.match import proof_of_match
from casid.cli.options import DEMO
from casid.report import uplot
from casid.report.figure import Axis, Band, Curve, Figure, Note, Panel, Rule, Span, stacked, thinned
from casid.report.looks import Look
from casid.report.match_page import write_match
from casid.report.pdf import browser
from casid.report.svg import paint

needs_uplot = pytest.mark.skipif(uplot.library() is None, reason="uplot-python is not installed")
needs_browser = pytest.mark.skipif(browser() is None, reason="no Chromium, Chrome or Edge is installed")


def decoded(panel: dict, series: dict) -> tuple[np.ndarray, np.ndarray]:
    x = np.frombuffer(base64.b64decode(panel["x"]), "<f4")
    codes = np.frombuffer(base64.b64decode(series["y"]), "<i2").astype(float)
    y = np.where(codes < -32000, np.nan, series["low"] + series["step"] * (codes + 32000))
    return x[codes != -32767], y[codes != -32767]  # at places of its own


_LINE = Look(name="as given", colour="#D55E00", dash="--")


def drawn(t: np.ndarray, y: np.ndarray, label: str = "q [deg/s]") -> Figure:
    parts = (
        Span(look=Look(colour="#009E73", alpha=0.2), low=t[5], high=t[9]),
        Band(look=Look(name="tolerance", colour="#DDDDDD"), x=t, low=y - 1.0, high=y + 2.0),
        Rule(look=Look(colour="#000000"), at=t[3]),
        Curve(look=_LINE, x=t, y=y),
        Note(text="m1", x=t[0]),
    )
    return Figure(rows=((Panel(parts=parts, x=Axis(label="time t [s]"), y=Axis(label=label)),),))


def test_curves_bands_spans_and_marks_are_those_of_the_figure() -> None:
    """To half a step of 64 000 levels, with the gap where a sample is missing."""
    t = np.linspace(2.0, 8.0, 401)
    y = 5.0 * np.sin(t)
    y[50:60] = np.nan
    told = uplot.painted(drawn(t, y))
    (panel,) = told["panels"]
    x, read = decoded(panel, panel["series"][0])
    np.testing.assert_allclose(x, t, rtol=1e-6)
    assert np.isnan(read[50:60]).all() and panel["series"][0]["label"] == "as given"
    np.testing.assert_allclose(read[100:], y[100:], atol=10.0 / 64000)
    x, low = decoded(panel, panel["bands"][0]["low"])
    np.testing.assert_allclose(low[x > 4.0], y[t > 4.0][: (x > 4.0).sum()] - 1.0, atol=10.0 / 64000)
    assert panel["marks"][0]["at"] == t[3]
    assert (panel["spans"][0]["from"], panel["spans"][0]["to"]) == (t[5], t[9])
    assert panel["label"] == "q [deg/s]" and panel["axis"] == "time t [s]"
    assert [one["name"] for one in told["legend"]] == ["tolerance", "as given"]


def test_both_painters_have_the_same_limits_names_and_legend() -> None:
    """Truth: each other. Two columns, of which the last row has one panel, and a logarithmic axis."""
    t = np.geomspace(0.1, 10.0, 60)
    panels = [
        Panel(
            parts=(Curve(look=_LINE, x=t, y=k * np.sin(t)),),
            x=Axis(label="frequency ω [rad/s]", log=True),
            y=Axis(label=f"channel {k}"),
        )
        for k in (1, 2, 3)
    ]
    figure = Figure(rows=stacked(panels, 2))
    printed, told = paint(figure), uplot.painted(figure)
    assert [axis.get_title(loc="left") for axis in printed.axes] == [one["label"] for one in told["panels"]]
    for axis, one in zip(printed.axes, told["panels"], strict=True):
        assert axis.get_xlim() == pytest.approx(one["domain"]) and axis.get_ylim() == pytest.approx(one["range"])
        assert [axis.get_xscale() == "log", axis.get_yscale() == "log"] == one["log"]
    named = [text.get_text() for text in printed.legends[0].get_texts()]
    assert named == [one["name"] for one in told["legend"]] == ["as given"]
    below = [axis.get_xlabel() for axis in printed.axes]
    assert below == ["", "frequency ω [rad/s]", "frequency ω [rad/s]"], "the last panel of each column names the axis"


def test_a_long_curve_keeps_its_peaks_and_its_gaps() -> None:
    """One sample of 90 000 stands out; it is the largest of what is left. One is missing; a gap is left."""
    t = np.arange(90_000) / 50.0
    y = np.zeros(len(t))
    y[41_234] = 7.0
    y[60_001] = np.nan
    x, left = thinned(t, y, 4000)
    assert len(x) <= 4001 and np.nanmax(left) == 7.0
    assert x[np.nanargmax(left)] == t[41_234]
    assert x[np.isnan(left)].tolist() == [t[60_001]]


@needs_uplot
def test_what_a_figure_says_cannot_leave_its_script() -> None:
    t = np.linspace(0.0, 1.0, 50)
    told = uplot.curves(drawn(t, t, "</script><script>alert(1)</script>"))
    assert told is not None and "</script>" not in told
    assert json.loads(told)["panels"][0]["label"].startswith("</script>")


def page(folder: Path) -> Path:
    proof = proof_of_match(DEMO / "aircraft.toml", DEMO / "m4.csv", tests=["2.c.10", "2.d.2"])
    write_match(proof, folder)
    return folder / "match.html"


@needs_uplot
def test_a_page_is_one_file_with_its_library_and_the_licence(tmp_path: Path) -> None:
    text = page(tmp_path).read_text(encoding="utf-8")
    assert text.count("var uPlot") == 1 and "MIT Licensed" in re.search("<footer.*?</footer>", text, re.S)[0]  # pyright: ignore
    assert not re.search(r"""(?:src|href)=["'](?!data:|#)""", text)
    assert "<img" in text  # for print, and for readers without scripts


def test_without_the_library_a_page_keeps_its_pictures(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("casid.report.uplot.library", lambda: None)
    text = page(tmp_path).read_text(encoding="utf-8")
    assert "<script" not in text and text.count("<img") == 3


# zooms as a reader does, and writes what it finds into the page, which the browser then prints
_READER = """
<script>
window.faults = [];
window.addEventListener("error", (e) => window.faults.push(e.message));
const wait = () => new Promise((done) => setTimeout(done, 100));
window.addEventListener("load", () => setTimeout(async () => {
  const told = { faults: window.faults };
  try {
    for (let k = 0; k < 40 && !document.querySelector("figure.live"); k++) await wait();
    told.drawn = document.querySelector("figure.live") !== null;
    const figure = document.querySelector("figure.live"), plots = figure.plots, over = plots[0].over;
    const box = over.getBoundingClientRect();
    told.panels = plots.length;
    const shown = (name) => [...figure.querySelectorAll(name)].filter((one) => one.offsetWidth > 0 && one.textContent);
    told.axes = shown(".axis").map((one) => one.textContent);
    told.legends = shown(".legend span").map((one) => one.textContent.trim());
    told.values = [shown(".readout").length];
    told.canvases = figure.querySelectorAll("canvas").length;
    const pixels = (canvas) => canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
    const inked = (canvas) => pixels(canvas).some((v) => v);
    told.inked = [...figure.querySelectorAll("canvas")].every(inked);
    const cut = () => [...figure.querySelectorAll("canvas")].map((c) => {
      const margin = c.getContext("2d").getImageData(0, 0, 2, c.height).data;
      return margin.some((v) => v);
    });
    told.cut = cut();
    told.lefts = plots.map((p) => p.bbox.left);
    told.before = plots.map((p) => [p.scales.x.min, p.scales.x.max]);
    const heights = () => plots.map((p) => [p.scales.y.min, p.scales.y.max]);
    told.heights = [heights()];
    const at = (type, share, more) => new MouseEvent(type,
      { bubbles: true, clientX: box.left + share * box.width, clientY: box.top + 20, ...more });
    over.dispatchEvent(at("mouseenter", 0.3));
    over.dispatchEvent(at("mousemove", 0.3));
    await wait();
    over.dispatchEvent(at("mousedown", 0.3, { button: 0 }));
    await wait();
    over.dispatchEvent(at("mousemove", 0.6));
    await wait();
    document.dispatchEvent(at("mouseup", 0.6, { button: 0 }));
    await wait();
    told.cursors = plots.map((p) => p.cursor.idx);
    told.values.push(shown(".readout").length);
    told.heights.push(heights());
    told.zoomed = plots.map((p) => [p.scales.x.min, p.scales.x.max]);
    told.cut.push(...cut());
    told.lefts.push(...plots.map((p) => p.bbox.left));
    figure.querySelector("[aria-label='later']").click();
    await wait();
    told.panned = plots.map((p) => [p.scales.x.min, p.scales.x.max]);
    figure.querySelector("[aria-label='show all']").click();
    await wait();
    told.all = plots.map((p) => [p.scales.x.min, p.scales.x.max]);
    told.heights.push(heights());
    over.dispatchEvent(at("mouseleave", 1.2));
    await wait();
    told.values.push(shown(".readout").length);
    const edge = (one) => one.getBoundingClientRect(), frame = edge(figure);
    const out = (one) => one.offsetWidth > 0 && edge(one).right > frame.right + 1;
    told.outside = [...figure.querySelectorAll(".heading, .axis, .legend span, .tools > *")].filter(out).length;
    const tick = figure.querySelector("input[type=checkbox]");
    tick.click();
    await wait();
    told.hidden = figure.querySelector(".panel").hidden;
    told.wide = document.documentElement.scrollWidth - document.documentElement.clientWidth;
    told.requests = performance.getEntriesByType("resource").map((e) => e.name).filter((n) => !n.startsWith("data:"));
  } catch (error) { told.faults.push(String(error)); }
  const place = document.createElement("pre");
  place.id = "told"; place.textContent = JSON.stringify(told);
  document.body.append(place);
}, 1500));
</script>
"""


def read_in_a_browser(file: Path, width: int) -> dict:
    """What the reader found in a page; the page is changed."""
    file.write_text(file.read_text(encoding="utf-8").replace("<head>", f"<head>{_READER}"), encoding="utf-8")
    options = [
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        f"--window-size={width},2400",
        "--virtual-time-budget=12000",
    ]
    told: dict = {}
    for attempt in range(5):  # a browser without a screen may pass its virtual time without drawing a frame
        place = f"--user-data-dir={file.parent / f'profile{attempt}'}"
        command = [str(browser()), *options, place, "--dump-dom", file.as_uri()]
        dumped = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True).stdout
        found = re.search(r'<pre id="told">(.*?)</pre>', dumped, re.S)
        assert found, dumped[-2000:]
        told = json.loads(html.unescape(found[1]))
        if told["drawn"]:
            break
    return told


@needs_uplot
@needs_browser
@pytest.mark.parametrize("size", [1.0, 12_000.0, 1.7e9])
def test_labels_have_room_and_panels_stay_aligned(tmp_path: Path, size: float) -> None:
    """No ink at the edge of a canvas, and one left edge for all panels, also of a quantity of many digits."""
    t = np.linspace(0.0, 20.0, 401)
    panels = [
        Panel(parts=(Curve(look=_LINE, x=t, y=scale * np.sin(t)),), y=Axis(label=f"{scale:g}")) for scale in (1.0, size)
    ]
    curves = uplot.curves(Figure(rows=stacked(panels)))
    script, _ = uplot.library() or ("", "")
    own = (Path(uplot.__file__).parent / "templates" / "interactive.js").read_text(encoding="utf-8")
    file = tmp_path / "page.html"
    file.write_text(
        '<!doctype html><html><head><meta charset="utf-8"></head><body><figure class="has-curves">'
        f'<div class="curves" hidden></div><script type="application/json">{curves}</script>'
        f"</figure><script>{script}\n{own}</script></body></html>",
        encoding="utf-8",
    )
    told = read_in_a_browser(file, 1400)
    assert told["faults"] == [] and told["panels"] == 2
    assert not any(told["cut"])
    assert told["lefts"][0] == told["lefts"][1] and told["lefts"][2] == told["lefts"][3]


@needs_uplot
@needs_browser
@pytest.mark.parametrize("width", [1400, 420])
def test_in_a_browser_it_draws_zooms_pans_and_asks_for_nothing(tmp_path: Path, width: int) -> None:
    told = read_in_a_browser(page(tmp_path), width)
    assert told["faults"] == [] and told["requests"] == []
    assert told["panels"] == told["canvases"] == 4 and told["inked"]
    assert set(told["axes"]) == {"time t [s]"} and len(told["axes"]) == (2 if width > 420 else 1), "below each column"
    assert told["legends"][:4] == ["tolerance", "samples", "measured", "as given"]
    assert told["values"] == [0, 4, 0], "values stand there while the cursor does"
    assert told["heights"][1] != told["heights"][0] == told["heights"][2]
    assert told["outside"] == 0
    (before,), (zoomed,), (panned,), (whole,) = (
        {tuple(one) for one in told[k]} for k in ("before", "zoomed", "panned", "all")
    )
    length = before[1] - before[0]
    assert zoomed == pytest.approx((before[0] + 0.3 * length, before[0] + 0.6 * length), abs=0.02 * length)
    assert panned[0] > zoomed[0] and panned[1] - panned[0] == pytest.approx(zoomed[1] - zoomed[0])
    assert whole == pytest.approx(before)
    assert len(set(told["cursors"])) == 1 and told["cursors"][0] is not None
    assert told["hidden"] is True
    assert told["wide"] <= 0 or width > 420
