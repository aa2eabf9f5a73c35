/*
 * A job of 200 000 lines, sent by a control page whose tab is hidden and slowed down as browsers do it: by the worker of
 * the page over a serial port, and by the program that serves the page. The job takes as long as the simulator says that
 * it does without any sender, and the memory of the page is the same at its end as at its beginning; nor does it grow in an
 * hour of the virtual machine's time.
 *
 * Its arguments are the page, the monitor, the simulator, and the machine's settings.
 */

'use strict';

const { execFileSync } = require('child_process');
const fs = require('fs');

const { check, run, until } = require('./cncjs');
const { browse } = require('./browser');
const { judged } = require('./control/judge');
const {
  click, delay, isState, openFile, press, state, text,
} = require('./control/operator');
const connections = require('./control/connections');

const [, , pageFile, monitor, simulator, settings] = process.argv;

const LINES = 200000;
const NAME = 'long.nc';
// An hour: lines of half a second each.
const HOUR = 'hour.nc';
const HOUR_LINES = 7200;
const FAST = '20';
// How much longer the job may take on a computer that does something else as well, and what the memory may grow by from
// the second quarter to the last.
const LATE = 0.25;
const GROWTH = 0.25;
const MEASURED_MS = 3000;
// Browsers slow down what is not in front; what drives them usually prevents it.
const SLOWED = [
  '--disable-background-timer-throttling', '--disable-backgrounding-occluded-windows', '--disable-renderer-backgrounding',
];

/** To and fro, 0.1 mm at a time. */
function written() {
  const lines = Array.from({ length: LINES - 3 }, (_, line) => `X${Math.floor(line / 900) % 2 === 0 ? -0.1 : 0.1}`);
  fs.writeFileSync(NAME, ['G21 G91', 'G1 F5000', ...lines, 'M30', ''].join('\n'));
}

/** How long the job takes, s. */
function ideal() {
  execFileSync(simulator, ['sim', NAME, '--settings', settings, '--json', 'long.json'], { stdio: 'ignore' });
  return JSON.parse(fs.readFileSync('long.json', 'utf8')).motion_time_s;
}

/** The memory that a page cannot do without, bytes. */
async function memory(session) {
  await session.send('HeapProfiler.collectGarbage');
  const usage = await session.send('Runtime.getHeapUsage');
  return usage.usedSize + (usage.embedderHeapUsedSize || 0) + (usage.backingStorageSize || 0);
}

/** Runs a program in a page that `hide` puts aside. Returns the memory of the page while it runs. */
async function ran(open, program, hide) {
  const browser = await browse('', SLOWED);
  let connection;
  try {
    connection = await open(browser);
    const { page } = connection;
    await connections.connect(connection);
    await press(page, 'Unlock');
    await isState(page, 'Idle');
    await openFile(page, program);
    await click(page, '#run');
    await isState(page, 'Running');
    await hide(browser, page);
    const session = await page.createCDPSession();
    const used = [];
    const job = () => text(page, '#job');
    await until(async () => {
      await delay(MEASURED_MS);
      used.push(await memory(session));
      return (await job()).startsWith('done');
    }, 'the job is done', async () => `${await job()} ${await state(page)}`);
    check(connection.faults.length === 0, connection.faults.join('\n'));
    return used;
  } finally {
    await browser.close();
    if (connection) connection.close();
  }
}

async function hidden(browser, page) {
  const other = await browser.newPage();
  await other.bringToFront();
  check(await page.evaluate(() => document.hidden), 'the page is hidden');
}

/** The least counts: what is on its way in the page comes and goes. */
function judgeMemory(name, used) {
  const quarter = Math.ceil(used.length / 4);
  const [before, after] = [used.slice(quarter, 2 * quarter), used.slice(-quarter)].map((part) => Math.min(...part));
  console.log(`${name}: ${used.map((it) => Math.round(it / 1024)).join(' ')} KiB`);
  check(used.length >= 8, `${name}: the memory was measured ${used.length} times`);
  check(after <= before * (1 + GROWTH), `${name}: the memory grows from ${before} to ${after} bytes`);
}

async function sent(name, open, idealS) {
  const machine = await judged(simulator, settings, name);
  const used = await ran((browser) => open(browser, machine), NAME, hidden);
  const steps = await machine.end();
  const tookS = (steps.at(-1) - steps[0]) / 1000;
  console.log(`${name}: ${tookS.toFixed(1)} s of ${idealS.toFixed(1)} s`);
  check(tookS <= idealS * (1 + LATE), `${name}: the job takes ${tookS} s instead of ${idealS} s`);
  judgeMemory(name, used);
}

/** An hour of the virtual machine's, in view. */
async function hour() {
  const lines = Array.from({ length: HOUR_LINES }, (_, line) => `G1 X${line % 2 ? 0 : 5} F600`);
  fs.writeFileSync(HOUR, ['G21 G90', ...lines, 'M30', ''].join('\n'));
  const open = (browser) => connections.virtual(browser, pageFile);
  judgeMemory('an hour', await ran(open, HOUR, (_, page) => page.select('#speed', FAST)));
}

async function main() {
  written();
  const idealS = ideal();
  const served = (browser, { address }) => connections.served(browser, monitor, address);
  const serial = (browser, { address }) => connections.serial(browser, pageFile, address);
  await hour();
  await sent('serial', serial, idealS);
  await sent('served', served, idealS);
  return [0, 0, 0];
}

run(main);
