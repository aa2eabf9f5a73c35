/* A served simulator that writes every step down, which judges when its axes have stood. */

'use strict';

const fs = require('fs');
const path = require('path');

const { check, until } = require('../cncjs');
const { start } = require('../monitor');
const { tapped } = require('./line');

// Steps of one motion are less than this apart, ms.
const REST_MS = 200;

/** Starts one behind a TCP address of which all that passes is kept. */
async function judged(simulator, settings, name) {
  const trace = path.resolve(`${name}.csv`);
  const options = ['--tcp', '127.0.0.1:0', '--switches', '--settings', settings, '--trace', trace];
  const { address, child } = await start(simulator, options);
  const line = await tapped(address);
  /** Ends the machine; returns when it has stepped, ms from its first step. */
  const end = async () => {
    line.close();
    line.cut();
    child.kill('SIGINT');
    await until(() => child.exitCode !== null || child.signalCode !== null, 'the simulator ends');
    const rows = fs.readFileSync(trace, 'utf8').trim().split('\n').slice(1);
    return rows.map((row) => Number(row.slice(0, row.indexOf(','))) / 1e6);
  };
  return { line, address: line.address, end };
}

/** The times at which the axes begin to move after a rest, ms. */
const begins = (steps) => steps.filter((at, index) => index === 0 || at - steps[index - 1] > REST_MS);

/**
 * Checks that the axes have stood within a time of each loss, and have moved until it began. A busy computer delays the
 * machine's clock: it is set again by each key, whose first jog is the next step of the machine's.
 */
function checkStops(steps, passed, losses, withinMs) {
  const jogs = passed.all.filter((piece) => piece.isSent && piece.text.includes('$J='));
  check(jogs.length > 0 && steps.length > 0, 'the machine has jogged');
  let machineMs = jogs[0].ms - steps[0];
  for (const {
    what, heldMs, beganMs, ms, untilMs,
  } of losses) {
    const jog = jogs.find((piece) => piece.ms >= heldMs);
    check(jog, `${what}: no jog was sent`);
    const away = (at) => Math.abs(jog.ms - machineMs - at);
    machineMs = jog.ms - begins(steps).reduce((one, other) => (away(other) < away(one) ? other : one));
    const [began, from, to] = [beganMs, ms, untilMs].map((time) => time - machineMs);
    const moved = steps.some((at) => at >= began - withinMs && at < from);
    const after = steps.filter((at) => at >= from && at < to);
    check(moved, `${what}: the axis did not move before`);
    const last = after.length > 0 ? after.at(-1) - from : 0;
    console.log(`${what}: at rest after ${last.toFixed(0)} ms`);
    check(last <= withinMs, `${what}: the axis still moves ${last.toFixed(0)} ms later`);
  }
}

module.exports = { checkStops, judged };
