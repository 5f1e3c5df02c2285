// What the live view and the report of a drive show beside the map: figures over time, events, drives, what was learned.

for (const [kind, text] of [['path', 'path'], ['track', 'driven'], ['plan', 'plan'], ['slide', 'slide, 10 s'], ['icr', 'tread ICRs'],
  ['ellipse', '95 % position']]) showKey(kind, text);

/** Events as time, level, name and text. */
let events = [];

// --- Figures ---

/** Kinds of fixes, as sensor_msgs/NavSatStatus counts them. */
const FIXES = { '-1': 'none', 0: 'alone', 1: 'SBAS', 2: 'RTK' };
const STRIPS = [
  CROSS_TRACK,
  {
    name: 'Speed', unit: 'm/s', least: 0.2, zero: true,
    lines: [
      { name: 'measured', of: f => get(f, 'traction'), colour: '--blue' },
      { name: 'commanded', of: f => get(f, 'traction_command'), colour: '--orange', dash: [6, 4] },
    ],
    value: ([v]) => [is(v) ? fixed(v, 2) : '–', 'm/s'],
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
  GRIP,
  TIP_OVER,
  {
    name: 'Age of the pose', unit: 's', range: [0, 0.5],
    of: f => get(f, 'pose_age'),
    value: ([a]) => [digits(a), 's'],
  },
  {
    name: 'Kind of fix', range: [-1, 2], words: FIXES,
    of: f => get(f, 'fix_status'),
    value: ([s]) => [FIXES[s] || '–', ''],
  },
  {
    name: 'Standard deviation of fixes', unit: 'cm', least: 2,
    of: f => is(get(f, 'fix_sigma')) ? 100 * get(f, 'fix_sigma') : null,
    value: ([s]) => [digits(s), 'cm'],
  },
];

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
    $('diagnosis').textContent = values.drives ? `${capital(values.drives)}.` : 'The motors reach the commanded speeds.';
    $('diagnosis').className = values.drives ? 'short' : '';
    const figures = [
      ['largest traction', values.traction_reached_m_s, 'm/s'],
      ['largest steer', values.steer_reached_m_s, 'm/s'],
      ['traction gains', values.traction_acceleration_m_s2, 'm/s²'],
      ['steer gains', values.steer_acceleration_m_s2, 'm/s²'],
      ['traction over its commands', values.traction_gain, ''],
      ['steer over its commands', values.steer_gain, ''],
      ['a command acts after', values.drive_delay_s, 's'],
    ];
    $('motors').replaceChildren(...figures.flatMap(([name, value, unit]) =>
      [make('dt', { textContent: name }), make('dd', { textContent: `${digits(Number(value))} ${unit}`.trim() })]));
  }
  const learned = Object.entries(values).filter(([key]) => key.startsWith('learned_'));
  $('learned').hidden = !learned.length;
  const rows = [], others = [];
  for (const [key, text] of learned) {
    const name = words(key.slice(8)), unit = unitOf(key);
    const [, value, low, high, prior] = /^(\S+) \((\S+) to ([^,)]+)(.*)\)$/.exec(text) || [null, text, text, text, ''];
    const write = number => digits(Number(number), 2, 4);
    if (prior) others.push(`${name} ${write(value)} ${unit}`.trim());
    else rows.push(make('tr', {}, ...[name, `${write(value)} ${unit}`, `${write(low)} to ${write(high)}`].map(textContent => make('td', { textContent }))));
  }
  $('learned').querySelector('table').hidden = !rows.length;
  $('learned').querySelector('tbody').replaceChildren(...rows);
  $('assumed').textContent = others.length ? `Not learned yet, as configured: ${others.join(', ')}.` : '';
}
