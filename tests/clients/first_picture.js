/*
 * How soon the path of a long job is seen: the size of its page, and the time of the processor until the page has drawn
 * its first picture, by the clock of its thread. Five times as many lines take no more than eight times as long.
 *
 * Its arguments are the program that makes such pages, the settings of the machine, the example, and the pages of the
 * project, whose sizes are told. The table is left in figures.md.
 */

'use strict';

const { execFileSync } = require('child_process');
const fs = require('fs');
const { pathToFileURL } = require('url');

const { check, run } = require('./cncjs');
const { browse, newPage } = require('./browser');

const [, , view, settings, example, ...pages] = process.argv;

const LINES = [200000, 1000000];
const MOST_RATIO = 8;
const MB = 1e6;

/** A relief: the lines of docs/view.md. */
function relief(count) {
  const row = (k) => {
    const [r, rest] = [Math.floor(k / 400), k % 400];
    const x = r % 2 ? 399 - rest : rest;
    return `G1X${(x / 4).toFixed(3)}Y${(r / 4).toFixed(3)}Z${(Math.sin(x / 20) * Math.cos(r / 15) - 2).toFixed(3)}`;
  };
  const name = `relief-${count}.nc`;
  fs.writeFileSync(name, ['G21G90', 'G1F3000', ...Array.from({ length: count }, (_, k) => row(k)), ''].join('\n'));
  return name;
}

/** The size of the page of a program, MB, and the time of the processor until its first picture, s. */
async function measured(browser, program) {
  const file = `${program.split('/').pop()}.html`;
  execFileSync(view, ['view', program, '--settings', settings, '--output', file], { stdio: 'ignore' });
  const page = await newPage(browser);
  const session = await page.createCDPSession();
  await session.send('Performance.enable', { timeDomain: 'threadTicks' });
  await page.goto(pathToFileURL(file), { timeout: 0 });
  await page.waitForFunction(() => document.body.dataset.ready === 'yes', { timeout: 0 });
  await page.evaluate(() => new Promise((drawn) => {
    requestAnimationFrame(() => requestAnimationFrame(drawn));
  }));
  const { metrics } = await session.send('Performance.getMetrics');
  await page.close();
  const seconds = metrics.find(({ name }) => name === 'TaskDuration').value;
  check(seconds > 0, 'the thread of the page has worked');
  return { size: fs.statSync(file).size / MB, seconds };
}

async function main() {
  const browser = await browse('drawing');
  const rows = pages.map((page) => `| \`${page.split('/').pop()}\` | | ${(fs.statSync(page).size / MB).toFixed(2)} | |`);
  const times = [];
  try {
    for (const [program, count] of [[example, 0], ...LINES.map((lines) => [relief(lines), lines])]) {
      const { size, seconds } = await measured(browser, program);
      const name = count ? 'the relief' : `\`${program.split('/').pop()}\``;
      const lines = count || fs.readFileSync(program, 'utf8').trim().split('\n').length;
      rows.push(`| ${name} | ${lines.toLocaleString('en').replace(/,/g, ' ')} | ${size.toFixed(2)} | ${seconds.toFixed(1)} |`);
      if (count) times.push(seconds);
    }
  } finally {
    await browser.close();
  }
  check(times[1] < MOST_RATIO * times[0], `${times} s for ${LINES} lines`);
  const head = ['| page | lines | MB | s of the processor until the first picture |', '|---|---|---|---|'];
  fs.writeFileSync('figures.md', `\n${[...head, ...rows].join('\n')}\n\n`);
  return [0, 0, 0];
}

run(main);
