/*
 * A day at the control page: homing, zero by the probe, a job with two tools, with an override, a hold, a jog in the
 * change of the tool, a stop, and a start at a line. The machine has 200 mm of travel, and is not homed.
 */

'use strict';

const fs = require('fs');

const { HOME, check, until } = require('../cncjs');
const {
  at, delay, enter, fill, isAt, isState, openFile, pressable, seen, state, text,
} = require('./operator');

const PROGRAM = `G21 G90 G17 G54
T1 M6
M3 S800
G0 X5 Y5 Z5
G1 Z-2 F600
X35 F600
Y35
X5
Y5
G0 Z5
T2 M6
M3 S800
G1 Z-1 F600
X35 F600
Y35
X5
Y5
G0 Z10
M5
X0 Y0
M30
`;
const NAME = 'day.nc';
const END = '0.000,0.000,10.000';
// In the cut of the second tool.
const RESUMED_AT = 14;

/** Machine coordinates of a machine of 200 mm: the block's corner and top, and the plate below. */
const CORNER_MM = -125;
const TOP_MM = -170;
const PLATE_MM = -190;
const DIAMETER_MM = 6;

const places = (...numbers) => numbers.map((number) => (number + 0).toFixed(3)).join();

async function isIdle(page) {
  await isState(page, 'Idle');
}

async function homed(page, hands) {
  await hands.press(page, 'Home all axes');
  await isAt(page, places(...HOME), 'machine');
}

/** Goes to a place near what is probed by a typed line, and the rest by steps. */
async function approached(page, hands, [x, y, z], feed) {
  await enter(page, `$J=G53G90G21X${x}Y${y}Z${z + 2}F${feed}`);
  await isAt(page, places(x, y, z + 2), 'machine');
  await hands.click(page, 'input[name=step][value="1"]');
  await hands.step(page, 'Z', -1);
  await hands.step(page, 'Z', -1);
  await isAt(page, places(x, y, z), 'machine');
}

/** Probes; the result is as it is told. */
async function probed(page, hands, target, values, result) {
  await page.select('#probe-target', target);
  for (const [name, value] of Object.entries(values)) await fill(page, `#probe-${name}`, String(value));
  if (await page.$('#probe-checked:not(:checked)')) await hands.click(page, '#probe-checked');
  await hands.click(page, '#probe');
  const note = () => text(page, '#note');
  await until(async () => (await note()) === result, result, async () => `${await note()} ${await seen(page)}`);
  await isIdle(page);
}

/** Z and a corner of the block, or Z alone at the plate. */
async function zeroed(page, hands, { hasBlock, feed }) {
  const slow = Math.min(feed, 600);
  if (!hasBlock) {
    await approached(page, hands, [CORNER_MM - 3, CORNER_MM - 3, PLATE_MM + 4], feed);
    await probed(page, hands, 'top', { search: 10, retract: 2, feed: slow }, `zero at machine Z${places(PLATE_MM)}`);
    // Nobody takes the plate away.
    await enter(page, '$798=0');
    await hands.press(page, 'Zero X');
    await hands.press(page, 'Zero Y');
    await until(async () => (await at(page)).startsWith('0.000,0.000,'), 'X and Y are zero', () => seen(page));
    return [CORNER_MM - 3, CORNER_MM - 3, PLATE_MM];
  }
  await approached(page, hands, [CORNER_MM - 5, CORNER_MM - 5, TOP_MM + 4], feed);
  await probed(page, hands, 'top', { search: 10, retract: 2, feed: slow }, `zero at machine Z${places(TOP_MM)}`);
  await page.select('#probe-target', 'corner');
  await pressable(page, 'input[name=corner]');
  const corners = await page.$$('input[name=corner]');
  await corners.at(-1).evaluate((corner) => corner.click());
  const zero = CORNER_MM - DIAMETER_MM / 2;
  const sides = { diameter: DIAMETER_MM, beside: 15, depth: 6, search: 15 };
  await probed(page, hands, 'corner', sides, `zero at machine X${places(zero)} Y${places(zero)}`);
  return [zero, zero, TOP_MM];
}

const job = async (page) => `${await text(page, '#job')} ${await seen(page)}`;

/** The machine waits for a tool. */
async function isChanging(page, tool) {
  const wanted = `Tool change: T${tool}`;
  await until(async () => (await text(page, '#waits')).startsWith(wanted), wanted, () => job(page));
}

async function overriddenAndHeld(page, hands) {
  await isState(page, 'Running');
  await hands.press(page, 'Feed −10 %');
  const feed = () => page.$eval('[data-override=Feed] output', (output) => output.textContent);
  await until(async () => await feed() === '90 %', 'the feed is 90 %', feed);
  await hands.click(page, '#hold');
  await isState(page, 'Hold: at rest');
  const where = await at(page);
  await delay(300);
  check(await at(page) === where, `it moves in a hold: ${await seen(page)}`);
  await hands.press(page, 'Feed 100 %');
  await hands.click(page, '#resume');
}

async function run(page, hands) {
  fs.writeFileSync(NAME, PROGRAM);
  await openFile(page, NAME);
  await hands.click(page, '#run');
  await isChanging(page, 1);
  await hands.click(page, '#resume');
  await overriddenAndHeld(page, hands);
}

/** In the change of the tool, the machine is jogged. */
async function jogged(page, hands) {
  await isChanging(page, 2);
  await hands.click(page, '#take-lines');
  await isState(page, 'Change of the tool');
  await hands.step(page, 'Z', 1);
  await until(async () => (await at(page)).endsWith(',6.000'), 'Z is jogged', () => job(page));
  // Nothing is resumed while a jog is under way.
  await isState(page, 'Change of the tool');
}

/** In the second tool, the job is stopped. */
async function stopped(page, hands) {
  // Right after a jog the page asks to wait for the end of the motion.
  await until(async () => {
    if (await state(page) !== 'Change of the tool') return true;
    await hands.click(page, '#resume');
    await delay(500);
    return false;
  }, 'the job goes on', () => job(page));
  const isCutting = async () => {
    const [x, , z] = (await at(page)).split(',');
    return z === '-1.000' && parseFloat(x) > 8;
  };
  await until(isCutting, 'the second tool cuts', () => job(page));
  await hands.click(page, '#stop');
  await until(async () => / of 21 lines taken$/.test(await text(page, '#job')), 'the job is stopped', () => job(page));
  await isIdle(page);
}

/** The job goes on at a line, with the tool that is in. */
async function resumed(page, hands) {
  await fill(page, '#entry-line', String(RESUMED_AT));
  await hands.click(page, '#find-entry');
  const entry = () => text(page, '#entry');
  await until(async () => (await entry()).includes('T2 has to be in the spindle'), 'the start is found', entry);
  await hands.click(page, '#confirm-entry');
  await hands.click(page, '#run-entry');
  await isState(page, 'Running');
  await until(async () => (await text(page, '#job')).startsWith('done'), 'the job ends', () => job(page));
}

/** The whole day. Returns where the machine stands. */
async function day(page, hands, machine) {
  await homed(page, hands);
  await machine.measured();
  const zero = await zeroed(page, hands, machine);
  await run(page, hands);
  await jogged(page, hands);
  await stopped(page, hands);
  await resumed(page, hands);
  const end = zero.map((place, axis) => place + [0, 0, 10][axis]);
  await isAt(page, END);
  await isAt(page, places(...end), 'machine');
  return end;
}

module.exports = { day };
