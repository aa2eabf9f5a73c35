/*
 * cncjs' web page in a browser without a window: whatever is done is done with the page's widgets and
 * buttons, and whatever is checked is what the page shows.
 *
 * The page jogs with `G91`, `G0` and `G90`, holds and goes on with single bytes, and stops a paused
 * job with a reset.
 */

'use strict';

const fs = require('fs');
const path = require('path');

const { browse, newPage } = require('./browser');
const {
  HOME, ORIGIN, TIMEOUT_MS, check, measured, run, serve, spiral, until,
} = require('./cncjs');

const port = process.argv[2];

// How long the console may take to draw what is typed, by the page's own clock.
const DRAWN_MS = 500;
// After how long a job that is still open is closed again.
const CLOSED_MS = 500;

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

/** What a user does with the page, and what it shows. */
class Screen {
  constructor(page) {
    this.page = page;
  }

  /** Clicks with the mouse: on what stays where it is. */
  async click(selector) {
    const found = await this.page.waitForSelector(selector, { timeout: TIMEOUT_MS });
    await found.click();
    await found.dispose();
  }

  /**
   * Presses a button that can be pressed, at once: the page draws its buttons anew with every report,
   * and the mouse might be pressed on one and released on another.
   */
  async press(selector) {
    await this.until(() => this.page.evaluate((button) => {
      const found = document.querySelector(button);
      if (found) found.click();
      return Boolean(found);
    }, `${selector}:not([disabled])`), `${selector} can be pressed`);
  }

  /** What the page shows now, in one go: it may be slow. */
  look() {
    return this.page.evaluate((grbl, axes, gcode) => {
      const texts = (selector) => Array.from(
        document.querySelectorAll(selector),
        (element) => element.textContent.trim(),
      );
      const place = (which) => texts(`${axes} td[class*="${which}-position"] > div:first-child`);
      const cells = texts(`${gcode} .col-xs-6 > div`);
      const after = (name) => cells[cells.indexOf(name) + 1];
      return {
        state: texts(`${grbl} .row:has([title="State"]) [class*="well"]`)[0],
        machine: place('machine').map(Number),
        work: place('work').map(Number),
        // Of feed, spindle and rapids.
        overrides: texts(`${grbl} [class*="dro-display"]`).join(' '),
        // Lines of the job.
        sent: after('Sent'),
        received: after('Received'),
      };
    }, GRBL, AXES, GCODE);
  }

  /** Waits until what the page shows is as claimed. */
  async until(claim, what) {
    let shown;
    await until(async () => {
      shown = await this.look();
      return claim(shown);
    }, what, () => JSON.stringify(shown));
  }

  async isState(wanted) {
    await this.until(({ state }) => state === wanted, `the page shows ${wanted}`);
  }

  /** The machine is idle at a place, and the work position belongs to it. */
  async isIdleAt(...places) {
    const wanted = JSON.stringify(['Idle', ...places]);
    await this.until(
      ({ state, machine, work }) => JSON.stringify([state, machine, work]) === wanted,
      `the page shows ${wanted}`,
    );
  }

  async showsOverrides(wanted) {
    await this.until(({ overrides }) => overrides === wanted, `the overrides are ${wanted}`);
  }

  /** Types a line into the console: what is sent is read from what has been drawn. */
  async type(line) {
    await this.click('[data-widget-id="console"] .xterm');
    await this.page.keyboard.type(line);
    // What the console has put off until then comes first, however long the page stands still.
    await this.page.evaluate((ms) => new Promise((drawn) => { setTimeout(drawn, ms); }), DRAWN_MS);
    await this.page.keyboard.press('Enter');
  }
}

async function connect(screen) {
  // The page regrets that it has no WebGL.
  await screen.click('[class*="modal-footer"] button');
  // Or it opens the port again by itself, when it has looked which ports there are after a close.
  const isAutomatic = `${CONNECTION} input[type="checkbox"]:checked`;
  await screen.press(isAutomatic);
  await screen.page.waitForSelector(isAutomatic, { hidden: true, timeout: TIMEOUT_MS });
  await screen.click(`${CONNECTION} .Select:not(.is-disabled) .Select-control`);
  await screen.click(`${CONNECTION} .Select-option`);
  await screen.click(`${CONNECTION} button:has(.fa-toggle-off)`);
  await screen.until(({ state }) => /^[A-Z]/.test(state), 'the page shows a state');
}

/** The jog buttons: 1 mm each way, and back to the origin of the work coordinates. */
async function jog(screen, [x, y, z]) {
  await screen.press('[title="Move X+"]');
  await screen.isIdleAt([x + 1, y, z], [1, 0, 10]);
  await screen.press('[title="Move X- Y+"]');
  await screen.isIdleAt([x, y + 1, z], [0, 1, 10]);
  await screen.press('[title="Move Z-"]');
  await screen.isIdleAt([x, y + 1, z - 1], [0, 1, 9]);
  await screen.press('[title="Move Z+"]');
  await screen.press('[title="Move To XY Zero (G0 X0 Y0)"]');
  await screen.isIdleAt([x, y, z], [0, 0, 10]);
}

/** Loads a job; the page does not load the same file twice. */
async function load(screen, name, lines) {
  fs.writeFileSync(name, lines);
  const input = await screen.page.$(`${WORKFLOW} input[type=file]`);
  await input.uploadFile(name);
  await screen.until(({ sent }) => /^0 \/ [1-9]/.test(sent), 'the job is loaded');
}

/** Closes the job. The page does not where it believes that the job still runs or is paused: it is asked again. */
async function unload(screen) {
  await screen.press(`${WORKFLOW} [title="Close"]`);
  await until(async () => {
    await new Promise((passed) => { setTimeout(passed, CLOSED_MS); });
    const { sent } = await screen.look();
    if (!/[1-9]/.test(sent)) return true;
    const close = await screen.page.$(`${WORKFLOW} [title="Close"]:not(:disabled)`);
    if (close) await close.evaluate((button) => button.click());
    return false;
  }, 'the job is closed');
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
    await screen.press(button(axis, number));
    await screen.showsOverrides(shown);
  }
}

/** A job, held by the buttons above the page and paused by those of the job. */
async function hold(screen) {
  await screen.press(`${WORKFLOW} [title="Run"]`);
  await screen.isState('Run');
  await screen.press('[title="Feedhold"]');
  await screen.isState('Hold');
  await override(screen);
  await screen.press('[title="Cycle Start"]');
  await screen.isState('Run');
  await screen.press(`${WORKFLOW} [title="Pause"]`);
  await screen.isState('Hold');
  await screen.press(`${WORKFLOW} [title="Resume"]`);
  await screen.isState('Run');
}

/** A job that runs is paused and stopped, which resets at rest; run again, reset, and unlocked. */
async function stop(screen) {
  await screen.press(`${WORKFLOW} [title="Pause"]`);
  await screen.isState('Hold');
  await screen.press(`${WORKFLOW} [title="Stop"]`);
  await screen.isState('Idle');
  await screen.press(`${WORKFLOW} [title="Run"]`);
  await screen.isState('Run');
  await screen.press('[title="Reset"]');
  await screen.isState('Alarm');
  await screen.press('[title="Unlock"]');
  await screen.isState('Idle');
}

/** A whole job: it can be closed when every line is answered. */
async function finish(screen, place) {
  await screen.press(`${WORKFLOW} [title="Run"]`);
  await screen.isState('Run');
  await screen.isIdleAt(place, [0, 0, 10]);
  await unload(screen);
}

async function drive(screen) {
  const origin = [ORIGIN.x, ORIGIN.y, ORIGIN.z];
  const work = (place) => place.map((value, axis) => value - origin[axis]);
  const start = [ORIGIN.x, ORIGIN.y, ORIGIN.z + 10];
  await connect(screen);
  await screen.press('[title="Homing"]');
  await screen.isIdleAt(HOME, HOME);
  await measured();
  await screen.type(`G10 L2 P1 X${ORIGIN.x} Y${ORIGIN.y} Z${ORIGIN.z}`);
  await screen.isIdleAt(HOME, work(HOME));
  await screen.type('G54 G0 X0 Y0 Z10');
  await screen.isIdleAt(start, [0, 0, 10]);

  await jog(screen, start);
  // The page may be slow, and the machine must move as long as it takes: that job is never at its end.
  await load(screen, 'endless.nc', spiral(2000, 700));
  await hold(screen);
  await stop(screen);
  await unload(screen);
  await load(screen, 'job.nc', spiral(200));
  await finish(screen, start);

  const end = [-20, -30, -10];
  await screen.type(`G53 G0 X${end[0]} Y${end[1]} Z${end[2]}`);
  await screen.isIdleAt(end, work(end));
  await close(screen);
  return end;
}

/** Closes the port. */
async function close(screen) {
  await screen.press(`${CONNECTION} button:has(.fa-toggle-on)`);
  const isClosed = `${CONNECTION} button:has(.fa-toggle-off)`;
  await screen.page.waitForSelector(isClosed, { timeout: TIMEOUT_MS });
}

async function main() {
  const { number } = await serve(portFinder());
  const browser = await browse();
  const page = await newPage(browser);
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
