// The plots of a report: drag to zoom, double click for all, one cursor for all plots of a group.

const groups = {};
let zooming = false;
/** Called with the time under the cursor of the plots over time. */
let pointed = () => {};

for (const piece of document.querySelectorAll('.swatch[data-colour]'))
  piece.firstElementChild.setAttribute('stroke-dasharray', dashOf(piece.dataset.colour).join(' ') || 'none');

function rangeOf(plot) {
  return (_, low, high) => {
    // No line is shown.
    if (!is(low)) return plot.logarithmic ? [0.1, 10] : [0, 1];
    if (plot.logarithmic) return uPlot.rangeLog(low, high, 10, false);
    for (const [value] of plot.limits) [low, high] = [Math.min(low, value), Math.max(high, value)];
    const margin = 0.08 * (high - low || Math.abs(high) || 1);
    return [low - margin, high + margin];
  };
}

/** Returns the horizontal axis: counts have no fractions, and uPlot names the powers of ten only. */
function xAxisOf({ x_title: name, x_logarithmic, lines }) {
  if (x_logarithmic) return {
    name, scale: { distr: 3, range: (_, low, high) => uPlot.rangeLog(low ?? 1, high ?? 10, 10, false) },
    axis: { label: name, filter: (_, values) => values.map(value => /^[125]/.test(value.toExponential()) ? value : null) },
  };
  const counts = lines.every(({ x }) => x.every(Number.isInteger));
  return { name, scale: {}, axis: { label: name, ...(counts && { incrs: [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000] }) } };
}

function drawPlot(element) {
  const plot = JSON.parse(element.querySelector('script').textContent);
  const { group } = element.dataset;
  const charts = groups[group] ??= [];
  const table = line => [line.x, line.y];
  const lines = plot.lines.map(({ name, colour, dots }, i) => ({ name, colour, dash: dashOf(colour), dots: dots && (i % 2 ? 'full' : 'empty') }));
  // What is drawn as dots is so in the legend.
  for (const { colour, dots } of lines.filter(line => line.dots))
    for (const piece of element.closest('section').querySelectorAll(`.swatch[data-colour="${colour}"]`))
      piece.innerHTML = `<circle cx="13" cy="5" r="3.5" stroke="var(${colour})" stroke-width="1.5" fill="${dots === 'full' ? `var(${colour})` : 'none'}"/>`;
  const chart = plotOf(element, {
    height: plot.height_px,
    x: xAxisOf(plot),
    y: { scale: { range: rangeOf(plot), distr: plot.logarithmic ? 3 : 1 }, axis: { label: plot.y_title, ...(!isNarrow() && { size: 58 }) } },
    lines,
    limits: plot.limits,
    legend: true,
    cursor: { sync: { key: group, setSeries: false }, points: { size: 6 } },
    hooks: {
      setCursor: [({ cursor: { left }, posToVal }) => {
        if (group === 'time' && left >= 0) pointed(posToVal(left, 'x'));
      }],
      setScale: [(chart, key) => {
        if (key !== 'x' || zooming) return;
        zooming = true;
        const { min, max } = chart.scales.x;
        for (const other of charts) if (other.chart !== chart) other.chart.setScale('x', { min, max });
        zooming = false;
      }],
    },
  }, plot.lines.length === 1 ? table(plot.lines[0]) : plot.lines.length ? uPlot.join(plot.lines.map(table)) : [[], []]);
  charts.push({ chart, plot });
}

// All plots of a group begin with the same stretch, that of the longest.
zooming = true;
document.querySelectorAll('.plot').forEach(drawPlot);
for (const charts of Object.values(groups)) {
  const all = charts.flatMap(({ plot }) => plot.lines.flatMap(line => line.x));
  const [min, max] = all.reduce(([low, high], x) => [Math.min(low, x), Math.max(high, x)], [Infinity, -Infinity]);
  for (const { chart, plot } of charts) {
    if (!(min < max) || plot.x_logarithmic) continue;
    // A double click asks for all: of the group, not of one plot.
    chart.root.addEventListener('dblclick', () => chart.setScale('x', { min, max }));
    chart.setScale('x', { min, max });
  }
}
zooming = false;

// A box shows or hides a run in all plots.
for (const box of document.querySelectorAll('input[data-run]'))
  box.addEventListener('change', () => {
    for (const { chart, plot } of Object.values(groups).flat())
      plot.lines.forEach((line, i) => { if (line.run === Number(box.dataset.run)) chart.setSeries(i + 1, { show: box.checked }); });
  });
// The page's scroll bar may have come while the plots were drawn.
fit();
document.body.dataset.plots = plots.length;
