// The map of a report: a click on it shows its moment in the plots, and the time of the plots is shown on it.

const given = JSON.parse($('runs').textContent);
column = Object.fromEntries(given.columns.map((name, i) => [name, i]));
parts = given;
for (const run of given.runs) runs.push({ ...run, dash: dashOf(run.colour), plan: [] });

takeGround();

// --- Time ---

const show = () => {
  drawMap();
  if (!newest()) return;
  showTime();
};
/** Shows a time under the cursors of the plots. */
function point(time) {
  const [first] = groups.time || [];
  if (first) first.chart.setCursor({ left: first.chart.valToPos(time, 'x'), top: 10 });
}
pointed = seek;
$('live').textContent = 'End';
$('span').remove();
$('time').oninput = event => {
  seek(Number(event.target.value));
  point(cursor);
};

const SPAN_S = 10;
onPlace(moment => {
  seek(moment);
  const [first] = groups.time || [];
  if (first) first.chart.setScale('x', { min: moment - SPAN_S, max: moment + SPAN_S });
  point(moment);
  say(`At ${moment.toFixed(1)} s; the plots show that moment. Double click in one for everything.`);
});

// --- Words ---

function say(text) {
  $('hint').textContent = text;
  $('hint').hidden = false;
}
const HINT = 'A click on a line shows its moment in the plots.';
say(HINT);
map.addEventListener('pointermove', event => {
  const [x, y] = placeOf(event), height = given.ground && heightIn(given.ground, x, y), earth = onEarth(x, y);
  const up = is(height) ? `, height ${fixed(height, 2)} m` : '';
  say(`x ${fixed(x, 2)} m, y ${fixed(y, 2)} m${up}${earth && `, ${earth}`}`);
});
map.addEventListener('pointerleave', () => say(HINT));
showKey('path', given.path.length && 'path');
for (const { text } of given.marks) showKey('steep', text);

drawAbove = (pen, X, Y) => {
  pen.strokeStyle = colours['--ink'];
  pen.lineWidth = 3;
  for (const { run, x, y } of given.marks) {
    if (runs[run].hidden) continue;
    pen.beginPath();
    for (const side of [-7, 7]) { pen.moveTo(X(x) - 7, Y(y) + side); pen.lineTo(X(x) + 7, Y(y) - side); }
    pen.stroke();
  }
};
for (const box of document.querySelectorAll('input[data-run]'))
  box.addEventListener('change', () => {
    runs[Number(box.dataset.run)].hidden = !box.checked;
    draw();
  });
draw();
