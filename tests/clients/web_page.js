/*
 * The page of `cargo xtask web` in a browser without a window: as wide as a screen from a server, and as wide as a
 * phone as a file. Program and settings are uploaded and dropped, a job is cancelled, the machine panics, and the page
 * asks nobody for anything.
 *
 * Its arguments are the page, a program and its settings, the hash of its step events, and a long program.
 */

'use strict';

const fs = require('fs');
const path = require('path');
const { pathToFileURL } = require('url');

const { check, run, until } = require('./cncjs');
const { browse, newPage, serve } = require('./browser');

const [, , pageFile, program, settings, hash, long] = process.argv;

const state = (page) => page.evaluate(() => document.getElementById('state').textContent);

async function upload(page, files) {
  for (const [id, file] of Object.entries(files)) {
    const input = await page.$(`#${id}`);
    await input.uploadFile(file);
  }
}

/** Waits for the view of the job that has been played last: the one in the page's frame. */
async function viewed(page) {
  let [view, seen] = [null, ''];
  await until(async () => {
    const frame = await page.$('#frame iframe');
    view = frame && await frame.contentFrame();
    seen = view && `${view.url()} ${await view.evaluate(() => `${document.readyState} ${document.body?.dataset.ready}`)}`;
    return seen && seen.endsWith(' yes');
  }, 'the view is there', () => seen);
  return view;
}

/** Waits for the hash of a job that has been begun, and for its view. */
async function played(page) {
  await until(() => page.evaluate(() => 'hash' in document.body.dataset), 'the job comes to its end', () => state(page));
  const seen = await page.evaluate(() => [document.body.dataset.hash, document.getElementById('facts').textContent]);
  check(seen[0] === hash && seen[1].includes(hash), `${seen} is not ${hash}`);
  const view = await viewed(page);
  const drawn = await view.evaluate(() => {
    window.view.scene.render();
    return [window.view.facts.hash, window.view.scene.drawn, window.view.path.pieces, window.view.listing.element.textContent];
  });
  check(drawn[0] === hash && drawn[1] > 100 && drawn[1] === drawn[2], drawn.join());
  check(drawn[3].includes('G21'), 'the program is listed');
}

/** Drops files, each with its name and its bytes. */
function drop(page, files) {
  return page.evaluate((all) => {
    const dataTransfer = new DataTransfer();
    all.forEach(([name, bytes]) => dataTransfer.items.add(new File([new Uint8Array(bytes)], name)));
    document.dispatchEvent(new DragEvent('drop', { dataTransfer, bubbles: true, cancelable: true }));
  }, files.map(([name, bytes]) => [name, [...bytes]]));
}

/** Files are dropped, and taken as what they are: a program may have settings in it, and settings be in UTF-16. */
async function dropped(page) {
  const names = () => page.evaluate(() => ['program', 'settings'].map((id) => document.getElementById(id).files[0]?.name).join());
  await drop(page, [['own.nc', Buffer.from('$110=4000\nG21\nG0X1\n')]]);
  await until(async () => (await names()).startsWith('own.nc,'), 'a program is taken', names);
  const list = fs.readFileSync(settings, 'utf8');
  await drop(page, [[path.basename(program), fs.readFileSync(program)], ['list.txt', Buffer.from(`\ufeff${list}`, 'utf16le')]]);
  const both = `${path.basename(program)},list.txt`;
  await until(async () => await names() === both, 'both are taken', names);
  await until(() => page.evaluate((text) => document.body.dataset.hash === text, hash), 'the job comes to its end', () => state(page));
  await played(page);
}

/** A machine homes amid switches. */
async function homed(page) {
  fs.writeFileSync('home.nc', '$H\nG53G0X-5\n');
  fs.writeFileSync('home.settings', '$22=1\n$130=20\n$131=20\n$132=20\n$24=300\n$25=900\n');
  await upload(page, { program: 'home.nc', settings: 'home.settings' });
  await page.click('#switches');
  await page.click('#run');
  await until(() => page.evaluate(() => 'hash' in document.body.dataset), 'the job comes to its end', () => state(page));
  const seen = await page.evaluate(() => [document.getElementById('facts').textContent, document.getElementById('refusals').hidden]);
  check(seen[0].endsWith('ends in Idle') && seen[1], seen.join());
  await page.click('#switches');
}

/** A long job is cancelled. */
async function cancelled(page) {
  await upload(page, { program: long });
  await page.click('#run');
  await until(() => page.evaluate(() => Boolean(window.web.worker) && document.getElementById('progress').value > 0), 'the long job goes on', () => state(page));
  check(/^\d+ % of the program, .* of the machine's time$/.test(await state(page)), await state(page));
  await page.click('#cancel');
  check(await state(page) === 'cancelled', await state(page));
  const seen = await page.evaluate(() => [window.web.worker, document.getElementById('outcome').hidden, document.getElementById('run').disabled]);
  check(seen[0] === null && seen[1] && !seen[2], seen.join());
}

/** A text that the machine has no room for makes it panic. */
async function panicked(page) {
  await page.evaluate(() => window.web.start([0, 1, 2, 3, 4].map(() => new Uint8Array(1))));
  await until(() => page.evaluate(() => !window.web.worker), 'the panic is told', () => state(page));
  const told = await state(page);
  check(/^the simulator has a fault.*panicked at .*index out of bounds.*unreachable/s.test(told), told);
}

/** Settings that are refused are told, and nothing is played. */
async function refused(page) {
  fs.writeFileSync('bad.settings', '$110=5000\n$3=300\n');
  await upload(page, { program, settings: 'bad.settings' });
  await page.click('#run');
  await until(() => page.evaluate(() => document.getElementById('state').className === 'bad'), 'the refusal is told', () => state(page));
  const told = await state(page);
  check(told.includes('bad.settings') && told.includes('$3=300'), told);
  check(await page.evaluate(() => !('hash' in document.body.dataset)), 'there is no hash');
}

/** The causes of refusals are counted. */
async function tabulated(page) {
  fs.writeFileSync('refused.nc', 'G0X1\nG999\nG999\nM106 (<b>)\n');
  await upload(page, { program: 'refused.nc', settings });
  await page.click('#run');
  await until(() => page.evaluate(() => 'hash' in document.body.dataset), 'the job comes to its end', () => state(page));
  const rows = await page.evaluate(() => [...document.querySelectorAll('#refusals tbody tr')].map((row) => [...row.cells].map((cell) => cell.textContent)));
  check(rows.length === 2 && rows[0][0] === '2' && rows[0][1] === 'G999' && rows[0][2].includes(': remove the word') && rows[0][3] === 'error:20' && rows[0][4] === '2', JSON.stringify(rows));
  await viewed(page);
}

/** An alarm is told with its line, what it means and what to do: of the job, and where it ends the job. */
async function alarmed(page) {
  fs.writeFileSync('probe.nc', 'G0X-1\nG38.2 Z-1 F99\nX-2\n');
  fs.writeFileSync('mill.settings', '$22=1\n$20=1\n');
  await upload(page, { program: 'probe.nc', settings: 'mill.settings' });
  await page.click('#run');
  await until(() => page.evaluate(() => 'hash' in document.body.dataset), 'the job comes to its end', () => state(page));
  const expected = 'ALARM:5, the probe made no contact: unlock with $X';
  const warnings = await page.evaluate(() => document.getElementById('warnings').textContent);
  check(warnings.includes(`line 2 (G38.2 Z-1 F99): ${expected}`), warnings);
  const view = await viewed(page);
  const told = await view.evaluate(() => document.getElementById('alarm').textContent);
  check(told.startsWith(`line 2: ${expected}`), told);
  fs.writeFileSync('far.nc', 'G0X-1\nX250\nX-2\n');
  await upload(page, { program: 'far.nc', settings: 'mill.settings' });
  await page.click('#run');
  await until(() => page.evaluate(() => document.getElementById('state').className === 'bad'), 'the alarm is told', () => state(page));
  const ended = await state(page);
  check(ended.startsWith('line 2 (X250): ALARM:2, the target is outside') && ended.includes('(X 250.000 '), ended);
}

async function look(browser, address, width) {
  const page = await newPage(browser);
  await page.setViewport({ width, height: 800 });
  const faults = [];
  page.on('pageerror', (error) => faults.push(error.message));
  page.on('console', (message) => faults.push(`${message.type()}: ${message.text()}`));
  page.on('request', (request) => {
    const url = request.url();
    if (url !== address && !url.startsWith('blob:') && !url.startsWith('data:')) faults.push(`asks for ${url}`);
  });
  try {
    await page.goto(address);
    await until(() => page.evaluate(() => document.body.dataset.ready === 'yes'), 'the page is there', () => faults.join());
    check(await page.evaluate(() => document.getElementById('run').disabled), 'without a program nothing is played');
    await upload(page, { program, settings });
    await page.click('#run');
    await played(page);
    await cancelled(page);
    await dropped(page);
    await panicked(page);
    await refused(page);
    await tabulated(page);
    await alarmed(page);
    await homed(page);
    await upload(page, { program, settings });
    await page.click('#run');
    await played(page);
    const wide = await page.evaluate(() => document.documentElement.scrollWidth);
    check(wide <= width, `the page is ${wide} pixels wide`);
    check(faults.length === 0, faults.join('\n'));
  } finally {
    await page.screenshot({ path: `web-${width}.png` });
    await page.close();
  }
}

async function main() {
  const asked = [];
  const server = await serve(pageFile, asked);
  const browser = await browse('drawing');
  try {
    await look(browser, `http://127.0.0.1:${server.address().port}/`, 1400);
    await look(browser, pathToFileURL(pageFile).href, 390);
    check(asked.length === 0, `the server is asked for ${asked}`);
  } finally {
    await browser.close();
    server.close();
  }
  return [0, 0, 0];
}

run(main);
