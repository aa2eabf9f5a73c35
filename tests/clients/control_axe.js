/*
 * What axe-core finds at the control page, in its main states, light and dark, from the width of a phone to that of a
 * large screen: nothing of weight "serious" or more.
 *
 * Its argument is the page.
 */

'use strict';

const fs = require('fs');

const { check, run, until } = require('./cncjs');
const { browse } = require('./browser');
const {
  click, isState, openFile, press, state, text,
} = require('./control/operator');
const connections = require('./control/connections');

const [, , pageFile] = process.argv;

const AXE = fs.readFileSync(require.resolve('axe-core/axe.min.js'), 'utf8');
const WIDTHS = [390, 768, 1400, 2560];
const SERIOUS = ['serious', 'critical'];
const NAME = 'axe.nc';
const PROGRAM = 'G21 G90\nT1 M6\nM3 S1000\nG1 X20 F120\nX0\nM5\n';

/** What is found in a frame. */
async function found(frame) {
  await frame.evaluate(AXE);
  const violations = await frame.evaluate(async () => {
    const results = await window.axe.run(document, { iframes: false, resultTypes: ['violations'] });
    return results.violations.map(({ id, impact, help, nodes }) => ({
      id, impact, help, where: nodes.slice(0, 3).map(({ target, failureSummary }) => `${target.join()}: ${failureSummary}`),
    }));
  });
  return violations.filter(({ impact }) => SERIOUS.includes(impact));
}

/** Looks at the page as it is, in each width and scheme. */
async function look(page, name, faults) {
  for (const scheme of ['light', 'dark']) {
    await page.emulateMediaFeatures([{ name: 'prefers-color-scheme', value: scheme }]);
    for (const width of WIDTHS) {
      await page.setViewport({ width, height: 900 });
      for (const frame of page.frames()) {
        for (const { id, impact, help, where } of await found(frame)) {
          faults.push(`${name}, ${scheme}, ${width} px: ${id} (${impact}), ${help}\n  ${where.join('\n  ')}`);
        }
      }
      const wide = await page.evaluate(() => document.documentElement.scrollWidth);
      if (wide > width) faults.push(`${name}, ${scheme}: the page is ${wide} px wide of ${width} px`);
    }
  }
}

async function opened(page) {
  await page.$$eval('details', (folds) => folds.forEach((fold) => { fold.open = true; }));
}

async function watch(connection, faults) {
  const { page } = connection;
  await look(page, 'not connected', faults);
  await connections.connect(connection);
  await look(page, 'locked', faults);
  await press(page, 'Unlock');
  await isState(page, 'Idle');
  await click(page, '#read-settings');
  await until(() => page.$('#setting-798'), 'the settings are read');
  await click(page, '#read-tables');
  await until(() => page.$('input[aria-label="G54 Z"]'), 'the tables are read');
  fs.writeFileSync(NAME, PROGRAM);
  await openFile(page, NAME);
  await opened(page);
  await look(page, 'idle, with everything', faults);
  await click(page, '#run');
  await until(async () => (await state(page)) !== 'Idle' && (await text(page, '#job')).length > 0, 'the job begins');
  await look(page, 'a change of the tool', faults);
  await until(async () => {
    if (await state(page) === 'Running') return true;
    await click(page, '#resume');
    return false;
  }, 'the job runs');
  await look(page, 'running', faults);
}

async function main() {
  const browser = await browse();
  const faults = [];
  const connection = await connections.virtual(browser, pageFile);
  try {
    await watch(connection, faults);
  } finally {
    await connection.page.screenshot({ path: 'axe.png', fullPage: true });
    await browser.close();
    connection.close();
  }
  check(connection.faults.length === 0, connection.faults.join('\n'));
  check(faults.length === 0, [...new Set(faults)].join('\n'));
  return [0, 0, 0];
}

run(main);
