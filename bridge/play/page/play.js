// A hillside to play on: the simulation of `sidehill simulate`, one rover for each controller.

$('brand').textContent = 'Sidehill: a hillside to play on';
$('state').textContent = 'Loading the simulation';
$('hint').textContent = 'Drag a rover aside, or press Draw and draw a path with finger or mouse.';
$('hint').hidden = false;
$('tools').prepend(make('button', { id: 'draw', ariaPressed: 'false', textContent: 'Draw' }));
for (const [kind, text] of [['path', 'path'], ['plan', 'plan'], ['slide', 'slide, 10 s'], ['believed', 'believed position']]) showKey(kind, text);

$('words').querySelector('dl').append(make('dt', { textContent: 'Late, weak drives' }), make('dd', {
  textContent: 'commands act 0.35 s late and slowly, or the motors reach only 0.4 m/s ahead and 0.25 m/s of steer; the controllers are not told',
}));

/** How rovers are drawn, in the order of their controllers. */
const STYLES = [
  { colour: '--blue', dash: [] },
  { colour: '--orange', dash: [10, 5] },
  { colour: '--green', dash: [10, 4, 2, 4] },
];
/** Frames of a run that are kept at most, about. */
const FRAMES = 3000;
/** Longest time that a picture may take for the simulation, ms. */
const BUDGET_MS = 16;
/** Distance of the points of a path that is drawn, m. */
const DRAWN_M = 0.15;
const SHORTEST_M = 1.5;

const DEFAULTS = {
  vehicle: 'j8', course: 'figure_eight', speed_m_s: 0.5, terrain: 'plane', slope_deg: 12, uphill_deg: 0, friction: 0.7,
  patches: false, sensors: 'realistic', drives: 'realistic', controllers: ['contact-mpc', 'pure-pursuit'], seed: 1, path: [],
};

let simulation = null, choices = null, hillside = null;
let setup = { ...DEFAULTS };
/** Text of a scenario file that was opened; it holds until something is chosen. */
let opened = null;
/** Scenario that is driven, as YAML, and what is wrong with it. */
let scenario = '', fault = '', facts = null;
let time = 0, playing = true, moved = false;
const form = $('setup');

// --- Set-up: form, link and scenario ---

/** Returns a value of a link for a field of the form; nothing where the field cannot have it. */
function ofField(key, text) {
  const field = form.elements[key], fallback = DEFAULTS[key];
  if (key === 'controllers') {
    const names = text.split(',').filter(name => choices.controllers.includes(name));
    return names.length ? names.slice(0, STYLES.length) : undefined;
  }
  if (key === 'path') {
    const numbers = text.split(',').map(Number).filter(Number.isFinite);
    return numbers.slice(0, numbers.length - numbers.length % 2);
  }
  if (typeof fallback === 'boolean') return text === '1';
  if (typeof fallback === 'number') {
    const number = Number(text);
    if (!Number.isFinite(number)) return undefined;
    return field ? Math.min(Math.max(number, Number(field.min)), Number(field.max)) : Math.max(0, Math.round(number));
  }
  return [...(field.options || field)].some(({ value }) => value === text) ? text : undefined;
}

/** Returns the set-up of a link; what it does not hold stays at its default. */
function ofLink(hash) {
  const held = new URLSearchParams(hash.replace(/^#/, ''));
  const read = { ...DEFAULTS };
  for (const key of Object.keys(DEFAULTS)) {
    const value = held.has(key) ? ofField(key, held.get(key)) : undefined;
    if (value !== undefined) read[key] = value;
  }
  read.speed_m_s = Math.min(read.speed_m_s, vehicleOf(read).speed_max_m_s);
  if (read.course === 'drawn' && read.path.length < 4) read.course = DEFAULTS.course;
  return read;
}
const vehicleOf = ({ vehicle }) => choices.vehicles.find(({ id }) => id === vehicle);

/** Returns the link's part that holds the set-up: what differs from the defaults. */
function toLink() {
  const held = new URLSearchParams();
  for (const [key, value] of Object.entries(setup)) {
    if (String(value) === String(DEFAULTS[key]) || (key === 'path' && setup.course !== 'drawn')) continue;
    held.set(key, key === 'path' ? value.map(x => x.toFixed(2)).join(',') : typeof value === 'boolean' ? Number(value) : value);
  }
  return `#${decodeURIComponent(held.toString())}`;
}

const UPHILL = ['up the map', 'up and left', 'left', 'down and left', 'down the map', 'down and right', 'right', 'up and right'];
/** Shows the set-up in the form. */
function fillForm() {
  const vehicle = vehicleOf(setup);
  form.elements.speed_m_s.max = vehicle.speed_max_m_s;
  for (const [key, value] of Object.entries(setup)) {
    const field = form.elements[key];
    if (!field) continue;
    if (field.type === 'checkbox') field.checked = value;
    else field.value = value;
  }
  for (const box of form.querySelectorAll('[name=controllers]')) {
    box.checked = setup.controllers.includes(box.value);
    box.disabled = !box.checked && setup.controllers.length === STYLES.length;
  }
  form.elements.course.querySelector('[value=drawn]').disabled = !setup.path.length;
  const slips = vehicle.has_wheels;
  form.elements.friction.disabled = form.elements.patches.disabled = !slips;
  for (const input of form.querySelectorAll('input[type=range]')) {
    const value = Number(input.value);
    let text = `${value.toFixed(input.dataset.digits)} ${input.dataset.unit}`.replace(' °', '°');
    if (input.dataset.words) text = UPHILL[Math.round((value + 360) / 45) % 8];
    if (input.name === 'friction' && !slips) text = 'not modelled';
    input.previousElementSibling.textContent = text;
    input.setAttribute('aria-valuetext', text);
  }
}

function readForm() {
  const next = { ...setup };
  for (const [key, value] of Object.entries(DEFAULTS)) {
    const field = form.elements[key];
    if (!field || key === 'controllers') continue;
    next[key] = field.type === 'checkbox' ? field.checked : typeof value === 'number' ? Number(field.value) : field.value;
  }
  const boxes = [...form.querySelectorAll('[name=controllers]:checked')];
  next.controllers = boxes.map(box => box.value);
  if (next.vehicle !== setup.vehicle) {
    next.speed_m_s = Math.min(next.speed_m_s, vehicleOf(next).speed_max_m_s);
    if (next.course === 'drawn') next.course = DEFAULTS.course;
  }
  return next;
}

let change = null;
form.addEventListener('submit', event => event.preventDefault());
form.addEventListener('input', event => {
  const next = readForm();
  if (!next.controllers.length) {
    event.target.checked = true;
    return;
  }
  opened = null;
  setup = next;
  fillForm();
  // A slider that moves changes the hillside once it rests.
  clearTimeout(change);
  change = setTimeout(choose, event.target.type === 'range' ? 200 : 0);
});

/** Takes over the set-up: link, scenario and a new drive. */
function choose() {
  history.replaceState(null, '', toLink() === '#' ? location.pathname + location.search : toLink());
  fillForm();
  driveScenario(() => simulation.scenario(JSON.stringify(setup)));
}

/** Builds the hillside of a scenario, or says what is wrong with it. */
function driveScenario(text) {
  leave();
  fault = '';
  try {
    scenario = text();
    hillside = new simulation.Hillside(scenario);
    facts = JSON.parse(hillside.facts());
    parts.path = facts.path;
    parts.vehicle = facts.vehicle;
    ground = { heights: (...at) => hillside.ground(...at), slippery: (...at) => hillside.slippery(...at) };
    begin();
  } catch (error) {
    leave();
    fault = (error.message || String(error)).replaceAll('config/scenarios/', '');
    parts.path = [];
    showRovers();
  }
  picture = null;
  setMode('whole');
}

function leave() {
  for (const run of runs) run.rover.free();
  runs.length = 0;
  if (hillside) hillside.free();
  hillside = ground = null;
}

/** Starts again on the same hillside. */
function begin() {
  for (const run of runs) run.rover.free();
  runs.length = 0;
  time = 0;
  cursor = null;
  moved = false;
  playing = true;
  hillside.controllers().slice(0, STYLES.length).forEach((name, i) => {
    const run = {
      ...STYLES[i], planColour: STYLES[i].colour, planDash: [1, 6], name, frames: [], plan: [], rover: hillside.rover(name), held: null, figures: null,
    };
    runs.push(run);
    advanceRun(run);
    run.figures = JSON.parse(run.rover.figures());
  });
  STRIPS.forEach(showKeys);
  showRovers();
}

// --- The drive ---

/** Drives a run by one cycle. */
function advanceRun(run) {
  if (run.held) {
    try { run.rover.put(...run.held); } catch { run.held = null; }
  }
  const frame = run.rover.step();
  if (!frame) return;
  const { frames } = run;
  const apart = facts.duration_s / FRAMES;
  // The newest is always kept, those before it at a distance.
  if (frames.length > 1 && frame[0] - frames[frames.length - 2][0] < apart) frames[frames.length - 1] = frame;
  else frames.push(frame);
  run.plan = run.rover.plan();
}

const drives = () => runs.filter(run => !run.rover.ended());
let before = 0, told_ms = 0, plotted_ms = 0;

function tick(now) {
  requestAnimationFrame(tick);
  try {
    drive(now);
  } catch (error) {
    // After a panic the simulation cannot be used again.
    runs.length = 0;
    hillside = ground = null;
    fault = `The simulation has failed: ${error.message || error}. Load the page again.`;
    draw();
  }
}

function drive(now) {
  const passed_s = Math.min((now - before) / 1000, 0.1);
  before = now;
  if (!hillside || document.hidden) return;
  if (playing && drives().length) {
    time += passed_s * Number($('pace').value);
    const until = performance.now() + BUDGET_MS;
    for (;;) {
      // The one that is farthest behind.
      const late = drives().filter(run => last(run.frames)[0] + facts.period_s <= time);
      if (!late.length) break;
      const run = late.reduce((a, b) => last(b.frames)[0] < last(a.frames)[0] ? b : a);
      if (performance.now() > until) {
        // Slower than asked for.
        time = last(run.frames)[0] + facts.period_s;
        break;
      }
      advanceRun(run);
      draw();
    }
  }
  if (now - told_ms > 250) {
    told_ms = now;
    for (const run of runs) {
      if (run.done) continue;
      run.done = run.rover.ended();
      run.figures = JSON.parse(run.rover.figures());
    }
    showFigures();
    draw();
  }
}

// --- Map: ground, drawing and dragging ---

let drawing = null;
drawAbove = (pen, X, Y) => {
  for (const run of runs) {
    const frame = shown(run.frames), [x, y] = [get(frame, 'estimate_x'), get(frame, 'estimate_y')];
    if (!is(x)) continue;
    pen.strokeStyle = colours[run.colour];
    pen.lineWidth = 2;
    pen.beginPath();
    pen.moveTo(X(x) - 7, Y(y)); pen.lineTo(X(x) + 7, Y(y));
    pen.moveTo(X(x), Y(y) - 7); pen.lineTo(X(x), Y(y) + 7);
    pen.stroke();
  }
  if (!drawing) return;
  pen.strokeStyle = colours['--ink'];
  pen.lineWidth = 5;
  pen.beginPath();
  for (let i = 0; i < drawing.length; i += 2) pen[i ? 'lineTo' : 'moveTo'](X(drawing[i]), Y(drawing[i + 1]));
  pen.stroke();
};

const isDrawn = () => $('draw').getAttribute('aria-pressed') === 'true';
function setDrawn(on) {
  $('draw').setAttribute('aria-pressed', on);
  map.toggleAttribute('data-draws', on);
  hint(on ? 'Draw a path: the rovers begin where you begin.' : '');
}
$('draw').onclick = () => {
  setDrawn(!isDrawn());
  if (isDrawn()) setMode('free');
};
const HINT = $('hint').textContent;
function hint(text) {
  $('hint').textContent = text || HINT;
}

touched = (place, reach) => {
  if (!hillside && !isDrawn()) return null;
  return isDrawn() ? drawPath(place) : dragRover(place, reach);
};

function drawPath(from) {
  drawing = [...from];
  const apart = DRAWN_M * (parts.vehicle ? Math.min(1, parts.vehicle.body[0] / 2) : 1);
  let length = 0;
  return {
    move([x, y]) {
      const far = Math.hypot(x - drawing[drawing.length - 2], y - drawing[drawing.length - 1]);
      if (far < apart) return;
      length += far;
      drawing.push(x, y);
      draw();
    },
    end() {
      const path = drawing.map(x => Number(x.toFixed(2)));
      drawing = null;
      if (length < SHORTEST_M) {
        hint(`This is ${length.toFixed(1)} m: draw at least ${SHORTEST_M} m.`);
        draw();
        return;
      }
      setDrawn(false);
      opened = null;
      setup = { ...setup, course: 'drawn', path };
      choose();
    },
  };
}

function dragRover(place, reach) {
  if (cursor !== null) return null;
  const far = run => Math.hypot(get(last(run.frames), 'x') - place[0], get(last(run.frames), 'y') - place[1]);
  const near = drives().sort((a, b) => far(a) - far(b))[0];
  if (!near || far(near) > Math.max(reach, parts.vehicle.body[0] / 2)) return null;
  const frame = last(near.frames);
  const aside = [get(frame, 'x') - place[0], get(frame, 'y') - place[1]];
  const hold = ([x, y]) => {
    near.held = [x + aside[0], y + aside[1]];
    moved = near.moved = true;
    if (!playing) advanceRun(near);
    draw();
  };
  return {
    move: hold,
    end() { near.held = null; },
  };
}

// --- Figures ---

const STRIPS = [
  CROSS_TRACK,
  {
    name: 'Slide', unit: 'cm/s', least: 2, zero: true,
    of: f => is(get(f, 'slide_x')) ? 100 * Math.hypot(get(f, 'slide_x'), get(f, 'slide_y')) : null,
    value: ([v]) => [is(v) && v < 0.05 ? '0' : digits(v), 'cm/s'],
  },
  GRIP,
  { ...TIP_OVER, name: 'Tip-over margin: 0 tips over', value: ([m]) => [digits(m), ''] },
  {
    name: 'Speed', unit: 'm/s', least: 0.2, zero: true,
    of: f => get(f, 'traction'),
    value: ([v]) => [is(v) ? fixed(v, 2) : '–', 'm/s'],
  },
  {
    name: 'Steer', unit: 'm/s', least: 0.1, zero: true,
    of: f => get(f, 'steer'),
    value: ([v]) => side(v, 'm/s', 'right', 'left', 0.005),
  },
];
STRIPS.forEach(addStrip);

function timeAxis() {
  return [0, Math.max(newest()[0], 20)];
}

/** Lists the controllers: the legend of the whole page. */
function showRovers() {
  $('rovers').replaceChildren(...runs.map(run => {
    run.error = make('b', { textContent: '–' });
    return make('li', {}, swatch(run), run.name, run.error);
  }));
  $('figures').querySelector('tbody').replaceChildren(...runs.map(run => {
    run.cells = [0, 1, 2].map(() => make('td'));
    run.words = make('small');
    run.row = make('tr', {}, make('td', {}, make('span', { className: 'name' }, swatch(run), run.name), run.words), ...run.cells);
    return run.row;
  }));
  showFigures();
}

/** Returns a length of some centimetres as text: a figure that is read while it changes. */
const centimetres = value => is(value) ? fixed(value, Math.abs(value) < 9.95 ? 1 : 0) : '–';

const SENSING = { perfect: 'Perfect sensors', realistic: 'Realistic sensors' };
function showFigures() {
  const sensing = opened !== null || !SENSING[setup.sensors] ? '' : `${SENSING[setup.sensors]}, ${setup.drives} drives. `;
  $('sensing').textContent = `${sensing}Cross-track errors from 2 s on.`;
  for (const run of runs) {
    const { figures: f } = run;
    if (!f) continue;
    run.row.dataset.figures = run.done ? JSON.stringify(f) : '';
    const values = [100 * f.cross_track_rms_m, 100 * f.cross_track_max_m, f.steer_total_variation_m_s];
    values.forEach((value, i) => { run.cells[i].textContent = f.time_s > 2 ? digits(value) : '–'; });
    const now = run.done
      ? f.completed ? `finished in ${f.time_s.toFixed(0)} s` : `stopped: ${f.ended_by}`
      : run.rover.state() === 'tracking' ? 'drives' : [run.rover.state(), run.rover.reason()].filter(Boolean).join(': ');
    run.words.textContent = run.moved ? `${now}; moved by hand` : now;
  }
  const notes = facts && hillside ? [...facts.warnings] : [];
  if (moved) notes.push('A rover was moved by hand: these are not the figures of simulate.');
  $('note').textContent = notes.join('. ');
}

/** Returns kind, name and reason of the state. */
function stateNow() {
  if (fault) return ['stopped', 'Cannot be driven', fault];
  if (!runs.length) return ['waits', 'Loading the simulation', ''];
  const vehicle = vehicleOf(setup);
  const what = opened !== null ? `Scenario ${facts.name}` : vehicle.name;
  const on = opened !== null ? '' : `, ${setup.slope_deg}° slope${vehicle.has_wheels ? `, friction ${setup.friction.toFixed(2)}` : ''}`;
  const left = drives().length;
  const failed = runs.filter(run => run.done && !run.figures.completed);
  if (!left && failed.length) return ['warns', `${failed.map(run => run.name).join(' and ')} did not arrive`, what + on];
  if (!left) return ['done', 'Arrived', what + on];
  if (!playing) return ['waits', 'Paused', what + on];
  return ['drives', 'Driving', what + on];
}

function showState() {
  tell(...stateNow(), '');
  const over = !drives().length;
  const pauses = playing && !over;
  $('run').textContent = pauses ? '❚❚' : '▶';
  $('run').setAttribute('aria-label', pauses ? 'Pause' : 'Drive');
}

/** Time between two pictures of the plots while they only grow, ms. */
const PLOT_MS = 100;

function show() {
  showState();
  drawMap();
  if (!newest()) return;
  showTime();
  showPast();
  const now = performance.now();
  if (drives().length && playing && cursor === null && now - plotted_ms < PLOT_MS) return;
  plotted_ms = now;
  for (const run of runs) {
    const error = get(shown(run.frames), 'cross_track');
    run.error.textContent = `${centimetres(is(error) ? 100 * Math.abs(error) : null)} cm`;
  }
  const axis = timeAxis();
  for (const strip of STRIPS) drawStrip(strip, axis);
}

// --- Buttons ---

$('run').onclick = () => {
  if (!drives().length) { if (hillside) begin(); } else playing = !playing;
  if (playing) cursor = null;
  draw();
};
$('again').onclick = () => { if (hillside) begin(); draw(); };
$('time').oninput = event => {
  const value = Number(event.target.value), over = !drives().length;
  playing = false;
  seek(!over && newest() && value >= newest()[0] - 0.05 ? null : value);
};
$('copy').onclick = async () => {
  const link = location.href;
  try {
    await navigator.clipboard.writeText(link);
    $('shared').textContent = 'The link is copied.';
  } catch {
    $('shared').textContent = link;
  }
  if (opened !== null) $('shared').textContent = 'This scenario was opened from a file, which a link does not hold: share the file.';
};
$('save').onclick = () => {
  const name = 'hillside.yaml';
  const url = URL.createObjectURL(new Blob([scenario], { type: 'application/yaml' }));
  make('a', { href: url, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(url), 10000);
  $('shared').textContent = `Saved as ${name}. Drive it: sidehill simulate ${name}`;
};
$('open').onchange = async event => {
  const [file] = event.target.files;
  event.target.value = '';
  if (!file) return;
  const text = await file.text();
  opened = text;
  driveScenario(() => text);
};
addEventListener('hashchange', () => {
  if (!simulation) return;
  opened = null;
  setup = ofLink(location.hash);
  choose();
});

// --- Begin ---

async function load() {
  const packed = Uint8Array.from(atob($('simulation').textContent), letter => letter.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream('gzip'));
  const code = await new Response(stream).arrayBuffer();
  await wasm_bindgen({ module_or_path: code });
  simulation = wasm_bindgen;
  choices = JSON.parse(simulation.choices());
  column = Object.fromEntries(choices.columns.map((name, i) => [name, i]));
  form.elements.vehicle.replaceChildren(...choices.vehicles.map(({ id, name }) => make('option', { value: id, textContent: name })));
  $('controllers').querySelector('.choice').replaceChildren(...choices.controllers.map(name =>
    make('label', {}, make('input', { type: 'checkbox', name: 'controllers', value: name }), make('span', { textContent: name }))));
  setup = ofLink(location.hash);
  choose();
  requestAnimationFrame(tick);
}
load().catch(error => {
  fault = `The simulation does not start in this browser: ${error.message || error}`;
  draw();
});
