/*
 * The pictures of docs/control.md: the control page with a job in it, its areas one by one, and a phone.
 *
 * Its arguments are the page, and the program that is shown.
 */

'use strict';

const fs = require('fs');
const path = require('path');

const { check, run, until } = require('./cncjs');
const { browse } = require('./browser');
const {
  at, click, delay, enter, isState, openFile, press, seen, state,
} = require('./control/operator');
const connections = require('./control/connections');

const [, , pageFile, , , , program] = process.argv;

// A picture in the documents is no larger, bytes.
const MOST_BYTES = 100000;
const QUALITY = 60;
// For how long the job has been cutting.
const CUT_MS = 8000;

async function take(page, name, selector) {
  const area = selector ? await page.$(selector) : page;
  check(area, `there is ${selector}`);
  const file = `control-${name}.webp`;
  await area.screenshot({ path: file, type: 'webp', quality: QUALITY });
  const { size } = fs.statSync(file);
  check(size <= MOST_BYTES, `${file} has ${size} bytes`);
}

/** A job under connection, somewhere in its middle. */
async function cutting(page) {
  await connections.connect({ page, connect: () => click(page, '#connect') });
  await press(page, 'Home all axes');
  await isState(page, 'Idle');
  await enter(page, '$J=G53G90G21X-150Y-150Z-100F5000');
  await until(async () => await at(page, 'machine') === '-150.000,-150.000,-100.000', 'it is there');
  await press(page, 'Zero all axes');
  const name = path.basename(program);
  fs.copyFileSync(program, name);
  await openFile(page, name);
}

async function shown(browser) {
  const connection = await connections.virtual(browser, pageFile, { width: 1400, height: 900, scheme: 'light' });
  const { page } = connection;
  try {
    await cutting(page);
    await click(page, '#run');
    await until(async () => await state(page) === 'Running' && parseFloat((await at(page)).split(',')[2]) < 0, 'it cuts', () => seen(page));
    await delay(CUT_MS);
    await page.evaluate(() => window.scrollTo(0, 0));
    await take(page, 'page');
    for (const area of ['state', 'jog', 'setup', 'probe', 'program']) await take(page, area, `section.${area}`);
    await page.setViewport({ width: 390, height: 844 });
    await page.evaluate(() => window.scrollTo(0, 0));
    await take(page, 'phone');
  } finally {
    await page.close();
    connection.close();
  }
}

async function main() {
  const browser = await browse('drawing');
  try {
    await shown(browser);
  } finally {
    await browser.close();
  }
  return [0, 0, 0];
}

run(main);
