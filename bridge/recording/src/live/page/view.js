'use strict';
// What the live view and `sidehill play` share: frames over time, plots of them, and the map.

const GAP_S = 3;
const DEG = 180 / Math.PI;
const $ = id => document.getElementById(id);
const make = (tag, props = {}, ...children) => {
  const node = Object.assign(document.createElement(tag), props);
  node.append(...children);
  return node;
};

// --- Runs: what is shown over time ---

/** What is drawn, one or several: `frames`, `plan` as x, y, x, y ..., `colour`, `dash`, `planColour`, `planDash`, and a
 * `name` where there are several. A frame begins with its time; `column` has the places of the other entries. */
const runs = [];
let column = {};
/** `path` as x, y, x, y ..., and `vehicle` with body and wheels. */
let parts = {};

const get = (frame, name) => frame ? frame[column[name]] : null;
const is = value => value !== null && value !== undefined && !Number.isNaN(value);
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

/** Shows the time on slider and clock. */
function showTime() {
  const time = cursor === null ? newest()[0] : cursor;
  Object.assign($('time'), { min: oldest(), max: newest()[0] });
  $('time').value = time;
  const ago = newest()[0] - time;
  const long = ago < 100 ? `${ago.toFixed(0)} s` : `${(ago / 60).toFixed(1)} min`;
  $('clock').textContent = clock(time);
  $('past').hidden = cursor === null;
  $('past').textContent = `${long} ago`;
  $('time').setAttribute('aria-valuetext', cursor === null ? 'now' : `${long} ago`);
}

let due = false;
/** Whether plots out of sight are drawn as well, as for print. */
let whole = false;
/** Shows all of it, once a picture; `show` is the page's own. */
function draw() {
  if (due) return;
  due = true;
  requestAnimationFrame(() => {
    due = false;
    show();
  });
}
addEventListener('resize', draw);
addEventListener('scroll', draw, { passive: true });

// --- Figures ---

const digits = (value, n = 2) => {
  if (!is(value)) return '–';
  if (Math.abs(value) < 5e-4) return '0';
  const places = Math.max(0, n - 1 - Math.floor(Math.log10(Math.abs(value))));
  return value.toFixed(Math.min(places, 3));
};
const side = (value, unit, negative, positive, floor) => {
  if (!is(value)) return ['–', ''];
  const text = Math.abs(value) < floor ? '0' : digits(Math.abs(value));
  return [text, text === '0' ? unit : `${unit} ${value < 0 ? negative : positive}`];
};
const signed = value => value.toFixed(1).replace('-', '\u2212');

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

const swatch = ({ colour, dash }) => {
  const holder = make('span');
  holder.innerHTML = `<svg viewBox="0 0 26 10" aria-hidden="true"><path d="M0 5h26" fill="none" stroke="var(${colour})" stroke-width="3" stroke-dasharray="${(dash || []).join(' ') || 'none'}"/></svg>`;
  return holder.firstChild;
};

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
 * or `lines` of the only run with `of` each; `value` returns text and unit for the values. */
function addStrip(strip) {
  strip.canvas = make('canvas');
  strip.canvas.setAttribute('role', 'img');
  strip.text = make('p', { className: 'value' });
  strip.keys = make('p', { className: 'keys' });
  strip.box = make('article', { className: 'strip', hidden: true },
    make('header', {}, make('h2', { textContent: strip.name }), strip.text), strip.keys, strip.canvas);
  showKeys(strip);
  $('strips').append(strip.box);
  const pick = event => {
    if (!newest() || (event.type === 'pointermove' && !event.buttons)) return;
    const { left, width } = strip.canvas.getBoundingClientRect();
    const [from, to] = timeAxis();
    seek(from + (to - from) * (event.clientX - left - LEFT) / (width - LEFT - RIGHT));
  };
  strip.canvas.addEventListener('pointerdown', pick);
  strip.canvas.addEventListener('pointermove', pick);
}

const LEFT = 38, RIGHT = 10, TOP = 8, BOTTOM = 20;

/** Returns a step of 1, 2 or 5 times a power of ten that divides a range into about so many parts. */
function step(range, count) {
  const rough = range / count, power = 10 ** Math.floor(Math.log10(rough));
  return power * [1, 2, 5, 10].find(factor => factor * power >= rough - 1e-12);
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

let colours = {};
function readColours() {
  const style = getComputedStyle(document.documentElement);
  for (const name of ['ground', 'panel', 'ink', 'soft', 'line', 'grid', 'path', 'blue', 'orange', 'green', 'violet'])
    colours[`--${name}`] = style.getPropertyValue(`--${name}`).trim();
}
readColours();
matchMedia('(prefers-color-scheme: dark)').addEventListener('change', () => { readColours(); draw(); });

function drawStrip(strip, [from, to]) {
  const lines = linesOf(strip).filter(line => line.frames.length);
  const values = lines.map(line => line.of(shown(line.frames)));
  if (strip.box.hidden) {
    if (!lines.some(line => line.frames.some(frame => is(line.of(frame))))) return;
    strip.box.hidden = false;
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
  strip.canvas.setAttribute('aria-label', `${strip.name} over time, now ${label}`);
  const { top, bottom } = strip.canvas.getBoundingClientRect();
  if (!whole && (bottom < 0 || top > innerHeight)) return;

  let [low, high] = strip.range || [-strip.least, strip.least];
  if (!strip.range) [low, high] = [0, 0];
  for (const { frames, of } of lines)
    for (let i = Math.max(0, indexAt(frames, from) - 1); i < frames.length && frames[i][0] <= to; i++) {
      const y = of(frames[i]);
      if (is(y)) [low, high] = [Math.min(low, y), Math.max(high, y)];
    }
  const size = step(Math.max(high - low, strip.least || 0), 2.5);
  if (!strip.range) {
    // The ends are whole steps, so that the axis is calm.
    const end = value => Math.abs(value) < 1e-9 ? 0 : Math.sign(value) * Math.ceil(Math.abs(value) / size + 0.05) * size;
    [low, high] = [end(low), end(high)];
    if (low === high) high = size;
  }
  const [pen, width, height] = prepare(strip.canvas);
  const x = time => LEFT + (width - LEFT - RIGHT) * (time - from) / (to - from);
  const y = value => TOP + (height - TOP - BOTTOM) * (high - value) / (high - low);

  pen.font = '12px system-ui, sans-serif';
  pen.fillStyle = colours['--soft'];
  pen.lineWidth = 1;
  pen.textAlign = 'right';
  pen.textBaseline = 'middle';
  const places = Math.max(0, -Math.floor(Math.log10(size) + 1e-9));
  for (let value = Math.ceil(low / size - 1e-9) * size; value <= high + 1e-9; value += size) {
    const zero = Math.abs(value) < 1e-9;
    pen.strokeStyle = colours[zero && strip.zero ? '--path' : '--grid'];
    pen.beginPath();
    pen.moveTo(LEFT, y(value));
    pen.lineTo(width - RIGHT, y(value));
    pen.stroke();
    pen.fillText((zero ? 0 : value).toFixed(places).replace('-', '\u2212'), LEFT - 5, y(value));
  }
  if (is(strip.limit)) {
    pen.strokeStyle = colours['--ink'];
    pen.lineWidth = 2;
    pen.beginPath();
    pen.moveTo(LEFT, y(strip.limit));
    pen.lineTo(width - RIGHT, y(strip.limit));
    pen.stroke();
  }
  pen.textBaseline = 'alphabetic';
  const wide = from > 1e9 ? 76 : 60;
  const apart = [5, 10, 15, 20, 30, 60, 120, 180, 300].find(s => (width - LEFT - RIGHT) * s / (to - from) > wide) || 300;
  pen.strokeStyle = colours['--grid'];
  pen.lineWidth = 1;
  for (let time = Math.ceil(from / apart) * apart; time <= to; time += apart) {
    pen.beginPath();
    pen.moveTo(x(time), TOP);
    pen.lineTo(x(time), height - BOTTOM);
    pen.stroke();
    const label = clock(time, false), half = pen.measureText(label).width / 2;
    pen.textAlign = 'center';
    if (time >= 0) pen.fillText(label, Math.min(x(time), width - half - 1), height - 5);
  }

  pen.save();
  pen.beginPath();
  pen.rect(LEFT, 0, width - LEFT - RIGHT + 3, height - BOTTOM + 2);
  pen.clip();
  for (const { frames, of, colour, dash = [] } of lines) {
    pen.strokeStyle = colours[colour];
    pen.lineWidth = 2.5;
    pen.setLineDash(dash);
    pen.beginPath();
    let before = null;
    for (let i = Math.max(0, indexAt(frames, from) - 1); i < frames.length; i++) {
      const [time] = frames[i], value = of(frames[i]);
      if (is(value)) {
        if (before !== null && time - before < GAP_S) pen.lineTo(x(time), y(value));
        else pen.moveTo(x(time), y(value));
        before = time;
      } else before = null;
      if (time > to) break;
    }
    pen.stroke();
  }
  pen.restore();
  if (cursor !== null) {
    pen.strokeStyle = colours['--ink'];
    pen.lineWidth = 2;
    pen.beginPath();
    pen.moveTo(x(cursor), 0);
    pen.lineTo(x(cursor), height - BOTTOM);
    pen.stroke();
  }
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
let drawBelow = (pen, X, Y) => {}, drawAbove = (pen, X, Y) => {};

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

function bounds() {
  const xs = [], ys = [];
  const path = parts.path || [];
  for (let i = 0; i + 1 < path.length; i += 2) { xs.push(path[i]); ys.push(path[i + 1]); }
  for (const { frames } of runs)
    for (let i = 0; i < frames.length; i = i < frames.length - 1 ? Math.min(i + 5, frames.length - 1) : i + 1)
      if (is(get(frames[i], 'x'))) { xs.push(get(frames[i], 'x')); ys.push(get(frames[i], 'y')); }
  const least = list => list.reduce((a, b) => Math.min(a, b), Infinity);
  const most = list => list.reduce((a, b) => Math.max(a, b), -Infinity);
  return xs.length ? [least(xs), most(xs), least(ys), most(ys)] : [-2, 2, -2, 2];
}

/** Draws the map; the vehicle of the first run is the one that it follows. */
function drawMap() {
  const [pen, width, height] = prepare(map);
  const frame = runs.length ? shown(runs[0].frames) : undefined, here = is(get(frame, 'x'));
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
  const size = step(width / s, 6);
  pen.strokeStyle = colours['--grid'];
  pen.lineWidth = 1;
  pen.beginPath();
  for (let x = Math.ceil((view.x - width / 2 / s) / size) * size; X(x) < width; x += size) { pen.moveTo(X(x), 0); pen.lineTo(X(x), height); }
  for (let y = Math.ceil((view.y - height / 2 / s) / size) * size; Y(y) > 0; y += size) { pen.moveTo(0, Y(y)); pen.lineTo(width, Y(y)); }
  pen.stroke();

  const stroke = (points, colour, thick, dash = []) => {
    pen.strokeStyle = colours[colour];
    pen.lineWidth = thick;
    pen.setLineDash(dash);
    pen.beginPath();
    for (let i = 0; i + 1 < points.length; i += 2)
      pen[i ? 'lineTo' : 'moveTo'](X(points[i]), Y(points[i + 1]));
    pen.stroke();
    pen.setLineDash([]);
  };
  pen.globalAlpha = 0.6;
  stroke(parts.path || [], '--path', 8);
  pen.globalAlpha = 1;

  for (const { frames, colour, dash = [] } of runs) {
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
  for (const run of runs) {
    if (cursor === null) stroke(run.plan || [], run.planColour, 3, run.planDash);
    const frame = shown(run.frames);
    if (is(get(frame, 'x'))) drawVehicle(pen, frame, X, Y, s, run);
  }
  drawAbove(pen, X, Y);

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
  // Forward is x, left is y.
  pen.fillStyle = colours['--ink'];
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
      pen.moveTo(ix + 5, iy); pen.lineTo(ix, iy + 5); pen.lineTo(ix - 5, iy); pen.lineTo(ix, iy - 5);
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
