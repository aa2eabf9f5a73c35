/*
 * The page of `cargo xtask monitor` while a job is sent whose path is known in advance, in a browser without a
 * window, as wide as a screen and as a phone: the path that comes, where the machine is, what is left, and
 * what a page shows that is loaded again in the middle.
 */

'use strict';

const fs = require('fs');

const { check, run, until } = require('./cncjs');
const { browse, newPage } = require('./browser');
const { FAST, GO_ON, HOLD, SLOWLY, startJob } = require('./monitor');

const SIZES = [{ width: 1400, height: 900 }, { width: 390, height: 800 }];
// The machine is asked ten times a second, and tells each step besides: the marker of the job is as near, mm.
const NEAR_MM = 0.2;

/** What the page shows. */
function look(page) {
  return page.evaluate(() => {
    const { view } = window;
    const text = (id) => document.getElementById(id).textContent;
    return {
      isReady: document.body.dataset.ready === 'yes',
      link: text('link'),
      state: now.state, // eslint-disable-line no-undef
      left: text('left'),
      // Bindings of the page's script.
      points: path.length, // eslint-disable-line no-undef
      at: now.at, // eslint-disable-line no-undef
      job: now.job, // eslint-disable-line no-undef
      time: view && view.now,
      end: view && view.path.end,
      pieces: view && view.path.pieces,
      drawn: view && view.scene.drawn,
      tip: view && view.scene.tip,
      line: view && view.listing.current,
    };
  });
}

async function seen(page, claim, what) {
  let shown;
  await until(async () => {
    shown = await look(page);
    return shown.isReady && claim(shown);
  }, what, () => JSON.stringify(shown));
  return shown;
}

/** The machine is on the path of the job, and the page shows where. The job waits for pages that draw slowly. */
async function followed(page, job) {
  await seen(page, ({ pieces, drawn }) => pieces > 100 && drawn === pieces, 'the job is drawn');
  job.press(GO_ON);
  const isMoving = ({ state, job: at, time }) => state === 'Run' && at && at.is_on_path && at.time_s > 1 && time > 1;
  const shown = await seen(page, isMoving, 'the job is followed');
  check(Math.abs(shown.job.time_s + shown.job.left_s - shown.end) < 0.01, JSON.stringify(shown.job));
  // Both in one frame, as the next event may come between.
  const { far, line, wanted } = await page.evaluate(() => {
    draw(); // eslint-disable-line no-undef
    const { view } = window;
    view.scene.render();
    const place = view.path.at(view.now).xyz;
    return {
      far: Math.hypot(...place.map((value, axis) => value - now.at[axis])), // eslint-disable-line no-undef
      line: view.listing.current,
      wanted: view.path.at(view.now).line,
    };
  });
  check(far <= NEAR_MM, `the job's marker is ${far} mm from the machine`);
  check(line === wanted && line > 0, `line ${line}, not ${wanted}`);
  job.press(HOLD);
  return shown;
}

/** Who goes to another time stays there until he wants to follow again. */
async function left(page) {
  await page.evaluate(() => {
    const slider = document.getElementById('slider');
    slider.value = 0.5;
    slider.dispatchEvent(new Event('input'));
  });
  const pressed = (value) => page.evaluate((wanted) => (
    document.getElementById('follow').getAttribute('aria-pressed') === wanted), value);
  await until(() => pressed('false'), 'another time is shown');
  check(await page.evaluate(() => window.view.now === 0.5), 'the time that was chosen stays');
  await page.click('#follow');
  await until(() => pressed('true'), 'the machine is followed again');
  await seen(page, ({ time }) => time > 0.5, 'the time is that of the machine');
}

async function turned(page) {
  await page.focus('#stage');
  await page.keyboard.press('ArrowLeft');
  const yaw = () => page.evaluate(() => window.view.scene.camera.yaw);
  const before = await yaw();
  await page.keyboard.press('ArrowLeft');
  check(await yaw() !== before, 'an arrow turns');
  await page.click('[data-view=top]');
  check(await page.evaluate(() => window.view.scene.camera.pitch === Math.PI / 2), 'it is seen from above');
}

async function open(browser, size, address, faults) {
  const page = await newPage(browser);
  await page.setViewport(size);
  page.on('pageerror', (error) => faults.push(error.message));
  page.on('console', (message) => faults.push(`${message.type()}: ${message.text()}`));
  page.on('request', (request) => {
    if (new URL(request.url()).host !== address) faults.push(`asks for ${request.url()}`);
  });
  await page.goto(`http://${address}/`);
  return page;
}

async function watch(pages, job, faults) {
  for (const page of pages) {
    await page.bringToFront();
    const before = await followed(page, job);
    await page.reload();
    const after = await followed(page, job);
    check(after.time >= before.time, `the time is ${after.time} s after ${before.time} s`);
    check(after.points > 10 && after.line >= before.line, JSON.stringify(after));
    await left(page);
    await turned(page);
    const { width } = page.viewport();
    const wide = await page.evaluate(() => document.documentElement.scrollWidth);
    check(wide <= width, `the page is ${wide} pixels wide`);
    await page.screenshot({ path: `live-${width}.png` });
  }
  job.press(FAST + GO_ON);
  for (const page of pages) {
    await page.bringToFront();
    // What comes last is drawn a frame later.
    const isAtEnd = ({ left: text, state, time, end }) => text === 'done' && state === 'Idle' && time === end;
    await seen(page, (now) => now.link === 'ended' && isAtEnd(now), 'the job ends');
  }
  check(faults.length === 0, faults.join('\n'));
  await job.succeeds();
  return [0, 0, 0];
}

/** A job that ends in an alarm: the page tells its line, what it means and what to do. */
async function alarmed(browser, [monitor, simulator], faults) {
  fs.writeFileSync('far.nc', 'G4 P9\nG1 X-1 F600\nX250\nX-2\n');
  fs.writeFileSync('limits.settings', '$22=1\n$20=1\n');
  const job = await startJob([monitor, simulator, 'far.nc', 'limits.settings'], '$X\n');
  const page = await open(browser, SIZES[1], job.address, faults);
  const told = () => page.evaluate(() => document.getElementById('alarm').textContent);
  const expected = 'line 3 (X250): ALARM:2, the target is outside the machine\'s travel (X 250.000 ';
  await until(async () => (await told()).startsWith(expected), 'the alarm is told', told);
  check((await told()).includes('): reset, home or unlock with $X'), await told());
  await page.screenshot({ path: 'live-alarm.png' });
  check(faults.length === 0, faults.join('\n'));
}

async function main() {
  const browser = await browse('drawing');
  const faults = [];
  try {
    const job = await startJob(process.argv.slice(2));
    job.press(SLOWLY);
    const pages = [];
    for (const size of SIZES) pages.push(await open(browser, size, job.address, faults));
    const verdict = await watch(pages, job, faults);
    await alarmed(browser, process.argv.slice(2), faults);
    return verdict;
  } finally {
    await browser.close();
  }
}

run(main);
