/* What an operator does at the control page, and what the page shows. */

'use strict';

const { until } = require('../cncjs');
const { newPage } = require('../browser');

const delay = (ms) => new Promise((resolve) => setTimeout(resolve, ms));

/** What stands somewhere; nothing where that is not there. */
const text = (page, selector) => page.evaluate((wanted) => document.querySelector(wanted)?.textContent ?? '', selector);
const state = (page) => text(page, '#state');
const at = (page, kind = 'work') => page.$$eval(`.readout .${kind}`, (cells) => cells.map((cell) => cell.textContent).join());
const seen = async (page) => `${await state(page)} ${await at(page)}`;

const isState = (page, wanted) => until(async () => await state(page) === wanted, `the state is ${wanted}`, () => seen(page));
const isAt = (page, wanted, kind = 'work') => until(
  async () => await state(page) === 'Idle' && await at(page, kind) === wanted,
  `the machine stands at ${wanted}`,
  () => seen(page),
);

/** Clicks what is not below the bar with hold and resume. */
async function clickOn(element) {
  await element.evaluate((found) => found.scrollIntoView({ block: 'center' }));
  await element.click();
}

/** Waits for what `find` finds. */
async function awaited(page, find, what) {
  let element = null;
  await until(async () => {
    element = await find();
    return element !== null;
  }, what, () => seen(page));
  return element;
}

/** Waits until something can be pressed. */
const pressable = (page, selector) => awaited(page, () => page.$(`${selector}:not(:disabled)`), `${selector} can be pressed`);

/** Waits for a button with a name. */
const named = (page, name) => awaited(page, async () => {
  const button = await page.evaluateHandle((wanted) => [...document.querySelectorAll('button')].find(
    (one) => (one.getAttribute('aria-label') ?? one.textContent) === wanted,
  ), name);
  return button.asElement();
}, `there is a button ${name}`);

const click = async (page, selector) => clickOn(await pressable(page, selector));

/** Presses a button by its name. */
async function press(page, name) {
  const button = await named(page, name);
  await until(() => button.evaluate((it) => !it.disabled), `${name} can be pressed`, () => seen(page));
  await clickOn(button);
}

const choose = (page, step) => click(page, `input[name=step][value="${step}"]`);
const jogs = (page) => page.$$eval('#log .sent code', (lines) => lines.filter((line) => line.textContent.startsWith('$J=')).length);

/** Types a value in place of another one, and leaves the field. */
async function fill(page, selector, value) {
  await awaited(page, () => page.$(selector), `${selector} is there`);
  await page.$eval(selector, (field) => {
    const fold = field.closest('details');
    if (fold) fold.open = true;
  });
  await page.focus(selector);
  await page.$eval(selector, (field) => field.select());
  await page.keyboard.type(value);
  await page.keyboard.press('Tab');
}

/** Types a line into the console. */
async function enter(page, line) {
  await fill(page, '#line', line);
  await page.focus('#line');
  await page.keyboard.press('Enter');
}

/** Opens a program by its file. */
async function openFile(page, file) {
  await (await page.$('#file')).uploadFile(file);
  await until(async () => (await text(page, '#run')).startsWith(`Run ${file} from line`), 'the program is taken', () => text(page, '#run'));
}

/** Opens the page at an address, and keeps what goes wrong in it, and what it asks others for. */
async function openPage(browser, address, { width, height, scheme }, prepare = () => {}) {
  const page = await newPage(browser);
  await page.setViewport({ width, height });
  await page.emulateMediaFeatures([{ name: 'prefers-color-scheme', value: scheme }]);
  const faults = [];
  page.on('pageerror', (error) => faults.push(error.message));
  page.on('console', (message) => faults.push(`${message.type()}: ${message.text()}`));
  page.on('request', (request) => {
    const url = request.url();
    const isOwn = url === address || url.startsWith('blob:') || url.startsWith('data:');
    if (!isOwn && new URL(url).origin !== new URL(address).origin) faults.push(`asks for ${url}`);
  });
  await prepare(page);
  await page.goto(address);
  await until(() => page.evaluate(() => document.body.dataset.ready === 'yes'), 'the page is there', () => faults.join());
  return { page, faults };
}

module.exports = {
  at, choose, click, clickOn, delay, enter, fill, isAt, isState, jogs, named, openFile, openPage, press, pressable, seen,
  state, text,
};
