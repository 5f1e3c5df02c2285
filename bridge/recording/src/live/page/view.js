// What pages of a drive share: frames over time, plots of them, and the map.

const GAP_S = 3;
const DEG = 180 / Math.PI;
// --- Runs: what is shown over time ---

/** What is drawn, one or several: `frames`, `plan` as x, y, x, y ..., `colour`, `dash`, `planColour`, `planDash`, and a
 * `name` where there are several. A frame begins with its time; `column` has the places of the other entries. */
const runs = [];
let column = {};
/** `path` as x, y, x, y ..., and `vehicle` with body and wheels. */
let parts = {};

const get = (frame, name) => frame ? frame[column[name]] : null;
const last = frames => frames[frames.length - 1];

/** Returns the newest frame of all runs. */
function newest() {
  let found;
  for (const { frames } of runs) {
    const frame = last(frames);
    if (frame && (!found || frame[0] > found[0])) found = frame;
  }
  return found;
}
const oldest = () => Math.min(...runs.filter(run => run.frames.length).map(run => run.frames[0][0]));

// --- Time: null shows the present ---

let cursor = null;

function indexAt(frames, time) {
  let low = 0, high = frames.length;
  while (low < high) {
    const mid = (low + high) >> 1;
    if (frames[mid][0] < time) low = mid + 1; else high = mid;
  }
  if (low === frames.length || (low > 0 && time - frames[low - 1][0] < frames[low][0] - time)) low--;
  return low;
}
const shownIndex = frames => cursor === null ? frames.length - 1 : indexAt(frames, cursor);
const shown = frames => frames[shownIndex(frames)];

function clock(time, seconds = true) {
  if (time < 1e9) {
    const rounded = Math.round(time * 10) / 10;
    return `${rounded < 60 || !seconds ? rounded : rounded.toFixed(0)} s`;
  }
  return new Date(1000 * time).toLocaleTimeString([], { hour12: false, hour: '2-digit', minute: '2-digit', second: '2-digit' });
}

function seek(time) {
  cursor = time;
  if (newest() && time !== null) cursor = Math.min(Math.max(time, oldest()), newest()[0]);
  draw();
}

/** Shows the time on slider and clock, as a text of it. */
function showTime(textOf = clock) {
  const time = cursor ?? newest()[0];
  Object.assign($('time'), { min: oldest(), max: newest()[0], value: time });
  $('clock').textContent = textOf(time);
  $('time').setAttribute('aria-valuetext', textOf(time));
  if ($('live')) $('live').setAttribute('aria-pressed', cursor === null);
}
/** Says on the map how old what it shows is. */
function showPast() {
  const ago = newest()[0] - (cursor ?? newest()[0]);
  $('past').hidden = cursor === null;
  $('past').textContent = `${ago < 100 ? `${ago.toFixed(0)} s` : `${(ago / 60).toFixed(1)} min`} ago`;
}
if ($('live')) $('live').onclick = () => seek(null);

// --- State ---

const ICONS = { drives: '▶', done: '✓', warns: '▲', stopped: '■', waits: '●', lost: '⚠' };
let told = '';
/** Says in large type what kind of state it is, its name and its reason, and how current it is. */
function tell(kind, name, reason, link) {
  const text = [kind, name, reason, link].join('|');
  if (text === told) return;
  told = text;
  $('head').dataset.kind = kind;
  $('icon').textContent = ICONS[kind];
  $('state').textContent = name;
  $('reason').textContent = reason;
  $('link').textContent = link;
  document.title = `${name} – Sidehill`;
}

let due = false;
/** Shows all of it, once a picture; `show` is the page's own. */
function draw() {
  if (due) return;
  due = true;
  requestAnimationFrame(() => {
    due = false;
    show();
  });
}
renew = draw;
addEventListener('resize', draw);
addEventListener('scroll', draw, { passive: true });

// --- Figures ---

const side = (value, unit, negative, positive, floor) => {
  if (!is(value)) return ['–', ''];
  const text = Math.abs(value) < floor ? '0' : digits(Math.abs(value));
  return [text, text === '0' ? unit : `${unit} ${value < 0 ? negative : positive}`];
};
/** Returns how far the ground falls, deg, in a direction that is so far clockwise of the vehicle's. */
function tilt(frame, clockwise) {
  if (!is(get(frame, 'downhill_x'))) return null;
  const way = get(frame, 'heading') - clockwise;
  const sine = get(frame, 'downhill_x') * Math.cos(way) + get(frame, 'downhill_y') * Math.sin(way);
  return DEG * Math.asin(Math.min(Math.max(sine, -1), 1));
}

const CROSS_TRACK = {
  name: 'Cross-track error', unit: 'cm', least: 2, zero: true,
  of: f => is(get(f, 'cross_track')) ? 100 * get(f, 'cross_track') : null,
  value: ([e]) => side(e, 'cm', 'right', 'left', 0.05),
};
const GRIP = {
  name: 'Grip used', unit: '%', range: [0, 100], limit: 100,
  of: f => is(get(f, 'friction_use')) ? 100 * get(f, 'friction_use') : null,
  value: ([g]) => [is(g) ? g.toFixed(0) : '–', '%'],
};
const TIP_OVER = {
  name: 'Tip-over margin', unit: '', range: [0, 1], limit: 0,
  of: f => get(f, 'tip_over_margin'),
  value: ([m]) => [digits(m), '(0 tips over)'],
};

// --- Plots over time ---

/** Returns the lines of a strip: its own of the only run, or the same of each run. */
const linesOf = strip => strip.lines
  ? strip.lines.map(line => ({ ...line, frames: runs[0].frames }))
  : runs.map(({ name, colour, dash, frames }) => ({ name, colour, dash, frames, of: strip.of }));

/** Names the lines of a strip, where there are several. */
function showKeys(strip) {
  strip.texts = [];
  strip.keys.replaceChildren(...linesOf(strip).filter(line => line.name).map(line => {
    const text = make('span', { textContent: line.name });
    strip.texts.push(text);
    return make('span', {}, swatch(line), text);
  }));
}

/** Adds a strip: `name`, `unit`, `least` or `range`, `zero`, `limit`; `of`, which returns the value of a frame of any run,
 * or `lines` of the only run with `of` each; `value` returns text and unit for the values, `words` the texts of the axis. */
function addStrip(strip) {
  strip.holder = make('div', { className: 'plot' });
  strip.holder.setAttribute('role', 'img');
  strip.text = make('p', { className: 'value' });
  strip.keys = make('p', { className: 'keys' });
  strip.box = make('article', { className: 'strip', hidden: true },
    make('header', {}, make('h2', { textContent: strip.name }), strip.text), strip.keys, strip.holder);
  showKeys(strip);
  $('strips').append(strip.box);
  const pick = event => {
    if (!newest() || (event.type === 'pointermove' && !event.buttons)) return;
    seek(strip.chart.posToVal(event.clientX - strip.chart.over.getBoundingClientRect().left, 'x'));
  };
  strip.holder.addEventListener('pointerdown', pick);
  strip.holder.addEventListener('pointermove', pick);
}

const STRIP_HEIGHT = 110;
const TIMES = [0.1, 0.2, 0.5, 1, 2, 5, 10, 15, 20, 30, 60, 120, 180, 300, 600, 1200, 1800, 3600];

/** Makes the plot of a strip; a strip of other lines than before has another plot. */
function plotStrip(strip, lines) {
  const key = lines.map(({ name, colour }) => name + colour).join();
  if (strip.chart && strip.key === key) return;
  if (strip.chart) {
    plots.splice(plots.findIndex(({ chart }) => chart === strip.chart), 1);
    strip.chart.destroy();
  }
  strip.key = key;
  const here = chart => {
    if (cursor === null) return;
    const x = Math.round(chart.valToPos(cursor, 'x', true)), { ctx, bbox } = chart;
    ctx.fillStyle = colours['--ink'];
    ctx.fillRect(x - devicePixelRatio, bbox.top, 2 * devicePixelRatio, bbox.height);
  };
  // The ends are whole steps, so that the axis is calm.
  const range = (_, low, high) => {
    [low, high] = [low ?? 0, high ?? 0];
    if (strip.range) return [Math.min(strip.range[0], low), Math.max(strip.range[1], high)];
    [low, high] = [Math.min(low, 0), Math.max(high, 0)];
    const size = step(Math.max(high - low, strip.least || 0), 2.5);
    const end = value => Math.abs(value) < 1e-9 ? 0 : Math.sign(value) * Math.ceil(Math.abs(value) / size + 0.05) * size;
    return end(low) === end(high) ? [0, size] : [end(low), end(high)];
  };
  // A time of day that the edge would cut is left out.
  const timesOf = (chart, times) => times.map(time => {
    const text = clock(time, false);
    return time < 0 || chart.valToPos(time, 'x') + 3.5 * text.length > chart.bbox.width / devicePixelRatio + 12 ? '' : text;
  });
  strip.chart = plotOf(strip.holder, {
    height: STRIP_HEIGHT,
    // Times of day are longer than counts of seconds.
    x: { scale: {}, axis: { incrs: TIMES, space: (_, __, low) => low < 1e9 ? 40 : 68, values: timesOf } },
    y: { scale: { range }, axis: strip.words ? { splits: () => Object.keys(strip.words).map(Number), values: () => Object.values(strip.words) } : {} },
    lines,
    limits: is(strip.limit) ? [[strip.limit, '']] : [],
    hooks: { draw: [here] },
  }, [[], ...lines.map(() => [])]);
}

/** Returns times and values of a line from the frame before a time until that after another; a gap has no value. */
function valuesOf({ frames, of }, from, to) {
  const times = [], values = [];
  for (let i = Math.max(0, indexAt(frames, from) - 1); i < frames.length; i++) {
    const [time] = frames[i], value = of(frames[i]);
    if (times.length && time - times[times.length - 1] > GAP_S) {
      times.push(times[times.length - 1] + 1e-3);
      values.push(null);
    }
    times.push(time);
    values.push(is(value) ? value : null);
    if (time > to) break;
  }
  return [times, values];
}

function drawStrip(strip, [from, to]) {
  const lines = linesOf(strip).filter(line => line.frames.length);
  if (!lines.length) return;
  const values = lines.map(line => line.of(shown(line.frames)));
  if (strip.box.hidden) {
    if (!lines.some(line => line.frames.some(frame => is(line.of(frame))))) return;
    strip.box.hidden = false;
    // It may take room from others.
    fit();
  }
  let label;
  if (strip.lines || !runs[0].name) {
    const [value, unit] = strip.value(values);
    strip.text.replaceChildren(value, ' ', make('small', { textContent: unit }));
    label = `${value} ${unit}`;
  } else {
    const texts = values.map(value => strip.value([value]).join(' ').trim());
    texts.forEach((text, i) => { strip.texts[i].textContent = text; });
    label = texts.map((text, i) => `${lines[i].name} ${text}`).join(', ');
  }
  strip.holder.setAttribute('aria-label', `${strip.name} over time, now ${label}`);
  plotStrip(strip, lines);
  const { top, bottom } = strip.holder.getBoundingClientRect();
  if (!whole && (bottom < 0 || top > innerHeight)) return;
  const tables = lines.map(line => valuesOf(line, from, to));
  const together = strip.lines ? [tables[0][0], ...tables.map(([, values]) => values)] : uPlot.join(tables);
  strip.chart.batch(() => {
    strip.chart.setData(together, false);
    strip.chart.setScale('x', { min: from, max: to });
  });
}

/** Sets the size of a canvas to that on the screen, and returns its context and size. */
function prepare(canvas) {
  const ratio = devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  const pen = canvas.getContext('2d');
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  pen.lineJoin = pen.lineCap = 'round';
  return [pen, width, height];
}

// --- Map ---

const view = { mode: 'whole', x: 0, y: 0, scale: 40 };
const FOLLOW_LENGTHS = 7;

function setMode(mode) {
  view.mode = mode;
  $('follow').setAttribute('aria-pressed', mode === 'follow');
  $('whole').setAttribute('aria-pressed', mode === 'whole');
  draw();
}
$('follow').onclick = () => {
  const length = parts.vehicle ? parts.vehicle.body[0] : 1;
  view.scale = $('map').clientWidth / (FOLLOW_LENGTHS * length);
  setMode('follow');
};
$('whole').onclick = () => setMode('whole');
function zoom(factor, at) {
  const canvas = $('map');
  const [dx, dy] = at ? [at[0] - canvas.clientWidth / 2, canvas.clientHeight / 2 - at[1]] : [0, 0];
  const scale = Math.min(Math.max(view.scale * factor, 0.2), 2000);
  if (view.mode !== 'follow') {
    view.x += dx / view.scale - dx / scale;
    view.y += dy / view.scale - dy / scale;
  }
  view.scale = scale;
  setMode(view.mode === 'follow' ? 'follow' : 'free');
}
$('in').onclick = () => zoom(1.5);
$('out').onclick = () => zoom(1 / 1.5);

/** Returns what a finger that touches the map holds, with `move` and `end`; nothing where it is the map itself. Places
 * are in m, and `reach` is as far as a finger is broad. */
let touched = (place, reach) => null;
/** Draws below and above paths and vehicles; X and Y convert m into pixels. */
let drawBelow = (pen, X, Y) => {};
let drawAbove = (pen, X, Y) => {};

const fingers = new Map();
const FINGER = 22;
let held = null;
const map = $('map');
/** Returns the place of an event, m. */
const placeOf = event => [
  view.x + (event.offsetX - map.clientWidth / 2) / view.scale,
  view.y - (event.offsetY - map.clientHeight / 2) / view.scale,
];
map.addEventListener('wheel', event => {
  event.preventDefault();
  zoom(1.0015 ** -event.deltaY, [event.offsetX, event.offsetY]);
}, { passive: false });
map.addEventListener('pointerdown', event => {
  map.setPointerCapture(event.pointerId);
  if (held) return;
  held = fingers.size ? null : touched(placeOf(event), FINGER / view.scale);
  if (held) {
    held.id = event.pointerId;
    return;
  }
  fingers.set(event.pointerId, [event.offsetX, event.offsetY]);
});
for (const name of ['pointerup', 'pointercancel'])
  map.addEventListener(name, event => {
    fingers.delete(event.pointerId);
    if (!held || held.id !== event.pointerId) return;
    const { end } = held;
    held = null;
    end();
  });
map.addEventListener('pointermove', event => {
  if (held && held.id === event.pointerId) {
    held.move(placeOf(event));
    return;
  }
  const before = fingers.get(event.pointerId);
  if (!before) return;
  const now = [event.offsetX, event.offsetY];
  fingers.set(event.pointerId, now);
  const others = [...fingers].filter(([id]) => id !== event.pointerId);
  const share = 1 / fingers.size;
  view.x -= share * (now[0] - before[0]) / view.scale;
  view.y += share * (now[1] - before[1]) / view.scale;
  if (others.length) {
    const [, other] = others[0];
    const apart = point => Math.hypot(point[0] - other[0], point[1] - other[1]);
    zoom(apart(now) / Math.max(apart(before), 1), now);
  }
  setMode('free');
});

/** Returns latitude and longitude of a place as a text, as map programs take it; none where the drive has no place on earth. */
function onEarth(x, y) {
  const { earth } = parts;
  const powers = [1, x, y, x * x, x * y, y * y];
  const degrees = i => earth.reduce((sum, term, k) => sum + term[i] * powers[k], 0);
  return earth && is(x) ? [0, 1].map(i => `${degrees(i).toFixed(7)}°`).join(', ') : '';
}

/** Calls `found` with the moment at which a vehicle was where the map is clicked. */
function onPlace(found) {
  let pressed = null;
  map.addEventListener('pointerdown', event => { pressed = [event.offsetX, event.offsetY]; });
  map.addEventListener('click', event => {
    if (!pressed || Math.hypot(event.offsetX - pressed[0], event.offsetY - pressed[1]) > 6) return;
    const [x, y] = placeOf(event);
    let [nearest, moment] = [2 * FINGER / view.scale, null];
    for (const { frames } of inSight())
      for (const frame of frames) {
        const far = is(get(frame, 'x')) ? Math.hypot(get(frame, 'x') - x, get(frame, 'y') - y) : Infinity;
        if (far < nearest) [nearest, moment] = [far, frame[0]];
      }
    if (moment !== null) found(moment);
  });
}

/** Returns the height at a place between the nodes of a grid that have one: null where the nearest has none, nothing outside. */
function heightIn({ corner, size, nodes, heights }, x, y) {
  const [u, v] = [x, y].map((place, axis) => (place - corner[axis]) / size[axis] * (nodes[axis] - 1));
  if (!(u >= 0 && v >= 0 && u <= nodes[0] - 1 && v <= nodes[1] - 1)) return undefined;
  const at = (i, j) => heights[j * nodes[0] + i];
  if (!is(at(Math.round(u), Math.round(v)))) return null;
  let [sum, weights] = [0, 0];
  for (const i of [Math.floor(u), Math.floor(u) + 1])
    for (const j of [Math.floor(v), Math.floor(v) + 1]) {
      const height = i < nodes[0] && j < nodes[1] ? at(i, j) : null, weight = (1 - Math.abs(u - i)) * (1 - Math.abs(v - j));
      if (is(height)) [sum, weights] = [sum + weight * height, weights + weight];
    }
  return sum / weights;
}
/** Ground below the map: `heights` and `slippery` return heights, m, and how slippery it is, 0 to 1, at the nodes of a square, row
 * by row from its corner of the lowest x and y, a side and a count of nodes along it. */
let ground = null;
/** The ground as a picture of bands of height: `canvas`, place of its corner, side, m, and scale of the map. */
let picture = null;
const GROUND_POINTS = 200;

/** Shows the ground of `parts`, the nodes of a grid. */
function takeGround() {
  picture = null;
  ground = parts.ground && {
    heights: (x, y, side, count) => Array.from({ length: count * count }, (_, i) =>
      heightIn(parts.ground, x + side * (i % count) / (count - 1), y + side * Math.floor(i / count) / (count - 1))),
  };
}

function pictureGround() {
  const side = 1.6 * Math.max(map.clientWidth, map.clientHeight) / view.scale;
  const [x, y] = [view.x - side / 2, view.y - side / 2];
  const heights = ground.heights(x, y, side, GROUND_POINTS);
  let [low, high] = [Infinity, -Infinity];
  for (const height of heights) if (is(height)) [low, high] = [Math.min(low, height), Math.max(high, height)];
  const band = high - low > 0.01 ? step(high - low, 12) : Infinity;
  const canvas = make('canvas', { width: GROUND_POINTS, height: GROUND_POINTS });
  const pen = canvas.getContext('2d');
  const pixels = pen.createImageData(GROUND_POINTS, GROUND_POINTS);
  const dark = matchMedia('(prefers-color-scheme: dark)').matches;
  heights.forEach((height, i) => {
    const [row, left] = [Math.floor(i / GROUND_POINTS), i % GROUND_POINTS];
    const at = 4 * ((GROUND_POINTS - 1 - row) * GROUND_POINTS + left);
    // Of what is outside nothing is known.
    if (height === undefined) return;
    pixels.data.fill(dark ? 255 : 0, at, at + 3);
    if (!is(height)) {
      pixels.data[at + 3] = 90;
      return;
    }
    // Every other band is darker, with an edge as broad as a point of the picture.
    const rise = [1, GROUND_POINTS].map(next => Math.abs((is(heights[i + next]) ? heights[i + next] : height) - height));
    const within = Math.abs(((height / band) % 2 + 2) % 2 - 1);
    pixels.data[at + 3] = 26 * Math.min(Math.max(0.5 + (0.5 - within) * band / Math.max(rise[0] + rise[1], 1e-9), 0), 1);
  });
  pen.putImageData(pixels, 0, 0);
  // Slippery ground is hatched.
  const slippery = ground.slippery ? ground.slippery(x, y, side, GROUND_POINTS) : [];
  pen.fillStyle = colours['--orange'];
  slippery.forEach((much, i) => {
    const [row, left] = [GROUND_POINTS - 1 - Math.floor(i / GROUND_POINTS), i % GROUND_POINTS];
    if (much < 0.2 || (row + left) % 6 > 1) return;
    pen.globalAlpha = 0.2 + 0.6 * much;
    pen.fillRect(left, row, 1, 1);
  });
  const text = band < 1 ? `${Math.round(100 * band)} cm` : `${band} m`;
  showKey('bands', Number.isFinite(band) && `bands of ${text} of height`);
  showKey('slippery', slippery.length && 'slippery ground');
  return { canvas, x, y, side, scale: view.scale, dark };
}

function drawGround(pen, X, Y) {
  if (!ground) return;
  const half = [map.clientWidth / 2 / view.scale, map.clientHeight / 2 / view.scale];
  const outside = picture && (view.x - half[0] < picture.x || view.x + half[0] > picture.x + picture.side
    || view.y - half[1] < picture.y || view.y + half[1] > picture.y + picture.side);
  const dark = matchMedia('(prefers-color-scheme: dark)').matches;
  if (!picture || outside || view.scale / picture.scale > 2.5 || picture.dark !== dark) picture = pictureGround();
  const [left, top] = [X(picture.x), Y(picture.y + picture.side)];
  pen.drawImage(picture.canvas, left, top, X(picture.x + picture.side) - left, Y(picture.y) - top);
}

/** Names a line of the map in its legend, or what else is to be seen there; without a text no longer. */
function showKey(kind, text) {
  const key = $('legend').querySelector(`.${kind}`) || $('legend').appendChild(make('li', { className: kind }));
  key.hidden = !text;
  key.textContent = text || '';
}

/** What is known of obstacles: the time from which on, the side of a cell, and x, y, x, y of the ends of each row of cells. */
let obstacles = [];

/** Draws the obstacles of the time shown. */
function drawObstacles(pen, X, Y) {
  const [, cell, ...rows] = obstacles.findLast(([time]) => cursor === null || time <= cursor) || [];
  showKey('obstacles', rows.length && 'obstacles');
  pen.strokeStyle = colours['--obstacle'];
  pen.lineWidth = Math.max(cell * view.scale, 2);
  pen.lineCap = 'butt';
  pen.beginPath();
  for (let i = 0; i < rows.length; i += 4) {
    pen.moveTo(X(rows[i]), Y(rows[i + 1]));
    pen.lineTo(X(rows[i + 2]), Y(rows[i + 3]));
  }
  pen.stroke();
  pen.lineCap = 'round';
}

/** Draws the places where the vehicle has dug in. */
function drawDugIn(pen, X, Y) {
  const places = parts.dug_in || [];
  showKey('dug_in', places.length && 'dug in');
  pen.strokeStyle = colours['--obstacle'];
  pen.lineWidth = 3;
  pen.beginPath();
  for (let i = 0; i < places.length; i += 2) {
    const x = X(places[i]), y = Y(places[i + 1]);
    for (const way of [-1, 1]) {
      pen.moveTo(x - 8, y - 8 * way);
      pen.lineTo(x + 8, y + 8 * way);
    }
  }
  pen.stroke();
}

/** Returns the runs that are not hidden. */
const inSight = () => runs.filter(run => !run.hidden);

function bounds() {
  const xs = [], ys = [];
  const path = parts.path || [];
  for (let i = 0; i + 1 < path.length; i += 2) { xs.push(path[i]); ys.push(path[i + 1]); }
  for (const { frames } of inSight())
    for (let i = 0; i < frames.length; i = i < frames.length - 1 ? Math.min(i + 5, frames.length - 1) : i + 1)
      if (is(get(frames[i], 'x'))) { xs.push(get(frames[i], 'x')); ys.push(get(frames[i], 'y')); }
  const least = list => list.reduce((a, b) => Math.min(a, b), Infinity);
  const most = list => list.reduce((a, b) => Math.max(a, b), -Infinity);
  return xs.length ? [least(xs), most(xs), least(ys), most(ys)] : [-2, 2, -2, 2];
}

/** Draws a line through x, y, x, y ..., m. */
function strokeLine(pen, X, Y, points, colour, thick, dash = []) {
  pen.strokeStyle = colours[colour];
  pen.lineWidth = thick;
  pen.setLineDash(dash);
  pen.beginPath();
  for (let i = 0; i + 1 < points.length; i += 2)
    pen[i ? 'lineTo' : 'moveTo'](X(points[i]), Y(points[i + 1]));
  pen.stroke();
  pen.setLineDash([]);
}

/** Draws the map; the vehicle of the first run is the one that it follows. */
function drawMap() {
  const [pen, width, height] = prepare(map);
  const [first] = inSight();
  const frame = first ? shown(first.frames) : undefined, here = is(get(frame, 'x'));
  const length = parts.vehicle ? parts.vehicle.body[0] : 0.6;
  if (view.mode === 'whole') {
    const [left, right, low, high] = bounds(), around = 2 * length;
    // The buttons are on the right.
    const room = 60;
    // A window that is not yet laid out has no room at all.
    view.scale = Math.max(Math.min((width - room) / (right - left + around), height / (high - low + around)), 1e-3);
    view.x = (left + right) / 2 + room / 2 / view.scale;
    view.y = (low + high) / 2;
  } else if (view.mode === 'follow' && here) {
    view.x = get(frame, 'x');
    view.y = get(frame, 'y');
  }
  const s = view.scale;
  const X = x => width / 2 + (x - view.x) * s, Y = y => height / 2 - (y - view.y) * s;

  drawBelow(pen, X, Y);
  drawGround(pen, X, Y);
  const size = step(width / s, 6);
  pen.strokeStyle = colours['--grid'];
  pen.lineWidth = 1;
  pen.beginPath();
  for (let x = Math.ceil((view.x - width / 2 / s) / size) * size; X(x) < width; x += size) { pen.moveTo(X(x), 0); pen.lineTo(X(x), height); }
  for (let y = Math.ceil((view.y - height / 2 / s) / size) * size; Y(y) > 0; y += size) { pen.moveTo(0, Y(y)); pen.lineTo(width, Y(y)); }
  pen.stroke();

  drawObstacles(pen, X, Y);
  pen.globalAlpha = 0.6;
  strokeLine(pen, X, Y, parts.path || [], '--path', 8);
  pen.globalAlpha = 1;

  for (const { frames, colour, dash = [] } of inSight()) {
    const at = shownIndex(frames);
    pen.strokeStyle = colours[colour];
    pen.setLineDash(dash);
    // What came after the time shown is thin.
    for (const [begin, end, thick] of [[at, frames.length - 1, 1], [0, at, 3]]) {
      pen.lineWidth = thick;
      pen.beginPath();
      let before = null;
      for (let i = Math.max(begin, 0); i <= end; i++) {
        const [time] = frames[i], x = get(frames[i], 'x'), y = get(frames[i], 'y');
        if (!is(x)) { before = null; continue; }
        if (before !== null && time - before < GAP_S) pen.lineTo(X(x), Y(y)); else pen.moveTo(X(x), Y(y));
        before = time;
      }
      pen.stroke();
    }
    pen.setLineDash([]);
  }
  for (const run of inSight()) {
    if (cursor === null) strokeLine(pen, X, Y, run.plan || [], run.planColour, 3, run.planDash);
    const frame = shown(run.frames);
    if (is(get(frame, 'x'))) drawVehicle(pen, frame, X, Y, s, run);
  }
  drawAbove(pen, X, Y);
  drawDugIn(pen, X, Y);

  // Scale.
  pen.strokeStyle = pen.fillStyle = colours['--ink'];
  pen.lineWidth = 2;
  pen.beginPath();
  pen.moveTo(12, height - 18); pen.lineTo(12, height - 12); pen.lineTo(12 + size * s, height - 12); pen.lineTo(12 + size * s, height - 18);
  pen.stroke();
  pen.font = '13px system-ui, sans-serif';
  pen.textAlign = 'left';
  pen.textBaseline = 'alphabetic';
  pen.fillText(size >= 1 ? `${size} m` : `${Math.round(100 * size)} cm`, 18, height - 17);

  const [dx, dy] = [get(frame, 'downhill_x'), get(frame, 'downhill_y')];
  $('slope').hidden = !is(dx);
  if (is(dx)) {
    const degrees = DEG * Math.asin(Math.min(Math.hypot(dx, dy), 1));
    $('slope').querySelector('svg').style.transform = `rotate(${DEG * Math.atan2(-dy, dx) - 90}deg)`;
    $('slope').querySelector('svg').style.visibility = degrees < 0.5 ? 'hidden' : '';
    $('slope').querySelector('span').textContent = `downhill ${degrees.toFixed(0)}°`;
  }
  map.setAttribute('aria-label', here
    ? `Map of path and vehicle, which is at x ${get(frame, 'x').toFixed(1)} m, y ${get(frame, 'y').toFixed(1)} m`
    : 'Map of path and vehicle');
}

function drawVehicle(pen, frame, X, Y, s, { colour }) {
  const [x, y, heading] = [get(frame, 'x'), get(frame, 'y'), get(frame, 'heading')];
  const drawEllipse = () => {
    if (!is(get(frame, 'ellipse_x'))) return;
    pen.strokeStyle = colours['--green'];
    pen.lineWidth = 2.5;
    pen.setLineDash([1, 5]);
    pen.beginPath();
    pen.ellipse(X(get(frame, 'ellipse_x')), Y(get(frame, 'ellipse_y')), s * get(frame, 'ellipse_along'), s * get(frame, 'ellipse_across'), -get(frame, 'ellipse_heading'), 0, 2 * Math.PI);
    pen.stroke();
    pen.setLineDash([]);
  };
  const { body: [length, width], wheels } = parts.vehicle || { body: [0.6, 0.4], wheels: [] };
  pen.save();
  pen.translate(X(x), Y(y));
  pen.rotate(-heading);
  pen.scale(1, -1);
  // Forward is x, left is y. Of several vehicles what is below is seen.
  pen.fillStyle = colours['--ink'];
  pen.globalAlpha = runs.length > 1 ? 0.5 : 1;
  for (const [wx, wy, diameter, broad] of wheels)
    pen.fillRect(s * (wx - diameter / 2), s * (wy - broad / 2), s * diameter, s * broad);
  pen.fillStyle = colours['--panel'];
  pen.globalAlpha = 0.7;
  pen.fillRect(-s * length / 2, -s * width / 2, s * length, s * width);
  pen.fillStyle = colours[colour];
  pen.globalAlpha = 0.25;
  pen.fillRect(-s * length / 2, -s * width / 2, s * length, s * width);
  pen.globalAlpha = 1;
  pen.strokeStyle = colours['--ink'];
  pen.lineWidth = 2;
  pen.strokeRect(-s * length / 2, -s * width / 2, s * length, s * width);
  pen.fillStyle = colours['--ink'];
  pen.beginPath();
  const nose = s * length / 2, broad = Math.max(0.3 * s * width, 4);
  pen.moveTo(nose, 0); pen.lineTo(nose - 1.3 * broad, broad); pen.lineTo(nose - 1.3 * broad, -broad);
  pen.fill();

  if (is(get(frame, 'icr_x'))) {
    pen.fillStyle = colours['--orange'];
    for (const name of ['icr_left', 'icr_right']) {
      const [ix, iy] = [s * get(frame, 'icr_x'), s * get(frame, name)];
      pen.beginPath();
      pen.arc(ix, iy, 5, 0, 2 * Math.PI);
      pen.fill();
    }
  }
  const [tx, ty] = [10 * s * get(frame, 'slide_x'), 10 * s * get(frame, 'slide_y')];
  const far = Math.hypot(tx, ty);
  if (far > 3) {
    const [ux, uy] = [tx / far, ty / far], tip = Math.min(9, far);
    pen.strokeStyle = pen.fillStyle = colours['--violet'];
    pen.lineWidth = 3;
    pen.beginPath();
    pen.moveTo(0, 0); pen.lineTo(tx, ty);
    pen.stroke();
    pen.beginPath();
    pen.moveTo(tx + 3 * ux, ty + 3 * uy);
    pen.lineTo(tx - tip * ux - 0.6 * tip * uy, ty - tip * uy + 0.6 * tip * ux);
    pen.lineTo(tx - tip * ux + 0.6 * tip * uy, ty - tip * uy - 0.6 * tip * ux);
    pen.fill();
  }
  pen.restore();
  drawEllipse();
  // A vehicle that is small on the map is still found.
  if (s * length < 16) {
    pen.strokeStyle = colours['--ink'];
    pen.lineWidth = 2;
    pen.beginPath();
    pen.arc(X(x), Y(y), 13, 0, 2 * Math.PI);
    pen.stroke();
  }
}
