/*
 * The page of `cargo xtask monitor` after as many lines as ten minutes have: it keeps no more than the picture
 * does. This script is the machine; it knows of the page only where that says the machine is.
 */

'use strict';

const net = require('net');

const { check, run, until } = require('./cncjs');
const { browse, newPage } = require('./browser');
const { start } = require('./monitor');

const monitor = process.argv[2];
// Ten minutes at 350 lines a second, and how many the page is sent at a time.
const LINES = 600 * 350;
const PORTION = 1750;
// Where the memory is measured: 30 times.
const MEASURED_EVERY = 7000;
// What the memory may grow by from the first third to the last one. The path has at most 20 000 points at any time.
const GROWTH = 0.25;
const KIB = 1024;

/** A machine that answers `?` and `$$`, and that says where it is when it is told to. */
async function machine() {
  const server = net.createServer();
  await new Promise((listens) => { server.listen(0, '127.0.0.1', listens); });
  const connected = new Promise((resolve) => { server.once('connection', resolve); });
  let place = [0, 0];
  connected.then((socket) => {
    socket.on('data', (bytes) => {
      for (const byte of bytes.toString('latin1')) {
        if (byte === '?') socket.write(`<Run|MPos:${place.join('.000,')}.000,0.000|FS:350,0|WCO:0.000,0.000,0.000>\r\n`);
        if (byte === '\n') socket.write('$100=1.000\r\n$101=1.000\r\nok\r\n');
      }
    });
  });
  const moveTo = async (places) => {
    place = places[places.length - 1];
    const socket = await connected;
    socket.write(places.map(([x, y]) => `X:${x},Y:${y}\r\n`).join(''));
  };
  return { port: server.address().port, moveTo };
}

/** A flower of steps: no place is visited twice in the same way. */
function placeAt(line) {
  const angle = line * 0.001;
  const radius = 1000 * Math.cos(angle * 1.01);
  return [Math.cos(angle), Math.sin(angle)].map((part) => Math.round(radius * part) + 0);
}

/** The memory that the page cannot do without, bytes. */
async function memory(session) {
  await session.send('HeapProfiler.collectGarbage');
  const usage = await session.send('Runtime.getHeapUsage');
  return usage.usedSize + (usage.embedderHeapUsedSize || 0) + (usage.backingStorageSize || 0);
}

async function watch(page, session, moveTo) {
  const used = [];
  for (let line = 0; line < LINES; line += PORTION) {
    const places = Array.from({ length: PORTION }, (_, index) => placeAt(line + index));
    // eslint-disable-next-line no-await-in-loop
    await moveTo(places);
    const wanted = [...places[PORTION - 1], 0].join();
    let shown;
    // eslint-disable-next-line no-await-in-loop
    await until(async () => {
      shown = await page.evaluate(() => document.body.dataset.at);
      return shown === wanted;
    }, `the page shows ${wanted}`, () => `${shown}`);
    // eslint-disable-next-line no-await-in-loop
    if ((line + PORTION) % MEASURED_EVERY === 0) used.push(await memory(session));
  }
  const third = used.length / 3;
  const [before, after] = [used.slice(0, third), used.slice(-third)].map((part) => Math.max(...part));
  const all = used.map((bytes) => Math.round(bytes / KIB)).join(' ');
  check(used.length === 30 && after <= before * (1 + GROWTH), `KiB: ${all}`);
  console.log(`${all} KiB`);
  return [0, 0, 0];
}

async function main() {
  const { port, moveTo } = await machine();
  const { address } = await start(monitor, ['--tcp', `127.0.0.1:${port}`]);
  const browser = await browse();
  try {
    const page = await newPage(browser);
    await page.goto(`http://${address}/`);
    return await watch(page, await page.createCDPSession(), moveTo);
  } finally {
    await browser.close();
  }
}

run(main);
