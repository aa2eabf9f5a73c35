'use strict';

// What the monitor has sent: the path, speeds over time, and this moment.
let path = [];
let speeds = [];
let now = { extents: { low: [0, 0, 0], high: [0, 0, 0] } };
let unit = 'mm';
let isDue = false;

const element = (id) => document.getElementById(id);
const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

/** Makes a canvas as fine as the screen, and gives what draws in its pixels. */
function sheet(canvas) {
  const fine = window.devicePixelRatio || 1;
  const { clientWidth, clientHeight } = canvas;
  canvas.width = Math.max(1, Math.round(clientWidth * fine));
  canvas.height = Math.max(1, Math.round(clientHeight * fine));
  const context = canvas.getContext('2d');
  context.font = `${12 * fine}px sans-serif`;
  return { context, fine, width: canvas.width, height: canvas.height };
}

/** A round distance between grid lines, of which some five fit. */
function gridStep(length) {
  const power = 10 ** Math.floor(Math.log10(length / 5));
  return [1, 2, 5, 10].map((factor) => factor * power).find((step) => length / step <= 6);
}

function gridLines(low, high) {
  const step = gridStep(high - low);
  const lines = [];
  for (let index = Math.ceil(low / step); index * step <= high; index += 1) {
    lines.push(Number((index * step).toPrecision(12)));
  }
  return lines;
}

/** The path, in one scale for both axes. */
function drawPath() {
  const canvas = element('path');
  const { context, fine, width, height } = sheet(canvas);
  const { low, high } = now.extents;
  const margin = 40 * fine;
  const length = Math.max(
    (high[0] - low[0]) / Math.max(1, width - 2 * margin),
    (high[1] - low[1]) / Math.max(1, height - 2 * margin),
  );
  const scale = length > 0 ? 1 / length : 1;
  const left = width / 2 - (low[0] + high[0]) / 2 * scale;
  const bottom = height / 2 + (low[1] + high[1]) / 2 * scale;
  const across = (x) => left + x * scale;
  const up = (y) => bottom - y * scale;
  // For whoever measures what is drawn.
  canvas.dataset.view = JSON.stringify({ scale, left, bottom });

  context.strokeStyle = colour('--grid');
  context.fillStyle = colour('--faint');
  context.lineWidth = fine;
  for (const x of gridLines(-left / scale, (width - left) / scale)) {
    context.beginPath();
    context.moveTo(across(x), 0);
    context.lineTo(across(x), height);
    context.stroke();
    context.fillText(`${x}`, across(x) + 3 * fine, height - 4 * fine);
  }
  for (const y of gridLines((bottom - height) / scale, bottom / scale)) {
    context.beginPath();
    context.moveTo(0, up(y));
    context.lineTo(width, up(y));
    context.stroke();
    context.fillText(`${y}`, 3 * fine, up(y) - 3 * fine);
  }
  context.fillText(`X, Y in ${unit}`, 3 * fine, 14 * fine);

  context.strokeStyle = colour('--path');
  context.lineWidth = 1.5 * fine;
  context.lineJoin = 'round';
  context.beginPath();
  for (const [x, y] of path) context.lineTo(across(x), up(y));
  context.stroke();
  if (now.at) drawPoint(context, fine, across(now.at[0]), up(now.at[1]));
}

/** Where the machine is, and where it goes. */
function drawPoint(context, fine, x, y) {
  context.fillStyle = colour('--point');
  context.beginPath();
  context.arc(x, y, 5 * fine, 0, 2 * Math.PI);
  context.fill();
  if (now.heading === null || !/^(Run|Jog|Home)/.test(now.state)) return;
  context.save();
  context.translate(x, y);
  context.rotate(-now.heading);
  context.beginPath();
  context.moveTo(20 * fine, 0);
  context.lineTo(7 * fine, 6 * fine);
  context.lineTo(7 * fine, -6 * fine);
  context.fill();
  context.restore();
}

/** The speed over time. */
function drawSpeeds() {
  const { context, fine, width, height } = sheet(element('speeds'));
  const margin = 16 * fine;
  const most = speeds.reduce((most, [, speed]) => Math.max(most, speed), 1);
  const end = speeds.length ? Math.max(1, speeds[speeds.length - 1][0]) : 1;
  const up = (speed) => height - margin - speed / most * (height - 2 * margin);
  const across = (time) => time / end * width;
  context.strokeStyle = colour('--grid');
  context.fillStyle = colour('--faint');
  context.lineWidth = fine;
  for (const speed of gridLines(0, most)) {
    context.beginPath();
    context.moveTo(0, up(speed));
    context.lineTo(width, up(speed));
    context.stroke();
    context.fillText(`${speed}`, 2 * fine, up(speed) - 2 * fine);
  }
  for (const time of gridLines(0, end)) context.fillText(`${time} s`, across(time), height - 2 * fine);
  context.strokeStyle = colour('--path');
  context.beginPath();
  for (const [time, speed] of speeds) context.lineTo(across(time), up(speed));
  context.stroke();
}

function fill(row, values) {
  const cells = element(row).querySelectorAll('td');
  cells.forEach((cell, axis) => { cell.textContent = values ? values[axis].toFixed(3) : ''; });
}

function draw() {
  isDue = false;
  fill('machine', now.machine_mm);
  fill('work', now.work_mm);
  fill('low', now.extents.low);
  fill('high', now.extents.high);
  element('state').textContent = now.state || '\u00a0';
  element('speed').textContent = Math.round(now.speed_mm_min || 0);
  element('lines').textContent = now.lines || 0;
  drawPath();
  drawSpeeds();
  const last = now.at ? now.at.join() : '';
  document.body.dataset.at = last;
}

function redraw() {
  if (isDue) return;
  isDue = true;
  requestAnimationFrame(draw);
}

const events = new EventSource('/events');
events.onopen = () => { element('link').textContent = 'live'; };
events.onerror = () => { element('link').textContent = 'the monitor does not answer'; };
events.onmessage = ({ data }) => {
  const change = JSON.parse(data);
  if (change.is_all) {
    path = [];
    speeds = [];
  }
  path.push(...change.path);
  speeds.push(...change.speeds);
  ({ now, unit } = change);
  element('title').textContent = change.title;
  document.title = change.title;
  if (change.is_over) {
    events.close();
    element('link').textContent = 'ended';
  }
  redraw();
};
window.addEventListener('resize', redraw);
