// The report of a recorded drive: everything is in the page.

$('brand').textContent = 'Sidehill report';
$('live').textContent = 'End';
$('span').prepend(make('option', { value: '', textContent: 'all' }));
$('span').value = '';

const facts = JSON.parse($('facts').textContent), drive = JSON.parse($('drive').textContent);
column = Object.fromEntries(drive.columns.map((name, i) => [name, i]));
({ parts, events, obstacles } = drive);
takeGround();
runs.push({ colour: '--blue', frames: drive.frames, plan: [] });

// --- Time ---

/** When the recording began, s. Frames begin later. */
const BEGIN = (place => place ? place.time_s - place.after_s : newest()[0] - facts.duration_s)([...facts.stops, ...facts.worst][0]);

const MOMENT_S = '30';

/** Shows the moment of a place: plots of the time about it, and the map. */
function visit(place, button) {
  for (const other of document.querySelectorAll('[aria-current]')) other.removeAttribute('aria-current');
  if (button) button.setAttribute('aria-current', true);
  $('span').value = MOMENT_S;
  seek(place.time_s);
  // Beside the map there is room for the plots.
  const aim = $(matchMedia('(min-width: 60rem)').matches ? 'strips' : 'place');
  aim.style.scrollMarginTop = `${$('head').offsetHeight + 8}px`;
  aim.scrollIntoView({ block: 'start' });
}

/** Returns the ends of the time axis: all, or a span about the time shown. */
function timeAxis() {
  const first = oldest(), last = newest()[0], span = Number($('span').value);
  if (!span || span >= last - first) return [first, last];
  const middle = cursor === null ? last : cursor;
  const from = Math.min(Math.max(middle - span / 2, first), last - span);
  return [from, from + span];
}

$('time').oninput = event => seek(Number(event.target.value));
$('span').onchange = draw;

onPlace(seek);

// --- Words ---

const after = seconds => seconds < 100 ? `${fixed(seconds, 1)} s` : `${Math.floor(seconds / 60)}:${String(Math.floor(seconds % 60)).padStart(2, '0')} min`;
const centimetres = metres => `${digits(100 * Math.abs(metres))} cm`;
function where(place) {
  if (is(place.latitude_deg)) return `${place.latitude_deg.toFixed(7)}°, ${place.longitude_deg.toFixed(7)}°`;
  return is(place.x_m) ? `x ${fixed(place.x_m, 2)} m, y ${fixed(place.y_m, 2)} m` : 'place not known';
}

/** Lists moments: what it is, and more about it below. */
function list(id, moments, none) {
  const items = moments.map(({ place, text, loud, more }) => {
    const button = make('button', {}, make('time', { textContent: after(place.after_s) }),
      make('span', {}, ...(loud ? [make('b', { textContent: '▲ ' })] : []), text), ...more.filter(Boolean).map(textContent => make('small', { textContent })));
    button.onclick = () => visit(place, button);
    return make('li', {}, button);
  });
  $(id).querySelector('ol').replaceChildren(...items.length ? items : [make('li', { textContent: none })]);
}

const KIND_WORDS = { arrived: 'Arrived', asked: 'Stopped', fault: 'Stopped' };
list('stops', facts.stops.map(stop => ({
  place: stop,
  text: `${KIND_WORDS[stop.kind]}: ${stop.cause}`,
  loud: stop.kind === 'fault',
  more: [where(stop), ...stop.before, is(stop.stood_s) ? `drove on after ${after(stop.stood_s)}` : ''],
})), 'The vehicle was not stopped.');
list('worst', facts.worst.map(worst => ({
  place: worst,
  text: `${centimetres(worst.cross_track_m)} ${worst.cross_track_m < 0 ? 'right' : 'left'} of the path`,
  more: [`${where(worst)}, ${fixed(worst.arc_length_m, 1)} m along it`, `at ${digits(worst.speed_m_s)} m/s, roll ${signed(worst.roll_deg)}°, pitch ${signed(worst.pitch_deg)}°`],
})), 'No path was followed.');

/** Marks worst places and stops on the map: circles, and triangles as in the list. */
drawAbove = (pen, X, Y) => {
  const faults = facts.stops.filter(stop => stop.kind === 'fault');
  for (const [places, corners, far] of [[facts.worst, 24, 13], [faults, 3, 10]])
    for (const { x_m: x, y_m: y } of places) {
      if (!is(x)) continue;
      pen.beginPath();
      for (let i = 0; i < corners; i++) {
        const way = 2 * Math.PI * i / corners;
        pen.lineTo(X(x) + far * Math.sin(way), Y(y) - far * Math.cos(way));
      }
      pen.closePath();
      for (const [colour, thick] of [['--panel', 6], ['--orange', 3]]) {
        pen.strokeStyle = colours[colour];
        pen.lineWidth = thick;
        pen.stroke();
      }
    }
};
showKey('stop', facts.stops.some(stop => stop.kind === 'fault') && 'stopped');
showKey('worst', facts.worst.length && 'worst places');

/** Fills a list of figures. */
function figures(holder, entries) {
  const shown = entries.filter(([, value]) => value !== null);
  holder.append(...shown.flatMap(([name, value]) => [make('dt', { textContent: name }), make('dd', { textContent: value })]));
}
const known = (value, unit) => is(value) ? `${digits(value)} ${unit}`.trim() : null;
const { driven, cross_track: error, guard } = facts;
figures($('driven').querySelector('dl'), [
  ['distance by the treads', `${digits(driven.distance_m, 3)} m`],
  ['of it in reverse', driven.reverse_m > 0.1 ? `${digits(driven.reverse_m)} m` : null],
  ['time on a path', after(driven.time_s)],
  ['speed by the treads, mean', known(driven.mean_speed_m_s, 'm/s')],
  ['speed by the treads, largest', known(driven.speed_max_m_s, 'm/s')],
  ['cross-track error, RMS', error && centimetres(error.rms_m)],
  ['cross-track error, p95', error && centimetres(error.p95_m)],
  ['cross-track error, largest', error && centimetres(error.max_m)],
  ['tip-over margin, least', guard && known(guard.tip_over_margin_min, '')],
  ['grip used, largest', guard && `${(100 * guard.friction_use_max).toFixed(0)} %`],
  ['controller', facts.controller],
  ['recorded by', `${facts.command} ${facts.version}`],
]);

const amount = ({ found, unit }) => is(found) ? `${Number.isInteger(found) ? found : digits(found)} ${unit}`.trim() : 'not recorded';
const cells = texts => texts.map(text => text instanceof Node ? make('td', {}, text) : make('td', { textContent: text }));
$('limits').hidden = !facts.limits.length;
$('limits').querySelector('tbody').replaceChildren(...facts.limits.map(limit => make('tr', { className: limit.passed ? '' : 'over' }, ...cells([
  limit.name,
  amount(limit),
  `${limit.is_least ? '≥' : '≤'} ${limit.limit} ${limit.unit}`,
  limit.passed ? '✓ kept' : '▲ exceeded',
]))));

$('weather').querySelector('tbody').replaceChildren(...facts.sensors.map(sensor => {
  const gap = make('button', { textContent: digits(sensor.gap_max_s), ariaLabel: `${sensor.name}: longest gap, ${digits(sensor.gap_max_s)} s` });
  gap.onclick = () => visit({ time_s: sensor.gap_time_s });
  return make('tr', {}, ...cells([
    sensor.name, digits(sensor.rate_hz), digits(sensor.age_p50_s), digits(sensor.age_p95_s), digits(sensor.age_max_s),
    is(sensor.gap_time_s) ? gap : digits(sensor.gap_max_s), digits(100 * sensor.missing_share),
  ]));
}));

const { fixes } = facts;
if (fixes) {
  const percent = share => `${digits(100 * share)} %`;
  const kinds = [['with RTK', fixes.rtk_share], ['corrected from satellites', fixes.corrected_share], ['without corrections', fixes.alone_share], ['none', fixes.none_share]];
  const texts = [
    `Fixes: ${kinds.filter(([, share]) => share > 0).map(([name, share]) => `${percent(share)} ${name}`).join(', ')}`,
    is(fixes.sigma_p50_m) && `standard deviation ${digits(100 * fixes.sigma_p50_m)} cm p50, ${digits(100 * fixes.sigma_p95_m)} cm p95, ${digits(100 * fixes.sigma_max_m)} cm at most`,
  ];
  $('fixes').textContent = `${texts.filter(Boolean).join('; ')}. `;
  if (is(fixes.without_rtk_time_s)) {
    const button = make('button', { textContent: `${digits(fixes.without_rtk_max_s)} s` });
    button.onclick = () => visit({ time_s: fixes.without_rtk_time_s });
    $('fixes').append('Longest time without RTK: ', button);
  }
}

function showVerdict() {
  const faults = facts.stops.filter(stop => stop.kind === 'fault'), final = last(facts.stops);
  const over = facts.limits.filter(limit => !limit.passed);
  const lines = over.map(limit => `${capital(limit.name)}: ${amount(limit)}, allowed ${limit.is_least ? '≥' : '≤'}\u00a0${limit.limit}`);
  let kind = 'waits', name = 'Driven';
  if (facts.passed !== null) [kind, name] = facts.passed ? ['done', 'Passed'] : ['stopped', 'Not passed'];
  else if (faults.length) [kind, name] = ['stopped', faults.length === 1 ? 'Stopped' : `Stopped ${faults.length} times`];
  else if (final) [kind, name] = final.kind === 'arrived' ? ['done', 'Arrived'] : ['waits', 'Stopped'];
  if (faults.length || (!lines.length && final)) lines.push(capital((last(faults) || final).cause));
  if (facts.damaged) lines.push(`The recording ends early: ${facts.damaged}`);
  const reason = `${[...lines, `${digits(driven.distance_m, 3)} m by the treads in ${after(facts.duration_s)}`].join('. ')}.`;
  tell(kind, name, reason, BEGIN > 1e9 ? new Date(1000 * BEGIN).toLocaleString([], { dateStyle: 'medium', timeStyle: 'short' }) : '');
}
showVerdict();

// --- All of it ---

STRIPS.forEach(addStrip);
showEvents();
if (parts.diagnostics) showDiagnostics();
figures($('motors'), [
  ['traction, off its command, RMS', known(facts.drives.traction_difference_rms_m_s, 'm/s')],
  ['steer, off its command, RMS', known(facts.drives.steer_difference_rms_m_s, 'm/s')],
  ['largest age of feedback', known(facts.drives.feedback_age_max_s, 's')],
]);

function show() {
  drawMap();
  const axis = timeAxis();
  for (const strip of STRIPS) drawStrip(strip, axis);
  showTime(time => after(time - BEGIN));
}
draw();
