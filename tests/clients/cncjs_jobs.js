/*
 * cncjs' server, driven over its socket as its web page does it: connect, load, run, pause, resume,
 * stop, reset, unlock, console lines.
 *
 * The server keeps 120 bytes of a job in flight and sends `$G` and console lines besides. It asks `?`
 * four times a second and `$G` twice, and writes bytes from 0x80 up in UTF-8. It takes a job for
 * finished when every line is answered, the machine is idle, and its position has not changed for
 * half a second.
 */

'use strict';

const {
  HOME, ORIGIN, check, measured, run, serve, spiral, until,
} = require('./cncjs');

const port = process.argv[2];

/** The page's side of the socket. */
class Page {
  constructor(socket) {
    this.socket = socket;
    this.state = {};
    this.workflow = 'idle';
    this.sender = {};
    this.settings = {};
    this.lines = [];
    this.written = [];
    socket.on('controller:state', (type, state) => { this.state = state; });
    socket.on('controller:settings', (type, settings) => { this.settings = settings; });
    socket.on('workflow:state', (state) => { this.workflow = state; });
    socket.on('sender:status', (status) => { this.sender = status; });
    socket.on('serialport:read', (line) => { this.lines.push(line); });
    socket.on('serialport:write', (line) => { this.written.push(line); });
  }

  command(...parameters) {
    this.socket.emit('command', port, ...parameters);
  }

  active() {
    return (this.state.status || {}).activeState;
  }

  /** The hold is complete. */
  isHeld() {
    return this.active() === 'Hold' && this.state.status.subState === 0;
  }

  overrides() {
    return ((this.state.status || {}).ov || []).join(',');
  }

  position() {
    const { x, y, z } = (this.state.status || {}).mpos || {};
    return [Number(x), Number(y), Number(z)];
  }

  isAt(place) {
    return this.position().every((value, axis) => value === place[axis]);
  }

  welcomes() {
    return this.lines.filter((line) => line.startsWith('Grbl ')).length;
  }

  /** How many jogs have been sent. */
  jogs() {
    return this.written.filter((line) => line.startsWith('$J=')).length;
  }

  /** How far the machine is, and what cncjs makes of it. */
  progress() {
    const { received, total } = this.sender;
    const place = `${this.active()} at ${this.position()}, overrides ${this.overrides()}`;
    return `${place}; ${this.workflow}, ${received} of ${total} lines, ${this.welcomes()} welcomes`;
  }

  until(claim, what) {
    return until(claim, what, () => this.progress());
  }

  /** Sends a console line, and waits until the machine is at rest there. */
  async go(line, place) {
    this.command('gcode', line);
    await this.until(() => this.isAt(place) && this.active() === 'Idle', `${line} is done`);
  }

  async load(gcode) {
    await new Promise((resolve, reject) => {
      this.command('gcode:load', 'job.nc', gcode, {}, (error) => (error ? reject(error) : resolve()));
      // The server calls back through nothing when it is driven by a socket.
      resolve();
    });
    await this.until(() => this.sender.name === 'job.nc', 'the job is loaded');
  }

  async finished() {
    await this.until(() => this.workflow === 'idle', 'cncjs takes the job for finished');
    await this.until(() => this.active() === 'Idle', 'the machine is idle after it');
    check(this.sender.received === this.sender.total, 'every line is answered');
  }
}

/** The buttons that pause and resume, and others between them. */
async function pause(page, during = async () => {}) {
  page.command('gcode:pause');
  await page.until(() => page.active() === 'Hold', 'the machine is held');
  await during(page);
  page.command('gcode:resume');
  await page.until(() => page.active() !== 'Hold', 'the machine goes on');
}

/** Ten times as long for what is pressed while the job runs. */
async function slowDown(page) {
  Array(9).fill(-10).forEach((value) => page.command('feedOverride', value));
  await page.until(() => page.overrides() === '10,100,100', 'the feed is at 10 %');
}

/** The buttons of the override widgets. */
async function override(page) {
  for (const [command, value, shown] of [
    ['feedOverride', 0, '100,100,100'],
    ['feedOverride', 10, '110,100,100'],
    ['feedOverride', -1, '109,100,100'],
    ['rapidOverride', 25, '109,25,100'],
    ['spindleOverride', -10, '109,25,90'],
    ['rapidOverride', 100, '109,100,90'],
    ['spindleOverride', 0, '109,100,100'],
    ['feedOverride', 0, '100,100,100'],
  ]) {
    page.command(command, value);
    await page.until(() => page.overrides() === shown, `the overrides are ${shown}`);
  }
}

/** The jog buttons: a step there and back, and many that are cancelled. */
async function jog(page, [x, y, z]) {
  await page.go('$J=G91 X5 F3000', [x + 5, y, z]);
  await page.go('$J=G90 X0 F3000', [x, y, z]);
  // Far more than whoever cancels it would wait for. cncjs sends one after the other has been
  // answered, and goes on with that after the cancel.
  const jogs = page.jogs() + 8;
  page.command('gcode', Array(4).fill(['$J=G91 Y90 F1000', '$J=G91 Y-90 F1000']).flat());
  await page.until(() => page.jogs() === jogs, 'all jogs are sent');
  await page.until(() => page.active() === 'Jog', 'the machine jogs');
  page.command('jogCancel');
  await page.until(() => page.active() === 'Idle', 'the jogs are cancelled');
}

async function drive(page) {
  const { x, y, z } = ORIGIN;
  await page.until(() => page.active(), 'a report is understood');
  page.command('homing');
  await page.until(() => page.active() === 'Idle' && page.isAt(HOME), 'the machine is homed');
  await measured();
  await page.until(() => (page.settings.settings || {}).$132, 'the settings are read');
  // It passes the lines of `$I` on to the page's console.
  page.command('gcode', '$I');
  await page.until(
    () => page.lines.some((line) => line.startsWith('[MSG:Step rate: ')),
    'the step rate is shown',
  );
  page.command('gcode', `G10 L2 P1 X${x} Y${y} Z${z}`);
  await page.go('G54 G0 X0 Y0 Z10', [x, y, z + 10]);

  // A whole job with two pauses.
  await page.load(spiral(100));
  await slowDown(page);
  page.command('gcode:start');
  await page.until(() => page.active() === 'Run', 'the job runs');
  await pause(page);
  await pause(page, override);
  await page.finished();
  check(page.isAt([x, y, z + 10]), `the job has ended at ${page.position()}`);

  // Two tools: cncjs stops its job at each `M6`, which it does not send, and its user resumes.
  await page.load(['T1 M6', 'M3 S800', spiral(20), 'M5', 'T2 M6', 'M3 S800', spiral(20), 'M5'].join('\n'));
  page.command('gcode:start');
  await page.until(() => page.workflow === 'paused', 'cncjs waits for the first tool');
  let pressed = 0;
  await page.until(() => {
    if (page.workflow === 'paused' && Date.now() - pressed > 1000) {
      pressed = Date.now();
      page.command('gcode:resume');
    }
    return page.workflow === 'idle';
  }, 'the job with two tools ends');
  await page.finished();
  check(!page.written.some((line) => /^[^(]*M6/.test(line)), 'the machine gets no M6');
  check(page.isAt([x, y, z + 10]), `the job with two tools has ended at ${page.position()}`);
  // Slow enough that the machine has no moment at rest between two lines, however late they come.
  await page.load(spiral(2000, 700));

  await jog(page, [x, y, z + 10]);

  // Stopped by force in a hold: half a second later, a reset. While the machine moves it would hold it
  // before, and reset it even if that had not come to its end by then.
  page.command('gcode:start');
  await page.until(() => page.active() === 'Run', 'the job runs');
  page.command('feedhold');
  await page.until(() => page.isHeld(), 'the machine is held');
  const welcomes = page.welcomes();
  page.command('gcode:stop', { force: true });
  await page.until(() => page.welcomes() > welcomes, 'the machine is reset');
  await page.until(() => page.active() === 'Idle', 'a reset in a hold keeps the machine unlocked');

  // Reset in motion: locked, and after `$X` a whole job.
  page.command('gcode:start');
  await page.until(() => page.active() === 'Run', 'the job runs');
  page.command('reset');
  await page.until(() => page.active() === 'Alarm', 'a reset in motion locks the machine');
  page.command('unlock');
  await page.until(() => page.active() === 'Idle', 'the machine is unlocked');
  await page.load(spiral(200));
  page.command('gcode:start');
  await page.until(() => page.active() === 'Run', 'the job runs');
  await page.finished();
  check(page.isAt([x, y, z + 10]), `the job has ended at ${page.position()}`);

  await page.go('G53 G0 X-20 Y-30 Z-10', [-20, -30, -10]);
  return [-20, -30, -10];
}

async function main() {
  const { number, token } = await serve();
  const socket = require('socket.io-client')(`http://127.0.0.1:${number}`, { query: { token } });
  await new Promise((resolve) => { socket.on('startup', resolve); });
  const page = new Page(socket);
  await new Promise((resolve, reject) => {
    const options = { controllerType: 'Grbl', baudrate: 115200 };
    socket.emit('open', port, options, (error) => (error ? reject(new Error(error)) : resolve()));
  });
  return drive(page);
}

run(main);
