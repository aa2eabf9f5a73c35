/*
 * The control page while a key of the pad is held, and what goes away then: the key, the focus, the window, the tab, the
 * page, the browser, the line, the server. A served simulator, which writes down every step, judges whether the axis
 * stands in time; no line may be sent behind.
 *
 * Its arguments are the page, the monitor, the simulator, and the machine's settings.
 */

'use strict';

const { check, run, until } = require('./cncjs');
const { browse } = require('./browser');
const { checkStops, judged } = require('./control/judge');
const {
  at, choose, delay, isState, press, seen, state,
} = require('./control/operator');
const connections = require('./control/connections');

const [, , pageFile, monitor, simulator, settings] = process.argv;

// The axis stands after this, ms.
const WITHIN_MS = 250;
// For how long it is watched.
const WATCHED_MS = 1500;
const KEY = 'ArrowLeft';
const QUESTIONS = ['$$', '$G', '$I', '$I+', '$+'];

async function ready(connection) {
  const { page } = connection;
  await connections.connect(connection);
  await press(page, 'Unlock');
  await isState(page, 'Idle');
  await choose(page, 0);
}

/** Holds the key until the axis moves, and returns since when. A page that was hidden may not have the keyboard at once. */
async function hold(page) {
  await page.bringToFront();
  const before = await at(page);
  let heldMs;
  await until(async () => {
    await page.keyboard.up(KEY);
    await page.focus('#pad');
    heldMs = performance.now();
    await page.keyboard.down(KEY);
    await delay(500);
    return await state(page) === 'Jogging' && await at(page) !== before;
  }, 'it moves', () => seen(page));
  return heldMs;
}

/** What is lost while the page stays: it is the same page afterwards. */
function losses(connection, browser) {
  const { page } = connection;
  return [
    ['the key is released', () => page.keyboard.up(KEY)],
    ['the pad loses the focus', () => page.focus('#feed')],
    ['the window loses the focus', () => page.evaluate(() => window.dispatchEvent(new Event('blur')))],
    ['the tab is hidden', async () => {
      const other = await browser.newPage();
      await other.bringToFront();
      await page.evaluate(() => document.dispatchEvent(new Event('visibilitychange')));
      connection.other = other;
    }],
  ];
}

/** Holds the key and makes one loss; returns what is judged. */
async function lose(machine, page, what, cause) {
  const heldMs = await hold(page);
  const beganMs = performance.now();
  await cause();
  const ms = performance.now();
  await delay(WATCHED_MS);
  const untilMs = performance.now();
  // What was on its connection may still come; a line that is there again is asked what the machine is.
  const behind = machine.line.passed.sentSince(ms + 50).split('\n').slice(0, -1);
  const lines = behind.filter((line) => !QUESTIONS.includes(line.replaceAll(/[\x80-\xff!~\x18]/g, '')));
  check(lines.length === 0, `${what}: behind is sent ${JSON.stringify(lines)}`);
  return {
    what, heldMs, beganMs, ms, untilMs,
  };
}

/** The losses after which the page is there, where they are wanted, and the last one, after which nothing is. */
async function watch(machine, connection, browser, last, isWhole) {
  const { page } = connection;
  const judgements = [];
  await ready(connection);
  for (const [what, cause] of isWhole ? losses(connection, browser) : []) {
    judgements.push(await lose(machine, page, what, cause));
    if (connection.other) await connection.other.close();
    delete connection.other;
    await page.keyboard.up(KEY);
    check(['Idle', 'Jogging'].includes(await state(page)), await seen(page));
    await isState(page, 'Idle');
  }
  judgements.push(await lose(machine, page, ...last(connection)));
  return judgements;
}

async function judge(name, open, last, isWhole) {
  const machine = await judged(simulator, settings, name);
  const browser = await browse();
  let connection;
  try {
    connection = await open(browser, machine);
    const judgements = await watch(machine, connection, browser, (lost) => last(lost, browser, machine), isWhole);
    console.log(name);
    checkStops(await machine.end(), machine.line.passed, judgements, WITHIN_MS);
  } finally {
    if (browser.connected) await browser.close();
    if (connection) connection.close();
  }
}

const atServer = (browser, { address }) => connections.served(browser, monitor, address);
const atSocket = (browser, { address }) => connections.socket(browser, pageFile, address);
const atSerial = (browser, { address }) => connections.serial(browser, pageFile, address);

async function main() {
  await judge('server', atServer, ({ program }) => ['the server is killed', () => program.child.kill('SIGKILL')], true);
  await judge('tab', atServer, ({ page }) => ['the tab is closed', () => page.close()]);
  await judge('browser', atServer, (_, browser) => ['the browser is killed', () => browser.process().kill('SIGKILL')]);
  await judge('cable', atServer, (_, __, { line }) => ['the line to the machine is cut', () => line.cut()]);
  await judge('socket', atSocket, ({ line }) => ['the WebSocket is cut', () => line.cut()]);
  await judge('serial', atSerial, ({ line }) => ['the serial port is lost', () => line.cut()], true);
  await judge('page', atSerial, ({ page }) => ['the page with the port is closed', () => page.close()]);
  return [0, 0, 0];
}

run(main);
