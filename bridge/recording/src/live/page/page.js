// The live view: shows what the server sends. Nothing is ever sent to it: the page cannot command the vehicle.

const KEPT_S = 600, LOST_MS = 6000;

// --- What is known ---

let run = '', have = '', states = [];
let frames = [];
let opened = performance.now(), heard = 0, moved = 0, behind = 0, offset = Infinity;

runs.push({
  colour: '--blue',
  planColour: '--orange',
  planDash: [7, 5],
  get frames() { return frames; },
  get plan() { return parts.plan || []; },
});

function forget() {
  frames = [];
  events = [];
  obstacles = [];
  parts = {};
  ground = null;
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
  const more = message.parts || {};
  Object.assign(parts, more);
  // Those from before this page was opened are not known.
  if (more.obstacles) obstacles = [...obstacles, more.obstacles].slice(-KEPT_S);
  if (more.diagnostics) showDiagnostics();
  if (more.ground) takeGround();
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

$('time').oninput = event => {
  const value = Number(event.target.value);
  seek(newest() && value >= newest()[0] - 0.3 ? null : value);
};
$('span').onchange = () => { windowEnd = null; draw(); };

/** Shortest time axis, of a drive that has just begun, s. */
const SHORTEST_S = 15;
let windowEnd = null;

/** Returns the ends of the time axis: it moves only as far as the time shown asks for. */
function timeAxis() {
  const span = Number($('span').value), last = newest()[0];
  if (cursor === null) windowEnd = last;
  else {
    if (windowEnd === null) windowEnd = last;
    windowEnd = Math.min(Math.max(windowEnd, cursor), cursor + span);
  }
  return [Math.max(windowEnd - span, Math.min(oldest(), windowEnd - SHORTEST_S)), windowEnd];
}

// --- State ---

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
  return `${fixed(speed, 2)} m/s${less}`;
}

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
  document.body.classList.toggle('lost', kind === 'lost');
  tell(kind, name, capital(reason), link);
}

// --- All of it ---

$('link').textContent = 'connecting';
STRIPS.forEach(addStrip);

function show() {
  showState();
  if (!newest()) return;
  drawMap();
  const axis = timeAxis();
  for (const strip of STRIPS) drawStrip(strip, axis);
  showTime();
  showPast();
  const frame = shown(frames), place = onEarth(get(frame, 'x'), get(frame, 'y'));
  $('hint').textContent = place && `vehicle at ${place}`;
  $('hint').hidden = !place;
}
connect();
