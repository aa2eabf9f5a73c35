/*
 * The control page in a browser without a window: an operator with the virtual machine, as wide as a screen from a
 * server, and as wide as a phone as a file. It unlocks, jogs by keyboard and mouse, sets zeros, runs a program with a
 * hold, changes a setting, probes, uses a macro, and homes; what is held while the page is left stops. Then comes a day
 * with a job of two tools, by mouse on the screen and by keyboard on the phone.
 *
 * Its argument is the page.
 */

'use strict';

const fs = require('fs');
const { pathToFileURL } = require('url');

const { check, run, until } = require('./cncjs');
const { browse, serve } = require('./browser');
const { day } = require('./control/day');
const { KEYBOARD, MOUSE } = require('./control/hands');
const {
  at, choose, click, delay, fill, isAt, isState, jogs, openFile, openPage, press, seen, state, text,
} = require('./control/operator');

const [, , pageFile] = process.argv;

// A second in each direction, so that there is time for a hold.
const PROGRAM = 'G21 G90\nG1 X5 F300\nY5\nX0\nY0\nX1.25 Y-2.5 (<b>)\n';
const NAME = 'p <img src=x onerror=document.title=1>.nc';

async function connected(page) {
  check(await state(page) === 'No machine' && await page.$eval('#hold', (button) => button.disabled), 'nothing is connected at first');
  await click(page, '#connect');
  await isState(page, 'Alarm: locked');
  check(await page.$eval('#pad button', (button) => button.disabled), 'a machine that is locked is not jogged');
  await press(page, 'Unlock');
  await isState(page, 'Idle');
  check(await at(page) === '0.000,0.000,0.000', await at(page));
}

/** By steps: keys count only where the pad has the focus. */
async function stepped(page) {
  await choose(page, 1);
  await page.keyboard.press('PageUp');
  await page.focus('#pad');
  await page.keyboard.press('ArrowRight');
  await page.keyboard.press('ArrowRight');
  await page.keyboard.press('PageDown');
  await isAt(page, '2.000,0.000,-1.000');
  await choose(page, 0.1);
  await press(page, 'Y+');
  await press(page, 'X− Y−');
  await isAt(page, '1.900,0.000,-1.000');
  await press(page, 'Zero X');
  await isAt(page, '0.000,0.000,-1.000');
  await press(page, 'Zero all axes');
  await isAt(page, '0.000,0.000,0.000');
}

/**
 * Holds a key or a button until the machine moves; `end` ends it. A page that is slow asks too late, and the motion ends:
 * then it is held again.
 */
async function held(page, [begin, release], end, what) {
  await until(async () => {
    await release();
    await isState(page, 'Idle');
    const before = await at(page);
    await begin();
    await delay(300);
    return await state(page) === 'Jogging' && await at(page) !== before;
  }, 'it moves', () => seen(page));
  await end();
  await isState(page, 'Idle');
  const [where, count] = [await at(page), await jogs(page)];
  await delay(400);
  check(await at(page) === where && await jogs(page) === count, `${what}: it still moves, ${await seen(page)}`);
}

async function heldInManyWays(page, browser) {
  await choose(page, 0);
  const keyDown = async () => {
    await page.focus('#pad');
    await page.keyboard.down('ArrowLeft');
  };
  const keyUp = () => page.keyboard.up('ArrowLeft');
  const key = [keyDown, keyUp];
  await held(page, key, keyUp, 'the key is released');
  await held(page, key, () => page.focus('#feed'), 'the pad loses the focus');
  await keyUp();
  await held(page, key, () => page.evaluate(() => window.dispatchEvent(new Event('blur'))), 'the window loses the focus');
  await keyUp();
  const leave = async () => {
    const other = await browser.newPage();
    await other.bringToFront();
    await page.evaluate(() => document.dispatchEvent(new Event('visibilitychange')));
    await other.close();
  };
  await held(page, key, leave, 'the page is hidden');
  await keyUp();
  await page.bringToFront();
  const button = await page.$('#pad button[aria-label="X+"]');
  const mouseDown = async () => {
    await button.evaluate((found) => found.scrollIntoView({ block: 'center' }));
    await button.hover();
    await page.mouse.down();
  };
  // The button of the mouse may be up already.
  const mouse = [mouseDown, () => page.mouse.up().catch(() => {})];
  await held(page, mouse, () => page.mouse.up(), 'the button is released');
  // Nothing tells that the page hangs: what was asked for counts for a moment alone.
  await held(page, mouse, () => page.evaluate(() => {
    const end = performance.now() + 1500;
    while (performance.now() < end);
    window.dispatchEvent(new Event('pointerup'));
  }), 'the page hangs');
  await page.mouse.up();
}

async function wentToZero(page) {
  const question = () => text(page, '.setup [role=alert]');
  await press(page, 'Go to zero');
  await until(async () => (await question()).includes('not homed'), 'the operator is asked', question);
  await press(page, 'Do not move');
  await until(async () => await question() === '', 'the question is gone', question);
  await press(page, 'Go to zero');
  await press(page, 'Move X and Y');
  await isAt(page, '0.000,0.000,0.000');
}

async function typed(page) {
  await page.type('#line', 'G999 <b>');
  await page.keyboard.press('Enter');
  await until(() => page.$('#note'), 'the error is told', () => seen(page));
  check(/^G999 <b>: error 20, .*remove the word/.test(await text(page, '#note')), await text(page, '#note'));
  const line = () => page.$eval('#line', (input) => input.value);
  await page.keyboard.press('ArrowUp');
  await until(async () => await line() === 'G999 <b>', 'the line comes back', line);
  await page.keyboard.press('ArrowDown');
  await until(async () => await line() === '', 'the line goes again', line);
  await page.type('#line', 'F100');
  await page.keyboard.press('Enter');
  await until(async () => await page.$('#note') === null, 'the next line takes the error away', () => seen(page));
}

/** Writes in the editor: what was written runs. */
async function edited(page) {
  await page.select('#example', 'plate.nc');
  await until(async () => await text(page, '#program') === 'plate.nc, 90 lines', 'an example is open', () => seen(page));
  await page.type('#find', 'x60');
  await until(async () => await text(page, '.find output') === '1 of 2', 'it is found', () => text(page, '.find output'));
  await page.keyboard.press('Enter');
  await page.keyboard.press('Escape');
  const selected = () => page.$eval('#text', (field) => field.value.slice(field.selectionStart, field.selectionEnd));
  await until(async () => await selected() === 'X60', 'what was found is selected', selected);
  await page.keyboard.type('X61\nF99');
  await until(async () => await text(page, '#program') === 'plate.nc, 91 lines', 'the change counts', () => text(page, '#program'));
  await page.keyboard.down('Control');
  await page.keyboard.press('z');
  await page.keyboard.up('Control');
  const lines = () => page.$$eval('.code pre > div', (found) => found.map((line) => line.textContent).join('\n'));
  await until(async () => !(await lines()).includes('F99'), 'the last line is undone', lines);
}

async function ran(page) {
  fs.writeFileSync(NAME, PROGRAM);
  await openFile(page, NAME);
  await click(page, '#run');
  await isState(page, 'Running');
  await until(async () => await text(page, '#job') === '6 of 6 lines taken' && parseFloat(await at(page)) > 1, 'the job goes on', () => seen(page));
  await click(page, '#hold');
  await isState(page, 'Hold: at rest');
  const where = await at(page);
  await delay(400);
  check(await at(page) === where, `it moves in a hold: ${await seen(page)}`);
  await click(page, '#resume');
  await until(async () => await text(page, '#job') === 'done: 6 lines', 'the job ends', async () => `${await text(page, '#job')} ${await seen(page)}`);
  await isAt(page, '1.250,-2.500,0.000');
  check(await page.$('img') === null && await page.title() === 'Leadscrew: control', 'a name is text');
  await click(page, '#run');
  await isState(page, 'Running');
  await click(page, '#stop');
  await until(async () => /, \d of 6 lines taken$/.test(await text(page, '#job')), 'the job is stopped', () => text(page, '#job'));
}

async function overridden(page) {
  await press(page, 'Feed +10 %');
  await press(page, 'Rapids 50 %');
  const values = () => page.$$eval('.overrides output', (outputs) => outputs.map((output) => output.textContent).join());
  await until(async () => await values() === '110 %,50 %,100 %', 'the overrides change', values);
  await press(page, 'Feed 100 %');
  await until(async () => await values() === '100 %,50 %,100 %', 'the feed is as programmed', values);
}

async function configured(page) {
  if (await state(page) !== 'Idle') await press(page, 'Unlock');
  await isState(page, 'Idle');
  await click(page, '#read-settings');
  await until(() => page.$('#setting-798'), 'the settings are read', () => seen(page));
  await fill(page, '#setting-112', '0');
  const rows = () => page.$$eval('.settings [role=alert], .settings .changed', (found) => found.map((it) => it.textContent).join());
  await until(async () => (await rows()).includes('at least 0.'), 'a value out of range is refused', rows);
  await fill(page, '#setting-112', '3200');
  await until(async () => (await rows()).includes('was 3000.000'), 'the setting is changed', rows);
}

/** Touches the plate, which is 90 mm below the middle of the travel. */
async function probed(page) {
  await page.select('#probe-target', 'top');
  await fill(page, '#probe-search', '150');
  await fill(page, '#probe-feed', '3000');
  const hint = () => text(page, '.probe .hint');
  await until(async () => (await hint()).includes('Z -150.0 to +0.0'), 'the motion is told before', hint);
  check(await page.$eval('#probe', (button) => button.disabled), 'a probe that was not checked is not used');
  await click(page, '#probe-checked');
  await click(page, '#probe');
  await isState(page, 'Running');
  const note = () => text(page, '#note');
  await until(async () => (await note()).startsWith('zero at machine Z-'), 'the plate is found', async () => `${await note()} ${await seen(page)}`);
  await isState(page, 'Idle');
  await until(async () => Math.abs(parseFloat((await at(page)).split(',')[2]) - 2) < 0.1, 'zero is at the contact', () => seen(page));
  await click(page, '#read-tables');
  const system = () => page.$eval('input[aria-label="G54 Z"]', (field) => field.value).catch(() => '');
  await until(async () => Math.abs(parseFloat(await system()) + 90) < 2, 'G54 has it', system);
}

async function repeated(page) {
  await page.$eval('.macros details', (fold) => { fold.open = true; });
  await page.type('#macro-name', 'lift');
  await page.type('#macro-text', 'G21G90\nG0Z{height=3}');
  await press(page, 'Keep');
  await press(page, 'lift');
  const field = await page.waitForSelector('.macros > form input');
  await field.focus();
  await page.keyboard.press('Enter');
  await until(async () => (await at(page)).endsWith(',3.000') && await state(page) === 'Idle', 'the macro runs', () => seen(page));
  await press(page, 'Remove lift');
}

async function homed(page) {
  if (await state(page) !== 'Idle') await press(page, 'Unlock');
  await isState(page, 'Idle');
  await press(page, 'Home all axes');
  await isState(page, 'Homing');
  await isAt(page, '-1.000,-1.000,-1.000', 'machine');
  await press(page, 'Zero all axes');
  await isAt(page, '0.000,0.000,0.000');
  await choose(page, 10);
  await press(page, 'X− Y−');
  await press(page, 'Z−');
  await isAt(page, '-10.000,-10.000,-10.000');
  await press(page, 'Go to zero');
  await isAt(page, '0.000,0.000,0.000');
}

async function disconnected(page) {
  await click(page, '#connect');
  await isState(page, 'No machine');
  check(await page.$eval('#hold', (button) => button.disabled), 'nothing is held without a machine');
  await click(page, '#connect');
  await isState(page, 'Alarm: locked');
}

async function areas(page, browser) {
  await connected(page);
  await stepped(page);
  await heldInManyWays(page, browser);
  await wentToZero(page);
  await typed(page);
  await edited(page);
  await ran(page);
  await overridden(page);
  await configured(page);
  await probed(page);
  await repeated(page);
  await homed(page);
  await disconnected(page);
}

async function look(browser, address, screen, hands) {
  const { page, faults } = await openPage(browser, address, screen);
  try {
    await areas(page, browser);
    await day(page, hands, { measured: () => {}, hasBlock: true, feed: 5000 });
    const wide = await page.evaluate(() => document.documentElement.scrollWidth);
    check(wide <= screen.width, `the page is ${wide} pixels wide`);
    check(faults.length === 0, faults.join('\n'));
  } finally {
    await page.screenshot({ path: `control-${screen.width}-${screen.scheme}.png`, fullPage: true });
    await page.close();
  }
}

async function main() {
  const asked = [];
  const server = await serve(pageFile, asked);
  const browser = await browse();
  try {
    await look(browser, `http://127.0.0.1:${server.address().port}/`, { width: 1400, height: 900, scheme: 'light' }, MOUSE);
    await look(browser, pathToFileURL(pageFile).href, { width: 390, height: 844, scheme: 'dark' }, KEYBOARD);
    check(asked.length === 0, `the server is asked for ${asked}`);
  } finally {
    await browser.close();
    server.close();
  }
  return [0, 0, 0];
}

run(main);
