"use strict";
// Draws the plots of a report with uPlot: drag to zoom, double click for all, one cursor for the page. Drawings zoom by the
// same gestures.
(() => {
  const groups = {};
  let zooming = false;

  // Colours are variables of the style sheet, which has them for light and dark pages; each has a dash of its own.
  const DASHES = [[], [9, 4], [3, 4], [12, 3, 3, 3], [6, 2], [2, 2], [16, 5]];
  const colourOf = (text) => {
    const name = /^var\((--\w+)\)$/.exec(text);
    return name ? getComputedStyle(document.documentElement).getPropertyValue(name[1]).trim() : text;
  };
  const dashOf = (text) => DASHES[Number(/^var\(--line(\d)\)$/.exec(text)?.[1] ?? 0)];
  for (const swatch of document.querySelectorAll(".swatch"))
    swatch.firstElementChild.setAttribute("stroke-dasharray", dashOf(swatch.dataset.colour).join(" ") || "none");
  const isNarrow = () => innerWidth < 600;

  function limitLines(limits) {
    return (chart) => {
      const { ctx, bbox } = chart;
      ctx.save();
      ctx.strokeStyle = ctx.fillStyle = colourOf("var(--soft)");
      const inside = isNarrow();
      ctx.textAlign = inside ? "right" : "left";
      ctx.font = `${11.5 * devicePixelRatio}px system-ui, sans-serif`;
      for (const [value, name] of limits) {
        const y = chart.valToPos(value, "y", true);
        if (y < bbox.top || y > bbox.top + bbox.height) continue;
        ctx.setLineDash([7 * devicePixelRatio, 4 * devicePixelRatio]);
        ctx.beginPath();
        ctx.moveTo(bbox.left, y);
        ctx.lineTo(bbox.left + bbox.width, y);
        ctx.stroke();
        // On a phone there is no room beside the plot.
        if (inside) ctx.fillText(name, bbox.left + bbox.width - 4 * devicePixelRatio, y - 4 * devicePixelRatio);
        else ctx.fillText(name, bbox.left + bbox.width + 6 * devicePixelRatio, y + 4 * devicePixelRatio);
      }
      ctx.restore();
    };
  }

  function range(plot) {
    return (chart, low, high) => {
      if (plot.magnified_to !== null) return [-plot.magnified_to, plot.magnified_to];
      // No line is shown.
      if (low === null) return plot.logarithmic ? [0.1, 10] : [0, 1];
      if (plot.logarithmic) return uPlot.rangeLog(low, high, 10, true);
      for (const [value] of plot.limits) {
        low = Math.min(low, value);
        high = Math.max(high, value);
      }
      const margin = 0.08 * (high - low || Math.abs(high) || 1);
      return [low - margin, high + margin];
    };
  }

  // Places on the map at a time of the plots: [time, x, y] of each run.
  let showPlace = () => {};

  function draw(element) {
    const plot = JSON.parse(element.querySelector("script").textContent);
    const group = element.dataset.group;
    const charts = (groups[group] ??= []);
    const tables = plot.lines.map((line) => [line.x, line.y]);
    const data = tables.length > 1 ? uPlot.join(tables) : (tables[0] ?? [[], []]);
    const number = (value) => (value == null ? "" : Number(value.toPrecision(5)).toString());
    const colour = (name) => () => colourOf(`var(--${name})`);
    const axis = { grid: { stroke: colour("grid"), width: 1 }, ticks: { stroke: colour("line"), width: 1 }, stroke: colour("ink") };
    const chart = new uPlot(
      {
        width: element.clientWidth,
        height: plot.height_px,
        // Room for the names of limits, in all plots alike, so that times stay below each other.
        padding: [12, () => (isNarrow() ? 12 : 112), 0, 0],
        cursor: { sync: { key: group, setSeries: false }, points: { size: 6 } },
        scales: { x: { time: false }, y: { range: range(plot), distr: plot.logarithmic ? 3 : 1 } },
        axes: [
          { ...axis, label: plot.x_title, labelSize: 20, size: 36 },
          { ...axis, label: plot.y_title, labelSize: 22, size: 60, space: 24 },
        ],
        series: [
          { label: plot.x_title, value: (_, value) => number(value) },
          ...plot.lines.map((line) => ({
            label: line.name,
            stroke: () => colourOf(line.colour),
            dash: dashOf(line.colour),
            width: 1.8,
            points: { show: false },
            value: (_, value) => number(value),
          })),
        ],
        hooks: {
          draw: [limitLines(plot.limits)],
          setCursor: [
            (chart) => {
              if (group === "time" && chart.cursor.left >= 0) showPlace(chart.posToVal(chart.cursor.left, "x"));
            },
          ],
          setScale: [
            (chart, key) => {
              if (key !== "x" || zooming) return;
              zooming = true;
              const { min, max } = chart.scales.x;
              for (const other of charts) if (other.chart !== chart) other.chart.setScale("x", { min, max });
              zooming = false;
            },
          ],
        },
      },
      data,
      element,
    );
    charts.push({ chart, plot, element });
  }

  // All plots of a group begin with the same stretch, that of the longest.
  zooming = true;
  document.querySelectorAll(".plot").forEach(draw);
  for (const charts of Object.values(groups)) {
    const all = charts.flatMap(({ plot }) => plot.lines.flatMap((line) => line.x));
    if (all.length === 0) continue;
    const [min, max] = all.reduce(([low, high], x) => [Math.min(low, x), Math.max(high, x)], [Infinity, -Infinity]);
    for (const { chart } of charts) {
      // A double click asks for all: of the group, not of one plot.
      chart.root.addEventListener("dblclick", () => chart.setScale("x", { min, max }));
      if (min < max) chart.setScale("x", { min, max });
    }
  }
  zooming = false;

  // Drawings are zoomed by their view box; of a map, the place under the cursor is shown.
  function zoomable(svg) {
    const whole = svg.getAttribute("viewBox");
    const { width } = svg.viewBox.baseVal;
    const namespace = "http://www.w3.org/2000/svg";
    const at = (event) => new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());
    const show = (box, zoom) => {
      svg.setAttribute("viewBox", box);
      svg.style.setProperty("--zoom", zoom);
      svg.classList.toggle("zoomed", zoom > 1);
    };
    let from = null;
    let frame = null;
    svg.addEventListener("pointerdown", (event) => {
      if (event.button !== 0) return;
      from = at(event);
      frame = svg.appendChild(document.createElementNS(namespace, "rect"));
      frame.setAttribute("class", "zoom-box");
      svg.setPointerCapture(event.pointerId);
      event.preventDefault();
    });
    const dragged = (event) => {
      const to = at(event);
      const box = [Math.min(from.x, to.x), Math.min(from.y, to.y), Math.abs(to.x - from.x), Math.abs(to.y - from.y)];
      ["x", "y", "width", "height"].forEach((name, index) => frame.setAttribute(name, box[index]));
      return box;
    };
    svg.addEventListener("pointermove", (event) => {
      if (from) dragged(event);
    });
    svg.addEventListener("pointerup", (event) => {
      if (!from) return;
      const box = dragged(event);
      const shown = svg.viewBox.baseVal.width;
      frame.remove();
      from = frame = null;
      // A click is no zoom, and beyond 200 times there is nothing to see.
      if (Math.min(box[2], box[3]) > 0.01 * shown && box[2] > width / 200) show(box.join(" "), width / box[2]);
    });
    svg.addEventListener("pointercancel", () => {
      frame?.remove();
      from = frame = null;
    });
    svg.addEventListener("dblclick", () => show(whole, 1));
    if (!svg.dataset.frame) return;
    const [left, top, frameWidth, frameHeight, west, east, south, north] = svg.dataset.frame.split(" ").map(Number);
    const tracks = JSON.parse(svg.dataset.tracks);
    const earth = svg.dataset.earth?.split(" ").map(Number);
    const dots = tracks.map((_, run) => {
      const dot = svg.appendChild(document.createElementNS(namespace, "circle"));
      dot.setAttribute("class", `here run${run}`);
      dot.setAttribute("r", 5);
      dot.setAttribute("visibility", "hidden");
      return dot;
    });
    showPlace = (time) =>
      tracks.forEach((track, run) => {
        const after = track.findIndex(([t]) => t >= time);
        const [, x, y] = track[after < 0 ? track.length - 1 : after] ?? [];
        dots[run].setAttribute("visibility", x === undefined ? "hidden" : "visible");
        if (x === undefined) return;
        dots[run].setAttribute("cx", left + (frameWidth * (x - west)) / (east - west));
        dots[run].setAttribute("cy", top + (frameHeight * (north - y)) / (north - south));
      });
    // A click shows the moment of the nearest place that was driven.
    svg.addEventListener("click", (event) => {
      const { x, y } = at(event);
      const [x_m, y_m] = [west + ((x - left) / frameWidth) * (east - west), north - ((y - top) / frameHeight) * (north - south)];
      let [nearest, moment] = [(0.03 * (east - west)) ** 2, null];
      for (const [t, tx, ty] of tracks.flat()) {
        const far = (tx - x_m) ** 2 + (ty - y_m) ** 2;
        if (far < nearest) [nearest, moment] = [far, t];
      }
      if (moment === null) return;
      showPlace(moment);
      const SPAN_S = 10;
      const charts = groups.time ?? [];
      charts[0]?.chart.setScale("x", { min: moment - SPAN_S, max: moment + SPAN_S });
      charts[0]?.chart.setCursor({ left: charts[0].chart.valToPos(moment, "x"), top: 10 });
      place.textContent = `At ${moment.toFixed(1)} s; the plots show that moment. Double click in one for everything.`;
    });
    const place = svg.parentElement.appendChild(document.createElement("p"));
    place.className = "hint";
    const hint = "Drag to zoom, double click for all.";
    place.textContent = hint;
    svg.addEventListener("pointermove", (event) => {
      const { x, y } = at(event);
      const [right, up] = [(x - left) / frameWidth, 1 - (y - top) / frameHeight];
      const inside = Math.min(right, up) >= 0 && Math.max(right, up) <= 1;
      const [x_m, y_m] = [west + right * (east - west), south + up * (north - south)];
      const degrees = (i) => (earth[i] + earth[i + 2] * x_m + earth[i + 4] * y_m).toFixed(7);
      const onEarth = earth ? `, latitude ${degrees(0)}\u00b0, longitude ${degrees(1)}\u00b0` : "";
      place.textContent = inside ? `X_g ${x_m.toFixed(2)} m, Y_g ${y_m.toFixed(2)} m${onEarth}` : hint;
    });
  }
  document.querySelectorAll("figure svg[viewBox]:not(.swatch)").forEach(zoomable);

  const each = (act) => Object.values(groups).flat().forEach(act);
  for (const box of document.querySelectorAll("input[id^=show]")) {
    const run = Number(box.id.slice(4));
    box.addEventListener("change", () =>
      each(({ chart, plot }) =>
        plot.lines.forEach((line, index) => {
          if (line.run === run) chart.setSeries(index + 1, { show: box.checked });
        }),
      ),
    );
  }
  const fit = () =>
    each(({ chart, plot, element }) => chart.setSize({ width: element.clientWidth, height: plot.height_px }));
  // The page's scroll bar may have come while the plots were drawn.
  fit();
  addEventListener("resize", fit);
  const repaint = () => each(({ chart }) => chart.redraw(false));
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", repaint);
  addEventListener("beforeprint", () => {
    fit();
    repaint();
  });
  document.body.dataset.plots = Object.values(groups).flat().length;
})();
