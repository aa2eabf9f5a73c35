/*
 * The page of `cargo xtask view` in a browser without a window, as wide as a screen and as a phone: what it
 * draws, that pointer, program and slider find each other, and that it asks nobody for anything.
 *
 * Its arguments are the page, and the step trace of the same program by `cargo xtask sim --trace`.
 */

'use strict';

const fs = require('fs');
const { pathToFileURL } = require('url');

const { check, run, until } = require('./cncjs');
const { browse, newPage } = require('./browser');

const [, , pageFile, traceFile] = process.argv;
const SIZES = [{ width: 1400, height: 900 }, { width: 390, height: 800 }];
// The path of the page is so near to the steps, mm, beyond one of them.
const NEAR_MM = 0.01;
// A segment of motion is no longer, ns.
const SEGMENT_NS = 1.5e6;

/** Time, ns from the first step, and steps of each axis. */
function readTrace() {
  const rows = fs.readFileSync(traceFile, 'utf8').trim().split('\n').slice(1);
  return rows.map((row) => row.split(',').map(Number));
}

/** How far a place is from where the steps are around a time, mm beyond a step. */
function off(trace, scales, seconds, place) {
  const ns = seconds * 1e9;
  const near = (row) => {
    const axes = row.slice(1).map((steps, axis) => Math.abs(steps / scales[axis] - place[axis]) - 1 / scales[axis]);
    return Math.max(0, ...axes);
  };
  let [before, least] = [trace[0], Infinity];
  for (const row of trace) {
    // The page's time begins with the first segment, up to one before the first step.
    if (row[0] > ns + 2 * SEGMENT_NS) break;
    if (row[0] >= ns - 2 * SEGMENT_NS) least = Math.min(least, near(row));
    before = row;
  }
  return Math.min(least, near(before));
}

/** Places on the screen at which one feed move lies alone, with its line. */
function lonely(page, most) {
  return page.evaluate((count) => {
    const { scene, path } = window.view;
    const found = [];
    for (let piece = 0; piece < path.pieces && found.length < count; piece += 1) {
      const [a, b] = [piece, piece + 1].map((row) => scene.project(path.xyz.subarray(3 * row, 3 * row + 3)));
      const [x, y] = [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2];
      const isLong = path.kind[piece] === 2 && Math.hypot(b[0] - a[0], b[1] - a[1]) > 3;
      const line = path.line[piece];
      const around = [[0, 0], [0, 8], [0, -8], [8, 0], [-8, 0]].map(([dx, dy]) => scene.pick(x + dx, y + dy, 14));
      const isAlone = around.every((hit) => hit && path.line[hit.piece] === line);
      const { left, top } = scene.stage.getBoundingClientRect();
      const isInside = x > 0 && y > 0 && x < scene.size[0] && y < scene.size[1];
      const there = isInside && document.elementFromPoint(left + x, top + y);
      const isFree = there && there.closest('#stage') && !there.closest('.over');
      if (isLong && isAlone && isFree && !found.some((other) => other.line === line)) {
        found.push({ line, x: left + x, y: top + y });
      }
    }
    return found;
  }, most);
}

/** What of the picture is not empty, pixels. */
function lit(page) {
  return page.evaluate(() => {
    const { canvas } = window.view.scene;
    const copy = document.createElement('canvas');
    [copy.width, copy.height] = [canvas.width, canvas.height];
    const context = copy.getContext('2d');
    context.drawImage(canvas, 0, 0);
    const { data } = context.getImageData(0, 0, copy.width, copy.height);
    let count = 0;
    for (let at = 3; at < data.length; at += 4) count += data[at] > 0;
    return count;
  });
}

async function drawn(page) {
  const seen = await page.evaluate(() => {
    const { scene, path, facts } = window.view;
    scene.render();
    return { drawn: scene.drawn, pieces: path.pieces, vertices: facts.path.vertices, moving: path.feeds + path.rapids };
  });
  check(seen.drawn === seen.pieces && seen.pieces === seen.vertices - 1, JSON.stringify(seen));
  check(seen.moving > 0.9 * seen.pieces, JSON.stringify(seen));
  const pixels = await lit(page);
  check(pixels > 500, `${pixels} pixels are drawn`);
}

async function pointed(page, size) {
  // On a phone, lines lie apart when one comes nearer.
  await page.evaluate((factor) => {
    window.view.scene.camera.scale(factor);
    window.view.scene.render();
  }, 1400 / size.width);
  const places = await lonely(page, 5);
  check(places.length >= 3, `${places.length} lines lie alone`);
  for (const { line, x, y } of places) {
    await page.mouse.move(x - 2, y - 2);
    await page.mouse.move(x, y);
    const seen = () => page.evaluate(() => ({
      tip: document.getElementById('tip').hidden ? '' : document.getElementById('tip').textContent,
      line: document.getElementById('line').textContent,
      hovered: window.view.hovered,
    }));
    let shown;
    await until(async () => {
      shown = await seen();
      return shown.hovered === line;
    }, `the pointer finds line ${line}`, () => JSON.stringify(shown));
    check(shown.tip.startsWith(`${line}: G`) && shown.tip.includes('mm/min'), shown.tip);
    check(shown.line.startsWith(`line ${line}, `) && shown.line.includes('programmed'), shown.line);
    await page.mouse.click(x, y);
    await until(() => page.evaluate((wanted) => window.view.listing.current === wanted, line), `a click chooses line ${line}`);
  }
}

/** A line of the program finds its piece. */
async function listed(page) {
  const { line, x, y } = await page.evaluate(() => {
    const { listing, path } = window.view;
    listing.element.scrollTop = 0;
    listing.element.scrollIntoView({ block: 'center' });
    listing.render();
    const row = [...listing.made.values()].find(({ dataset }) => path.first[dataset.line] >= 0);
    const { left, top, height } = row.getBoundingClientRect();
    return { line: Number(row.dataset.line), x: left + 80, y: top + height / 2 };
  });
  await page.mouse.move(x, y - 1);
  await page.mouse.move(x, y);
  await until(() => page.evaluate((wanted) => {
    const { scene, path } = window.view;
    return scene.chosen.some(({ first, line: chosen }) => chosen === wanted && first === path.first[wanted]);
  }, line), `line ${line} is highlighted`);
  await page.mouse.click(x, y);
  await until(() => page.evaluate((wanted) => {
    const { path, now } = window.view;
    return now === path.time[path.first[wanted]];
  }, line), `the time is that of line ${line}`);
  await page.evaluate(() => window.scrollTo(0, 0));
}

async function played(page, trace) {
  const { end, scales } = await page.evaluate(() => ({
    end: window.view.path.end,
    scales: window.view.facts.axes.map(({ scale }) => scale),
  }));
  for (let part = 0; part <= 20; part += 1) {
    const tip = await page.evaluate((time) => {
      const slider = document.getElementById('slider');
      slider.value = time;
      slider.dispatchEvent(new Event('input'));
      window.view.scene.render();
      return { tip: window.view.scene.tip, now: window.view.now };
    }, end * part / 20);
    const far = off(trace, scales, tip.now, tip.tip);
    check(far <= NEAR_MM, `the marker is ${far} mm off at ${tip.now} s`);
  }
  await page.evaluate(() => window.view.setTime(0));
  await page.click('#play');
  await until(() => page.evaluate(() => window.view.now > 0), 'the job is played');
  await page.click('#play');
  check(await page.evaluate(() => !window.view.isPlaying), 'it pauses');
}

async function typed(page) {
  await page.focus('#stage');
  await page.keyboard.press('2');
  check(await page.evaluate(() => window.view.scene.camera.pitch === Math.PI / 2), 'from above');
  await page.keyboard.press('ArrowUp');
  check(await page.evaluate(() => window.view.scene.camera.pitch < Math.PI / 2), 'an arrow turns');
  await page.keyboard.press('1');
  await page.focus('#program');
  await page.keyboard.press('Home');
  await page.keyboard.press('ArrowDown');
  check(await page.evaluate(() => window.view.listing.current === 2), 'an arrow goes to the next line');
  for (const [value] of await page.evaluate(() => window.view.curves.choices())) {
    await page.select('#what', value);
    await page.evaluate(() => window.view.curves.render());
  }
  for (const tab of ['job', 'settings', 'program']) {
    await page.click(`#tab-${tab}`);
    check(await page.evaluate((id) => document.getElementById(id).clientHeight > 100, tab), tab);
  }
}

async function look(browser, size, trace) {
  const page = await newPage(browser);
  await page.setViewport(size);
  const faults = [];
  page.on('pageerror', (error) => faults.push(error.message));
  page.on('console', (message) => faults.push(`${message.type()}: ${message.text()}`));
  page.on('request', (request) => {
    if (!request.url().startsWith('file:')) faults.push(`asks for ${request.url()}`);
  });
  try {
    await page.goto(pathToFileURL(pageFile).href);
    await until(() => page.evaluate(() => document.body.dataset.ready === 'yes'), 'the page is there', () => faults.join());
    await drawn(page);
    await pointed(page, size);
    await listed(page);
    await played(page, trace);
    await typed(page);
    const width = await page.evaluate(() => document.documentElement.scrollWidth);
    check(width <= size.width, `the page is ${width} pixels wide`);
    const colours = [];
    for (const value of ['light', 'dark']) {
      await page.emulateMediaFeatures([{ name: 'prefers-color-scheme', value }]);
      colours.push(await page.evaluate(() => getComputedStyle(document.body).backgroundColor));
    }
    check(colours[0] !== colours[1], `${colours} in the light and in the dark`);
    check(faults.length === 0, faults.join('\n'));
  } finally {
    await page.screenshot({ path: `view-${size.width}.png` });
    await page.close();
  }
}

async function main() {
  const trace = readTrace();
  const browser = await browse('drawing');
  try {
    for (const size of SIZES) await look(browser, size, trace);
  } finally {
    await browser.close();
  }
  return [0, 0, 0];
}

run(main);
