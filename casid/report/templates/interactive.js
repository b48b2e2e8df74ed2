"use strict";
/* Draws the curves of a page with uPlot: zoom by dragging or by the wheel, pan with shift, a cursor common to all panels. */
(function () {
  if (typeof uPlot === "undefined") return;
  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer;
  const curve = (s) => Array.from(new Int16Array(bytes(s.y)),
    (c) => c === -32768 ? null : c === -32767 ? undefined : s.low + s.step * (c + 32000));
  const FONT = "11px system-ui", TICK_AND_GAP = 18;
  const ruler = document.createElement("canvas").getContext("2d");
  ruler.font = FONT;
  const number = (u, v) => v == null ? "" : Number(v.toPrecision(5)).toString();

  function shade(panel) {
    return (u) => {
      const { left, top, width, height } = u.bbox, draw = u.ctx;
      draw.save();
      draw.beginPath(); draw.rect(left, top, width, height); draw.clip();
      for (const one of panel.spans) {
        const a = u.valToPos(one.from, "x", true), b = u.valToPos(one.to, "x", true);
        draw.fillStyle = one.colour;
        if (one.foot) draw.fillRect(a, top + height - 6 * devicePixelRatio, Math.max(b - a, 1), 6 * devicePixelRatio);
        else draw.fillRect(a, top, Math.max(b - a, 1), height);
      }
      draw.setLineDash([2, 3]);
      for (const one of panel.marks) {
        const at = u.valToPos(one.x, "x", true);
        draw.strokeStyle = one.colour;
        draw.beginPath(); draw.moveTo(at, top); draw.lineTo(at, top + height); draw.stroke();
      }
      draw.restore();
    };
  }

  function build(figure, place) {
    const told = JSON.parse(figure.querySelector("script[type='application/json']").textContent);
    const plots = [];
    let busy = false, room = 46;
    /* Room for the widest label of all panels: with one width their times stay below each other. */
    const roomFor = (u, labels) => {
      const widest = Math.max(0, ...(labels || []).map((one) => one == null ? 0 : ruler.measureText(one).width));
      if (widest + TICK_AND_GAP > room) {
        room = Math.ceil(widest + TICK_AND_GAP);
        queueMicrotask(() => plots.forEach((one) => one.redraw(true, true)));
      }
      return room;
    };
    const everywhere = (min, max) => {
      if (busy) return;
      busy = true;
      for (const one of plots) one.setScale("x", { min, max });
      busy = false;
    };
    const tools = document.createElement("div");
    tools.className = "tools";
    place.append(tools);
    const grid = document.createElement("div");
    grid.className = told.columns > 1 ? "panels two" : "panels";
    place.append(grid);
    const key = figure.id || "casid" + Math.random();
    const width = () => Math.max(200, Math.floor((grid.clientWidth - (two() ? 12 : 0)) / (two() ? 2 : 1)));
    const two = () => told.columns > 1 && grid.clientWidth > 560;

    function add(panel) {
      const box = document.createElement("div");
      box.className = "panel";
      grid.append(box);
      const series = [{ label: told.x || "x", value: number }], bands = [];
      const data = [Array.from(new Float32Array(bytes(panel.x)))];
      for (const one of panel.bands) {
        data.push(curve(one.high), curve(one.low));
        for (let i = 0; i < 2; i++) series.push({ label: "", stroke: "transparent", points: { show: false }, class: "silent" });
        bands.push({ series: [series.length - 2, series.length - 1], fill: one.colour });
      }
      for (const s of panel.series) {
        data.push(curve(s));
        series.push({
          label: s.label || panel.label, class: !s.label && panel.series.some((one) => one.label) ? "silent" : undefined, stroke: s.colour, width: s.dots ? 0 : s.width, dash: s.dash, value: number,
          points: { show: s.dots, size: 3, fill: s.colour, stroke: s.colour }, paths: s.dots ? () => null : undefined,
        });
      }
      const size = { width: width(), height: panel.height + 34 };
      const low = panel.range[0], high = panel.range[1];
      const plot = new uPlot({
        ...size, series, bands,
        title: panel.label,
        cursor: { sync: { key, setSeries: false }, drag: { x: true, y: false, uni: 20 }, focus: { prox: 16 } },
        scales: {
          x: { time: false, distr: panel.log[0] ? 3 : 1 },
          y: { distr: panel.log[1] ? 3 : 1, range: (u, min, max) => whole(u) ? [low, high] : padded(min, max, panel.log[1]) },
        },
        axes: [{ size: 26, font: FONT }, { size: roomFor, font: FONT, space: 18 }],
        legend: { live: true },
        hooks: {
          drawClear: [shade(panel)],
          setScale: [(u, name) => { if (name === "x" && plots.length) everywhere(u.scales.x.min, u.scales.x.max); }],
        },
      }, data, box);
      const first = data[0][0], last = data[0][data[0].length - 1];
      plot.over.addEventListener("wheel", (event) => {
        event.preventDefault();
        const at = plot.posToVal(event.clientX - plot.over.getBoundingClientRect().left, "x");
        zoom(plot, event.deltaY < 0 ? 0.8 : 1.25, at);
      }, { passive: false });
      plot.over.addEventListener("dblclick", () => everywhere(first, last));
      drag(plot);
      plot.ends = [first, last];
      plots.push(plot);
      return box;
    }
    const whole = (u) => !u.ends || (u.scales.x.min <= u.ends[0] && u.scales.x.max >= u.ends[1]);
    const padded = (min, max, log) => min == null ? [0, 1] : log ? [min, max]
      : [min - 0.05 * (max - min || 1), max + 0.05 * (max - min || 1)];
    function zoom(plot, factor, at) {
      const { min, max } = plot.scales.x, [first, last] = plot.ends;
      const a = at - (at - min) * factor, b = at + (max - at) * factor;
      everywhere(Math.max(a, first), Math.min(b, last));
    }
    function move(plot, by) {
      const { min, max } = plot.scales.x, [first, last] = plot.ends;
      const step = Math.min(Math.max(by, first - min), last - max);
      everywhere(min + step, max + step);
    }
    function drag(plot) {
      let from = null;
      plot.over.addEventListener("pointerdown", (event) => {
        if (!event.shiftKey && event.pointerType !== "touch") return;
        from = event.clientX;
        event.stopImmediatePropagation();
      }, true);
      plot.over.addEventListener("mousedown", (event) => { if (event.shiftKey) event.stopImmediatePropagation(); }, true);
      window.addEventListener("pointermove", (event) => {
        if (from === null) return;
        move(plot, plot.posToVal(0, "x") - plot.posToVal(event.clientX - from, "x"));
        from = event.clientX;
      });
      for (const end of ["pointerup", "pointercancel"]) window.addEventListener(end, () => { from = null; });
    }
    const button = (text, label, act) => {
      const one = document.createElement("button");
      one.type = "button"; one.textContent = text; one.title = label; one.setAttribute("aria-label", label);
      one.addEventListener("click", act);
      tools.append(one);
    };
    const middle = (plot) => 0.5 * (plot.scales.x.min + plot.scales.x.max);
    const length = (plot) => plot.scales.x.max - plot.scales.x.min;
    button("+", "zoom in", () => zoom(plots[0], 0.5, middle(plots[0])));
    button("\u2212", "zoom out", () => zoom(plots[0], 2.0, middle(plots[0])));
    button("\u25c0", "earlier", () => move(plots[0], -0.25 * length(plots[0])));
    button("\u25b6", "later", () => move(plots[0], 0.25 * length(plots[0])));
    button("all", "show all", () => everywhere(...plots[0].ends));
    for (const panel of told.panels) {
      const box = add(panel), name = document.createElement("label"), tick = document.createElement("input");
      if (told.panels.length < 2) continue;
      tick.type = "checkbox"; tick.checked = true;
      tick.addEventListener("change", () => { box.hidden = !tick.checked; });
      name.append(tick, " " + panel.label);
      tools.append(name);
    }
    const resized = () => plots.forEach((plot, i) => plot.setSize({ width: width(), height: told.panels[i].height + 34 }));
    new ResizeObserver(resized).observe(grid);
    figure.classList.add("live");
    figure.plots = plots;
  }

  const seen = new IntersectionObserver((entries) => {
    for (const entry of entries) {
      if (!entry.isIntersecting) continue;
      seen.unobserve(entry.target);
      const figure = entry.target, place = figure.querySelector(".curves");
      place.hidden = false;
      try { build(figure, place); } catch (error) { place.hidden = true; figure.classList.remove("live"); throw error; }
    }
  }, { rootMargin: "800px" });
  document.querySelectorAll("figure.has-curves").forEach((figure) => seen.observe(figure));
})();
