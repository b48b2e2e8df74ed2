"use strict";
/* Paints the figures of a page with uPlot: zoom by dragging or by the wheel, pan with shift, one cursor for all panels. */
(function () {
  if (typeof uPlot === "undefined") return;
  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer;
  const curve = (s) => Array.from(new Int16Array(bytes(s.y)),
    (c) => c === -32768 ? null : c === -32767 ? undefined : s.low + s.step * (c + 32000));
  const FONT = "11px system-ui", TICK_AND_GAP = 18, NUMBERS = 22, FREE = 6;
  const ruler = document.createElement("canvas").getContext("2d");
  ruler.font = FONT;
  const number = (v) => Number(v.toPrecision(4)).toString().replace("-", "\u2212");
  const make = (tag, name, place, text) => {
    const one = document.createElement(tag);
    if (name) one.className = name;
    if (text) one.textContent = text;
    if (place) place.append(one);
    return one;
  };

  /* What stands behind the curves, and what stands before them. */
  const clipped = (u, paint) => {
    const { left, top, width, height } = u.bbox;
    u.ctx.save();
    u.ctx.beginPath(); u.ctx.rect(left, top, width, height); u.ctx.clip();
    paint(u.ctx, left, top, width, height);
    u.ctx.restore();
  };
  const behind = (panel) => (u) => clipped(u, (draw, left, top, width, height) => {
    for (const one of panel.spans) {
      const a = u.valToPos(one.from, one.axis, true), b = u.valToPos(one.to, one.axis, true);
      draw.fillStyle = one.colour;
      if (one.axis === "y") draw.fillRect(left, Math.min(a, b), width, Math.abs(b - a));
      else draw.fillRect(a, top + height * (1 - one.part[1]), Math.max(b - a, 1), height * (one.part[1] - one.part[0]));
    }
  });
  const before = (panel) => (u) => {
    clipped(u, (draw, left, top, width, height) => {
      for (const one of panel.marks) {
        const at = u.valToPos(one.at, one.axis, true);
        draw.strokeStyle = one.colour; draw.lineWidth = one.width * devicePixelRatio;
        draw.setLineDash(one.dash.map((v) => v * devicePixelRatio));
        draw.beginPath();
        if (one.axis === "y") { draw.moveTo(left, at); draw.lineTo(left + width, at); }
        else { draw.moveTo(at, top); draw.lineTo(at, top + height); }
        draw.stroke();
      }
    });
    const draw = u.ctx, { left, top, width } = u.bbox;
    draw.save();
    draw.fillStyle = "#222"; draw.textBaseline = "bottom";
    for (const one of panel.notes) {
      const at = u.valToPos(one.x, "x", true);
      if (at < left - 1 || at > left + width) continue;
      draw.font = (one.bold ? "600 " : "") + 10.5 * devicePixelRatio + "px system-ui";
      draw.textAlign = one.align;
      draw.fillText(one.text, at, one.y === null ? top - 2 * devicePixelRatio : u.valToPos(one.y, "y", true));
    }
    draw.restore();
  };

  /* 1, 2 and 5 of every decade, 1 to 9 within one, the decades alone where there are many. */
  const decades = (u, i, min, max) => {
    const found = [], parts = max / min < 5 ? [1, 2, 3, 4, 5, 6, 7, 8, 9] : max / min < 50 ? [1, 2, 5] : [1];
    for (let ten = 10 ** Math.floor(Math.log10(min)); ten <= max; ten *= 10)
      for (const part of parts) if (ten * part >= min && ten * part <= max) found.push(ten * part);
    return found;
  };
  const axis = (log) => ({
    font: FONT, grid: { stroke: "#E4E4E4", width: 1 }, ticks: { show: false }, ...(log ? { splits: decades, filter: (u, at) => at } : {}),
  });

  /* A sign of the legend, as the painter for print has it. */
  function sign(one) {
    const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
    svg.setAttribute("width", 24); svg.setAttribute("height", 10);
    const shape = (tag, set) => {
      const part = document.createElementNS(svg.namespaceURI, tag);
      for (const [name, value] of Object.entries(set)) part.setAttribute(name, value);
      svg.append(part);
    };
    if (one.filled) shape("rect", { x: 0, y: 0, width: 24, height: 10, fill: one.colour });
    else if (one.dots) shape("circle", { cx: 12, cy: 5, r: 2.5, fill: one.colour });
    else shape("line", { x1: 0, x2: 24, y1: 5, y2: 5, stroke: one.colour, "stroke-width": one.width, "stroke-dasharray": one.dash });
    return svg;
  }

  function build(figure, place) {
    const told = JSON.parse(figure.querySelector("script[type='application/json']").textContent);
    const plots = [], boxes = [], names = [];
    let room = 40;
    /* Room for the widest label of all panels: with one width their times stay below each other. */
    const roomFor = (u, labels) => {
      const widest = Math.max(0, ...(labels || []).map((one) => one == null ? 0 : ruler.measureText(one).width));
      if (widest + TICK_AND_GAP > room) {
        room = Math.ceil(widest + TICK_AND_GAP);
        queueMicrotask(() => plots.forEach((one) => one.redraw(true, true)));
      }
      return room;
    };
    const linked = (plot) => told.linked ? plots.filter((one) => one.about === plot.about) : [plot];
    const everywhere = (plot, min, max) => {
      for (const one of linked(plot)) {
        one.view = [min, max];  // before `setScale`, which asks for the vertical range
        one.setScale("x", { min, max });
      }
    };
    const tools = make("div", "tools", place), choice = make("details", "", tools);
    make("summary", "", choice, "panels");
    const legend = make("div", "legend", place);
    for (const one of told.legend) make("span", "", legend).append(sign(one), " " + one.name);
    const grid = make("div", "panels", place);
    const key = figure.id || "casid" + Math.random();
    const beside = () => Math.max(1, Math.min(told.columns, Math.floor(grid.clientWidth / (told.columns > 2 ? 170 : 280))));
    const width = () => Math.floor((grid.clientWidth - 12 * (beside() - 1)) / beside());

    /* Numbers and name of the time stand below the last panel of a column. */
    const lowest = [];
    function columns() {
      grid.style.gridTemplateColumns = `repeat(${beside()}, 1fr)`;
      const at = boxes.map((box) => box.hidden ? null : box.getBoundingClientRect());
      at.forEach((own, i) => {
        lowest[i] = own !== null && (!told.linked || !at.some((one) => one && one.left === own.left && one.top > own.top));
        names[i].hidden = !lowest[i];
      });
      plots.forEach((plot, i) => plot.setSize({ width: width(), height: heightOf(i) }));
    }
    const head = (panel) => panel.notes.some((one) => one.y === null) ? 16 : 6;
    const heightOf = (i) => told.panels[i].height + head(told.panels[i]) + (lowest[i] ? NUMBERS : FREE);

    function add(panel, i) {
      const box = make("div", "panel", grid);
      boxes.push(box);
      make("div", "heading", box, panel.label);
      const values = make("div", "readout", box);
      const series = [{}], bands = [];
      const data = [Array.from(new Float32Array(bytes(panel.x)))];
      for (const one of panel.bands) {
        data.push(curve(one.high), curve(one.low));
        for (let k = 0; k < 2; k++) series.push({ stroke: "transparent", points: { show: false } });
        bands.push({ series: [series.length - 2, series.length - 1], fill: one.colour });
      }
      const first = series.length;
      for (const s of panel.series) {
        data.push(curve(s));
        series.push({
          stroke: s.colour, width: s.dots ? 0 : s.width, dash: s.dash,
          points: { show: s.dots, size: s.size, fill: s.colour, stroke: s.colour, width: 0 },
          paths: s.dots ? () => null : undefined,
        });
      }
      const shows = (u) => {
        const at = u.cursor.idx;
        values.replaceChildren();
        if (at == null || u.cursor.left < 0) return;
        make("span", "", values, number(data[0][at]));
        panel.series.forEach((s, k) => {
          const value = data[first + k][at];
          if (value == null || !s.label) return;
          make("b", "", values, number(value)).style.color = s.colour.replace(/,[^,]*\)$/, ",1)");
        });
      };
      const [low, high] = panel.range, [begin, end] = panel.domain;
      const plot = new uPlot({
        width: width(), height: panel.height + head(panel) + NUMBERS, series, bands,
        padding: [head(panel), 6, 0, 0],
        cursor: { sync: { key: told.linked ? key + panel.axis : key + i, setSeries: false }, drag: { x: true, y: false, uni: 20 }, points: { size: 5 } },
        scales: {
          x: { time: false, distr: panel.log[0] ? 3 : 1, range: (u, min, max) => u.view ? [min, max] : [begin, end] },
          y: { distr: panel.log[1] ? 3 : 1, range: (u, min, max) => whole(u) ? [low, high] : padded(min, max, panel.log[1]) },
        },
        axes: [
          { ...axis(panel.log[0]), size: () => lowest[i] === false ? FREE : NUMBERS, gap: 2,
            values: (u, at) => at.map((v) => lowest[i] === false ? "" : number(v)) },
          { ...axis(panel.log[1]), size: roomFor, space: 17, gap: 3, values: (u, at) => at.map(number) },
        ],
        legend: { show: false },
        hooks: {
          ready: [(u) => { u.ends = u.view = [begin, end]; }],
          drawClear: [behind(panel)],
          draw: [before(panel)],
          setCursor: [shows],
          setScale: [(u, name) => {  // by the drag of a reader
            const { min, max } = u.scales.x;
            if (name === "x" && u.view && (u.view[0] !== min || u.view[1] !== max)) everywhere(u, min, max);
          }],
        },
      }, data, box);
      names.push(make("div", "axis", box, panel.axis));
      plot.over.addEventListener("wheel", (event) => {
        event.preventDefault();
        const at = plot.posToVal(event.clientX - plot.over.getBoundingClientRect().left, "x");
        zoom(plot, event.deltaY < 0 ? 0.8 : 1.25, at);
      }, { passive: false });
      plot.over.addEventListener("dblclick", () => everywhere(plot, ...plot.ends));
      drag(plot);
      plot.about = panel.axis;
      plots.push(plot);
      return box;
    }
    const whole = (u) => !u.view || (u.view[0] <= u.ends[0] && u.view[1] >= u.ends[1]);
    const padded = (min, max, log) => min == null ? [0, 1] : log ? [min, max]
      : [min - 0.05 * (max - min || 1), max + 0.05 * (max - min || 1)];
    function zoom(plot, factor, at) {
      const { min, max } = plot.scales.x, [first, last] = plot.ends;
      const a = at - (at - min) * factor, b = at + (max - at) * factor;
      everywhere(plot, Math.max(a, first), Math.min(b, last));
    }
    function move(plot, by) {
      const { min, max } = plot.scales.x, [first, last] = plot.ends;
      const step = Math.min(Math.max(by, first - min), last - max);
      everywhere(plot, min + step, max + step);
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
    const middle = (plot) => 0.5 * (plot.scales.x.min + plot.scales.x.max);
    const length = (plot) => plot.scales.x.max - plot.scales.x.min;
    const button = (text, label, act) => {
      const one = make("button", "", tools, text);
      one.type = "button"; one.title = label; one.setAttribute("aria-label", label);
      one.addEventListener("click", () => plots.filter((plot) => linked(plot)[0] === plot).forEach(act));
    };
    button("+", "zoom in", (plot) => zoom(plot, 0.5, middle(plot)));
    button("\u2212", "zoom out", (plot) => zoom(plot, 2.0, middle(plot)));
    button("\u25c0", "earlier", (plot) => move(plot, -0.25 * length(plot)));
    button("\u25b6", "later", (plot) => move(plot, 0.25 * length(plot)));
    button("all", "show all", (plot) => everywhere(plot, ...plot.ends));
    tools.append(choice);
    choice.hidden = told.panels.length < 2;
    told.panels.forEach((panel, i) => {
      const box = add(panel, i);
      if (told.panels.length < 2) return;
      const name = make("label", "", choice), tick = make("input", "", name);
      tick.type = "checkbox"; tick.checked = true;
      tick.addEventListener("change", () => { box.hidden = !tick.checked; columns(); });
      name.append(" " + panel.label);
    });
    new ResizeObserver(columns).observe(grid);
    columns();
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
