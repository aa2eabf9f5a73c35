/*
 * The page of `cargo xtask view` in a browser without a window, as wide as a screen and as a phone: what it
 * draws, that pointer, program and slider find each other, what it finds, colours, hides and lists, and that it
 * asks nobody for anything.
 *
 * Its arguments are the page, and the step trace and the figures of the same program by `cargo xtask sim`.
 */

'use strict';

const fs = require('fs');
const { pathToFileURL } = require('url');

const { check, run, until } = require('./cncjs');
const { browse, newPage } = require('./browser');

const [, , pageFile, traceFile, figuresFile] = process.argv;
const SIZES = [{ width: 1400, height: 900 }, { width: 390, height: 800 }];
// The path of the page is so near to the steps, mm, beyond one of them.
const NEAR_MM = 0.01;
// A segment of motion is no longer, ns.
const SEGMENT_NS = 1.5e6;
// How far a speed is off that is measured from steps, and an acceleration where a motion ends.
const MEASURED = 0.01;
const ENDED = 0.1;
// Slower than this, the machine stops.
const STOPPED_MM_MIN = 30;

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
    // In the order of the lines: rows that were made before may be below the ones in sight.
    const rows = [...listing.made.values()].sort((a, b) => a.dataset.line - b.dataset.line);
    const row = rows.find(({ dataset }) => path.first[dataset.line] >= 0);
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

/** Finds lines by their text, with the keys alone, and by their number. */
async function searched(page) {
  const { hits, count } = await page.evaluate(() => ({
    hits: window.view.lines.flatMap((line, index) => (line.includes('I-2 J0') ? [index + 1] : [])),
    count: window.view.lines.length,
  }));
  const at = async (line, found) => {
    const [current, told] = await page.evaluate(() => [window.view.listing.current, document.getElementById('found').textContent]);
    check(current === line && told.startsWith(found), `line ${current}, ${told}, and not ${line}, ${found}`);
  };
  await page.focus('#program');
  await page.keyboard.press('Home');
  await page.keyboard.down('Control');
  await page.keyboard.press('f');
  await page.keyboard.up('Control');
  await page.keyboard.type('i-2 j0');
  await at(hits[0], `1 of ${hits.length}`);
  await page.keyboard.press('Enter');
  await at(hits[1], '2 of');
  await page.click('#before');
  await page.click('#before');
  await at(hits[hits.length - 1], `${hits.length} of`);
  const marked = await page.$$eval('.row.found', (rows) => rows.map((row) => row.textContent));
  check(marked.length > 0 && marked.every((row) => row.includes('I-2 J0')), `${marked} are marked`);
  await page.focus('#search');
  await page.keyboard.type('(');
  await at(hits[hits.length - 1], 'none');
  await page.keyboard.press('Escape');
  for (const [typed, line] of [['42', 42], ['4200', count]]) {
    await page.keyboard.press('g');
    await page.keyboard.type(typed);
    await page.keyboard.press('Enter');
    await at(line, 'none');
    await page.focus('#stage');
  }
}

/** What each colouring makes of the feed moves, beside what it is to be, and that each looks otherwise. */
async function coloured(page) {
  const options = await page.$$eval('#colour option', (all) => all.map(({ value }) => value));
  check(options.join() === 'speed,share,depth,tool,power', `${options}`);
  const pictures = new Set();
  for (const by of options) {
    await page.select('#colour', by);
    const { worst, ends, picture } = await page.evaluate((kind) => {
      const { scene, path, facts } = window.view;
      const [least, most] = path.place[2].reduce(([low, high], z, row) => (path.kind[row] === 2 || path.kind[row - 1] === 2
        ? [Math.min(low, z), Math.max(high, z)] : [low, high]), [Infinity, -Infinity]);
      const second = facts.programmed.find(({ tool }) => tool === 2).line;
      const wanted = {
        speed: (piece) => path.speed[piece] / path.fastestFeed,
        share: (piece) => path.speed[piece] / path.programmed[piece],
        depth: (piece) => (path.place[2][piece] - least) / (most - least),
        tool: (piece) => Number(path.line[piece] >= second),
        power: (piece) => (path.line[piece] > second ? 0.75 : 1),
      }[kind];
      const offs = [...path.kind].map((one, piece) => (one === 2 ? Math.abs(scene.values[3 * piece] - wanted(piece)) : 0));
      scene.render();
      return {
        worst: Math.max(...offs), picture: scene.canvas.toDataURL(), ends: document.getElementById('ends').textContent,
      };
    }, by);
    const told = {
      speed: /^01.500 mm.min$/, share: /^0100 %$/, depth: /^Z -12.000Z -7.000$/, tool: /^T1T2$/, power: /^012.000 rpm$/,
    }[by];
    check(worst < 1e-3 && told.test(ends), `${by}: ${worst} off, from ${ends}`);
    pictures.add(picture);
  }
  check(pictures.size === options.length, `${pictures.size} pictures of ${options}`);
  for (const [time, told] of [[5, /spindle 12.000 rpm$/], [1e9, /spindle 9.000 rpm$/]]) {
    const moment = await page.evaluate((seconds) => {
      window.view.setTime(seconds);
      return document.getElementById('moment').textContent;
    }, time);
    check(told.test(moment), moment);
  }
  await page.select('#colour', 'speed');
}

/** Pixels of the colour of what is outside of the travel. */
function outside(page) {
  return page.evaluate(() => {
    const { scene } = window.view;
    scene.render();
    const [width, height] = [scene.canvas.width, scene.canvas.height];
    const pixels = new Uint8Array(4 * width * height);
    scene.gl.readPixels(0, 0, width, height, scene.gl.RGBA, scene.gl.UNSIGNED_BYTE, pixels);
    let count = 0;
    for (let at = 0; at < pixels.length; at += 4) {
      count += pixels[at] > 200 && pixels[at + 1] < 60 && pixels[at + 2] > 120;
    }
    return count;
  });
}

async function filtered(page) {
  const rapids = () => page.evaluate(() => {
    const { scene, path } = window.view;
    scene.render();
    const [a, b] = [0, 1].map((row) => scene.project(path.xyz.subarray(3 * row, 3 * row + 3)));
    const hit = scene.pick((a[0] + b[0]) / 2, (a[1] + b[1]) / 2);
    return hit && path.kind[hit.piece] === 1;
  });
  // Nothing is highlighted, and all is drawn.
  await page.hover('#rapids');
  await page.evaluate(() => new Promise((resolve) => {
    requestAnimationFrame(() => requestAnimationFrame(resolve));
  }));
  await page.evaluate(() => window.view.hover(0));
  check(await rapids(), 'the first move is a rapid');
  const before = await lit(page);
  await page.click('#rapids');
  check(!await rapids() && await lit(page) < before, 'no rapid is drawn');
  await page.click('#rapids');
  check(await rapids() && await lit(page) === before, 'rapids are drawn again');
  check(await outside(page) === 0, 'nothing is outside while the travel is not shown');
  await page.click('#travel');
  const count = await outside(page);
  check(count > 20, `${count} pixels are outside of the travel`);
  check(await page.$eval('#kinds .outside', (shown) => !shown.hidden), 'the legend has what is outside');
  await page.click('#travel');
}

/** No text of the picture or the curves is cut at an edge, however the part lies. */
async function labelled(page) {
  const cut = await page.evaluate(() => {
    const { scene, curves } = window.view;
    const found = [];
    const { prototype } = CanvasRenderingContext2D;
    const { fillText } = prototype;
    prototype.fillText = function measured(text, x, y, most) {
      const width = Math.min(this.measureText(text).width, most || Infinity);
      const left = x - { left: 0, start: 0, center: width / 2, right: width }[this.textAlign];
      const { clientWidth, clientHeight } = this.canvas;
      const { offsetLeft, offsetTop, offsetHeight } = scene.legend;
      const isBelow = this.canvas !== curves.canvas && y > offsetTop && y < offsetTop + offsetHeight
        && left < offsetLeft && left + width > offsetLeft;
      if (isBelow || left < 0 || left + width > clientWidth || y < 5 || y > clientHeight - 5) found.push(`${text} at ${x}, ${y}`);
    };
    for (let step = 0; step < 24; step += 1) {
      scene.camera.turn(0.5, step % 2 ? 0.3 : -0.3);
      scene.camera.pan(step % 3 ? 150 : -250, step % 5 ? 60 : -200);
      scene.render();
    }
    curves.choices().forEach(([what]) => {
      curves.what = what;
      curves.render();
    });
    for (let step = 0; step < 30; step += 1) {
      curves.zoom(0.77, curves.range[0]);
      curves.render();
    }
    curves.zoom(1e9, 0);
    prototype.fillText = fillText;
    scene.view('iso');
    return found;
  });
  check(cut.length === 0, cut.join('\n'));
}

/** The tables say what `cargo xtask sim --json` says. */
async function tabled(page, figures) {
  await page.click('#tab-job');
  const tables = await page.$$eval('#job table', (all) => all.map((table) => ({
    title: table.caption.textContent,
    heads: [...table.tHead.querySelectorAll('th[scope=col]')].map((cell) => cell.textContent),
    rows: [...table.tBodies[0].rows].map((row) => [...row.cells].map((cell) => cell.textContent)),
  })));
  tables.forEach(({ title, heads, rows }) => {
    check(heads.every(Boolean) && rows.every((row) => row.length === heads.length), `heads of ${title}: ${heads}`);
  });
  const rows = (title) => tables.find((table) => table.title.startsWith(title)).rows;
  const row = (title, name) => rows(title).find(([first]) => first === name).slice(1);
  const { distances_mm: { cutting, rapids }, events, event_hash: hash, quality: { corners } } = figures;
  const equal = (shown, wanted) => check(shown === wanted, `${shown}, and not ${wanted}`);
  const plain = (text) => Number(text.replace(/\s/g, ''));
  equal(row('Time and', 'cutting')[1], cutting.toFixed(3));
  equal(row('Time and', 'rapids')[1], rapids.toFixed(3));
  equal(row('Time and', 'together')[1], (cutting + rapids).toFixed(3));
  equal(plain(row('The run', 'step events')[0]), events);
  equal(row('The run', 'hash of them')[0], hash);
  equal(row('Programmed', 'F').join(), '300,1500,mm/min');
  equal(row('Programmed', 'S').join(), '9000,12000,rpm');
  equal(rows('Tools').map(([tool]) => tool).join(), 'T1,T2');
  const lengths = rows('Tools').reduce((sum, cells) => sum + Number(cells[3]), 0);
  check(Math.abs(lengths / cutting - 1) < MEASURED, `the tools cut ${lengths} mm`);
  equal(rows('The whole').map((cells) => cells[5]).join(), '10.000,none,none');
  equal(row('The whole', 'X')[3], '-200 to 0');
  const [count, slowest, fastest, share] = rows('Corners')[0];
  // The stop for the second tool is a corner to the measurement of the steps.
  const speeds = corners.list.map(({ speed_mm_s: speed }) => 60 * speed).filter((speed) => speed > STOPPED_MM_MIN);
  equal(plain(count), speeds.length);
  const near = (shown, wanted) => check(Math.abs(shown / wanted - 1) < MEASURED, `${shown}, and not about ${wanted}`);
  near(plain(slowest), Math.min(...speeds));
  near(plain(fastest), Math.max(...speeds));
  near(parseFloat(share), 100 * corners.most_of_allowed);
  rows('Greatest').forEach(([axis, , acceleration]) => {
    const [greatest, limit] = acceleration.split(' of ').map(Number);
    check(greatest <= limit * (1 + ENDED), `${axis}: ${acceleration} mm/s²`);
  });
  await page.click('#tab-program');
  const unnamed = await page.$$eval('input, select', (all) => all.filter((field) => !field.ariaLabel && !field.labels.length).map(({ id }) => id));
  equal(unnamed.join(), '');
}

async function look(browser, size, trace, figures) {
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
    await searched(page);
    await coloured(page);
    await filtered(page);
    await labelled(page);
    await tabled(page, figures);
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

/** The page as a part of another one: it marks what its machine has cut, takes nothing else, and gets at nothing. */
async function framed(browser) {
  const page = await newPage(browser);
  await page.setContent('<title>around</title><iframe sandbox="allow-scripts"></iframe>');
  await page.evaluate((text) => { document.querySelector('iframe').srcdoc = text; }, fs.readFileSync(pageFile, 'utf8'));
  let frame;
  await until(async () => {
    frame = page.frames().find((one) => one !== page.mainFrame());
    return frame && frame.evaluate(() => document.body.dataset.ready === 'yes').catch(() => false);
  }, 'the page is in another one');
  const send = (report) => page.evaluate((text) => (
    document.querySelector('iframe').contentWindow.postMessage(text, '*')), typeof report === 'string' ? report : JSON.stringify(report));
  const shown = () => frame.evaluate(() => {
    const { scene } = window.view;
    return { cut: scene.cut, now: window.view.now, at: scene.live && scene.live.at };
  });
  const { machine, line, middle, end } = await frame.evaluate(() => {
    const { path } = window.view;
    const there = path.at(path.end / 2);
    return { machine: there.place, line: there.line, middle: path.end / 2, end: path.end };
  });
  const state = 'Run';
  for (const wrong of [
    'text', '[]', 'null', { machine, line, state: 7 }, { machine: [1, 2], line, state }, { machine: ['1', 2, 3], line, state },
    { machine, line: -1, state }, { machine, line: 1.5, state }, `{"machine":[${'1,'.repeat(1000)}1],"line":1,"state":"Run"}`,
  ]) await send(wrong);
  // Messages come in their order.
  await send({ machine: [1, 2, 3], line: null, state: 'Jog' });
  await until(async () => (await shown()).at, 'the machine is shown');
  const before = await shown();
  check(before.cut === 0 && before.now === end && before.at.join() === '1,2,3', JSON.stringify(before));
  await send({ machine, line, state });
  await until(async () => (await shown()).cut > 0, 'what has been cut is marked', async () => JSON.stringify(await shown()));
  const after = await shown();
  check(Math.abs(after.cut - middle) < 0.01 && after.now === after.cut, `${JSON.stringify(after)}, not ${middle} s`);
  const reach = await frame.evaluate(() => {
    try { return window.parent.document.title; } catch (error) { return error.name; }
  });
  check(reach === 'SecurityError', reach);
  await page.close();
}

async function main() {
  const trace = readTrace();
  const browser = await browse('drawing');
  try {
    const figures = JSON.parse(fs.readFileSync(figuresFile, 'utf8'));
    for (const size of SIZES) await look(browser, size, trace, figures);
    await framed(browser);
  } finally {
    await browser.close();
  }
  return [0, 0, 0];
}

run(main);
