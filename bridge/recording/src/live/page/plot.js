'use strict';
// What all pages share: elements, numbers, colours, and plots, which uPlot draws.

const $ = id => document.getElementById(id);
const make = (tag, props = {}, ...children) => {
  const node = Object.assign(document.createElement(tag), props);
  node.append(...children);
  return node;
};
const is = value => value !== null && value !== undefined && !Number.isNaN(value);

const capital = text => text.charAt(0).toUpperCase() + text.slice(1);

// --- Numbers ---

/** Returns a number with so many decimals, without a minus before zeros. */
const fixed = (value, places) => value.toFixed(places).replace(/^-(?=[0.]*$)/, '').replace('-', '\u2212');
const digits = (value, n = 2, most = 3) => {
  if (!is(value)) return '–';
  if (Math.abs(value) < 0.5 * 10 ** -most) return '0';
  const places = Math.max(0, n - 1 - Math.floor(Math.log10(Math.abs(value))));
  return fixed(value, Math.min(places, most));
};
const signed = value => fixed(value, 1);
const TICK = new Intl.NumberFormat('en', { maximumSignificantDigits: 5 });
/** Returns the texts of the ticks of an axis. */
const ticksOf = values => values.map(value => is(value) ? TICK.format(value).replace('-', '\u2212') : '');

/** Returns a step of 1, 2 or 5 times a power of ten that divides a range into about so many parts. */
function step(range, count) {
  const rough = range / count, power = 10 ** Math.floor(Math.log10(rough));
  return power * [1, 2, 5, 10].find(factor => factor * power >= rough - 1e-12);
}

// --- Colours: variables of the style, which has them for light and for dark ---

const NAMES = ['ground', 'panel', 'ink', 'soft', 'line', 'grid', 'path', 'blue', 'orange', 'green', 'violet', 'obstacle',
  'line0', 'line1', 'line2', 'line3', 'line4', 'line5', 'line6'].map(name => `--${name}`);
/** Each line of a report has a dash of its own beside its colour. */
const DASHES = [[], [9, 4], [3, 4], [12, 3, 3, 3], [6, 2], [2, 2], [16, 5]];
const dashOf = colour => DASHES[Number(/^--line(\d)$/.exec(colour)?.[1] ?? 0)];

let colours = {};
function readColours() {
  const style = getComputedStyle(document.documentElement);
  for (const name of NAMES) colours[name] = style.getPropertyValue(name).trim();
}
readColours();

const swatch = ({ colour, dash = [] }) => {
  const holder = make('span');
  holder.innerHTML = `<svg class="swatch" viewBox="0 0 26 10" aria-hidden="true"><path d="M0 5h26" fill="none" stroke="var(${colour})" stroke-width="3" stroke-dasharray="${dash.join(' ') || 'none'}"/></svg>`;
  return holder.firstChild;
};

// --- Plots ---

/** All plots of the page: `chart`, the `element` that holds it, and its `height`. */
const plots = [];
const isNarrow = () => innerWidth < 600;

/** Draws dashed limits, each a value with its name. */
const limitLines = limits => chart => {
  const { ctx, bbox } = chart, ratio = devicePixelRatio;
  ctx.save();
  ctx.font = `${12 * ratio}px system-ui, sans-serif`;
  ctx.textBaseline = 'alphabetic';
  let before = -Infinity;
  for (const [value, name] of limits) {
    const y = chart.valToPos(value, 'y', true);
    if (y < bbox.top - 1 || y > bbox.top + bbox.height + 1) continue;
    ctx.strokeStyle = ctx.fillStyle = colours['--soft'];
    ctx.lineWidth = ratio;
    ctx.setLineDash([7 * ratio, 4 * ratio]);
    ctx.beginPath();
    ctx.moveTo(bbox.left, y);
    ctx.lineTo(bbox.left + bbox.width, y);
    ctx.stroke();
    // Lines end at a name, so that it can be read; of two that are near each other one stands at the left.
    const low = y + (y < bbox.top + 20 * ratio ? 13 : -4) * ratio, left = Math.abs(low - before) < 14 * ratio;
    before = low;
    ctx.textAlign = left ? 'left' : 'right';
    const at = [left ? bbox.left + 4 * ratio : bbox.left + bbox.width - 4 * ratio, low];
    ctx.strokeStyle = colours['--panel'];
    ctx.lineWidth = 4 * ratio;
    ctx.setLineDash([]);
    ctx.strokeText(name, ...at);
    ctx.fillText(name, ...at);
  }
  ctx.restore();
};

/** Draws lines over a common quantity into an element. `x` and `y` are an axis and a scale of uPlot each; each of `lines`
 * has name, colour, and a dash or `dots`; each of `limits` a value and its name. */
function plotOf(element, { height, x, y, lines, limits = [], legend = false, cursor = { show: false }, hooks = {} }, data) {
  const axis = {
    stroke: () => colours['--ink'], grid: { stroke: () => colours['--grid'], width: 1 },
    ticks: { stroke: () => colours['--line'], width: 1, size: 4 }, font: '12px system-ui, sans-serif', labelFont: '13px system-ui, sans-serif',
    values: (_, values) => ticksOf(values),
  };
  // As broad as its longest text.
  const broad = (_, texts) => 12 + 7 * Math.max(3, ...(texts || []).map(text => String(text ?? '').length));
  const number = (_, value) => is(value) ? String(Number(value.toPrecision(3))) : '–';
  const chart = new uPlot({
    width: Math.max(element.clientWidth, 50), height, cursor, legend: { show: legend },
    padding: [8, 12, 0, 0],
    scales: { x: { time: false, ...x.scale }, y: { ...y.scale } },
    axes: [{ ...axis, labelSize: 20, size: 26, gap: 2, ...x.axis }, { ...axis, labelSize: 20, size: broad, space: 24, gap: 3, ...y.axis }],
    series: [{ label: x.name, value: number }, ...lines.map(({ name, colour, dash = [], dots }) => ({
      label: name, dash, width: dots ? 0 : 2, value: number,
      stroke: () => colours[colour],
      points: dots ? { show: true, size: 6, width: 1.5, fill: dots === 'full' ? () => colours[colour] : () => colours['--ground'] } : { show: false },
      ...(dots ? { paths: () => null } : {}),
    }))],
    hooks: { ...hooks, draw: [limitLines(limits), ...(hooks.draw || [])] },
  }, data, element);
  plots.push({ chart, element, height });
  return chart;
}

/** Fits plots to the width of the page. */
const fit = () => plots.forEach(({ chart, element, height }) => {
  if (element.clientWidth && element.clientWidth !== chart.width) chart.setSize({ width: element.clientWidth, height });
});
const repaint = () => plots.forEach(({ chart }) => chart.redraw(false, true));
addEventListener('resize', fit);
/** Whether the page is printed: then what is out of sight is drawn as well. */
let whole = false;
/** What a page does besides, when its colours or its size are others. */
let renew = () => {};
matchMedia('(prefers-color-scheme: dark)').addEventListener('change', () => { readColours(); repaint(); renew(); });
for (const name of ['beforeprint', 'afterprint'])
  addEventListener(name, () => {
    whole = name === 'beforeprint';
    readColours();
    fit();
    repaint();
    renew();
  });
