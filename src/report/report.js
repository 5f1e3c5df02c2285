"use strict";
// Draws the plots of a report with uPlot: drag to zoom, double click for all, one cursor for the page.
(() => {
  const groups = {};
  let zooming = false;

  function limitLines(limits) {
    return (chart) => {
      const { ctx, bbox } = chart;
      ctx.save();
      ctx.strokeStyle = ctx.fillStyle = "#444";
      ctx.textAlign = "left";
      ctx.font = `${11.5 * devicePixelRatio}px system-ui, sans-serif`;
      for (const [value, name] of limits) {
        const y = chart.valToPos(value, "y", true);
        if (y < bbox.top || y > bbox.top + bbox.height) continue;
        ctx.setLineDash([7 * devicePixelRatio, 4 * devicePixelRatio]);
        ctx.beginPath();
        ctx.moveTo(bbox.left, y);
        ctx.lineTo(bbox.left + bbox.width, y);
        ctx.stroke();
        ctx.fillText(name, bbox.left + bbox.width + 6 * devicePixelRatio, y + 4 * devicePixelRatio);
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

  function draw(element) {
    const plot = JSON.parse(element.querySelector("script").textContent);
    const group = element.dataset.group;
    const charts = (groups[group] ??= []);
    const tables = plot.lines.map((line) => [line.x, line.y]);
    const data = tables.length > 1 ? uPlot.join(tables) : (tables[0] ?? [[], []]);
    const number = (value) => (value == null ? "" : Number(value.toPrecision(5)).toString());
    const axis = { grid: { stroke: "#e6e6e6", width: 1 }, ticks: { stroke: "#888", width: 1 }, stroke: "#1a1a1a" };
    const chart = new uPlot(
      {
        width: element.clientWidth,
        height: plot.height_px,
        // Room for the names of limits, in all plots alike, so that times stay below each other.
        padding: [8, 100, 0, 0],
        cursor: { sync: { key: group, setSeries: false }, points: { size: 6 } },
        scales: { x: { time: false }, y: { range: range(plot), distr: plot.logarithmic ? 3 : 1 } },
        axes: [
          { ...axis, label: plot.x_title, labelSize: 20, size: 36 },
          { ...axis, label: plot.y_title, labelSize: 22, size: 60 },
        ],
        series: [
          { label: plot.x_title, value: (_, value) => number(value) },
          ...plot.lines.map((line) => ({
            label: line.name,
            stroke: line.colour,
            width: 1.6,
            points: { show: false },
            value: (_, value) => number(value),
          })),
        ],
        hooks: {
          draw: [limitLines(plot.limits)],
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
  addEventListener("beforeprint", fit);
  document.body.dataset.plots = Object.values(groups).flat().length;
})();
