/* What the scripts that drive cncjs have in common: jobs, waiting, and cncjs' server. */

'use strict';

const childProcess = require('child_process');
const fs = require('fs');
const http = require('http');
const net = require('net');
const path = require('path');

// How long nothing may happen: a guard for a machine that is stuck, no measure. How long anything
// takes is no concern of the scripts: the emulated machine goes as fast as its host lets it.
const TIMEOUT_MS = 180000;
// Where the work coordinates G54 begin, machine coordinates in mm.
const ORIGIN = { x: -100, y: -100, z: -50 };

// Where a machine stands that has been homed: the pull-off away from its switches.
const HOME = [-1, -1, -1];

const delay = (ms) => new Promise((resolve) => setTimeout(resolve, ms));

function check(claim, what) {
  if (!claim) {
    throw new Error(what);
  }
}

/**
 * Waits until a claim is true. `progress` tells how far the machine is, in words: as long as they
 * change, nothing is stuck.
 */
async function until(claim, what, progress = () => '') {
  let [seen, end] = [undefined, 0];
  while (!await claim()) {
    const before = seen;
    seen = await progress();
    if (seen !== before) {
      end = Date.now() + TIMEOUT_MS;
    }
    const silence = `nothing has happened for ${TIMEOUT_MS / 1000} s`;
    check(Date.now() < end, `${silence}: ${what}; ${seen}`);
    await delay(50);
  }
}

/** A job of short lines, arcs and comments that begins and ends 10 mm above the origin. */
function spiral(lines, feed = 6000) {
  const job = ['(a spiral)', 'G21 G90 G17 G54', '', 'G0 Z10', `G1 X0 Y0 F${feed}`, 'Z-1'];
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

/** Starts the server; gives its TCP port, and what a client shows to be let in. */
async function serve(environment = {}, tries = 3) {
  const number = await freePort();
  const server = childProcess.spawn(
    process.execPath,
    [path.join(process.env.NODE_PATH, 'cncjs/bin/cncjs'), '--port', number, '--host', '127.0.0.1',
      '--config', path.resolve('cncrc'), '--controller', 'Grbl'],
    { stdio: ['ignore', 'inherit', 'inherit'], env: { ...process.env, ...environment } },
  );
  let token;
  for (const end = Date.now() + TIMEOUT_MS; !token;) {
    check(Date.now() < end, 'the server does not start');
    await delay(100);
    if (server.exitCode !== null) {
      // Somebody else may have taken the port.
      check(tries > 1, 'the server has ended');
      return serve(environment, tries - 1);
    }
    token = await signIn(number);
  }
  return { number, token };
}

/** Lets who started the script compare the pins with the report: to be called after homing. */
async function measured() {
  console.log('homed');
  await until(() => fs.existsSync('measured'), 'the pins are compared with the report');
}

/** Runs a script, and says where the machine must be; who started it ends the server. */
function run(main) {
  main().then(
    (place) => { console.log(`at ${place.join(',')}`); process.exit(0); },
    (error) => { console.error(error); process.exit(1); },
  );
}

module.exports = {
  HOME, ORIGIN, TIMEOUT_MS, check, measured, run, serve, spiral, until,
};
