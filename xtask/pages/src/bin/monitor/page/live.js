/* What the machine does now: its path over that of the job, where it is, its speed, and what is left. */

// What the monitor has sent: the path, speeds over time, and this moment.
let path = [];
let speeds = [];
let now = { extents: { low: [0, 0, 0], high: [0, 0, 0] } };
let unit = 'mm';
let isDue = false;

const colourOf = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

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

/**
 * The machine that is watched. Where nothing is known of its job, or nothing can draw it, the picture shows what it has
 * done since.
 */
class Watched extends Machine {
  constructor(view) {
    super(view);
    this.canvas = element('canvas');
    this.canvas.id = 'path';
    this.canvas.setAttribute('aria-label', 'The path of the machine, and where it is');
    view.scene.above.before(this.canvas);
  }

  bounds() {
    return now.at ? [now.extents.low, now.extents.high] : null;
  }

  render(scene) {
    if (!(scene.path.count && scene.gl) && !scene.path.rotary.length) this.chords(scene);
    super.render(scene);
  }

  /** The path from one position that was sent to the next. */
  chords(scene) {
    const { context, fine, width, height } = sheet(this.canvas);
    const { camera: { target, zoom, yaw, pitch } } = scene;
    // For whoever measures what is drawn from above.
    const isAbove = yaw === 0 && pitch === Math.PI / 2;
    const scale = zoom * fine;
    this.canvas.dataset.view = isAbove
      ? JSON.stringify({ scale, left: width / 2 - target[0] * scale, bottom: height / 2 + target[1] * scale }) : '';
    context.scale(fine, fine);
    context.strokeStyle = colourOf('--trail');
    context.lineWidth = 1.5;
    context.lineJoin = 'round';
    context.beginPath();
    for (const place of path) context.lineTo(...scene.project(place));
    context.stroke();
  }
}

/** The speed over time. */
function drawSpeeds() {
  const { context, fine, width, height } = sheet($('speeds'));
  const margin = 16 * fine;
  const most = speeds.reduce((greatest, [, speed]) => Math.max(greatest, speed), 1);
  const end = speeds.length ? Math.max(1, speeds[speeds.length - 1][0]) : 1;
  const up = (speed) => height - margin - speed / most * (height - 2 * margin);
  const across = (time) => time / end * width;
  context.strokeStyle = colourOf('--grid');
  context.fillStyle = colourOf('--faint');
  context.lineWidth = fine;
  const steps = (greatest) => {
    const step = roundStep(greatest / 5);
    return Array.from({ length: Math.floor(greatest / step + 1e-9) + 1 }, (_, index) => +(index * step).toPrecision(12));
  };
  for (const speed of steps(most)) {
    context.beginPath();
    context.moveTo(0, up(speed));
    context.lineTo(width, up(speed));
    context.stroke();
    context.fillText(`${speed}`, 2 * fine, up(speed) - 2 * fine);
  }
  for (const time of steps(end)) context.fillText(`${time} s`, across(time), height - 2 * fine);
  context.strokeStyle = colourOf('--trail');
  context.beginPath();
  for (const [time, speed] of speeds) context.lineTo(across(time), up(speed));
  context.stroke();
}

function fill(row, values) {
  const cells = $(row).querySelectorAll('td');
  cells.forEach((cell, axis) => { cell.textContent = values ? values[axis].toFixed(3) : ''; });
}

/** What is left of the job, in words. */
function remaining(job, end) {
  if (!job || !end) return '';
  if (job.left_s <= 0) return 'done';
  return `${duration(job.left_s)} left${job.is_on_path ? '' : ', beside its path'}`;
}

function draw() {
  isDue = false;
  fill('machine', now.machine_mm);
  fill('work', now.work_mm);
  fill('low', now.extents.low);
  fill('high', now.extents.high);
  $('state').textContent = now.words || '\u00a0';
  $('values').replaceChildren(...(now.values || []).flatMap(([name, value]) => [element('dt', name), element('dd', value)]));
  const messages = now.messages || [];
  $('messages').hidden = !messages.length;
  $('messages').replaceChildren(...[...messages].reverse().map((text) => element('li', text)));
  $('lines').textContent = now.lines || 0;
  // The alarms of the job in advance are in its table.
  $('alarm').textContent = now.alarm || '';
  $('refusal').textContent = now.refusal || '';
  const { view } = window;
  const { job } = now;
  const { live } = view.scene;
  const { rotary } = view.path;
  $('left').textContent = remaining(job, view.path.end);
  if (job) $('done').value = view.path.end ? job.time_s / view.path.end : 0;
  if (job) live.cutTo(job.time_s);
  // Work on a rotary axis turns with it, which reports of three axes do not tell.
  live.at = rotary.length && job ? view.path.at(job.time_s).xyz : now.at;
  [live.heading, live.state] = [rotary.length ? null : now.heading, now.state];
  view.scene.unit = unit;
  live.ask();
  drawSpeeds();
  document.body.dataset.at = now.at ? now.at.join() : '';
}

function redraw() {
  if (isDue || !window.view) return;
  isDue = true;
  requestAnimationFrame(draw);
}

/** What is known of the job; a job without anything, where nothing is. */
async function known() {
  const get = (name) => fetch(`job.${name}`);
  const facts = await (await get('json')).json();
  if (!facts) {
    const nothing = {
      title: '', axes: ['X', 'Y', 'Z'].map((letter) => ({ letter, scale: 1, limits: [] })), path: { vertices: 0, segments: 0 },
      stretch_s: 1, times: {}, lines: 0, refused: [], refused_count: 0, alarms: [], holes: [], tool_changes: [], work_zeros: [], settings: [],
      corners: { count: 0, written: 0 }, programmed: [],
    };
    const none = new Uint8Array();
    return [nothing, decodePath(none, nothing), decodeCurves(none, nothing), ''];
  }
  const bytes = async (name) => new Uint8Array(await (await get(name)).arrayBuffer());
  const [pathBytes, curveBytes, text] = await Promise.all(['path', 'curves', 'program'].map(bytes));
  document.body.dataset.job = 'yes';
  $('done').hidden = false;
  return [facts, decodePath(pathBytes, facts), decodeCurves(curveBytes, facts), new TextDecoder().decode(text)];
}

async function start() {
  const view = new View(...await known());
  const machine = new Watched(view);
  const { cutLow, cutHigh, count } = view.path;
  // What is flat is seen from above.
  if (!count || cutHigh[2] - cutLow[2] < 1e-3) view.scene.view('top');
  view.setTime(0);
  machine.follow(true);
  window.view = view;
  document.body.dataset.ready = 'yes';
  redraw();
}

const events = new EventSource('/events');
events.onopen = () => { $('link').textContent = 'live'; };
events.onerror = () => { $('link').textContent = 'the monitor does not answer'; };
events.onmessage = ({ data }) => {
  const change = JSON.parse(data);
  if (change.is_all) {
    path = [];
    speeds = [];
  }
  path.push(...change.path);
  speeds.push(...change.speeds);
  ({ now, unit } = change);
  $('title').textContent = change.title;
  document.title = change.title;
  if (change.is_over) {
    events.close();
    $('link').textContent = 'ended';
  }
  redraw();
};
window.addEventListener('resize', redraw);
start();
