'use strict';

/*
 * cncjs' web page in a browser without a window: whatever is done is done with the page's widgets and
 * buttons, and whatever is checked is what the page shows.
 *
 * The page jogs with `G91`, `G0` and `G90`, holds and goes on with single bytes, and stops a paused
 * job with a reset.
 */

const fs = require('fs');
const path = require('path');

const puppeteer = require('puppeteer-core');

const {
  HOME, ORIGIN, check, delay, measured, run, serve, spiral, until,
} = require('./cncjs');

const port = process.argv[2];
const JOB = 'job.nc';

// Longest wait for a button that can be clicked: a guard, no measure.
const BUTTON_MS = 10000;

// How long the console may take to draw what is typed.
const DRAWN_MS = 500;

const CONNECTION = '[data-widget-id="connection"]';
const GRBL = '[data-widget-id="grbl"]';
const AXES = '[data-widget-id="axes"]';
const GCODE = '[data-widget-id="gcode"]';
const WORKFLOW = '[class*="workflow-control"]';

/** A folder with a `udevadm` that finds our port and no other: the server asks it for all ports. */
function portFinder() {
  const folder = path.resolve('bin');
  const entry = `P: /devices/virtual/tty/ttyS0\nN: ttyS0\nE: DEVNAME=${path.resolve(port)}\n`;
  fs.mkdirSync(folder);
  fs.writeFileSync('ports', entry);
  fs.writeFileSync(path.join(folder, 'udevadm'), `#!/bin/sh\ncat '${path.resolve('ports')}'\n`, {
    mode: 0o755,
  });
  return { PATH: `${folder}:${process.env.PATH}` };
}

/** A browser that sees nothing but this machine, and that ends with this script. */
function browse() {
  return puppeteer.launch({
    executablePath: process.env.CHROMIUM,
    pipe: true,
    userDataDir: path.resolve('profile'),
    defaultViewport: { width: 1600, height: 1800 },
    args: [
      // It opens one page, and that page is ours: root, and a container, can have no sandbox.
      '--no-sandbox',
      '--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1',
      '--disable-dev-shm-usage',
      // The page can do without its drawing, and processors would draw it here.
      '--disable-3d-apis',
    ],
  });
}

/** What a user does with the page, and what it shows. */
class Screen {
  constructor(page) {
    this.page = page;
  }

  async click(selector) {
    const options = { timeout: BUTTON_MS };
    const found = await this.page.waitForSelector(`${selector}:not([disabled])`, options);
    await found.click();
    await found.dispose();
  }

  /** The texts of all that a selector finds, without line breaks. */
  texts(selector) {
    return this.page.$$eval(selector, (found) => found.map(
      (element) => element.textContent.trim(),
    ));
  }

  async state() {
    const texts = await this.texts(`${GRBL} .row:has([title="State"]) [class*="well"]`);
    return texts[0];
  }

  /** The feed, spindle and rapid override. */
  async overrides() {
    return (await this.texts(`${GRBL} [class*="dro-display"]`)).join(' ');
  }

  async position(which) {
    const texts = await this.texts(`${AXES} td[class*="${which}-position"] > div:first-child`);
    return texts.map(Number);
  }

  async isState(state) {
    await until(async () => await this.state() === state, `the page shows ${state}`);
  }

  /** The machine is idle at a place, and the work position belongs to it. */
  async isIdleAt(machine, work) {
    await until(async () => {
      const positions = [await this.position('machine'), await this.position('work')];
      const shown = [await this.state(), ...positions];
      return JSON.stringify(shown) === JSON.stringify(['Idle', machine, work]);
    }, `the page shows Idle at ${machine}, ${work}`);
  }

  async showsOverrides(overrides) {
    await until(async () => await this.overrides() === overrides, `the overrides are ${overrides}`);
  }

  /** How many lines of the job are sent and received. */
  async lines() {
    const cells = await this.texts(`${GCODE} .col-xs-6 > div`);
    const after = (name) => cells[cells.indexOf(name) + 1];
    return { sent: after('Sent'), received: after('Received') };
  }

  /** Types a line into the console: what is sent is read from what has been drawn. */
  async type(line) {
    await this.click('[data-widget-id="console"] .xterm');
    await this.page.keyboard.type(line);
    await delay(DRAWN_MS);
    await this.page.keyboard.press('Enter');
  }
}

async function connect(screen) {
  // The page regrets that it has no WebGL.
  await screen.click('[class*="modal-footer"] button');
  await screen.click(`${CONNECTION} .Select:not(.is-disabled) .Select-control`);
  await screen.click(`${CONNECTION} .Select-option`);
  await screen.click(`${CONNECTION} button:has(.fa-toggle-off)`);
  await until(async () => /^[A-Z]/.test(await screen.state()), 'the page shows a state');
}

/** The jog buttons: 1 mm each way, and back to the origin of the work coordinates. */
async function jog(screen, [x, y, z]) {
  await screen.click('[title="Move X+"]');
  await screen.isIdleAt([x + 1, y, z], [1, 0, 10]);
  await screen.click('[title="Move X- Y+"]');
  await screen.isIdleAt([x, y + 1, z], [0, 1, 10]);
  await screen.click('[title="Move Z-"]');
  await screen.isIdleAt([x, y + 1, z - 1], [0, 1, 9]);
  await screen.click('[title="Move Z+"]');
  await screen.click('[title="Move To XY Zero (G0 X0 Y0)"]');
  await screen.isIdleAt([x, y, z], [0, 0, 10]);
}

async function load(screen, lines) {
  fs.writeFileSync(JOB, lines);
  const input = await screen.page.$(`${WORKFLOW} input[type=file]`);
  await input.uploadFile(JOB);
  await until(async () => /^0 \/ [1-9]/.test((await screen.lines()).sent), 'the job is loaded');
}

/** The buttons of the overrides: feed, rapid, spindle. */
async function override(screen) {
  const button = (axis, number) => `${GRBL} [class*="row"]:has(> .col-xs-1 [class*="dro-label"])`
    + `:nth-child(${axis}) button:nth-child(${number})`;
  const [feed, spindle, rapid] = [1, 2, 3];
  for (const [axis, number, shown] of [
    [feed, 4, '110% 100% 100%'],
    [feed, 2, '109% 100% 100%'],
    [rapid, 3, '109% 100% 25%'],
    [spindle, 1, '109% 90% 25%'],
    [rapid, 1, '109% 90% 100%'],
    [spindle, 5, '109% 100% 100%'],
  ]) {
    await screen.click(button(axis, number));
    await screen.showsOverrides(shown);
  }
}

/** A whole job, held by the buttons above the page and paused by those of the job. */
async function job(screen, place) {
  await screen.click(`${WORKFLOW} [title="Run"]`);
  await screen.isState('Run');
  await screen.click('[title="Feedhold"]');
  await screen.isState('Hold');
  await override(screen);
  await screen.click('[title="Cycle Start"]');
  await screen.isState('Run');
  await screen.click(`${WORKFLOW} [title="Pause"]`);
  await screen.isState('Hold');
  await screen.click(`${WORKFLOW} [title="Resume"]`);
  await screen.isState('Run');
  await until(async () => {
    const { sent, received } = await screen.lines();
    const [count, total] = received.split(' / ');
    return sent === received && count === total;
  }, 'every line is answered');
  // The page takes the job for finished: it could be closed.
  await screen.page.waitForSelector(`${WORKFLOW} [title="Close"]:not([disabled])`);
  await screen.isIdleAt(place, [0, 0, 10]);
}

/** Paused and stopped, which resets at rest; then reset in motion, and unlocked. */
async function stop(screen) {
  await screen.click(`${WORKFLOW} [title="Run"]`);
  await screen.isState('Run');
  await screen.click(`${WORKFLOW} [title="Pause"]`);
  await screen.isState('Hold');
  await screen.click(`${WORKFLOW} [title="Stop"]`);
  await screen.isState('Idle');
  await screen.click(`${WORKFLOW} [title="Run"]`);
  await screen.isState('Run');
  await screen.click('[title="Reset"]');
  await screen.isState('Alarm');
  await screen.click('[title="Unlock"]');
  await screen.isState('Idle');
}

async function drive(screen) {
  const origin = [ORIGIN.x, ORIGIN.y, ORIGIN.z];
  const work = (place) => place.map((value, axis) => value - origin[axis]);
  const start = [ORIGIN.x, ORIGIN.y, ORIGIN.z + 10];
  await connect(screen);
  await screen.click('[title="Homing"]');
  await screen.isIdleAt(HOME, HOME);
  await measured();
  await screen.type(`G10 L2 P1 X${ORIGIN.x} Y${ORIGIN.y} Z${ORIGIN.z}`);
  await screen.isIdleAt(HOME, work(HOME));
  await screen.type('G54 G0 X0 Y0 Z10');
  await screen.isIdleAt(start, [0, 0, 10]);

  await jog(screen, start);
  await load(screen, spiral(100));
  await job(screen, start);
  await stop(screen);

  const end = [-20, -30, -10];
  await screen.type(`G53 G0 X${end[0]} Y${end[1]} Z${end[2]}`);
  await screen.isIdleAt(end, work(end));
  await close(screen.page);
  return end;
}

// Closes the port. The page draws its buttons anew with every report, and a click on one that is
// being replaced is lost: it is pressed again.
async function close(page) {
  const isClosed = `${CONNECTION} button:has(.fa-toggle-off)`;
  for (let press = 0; press < 6; press += 1) {
    const button = await page.$(`${CONNECTION} button:has(.fa-toggle-on)`);
    if (button) await button.click().catch(() => {});
    const seen = await page.waitForSelector(isClosed, { timeout: 5000 }).catch(() => null);
    if (seen) return;
  }
  await page.waitForSelector(isClosed, { timeout: 5000 });
}

async function main() {
  const { number } = await serve(portFinder());
  const browser = await browse();
  const page = await browser.newPage();
  const faults = [];
  page.on('pageerror', (error) => faults.push(error.message));
  await page.goto(`http://127.0.0.1:${number}/`);
  let place;
  try {
    place = await drive(new Screen(page));
  } catch (error) {
    await page.screenshot({ path: 'page.png' });
    throw error;
  } finally {
    await browser.close();
  }
  check(faults.length === 0, faults.join('\n'));
  return place;
}

run(main);
