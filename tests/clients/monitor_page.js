/*
 * The page of `cargo xtask monitor` in a browser without a window: what it shows in the middle of a job and
 * at its end, and that it asks nobody else for anything.
 */

'use strict';

const {
  check, run, until,
} = require('./cncjs');
const { browse, newPage } = require('./browser');
const {
  FAST, GO_ON, SLOWLY, startJob,
} = require('./monitor');

// How far the machine goes on both axes, mm.
const REACH = 800;
// A line is 1.5 pixels wide, and its edges are blurred.
const PIXELS = 2;

/** What the page shows. */
function look(page) {
  return page.evaluate(() => ({
    at: document.body.dataset.at,
    link: document.getElementById('link').textContent,
    state: now.state || '', // eslint-disable-line no-undef
    cells: Array.from(document.querySelectorAll('td'), (cell) => cell.textContent),
    // A binding of the page's script.
    points: path.length, // eslint-disable-line no-undef
  }));
}

/** How far the drawn path reaches, mm: left, right, below, above. */
function reach(page) {
  return page.evaluate(() => {
    const canvas = document.getElementById('path');
    const { scale, left, bottom } = JSON.parse(canvas.dataset.view);
    const { width, height } = canvas;
    const { data } = canvas.getContext('2d').getImageData(0, 0, width, height);
    const [red, green, blue] = [0x18, 0x63, 0xad];
    const found = [Infinity, -Infinity, Infinity, -Infinity];
    for (let y = 0; y < height; y += 1) {
      for (let x = 0; x < width; x += 1) {
        const at = 4 * (y * width + x);
        const off = Math.abs(data[at] - red) + Math.abs(data[at + 1] - green)
          + Math.abs(data[at + 2] - blue);
        if (off < 40) {
          const [across, up] = [(x + 0.5 - left) / scale, (bottom - y - 0.5) / scale];
          found[0] = Math.min(found[0], across);
          found[1] = Math.max(found[1], across);
          found[2] = Math.min(found[2], up);
          found[3] = Math.max(found[3], up);
        }
      }
    }
    return { found, pixel: 1 / scale };
  });
}

async function watch(page, job, faults) {
  let shown;
  const seen = async (claim, what) => {
    await until(async () => {
      shown = await look(page);
      return claim(shown);
    }, what, () => JSON.stringify(shown));
  };
  await page.goto(`http://${job.address}/`);
  await seen(({ state }) => state.startsWith('Hold'), 'the job waits for the page');
  job.press(GO_ON);
  await seen(({ points, state }) => points > 1000 && state === 'Run', 'the path grows');
  job.press(SLOWLY);
  const before = shown.points;
  await page.reload();
  await seen(({ points }) => points >= before, 'the path is there again');
  check(shown.link === 'live', shown.link);
  job.press(FAST);
  await seen(({ link }) => link === 'ended', 'the job ends');
  await seen(({ at, state }) => at === '0,0,0' && state === 'Idle', 'the point is at the end');
  const zeros = ['0.000', '0.000', '0.000'];
  const [low, high] = [-REACH, REACH].map((value) => [value.toFixed(3), value.toFixed(3), '0.000']);
  check(shown.cells.join() === [...zeros, ...zeros, ...low, ...high].join(), shown.cells.join());
  const { found, pixel } = await reach(page);
  [-REACH, REACH, -REACH, REACH].forEach((wanted, index) => {
    const off = Math.abs(found[index] - wanted) / pixel;
    check(off <= PIXELS, `what is drawn is ${off} pixels off: ${found}`);
  });
  check(faults.length === 0, faults.join('\n'));
  await job.succeeds();
  return [0, 0, 0];
}

async function main() {
  const browser = await browse();
  const page = await newPage(browser);
  const job = await startJob(process.argv.slice(2));
  const faults = [];
  page.on('pageerror', (error) => faults.push(error.message));
  page.on('console', (message) => {
    if (message.type() === 'error') faults.push(message.text());
  });
  page.on('request', (request) => {
    if (new URL(request.url()).host !== job.address) faults.push(`asks for ${request.url()}`);
  });
  try {
    return await watch(page, job, faults);
  } finally {
    await page.screenshot({ path: 'page.png' });
    await browser.close();
  }
}

run(main);
