'use strict';
// Shows what the server sends. Nothing is ever sent to it: the page cannot command the vehicle.

const KEPT_S = 600, LOST_MS = 6000, GAP_S = 3;
const DEG = 180 / Math.PI;
const $ = id => document.getElementById(id);
const make = (tag, props = {}, ...children) => {
  const node = Object.assign(document.createElement(tag), props);
  node.append(...children);
  return node;
};

// --- What is known ---

let run = '', have = '', states = [], column = {};
let frames = [], events = [], parts = {};
let opened = performance.now(), heard = 0, moved = 0, behind = 0, offset = Infinity;

const get = (frame, name) => frame ? frame[column[name]] : null;
const is = value => value !== null && value !== undefined;
const newest = () => frames[frames.length - 1];

function forget() {
  frames = [];
  events = [];
  parts = {};
  offset = Infinity;
  cursor = null;
}

/** Puts frames into the order of time, each once. */
function merge(more) {
  const last = newest();
  if (!last || more.every(frame => frame[0] > last[0])) frames.push(...more);
  else {
    const all = frames.concat(more).sort((a, b) => a[0] - b[0]);
    frames = all.filter((frame, i) => i === 0 || frame[0] > all[i - 1][0]);
  }
  const from = newest()[0] - KEPT_S;
  let drop = 0;
  while (frames[drop][0] < from) drop++;
  frames.splice(0, drop);
}

function take(message) {
  heard = performance.now();
  if (message.hello) {
    if (message.hello.run !== run) forget();
    ({ run, states } = message.hello);
    column = Object.fromEntries(message.hello.columns.map((name, i) => [name, i]));
  }
  if (message.frames && message.frames.length) {
    merge(message.frames);
    moved = heard;
    const late = heard / 1000 - newest()[0];
    offset = Math.min(offset, late);
    behind = late - offset;
  }
  if (message.earlier && message.earlier.length) merge(message.earlier);
  if (message.events) {
    events.push(...message.events);
    events.splice(0, events.length - 200);
    showEvents();
  }
  if (message.parts) Object.assign(parts, message.parts);
  if (message.parts && message.parts.diagnostics) showDiagnostics();
  if (message.have) have = message.have;
  draw();
}

// --- The connection ---

let socket = null, pause = 500;

function connect() {
  const query = new URLSearchParams(location.search);
  if (have) query.set('since', have);
  const scheme = location.protocol === 'https:' ? 'wss' : 'ws';
  opened = performance.now();
  const mine = socket = new WebSocket(`${scheme}://${location.host}/?${query}`, 'sidehill.page.v1');
  mine.onmessage = event => {
    if (mine !== socket) return;
    pause = 500;
    take(JSON.parse(event.data));
  };
  mine.onclose = () => {
    if (mine !== socket) return;
    socket = null;
    setTimeout(() => socket || connect(), pause);
    pause = Math.min(2 * pause, 4000);
    showState();
  };
}

/** Gives up a connection that is silent, and tells how old everything is. */
function watch() {
  const now = performance.now();
  if (socket && now - Math.max(heard, opened) > LOST_MS) {
    const silent = socket;
    socket = null;
    silent.close();
    connect();
  }
  showState();
}
setInterval(watch, 250);
for (const name of ['online', 'pageshow'])
  addEventListener(name, () => socket || connect());
document.addEventListener('visibilitychange', () => {
  if (document.hidden) return;
  socket || connect();
  draw();
});

// --- Time: null shows the present ---

let cursor = null;

function indexAt(time) {
  let low = 0, high = frames.length;
  while (low < high) {
    const mid = (low + high) >> 1;
    if (frames[mid][0] < time) low = mid + 1; else high = mid;
  }
  if (low === frames.length || (low > 0 && time - frames[low - 1][0] < frames[low][0] - time)) low--;
  return low;
}
const shownIndex = () => cursor === null ? frames.length - 1 : indexAt(cursor);

function clock(time, seconds = true) {
  if (time < 1e9) {
    const rounded = Math.round(time * 10) / 10;
    return `${rounded < 60 || !seconds ? rounded : rounded.toFixed(0)} s`;
  }
  return new Date(1000 * time).toLocaleTimeString([], { hour12: false, hour: '2-digit', minute: '2-digit', second: '2-digit' });
}

function seek(time) {
  cursor = time;
  if (newest() && time !== null) {
    const [low, high] = [frames[0][0], newest()[0]];
    cursor = Math.min(Math.max(time, low), high);
  }
  draw();
}
$('live').onclick = () => seek(null);
$('time').oninput = event => {
  const value = Number(event.target.value);
  seek(newest() && value >= newest()[0] - 0.3 ? null : value);
};
$('span').onchange = () => { windowEnd = null; draw(); };

let windowEnd = null;

/** Returns the ends of the time axis: it moves only as far as the time shown asks for. */
function timeAxis() {
  const span = Number($('span').value), last = newest()[0];
  if (cursor === null) windowEnd = last;
  else {
    if (windowEnd === null) windowEnd = last;
    windowEnd = Math.min(Math.max(windowEnd, cursor), cursor + span);
  }
  return [windowEnd - span, windowEnd];
}

// --- State ---

const KINDS = { drives: '▶', done: '✓', warns: '▲', stopped: '■', waits: '●', lost: '⚠' };

/** Returns kind, name and reason of the state. */
function stateNow() {
  const { state, controller = '', reason = '', waits_for = '' } = parts.status || {};
  const status = controller || '';
  const why = /^stopping: /.test(status) ? status.slice(10) : '';
  const waits = waits_for.replace(/(^|; )waits for /g, (_, separator) => separator && '; ');
  const wanted = waits ? `Waits for ${waits}` : '';
  const finished = status === 'finished' || /followed to its end/.test(reason);
  switch (state) {
    case 'driving':
      if (/^fallback/.test(status)) return ['warns', 'Drives on its last plan', status.replace(/^.*?: /, '')];
      return waits ? ['warns', 'Driving', wanted] : ['drives', 'Driving', speedText()];
    case 'zeroing': case 'enabling': return ['warns', 'Arming', ''];
    case 'stopping': return finished ? ['done', 'Arriving', reason] : ['warns', 'Stopping', reason];
    case 'latched': return finished ? ['done', 'Finished', wanted || reason] : ['stopped', 'Stopped', [reason, wanted].filter(Boolean).join('. ')];
    case 'disarmed': return ['waits', 'Not armed', wanted || (/no path/.test(status) ? 'Waits for a path' : 'Ready to be armed')];
  }
  if (status === 'tracking') return ['drives', 'Driving', speedText()];
  if (finished) return ['done', 'Finished', ''];
  if (why) return ['stopped', 'Stopped', why];
  if (/^fallback/.test(status)) return ['warns', 'Drives on its last plan', status.replace(/^.*?: /, '')];
  if (status) return ['waits', 'Waiting', status];
  const speed = get(newest(), 'traction');
  return is(speed) ? ['waits', Math.abs(speed) < 0.005 ? 'Standing' : 'Moving', speedText()] : ['waits', 'Waiting', 'no data yet'];
}

function speedText() {
  const frame = newest(), speed = get(frame, 'traction'), share = get(frame, 'speed_share');
  if (!is(speed)) return '';
  const less = is(share) && share < 0.995 ? `, slowed to ${(100 * share).toFixed(0)} % by the ground ahead` : '';
  return `${speed.toFixed(2)} m/s${less}`;
}

let told = '';
function showState() {
  const now = performance.now();
  const seconds = since => {
    const s = Math.floor((now - since) / 1000);
    return s < 120 ? `${s} s` : `${Math.floor(s / 60)} min`;
  };
  const lost = !heard || !socket || socket.readyState !== WebSocket.OPEN || now - heard > LOST_MS / 2;
  let [kind, name, reason] = stateNow();
  let link = 'live';
  if (lost) {
    link = 'reconnecting';
    reason = heard ? `Last state: ${name}${reason ? `, ${reason}` : ''}` : 'The server does not answer yet.';
    name = heard ? `Connection lost ${seconds(heard)} ago` : 'Connecting';
    kind = 'lost';
  } else if (newest() && now - moved > 2500) {
    link = `no new data for ${seconds(moved)}`;
  } else if (behind > 1) {
    link = `${behind.toFixed(0)} s behind`;
  }
  const text = [kind, name, reason, link].join('|');
  if (text === told) return;
  told = text;
  $('head').dataset.kind = kind;
  document.body.classList.toggle('lost', kind === 'lost');
  $('icon').textContent = KINDS[kind];
  $('state').textContent = name;
  $('reason').textContent = reason.charAt(0).toUpperCase() + reason.slice(1);
  $('link').textContent = link;
  document.title = `${name} – Sidehill`;
}

// --- Figures ---

const digits = (value, n = 2) => {
  if (!is(value)) return '–';
  if (Math.abs(value) < 1e-9) return '0';
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
const STRIPS = [
  {
    name: 'Cross-track error', unit: 'cm', least: 2, zero: true,
    lines: [{ of: f => is(get(f, 'cross_track')) ? 100 * get(f, 'cross_track') : null, colour: '--blue' }],
    value: ([e]) => side(e, 'cm', 'right', 'left', 0.05),
  },
  {
    name: 'Speed', unit: 'm/s', least: 0.2, zero: true,
    lines: [
      { name: 'measured', of: f => get(f, 'traction'), colour: '--blue' },
      { name: 'commanded', of: f => get(f, 'traction_command'), colour: '--orange', dash: [6, 4] },
    ],
    value: ([v]) => [is(v) ? v.toFixed(2) : '–', 'm/s'],
  },
  {
    name: 'Steer', unit: 'm/s', least: 0.1, zero: true,
    lines: [
      { name: 'measured', of: f => get(f, 'steer'), colour: '--blue' },
      { name: 'commanded', of: f => get(f, 'steer_command'), colour: '--orange', dash: [6, 4] },
    ],
    value: ([v]) => side(v, 'm/s', 'right', 'left', 0.005),
  },
  {
    name: 'Attitude', least: 5, zero: true,
    lines: [
      { name: 'roll, right side down', of: f => tilt(f, Math.PI / 2), colour: '--blue' },
      { name: 'pitch, nose up', of: f => tilt(f, Math.PI), colour: '--orange', dash: [2, 4] },
    ],
    value: ([r, p]) => is(r) ? [`${signed(r)}° / ${signed(p)}°`, ''] : ['–', ''],
  },
  {
    name: 'Grip used', unit: '%', range: [0, 100], limit: 100,
    lines: [{ of: f => is(get(f, 'friction_use')) ? 100 * get(f, 'friction_use') : null, colour: '--blue' }],
    value: ([g]) => [is(g) ? g.toFixed(0) : '–', '%'],
  },
  {
    name: 'Tip-over margin', unit: '', range: [0, 1], limit: 0,
    lines: [{ of: f => get(f, 'tip_over_margin'), colour: '--blue' }],
    value: ([m]) => [digits(m), '(0 tips over)'],
  },
  {
    name: 'Age of the pose', unit: 's', range: [0, 0.5],
    lines: [{ of: f => get(f, 'pose_age'), colour: '--blue' }],
    value: ([a]) => [digits(a), 's'],
  },
];

for (const strip of STRIPS) {
  strip.canvas = make('canvas');
  strip.canvas.setAttribute('role', 'img');
  strip.text = make('p', { className: 'value' });
  strip.box = make('article', { className: 'strip', hidden: true },
    make('header', {}, make('h2', { textContent: strip.name }), strip.text));
  const named = strip.lines.filter(line => line.name);
  if (named.length) {
    const keys = make('p', { className: 'keys' });
    for (const line of named) {
      const key = make('span');
      key.innerHTML = `<svg viewBox="0 0 26 10" aria-hidden="true"><path d="M0 5h26" fill="none" stroke="var(${line.colour})" stroke-width="3" stroke-dasharray="${line.dash || 'none'}"/></svg>`;
      key.append(line.name);
      keys.append(key);
    }
    strip.box.append(keys);
  }
  strip.box.append(strip.canvas);
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
  for (const name of ['ground', 'panel', 'ink', 'soft', 'line', 'grid', 'path', 'blue', 'orange', 'green', 'violet', 'body'])
    colours[`--${name}`] = style.getPropertyValue(`--${name}`).trim();
}
readColours();
matchMedia('(prefers-color-scheme: dark)').addEventListener('change', () => { readColours(); draw(); });

function drawStrip(strip, [from, to], at) {
  const begin = Math.max(0, indexAt(from) - 1);
  const shown = strip.lines.map(line => line.of(frames[at]));
  if (strip.box.hidden) {
    if (!frames.some(frame => strip.lines.some(line => is(line.of(frame))))) return;
    strip.box.hidden = false;
  }
  const [value, unit] = strip.value(shown);
  strip.text.replaceChildren(value, ' ', make('small', { textContent: unit }));
  strip.canvas.setAttribute('aria-label', `${strip.name} over time, now ${value} ${unit}`);
  const { top, bottom } = strip.canvas.getBoundingClientRect();
  if (bottom < 0 || top > innerHeight) return;

  let [low, high] = strip.range || [-strip.least, strip.least];
  if (!strip.range) [low, high] = [0, 0];
  for (let i = begin; i < frames.length && frames[i][0] <= to; i++)
    for (const line of strip.lines) {
      const y = line.of(frames[i]);
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
  for (const line of strip.lines) {
    pen.strokeStyle = colours[line.colour];
    pen.lineWidth = 2.5;
    pen.setLineDash(line.dash || []);
    pen.beginPath();
    let before = null;
    for (let i = begin; i < frames.length; i++) {
      const [time] = frames[i], value = line.of(frames[i]);
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
    pen.moveTo(x(frames[at][0]), 0);
    pen.lineTo(x(frames[at][0]), height - BOTTOM);
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

const fingers = new Map();
const map = $('map');
map.addEventListener('wheel', event => {
  event.preventDefault();
  zoom(1.0015 ** -event.deltaY, [event.offsetX, event.offsetY]);
}, { passive: false });
map.addEventListener('pointerdown', event => {
  map.setPointerCapture(event.pointerId);
  fingers.set(event.pointerId, [event.offsetX, event.offsetY]);
});
for (const name of ['pointerup', 'pointercancel'])
  map.addEventListener(name, event => fingers.delete(event.pointerId));
map.addEventListener('pointermove', event => {
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
  for (let i = 0; i < frames.length; i += 5)
    if (is(get(frames[i], 'x'))) { xs.push(get(frames[i], 'x')); ys.push(get(frames[i], 'y')); }
  const last = newest();
  if (is(get(last, 'x'))) { xs.push(get(last, 'x')); ys.push(get(last, 'y')); }
  const least = list => list.reduce((a, b) => Math.min(a, b), Infinity);
  const most = list => list.reduce((a, b) => Math.max(a, b), -Infinity);
  return xs.length ? [least(xs), most(xs), least(ys), most(ys)] : [-2, 2, -2, 2];
}

function drawMap(at) {
  const [pen, width, height] = prepare(map);
  const frame = frames[at], here = is(get(frame, 'x'));
  const length = parts.vehicle ? parts.vehicle.body[0] : 0.6;
  if (view.mode === 'whole') {
    const [left, right, low, high] = bounds(), around = 2 * length;
    // The buttons are on the right.
    const room = 60;
    view.scale = Math.min((width - room) / (right - left + around), height / (high - low + around));
    view.x = (left + right) / 2 + room / 2 / view.scale;
    view.y = (low + high) / 2;
  } else if (view.mode === 'follow' && here) {
    view.x = get(frame, 'x');
    view.y = get(frame, 'y');
  }
  const s = view.scale;
  const X = x => width / 2 + (x - view.x) * s, Y = y => height / 2 - (y - view.y) * s;

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

  // What came after the time shown is thin.
  pen.strokeStyle = colours['--blue'];
  for (const [begin, end, thick] of [[at, frames.length - 1, 1], [0, at, 3]]) {
    pen.lineWidth = thick;
    pen.beginPath();
    let before = null;
    for (let i = begin; i <= end; i++) {
      const [time] = frames[i], x = get(frames[i], 'x'), y = get(frames[i], 'y');
      if (!is(x)) { before = null; continue; }
      if (before !== null && time - before < GAP_S) pen.lineTo(X(x), Y(y)); else pen.moveTo(X(x), Y(y));
      before = time;
    }
    pen.stroke();
  }
  const plan = cursor === null ? parts.plan || [] : [];
  stroke(plan, '--orange', 3, [7, 5]);

  if (here) drawVehicle(pen, frame, X, Y, s);

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

function drawVehicle(pen, frame, X, Y, s) {
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
  pen.fillRect(-s * length / 2, -s * width / 2, s * length, s * width);
  pen.fillStyle = colours['--body'];
  pen.strokeStyle = colours['--ink'];
  pen.lineWidth = 2;
  pen.beginPath();
  pen.rect(-s * length / 2, -s * width / 2, s * length, s * width);
  pen.fill();
  pen.stroke();
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

// --- Words ---

function showEvents() {
  const list = $('events').querySelector('ol');
  const top = list.scrollTop;
  list.replaceChildren(...events.slice().reverse().map(([time, level, name, text]) => {
    const button = make('button', {},
      make('time', { textContent: clock(time) }),
      make('span', { textContent: /^(state|start|controller|inputs|waits_for)$/.test(name) ? text : `${name}: ${text}` }));
    button.onclick = () => seek(time);
    return make('li', { className: (level >= 30 && !/it is held/.test(text)) || name === 'waits_for' ? 'warns' : '' }, button);
  }));
  list.scrollTop = top;
}

const words = key => key.replace(/_(m_s|m|s)$/, '').replace(/_/g, ' ');
const unitOf = key => (/_(m_s|m|s)$/.exec(key) || ['', ''])[1].replace('_', '/');
function showDiagnostics() {
  const { values = {} } = parts.diagnostics.controller || {};
  const known = 'drives' in values;
  $('drives').hidden = !known;
  if (known) {
    $('diagnosis').textContent = values.drives ? `${values.drives[0].toUpperCase()}${values.drives.slice(1)}.` : 'The motors reach the commanded speeds.';
    $('diagnosis').className = values.drives ? 'short' : '';
    const figures = [
      ['largest traction', values.traction_reached_m_s, 'm/s'],
      ['largest steer', values.steer_reached_m_s, 'm/s'],
      ['a command acts after', values.drive_delay_s, 's'],
    ];
    $('motors').replaceChildren(...figures.flatMap(([name, value, unit]) =>
      [make('dt', { textContent: name }), make('dd', { textContent: `${digits(Number(value))} ${unit}` })]));
  }
  const learned = Object.entries(values).filter(([key]) => key.startsWith('learned_'));
  $('learned').hidden = !learned.length;
  const rows = [], others = [];
  for (const [key, text] of learned) {
    const name = words(key.slice(8)), unit = unitOf(key);
    const [, value, low, high, prior] = /^(\S+) \((\S+) to ([^,)]+)(.*)\)$/.exec(text) || [null, text, text, text, ''];
    const write = number => digits(Number(number)).replace('-', '\u2212');
    if (prior) others.push(`${name} ${write(value)} ${unit}`.trim());
    else rows.push(make('tr', {}, ...[name, `${write(value)} ${unit}`, `${write(low)} to ${write(high)}`].map(textContent => make('td', { textContent }))));
  }
  $('learned').querySelector('table').hidden = !rows.length;
  $('learned').querySelector('tbody').replaceChildren(...rows);
  $('assumed').textContent = others.length ? `Not learned yet, as configured: ${others.join(', ')}.` : '';
}

// --- All of it ---

let due = false;
function draw() {
  if (due) return;
  due = true;
  requestAnimationFrame(() => {
    due = false;
    showState();
    if (!newest()) return;
    const at = shownIndex(), time = frames[at][0];
    drawMap(at);
    const axis = timeAxis();
    for (const strip of STRIPS) drawStrip(strip, axis, at);
    Object.assign($('time'), { min: frames[0][0], max: newest()[0] });
    $('time').value = time;
    $('live').setAttribute('aria-pressed', cursor === null);
    const ago = newest()[0] - time;
    const long = ago < 100 ? `${ago.toFixed(0)} s` : `${(ago / 60).toFixed(1)} min`;
    $('clock').textContent = clock(time);
    $('past').hidden = cursor === null;
    $('past').textContent = `${long} ago`;
    $('time').setAttribute('aria-valuetext', cursor === null ? 'now' : `${long} ago`);
  });
}
addEventListener('resize', draw);
addEventListener('scroll', draw, { passive: true });
connect();
