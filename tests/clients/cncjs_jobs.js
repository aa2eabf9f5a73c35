'use strict';

/*
 * cncjs' server, driven over its socket as its web page does it: connect, load, run, pause, resume,
 * stop, reset, unlock, console lines.
 *
 * The server keeps 120 bytes of a job in flight and sends `$G` and console lines besides. It asks `?`
 * four times a second and `$G` twice, and writes bytes from 0x80 up in UTF-8. It takes a job for
 * finished when every line is answered, the machine is idle, and its position has not changed for
 * half a second.
 */

const childProcess = require('child_process');
const fs = require('fs');
const http = require('http');
const net = require('net');
const path = require('path');

// How long anything may take: a guard for a machine that is stuck, no measure.
const PATIENCE_MS = 30000;
// Where the work coordinates G54 begin, machine coordinates in mm.
const ORIGIN = { x: -100, y: -100, z: -50 };

// Where a machine stands that has been homed: the pull-off away from its switches.
const HOME = [-1, -1, -1];

const port = process.argv[2];

const delay = (ms) => new Promise((resolve) => setTimeout(resolve, ms));

function check(claim, what) {
  if (!claim) {
    throw new Error(what);
  }
}

async function until(claim, what) {
  const end = Date.now() + PATIENCE_MS;
  while (!claim()) {
    check(Date.now() < end, `not within ${PATIENCE_MS / 1000} s: ${what}`);
    await delay(10);
  }
}

/** A job of short lines, arcs and comments that begins and ends 10 mm above the origin. */
function spiral(lines) {
  const job = ['(a spiral)', 'G21 G90 G17 G54', '', 'G0 Z10', 'G1 X0 Y0 F6000', 'Z-1'];
  for (let number = 0; number < lines; number += 1) {
    const angle = number * 0.15;
    const radius = 5 + 20 * number / lines;
    const [x, y] = [radius * Math.cos(angle), radius * Math.sin(angle)];
    job.push(`G1 X${x.toFixed(3)} Y${y.toFixed(3)}`);
    if (number % 50 === 49) {
      job.push(`G3 X${x.toFixed(3)} Y${y.toFixed(3)} I${(-x).toFixed(3)} J${(-y).toFixed(3)}`);
    }
    if (number % 10 === 9) {
      job.push(`; after ${number + 1}`);
    }
  }
  return [...job, 'G0 Z10', 'X0 Y0'].join('\n');
}

/** A TCP port that nobody uses. */
function freePort() {
  return new Promise((resolve) => {
    const server = net.createServer().listen(0, '127.0.0.1', () => {
      const { port: number } = server.address();
      server.close(() => resolve(number));
    });
  });
}

/** Signs in as the page does; `undefined` while the server is not up. */
function signIn(number) {
  return new Promise((resolve) => {
    const request = http.request({
      host: '127.0.0.1', port: number, path: '/api/signin', method: 'POST',
      headers: { 'Content-Type': 'application/json' },
    }, (response) => {
      let text = '';
      response.on('data', (chunk) => { text += chunk; });
      response.on('end', () => resolve(JSON.parse(text).token));
    });
    request.on('error', () => resolve(undefined));
    request.end('{}');
  });
}

/** The page's side of the socket. */
class Page {
  constructor(socket) {
    this.socket = socket;
    this.state = {};
    this.workflow = 'idle';
    this.sender = {};
    this.settings = {};
    this.lines = [];
    socket.on('controller:state', (type, state) => { this.state = state; });
    socket.on('controller:settings', (type, settings) => { this.settings = settings; });
    socket.on('workflow:state', (state) => { this.workflow = state; });
    socket.on('sender:status', (status) => { this.sender = status; });
    socket.on('serialport:read', (line) => { this.lines.push(line); });
  }

  command(...parameters) {
    this.socket.emit('command', port, ...parameters);
  }

  active() {
    return (this.state.status || {}).activeState;
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

  /** Sends a console line, and waits until the machine is at rest there. */
  async go(line, place) {
    this.command('gcode', line);
    await until(() => this.isAt(place) && this.active() === 'Idle', `${line} is done`);
  }

  async load(gcode) {
    await new Promise((resolve, reject) => {
      this.command('gcode:load', 'job.nc', gcode, {}, (error) => (error ? reject(error) : resolve()));
      // The server calls back through nothing when it is driven by a socket.
      resolve();
    });
    await until(() => this.sender.name === 'job.nc', 'the job is loaded');
  }

  async finished() {
    await until(() => this.workflow === 'idle', 'cncjs takes the job for finished');
    await until(() => this.active() === 'Idle', 'the machine is idle after it');
    check(this.sender.received === this.sender.total, 'every line is answered');
  }
}

/** The buttons that pause and resume, and others between them. */
async function pause(page, during = async () => {}) {
  page.command('gcode:pause');
  await until(() => page.active() === 'Hold', 'the machine is held');
  await during(page);
  page.command('gcode:resume');
  await until(() => page.active() === 'Run', 'the machine goes on');
}

/** The buttons of the override widgets. */
async function override(page) {
  for (const [command, value, shown] of [
    ['feedOverride', 10, '110,100,100'],
    ['feedOverride', -1, '109,100,100'],
    ['rapidOverride', 25, '109,25,100'],
    ['spindleOverride', -10, '109,25,90'],
    ['rapidOverride', 100, '109,100,90'],
    ['spindleOverride', 0, '109,100,100'],
    ['feedOverride', 0, '100,100,100'],
  ]) {
    page.command(command, value);
    await until(() => page.overrides() === shown, `the overrides are ${shown}`);
  }
}

/** The jog buttons: a step there and back, and many that are cancelled. */
async function jog(page, [x, y, z]) {
  await page.go('$J=G91 X5 F3000', [x + 5, y, z]);
  await page.go('$J=G90 X0 F3000', [x, y, z]);
  // Far more than whoever cancels it would wait for.
  page.command('gcode', Array(4).fill(['$J=G91 Y90 F1000', '$J=G91 Y-90 F1000']).flat());
  await until(() => page.active() === 'Jog', 'the machine jogs');
  page.command('jogCancel');
  await until(() => page.active() === 'Idle', 'the jogs are cancelled');
}

async function drive(page) {
  const { x, y, z } = ORIGIN;
  await until(() => page.active(), 'a report is understood');
  page.command('homing');
  await until(() => page.active() === 'Idle' && page.isAt(HOME), 'the machine is homed');
  // Who started this compares the pins with the report.
  console.log('homed');
  await until(() => fs.existsSync('measured'), 'the pins are compared with the report');
  await until(() => (page.settings.settings || {}).$132, 'the settings are read');
  page.command('gcode', `G10 L2 P1 X${x} Y${y} Z${z}`);
  await page.go('G54 G0 X0 Y0 Z10', [x, y, z + 10]);

  // A whole job with two pauses.
  await page.load(spiral(100));
  page.command('gcode:start');
  await until(() => page.active() === 'Run', 'the job runs');
  await pause(page);
  await pause(page, override);
  await page.finished();
  check(page.isAt([x, y, z + 10]), `the job has ended at ${page.position()}`);

  await jog(page, [x, y, z + 10]);

  // Stopped by force: a hold and, half a second later, a reset.
  page.command('gcode:start');
  await until(() => page.active() === 'Run', 'the job runs');
  const welcomes = page.welcomes();
  while (page.welcomes() === welcomes) {
    // It does not reset when no report has told it of the hold by then: the button is pressed again.
    page.command('gcode:stop', { force: true });
    await delay(1500);
  }
  await until(() => page.active() === 'Idle', 'a reset in a hold keeps the machine unlocked');

  // Reset in motion: locked, and after `$X` the whole job again.
  page.command('gcode:start');
  await until(() => page.active() === 'Run', 'the job runs');
  page.command('reset');
  await until(() => page.active() === 'Alarm', 'a reset in motion locks the machine');
  page.command('unlock');
  await until(() => page.active() === 'Idle', 'the machine is unlocked');
  page.command('gcode:start');
  await until(() => page.active() === 'Run', 'the job runs');
  await page.finished();
  check(page.isAt([x, y, z + 10]), `the job has ended at ${page.position()}`);

  await page.go('G53 G0 X-20 Y-30 Z-10', [-20, -30, -10]);
  return [-20, -30, -10];
}

async function main() {
  const modules = process.env.NODE_PATH;
  const number = await freePort();
  childProcess.spawn(
    process.execPath,
    [path.join(modules, 'cncjs/bin/cncjs'), '--port', number, '--host', '127.0.0.1',
      '--config', path.resolve('cncrc'), '--controller', 'Grbl'],
    { stdio: ['ignore', 'inherit', 'inherit'] },
  );
  let token;
  for (const end = Date.now() + PATIENCE_MS; !token;) {
    check(Date.now() < end, 'the server does not start');
    await delay(100);
    token = await signIn(number);
  }
  const socket = require('socket.io-client')(`http://127.0.0.1:${number}`, { query: { token } });
  await new Promise((resolve) => { socket.on('startup', resolve); });
  const page = new Page(socket);
  await new Promise((resolve, reject) => {
    const options = { controllerType: 'Grbl', baudrate: 115200 };
    socket.emit('open', port, options, (error) => (error ? reject(new Error(error)) : resolve()));
  });
  return drive(page);
}

// Who started this ends the server.
main().then(
  (place) => { console.log(`at ${place.join(',')}`); process.exit(0); },
  (error) => { console.error(error); process.exit(1); },
);
