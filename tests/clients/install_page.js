/*
 * The page of a release in a browser without a window. `navigator.usb` hands each transfer to a model of the bootloader
 * in a chip's ROM: images are installed, by mouse and by keyboard, and refused; the flash is compared each time.
 *
 * Its arguments are the folder of the pages and the cases.
 */

'use strict';

const crypto = require('crypto');
const fs = require('fs');
const http = require('http');
const path = require('path');

const { check, run, until } = require('./cncjs');
const { browse, newPage } = require('./browser');

const [, , site, list] = process.argv;
const TYPES = { '.html': 'text/html', '.json': 'application/json', '.txt': 'text/plain' };
// What the flash has before.
const BEFORE = 0xa5;
const FLASH = 0x08000000;
const BOARDS = 6;
// Refusals that the words about access are for.
const ACCESS = ['open', 'NotFoundError', 'SecurityError'];
// What happens to the flash while the cable is pulled out.
const STAGES = ['looked at', 'erased', 'written', 'read back'];
const WIDTHS = [1280, 390];
// bmRequestType: the kinds, and the bit of the direction.
const KINDS = { standard: 0, class: 0x20 };
const RECIPIENTS = { device: 0, interface: 1 };
const IN = 0x80;

const sha256 = (bytes) => crypto.createHash('sha256').update(bytes).digest('hex');

function ask(address, method, body = Buffer.alloc(0)) {
  return new Promise((resolve, reject) => {
    const request = http.request(address, { method }, (response) => {
      const parts = [];
      response.on('data', (part) => parts.push(part));
      response.on('end', () => resolve({ code: response.statusCode, bytes: Buffer.concat(parts) }));
    });
    request.on('error', reject);
    request.end(body);
  });
}

/** Hands a transfer to the model: its answer, or why there is none. */
async function transfer(device, setup, lengthOrBytes) {
  const isIn = typeof lengthOrBytes === 'number';
  const type = KINDS[setup.requestType] | RECIPIENTS[setup.recipient] | (isIn ? IN : 0);
  const query = `type=${type}&request=${setup.request}&value=${setup.value}&index=${setup.index}`;
  const answer = isIn
    ? await ask(`${device}/in?${query}&length=${lengthOrBytes}`, 'POST')
    : await ask(`${device}/out?${query}`, 'POST', Buffer.from(lengthOrBytes));
  return answer.code === 200 ? { bytes: [...answer.bytes] } : { failure: String(answer.bytes) };
}

/** In the page: a `navigator.usb` that behaves as that of Chromium, with one device or a refusal. */
function replaceUsb(usb) {
  const give = (value) => Object.defineProperty(navigator, 'usb', { value });
  if (usb === 'insecure') Object.defineProperty(window, 'isSecureContext', { value: false });
  if (usb === 'none' || usb === 'insecure') {
    give(undefined);
    return;
  }
  const refuse = (name, message) => { throw new DOMException(message, name); };
  const state = { isOpen: false, configuration: null, claimed: false };
  async function exchange(setup, what) {
    if (!state.isOpen) refuse('InvalidStateError', 'The device must be opened first.');
    if (setup.recipient === 'interface' && !state.claimed) refuse('InvalidStateError', 'The interface must be claimed.');
    const { bytes, failure } = await window.transfer(setup, what);
    if (failure === 'gone') refuse('NetworkError', 'A transfer error has occurred.');
    if (failure) return { status: 'stall' };
    const isIn = typeof what === 'number';
    return isIn ? { status: 'ok', data: new DataView(new Uint8Array(bytes).buffer) } : { status: 'ok', bytesWritten: what.length };
  }
  const alternates = [0, 1, 2, 3].map((alternateSetting) => ({ alternateSetting, interfaceName: null }));
  const configuration = { configurationValue: 1, interfaces: [{ interfaceNumber: 0, alternates }] };
  const device = {
    get configuration() { return state.configuration; },
    async open() {
      if (usb === 'open') refuse('SecurityError', 'Access denied.');
      Object.assign(state, { isOpen: true, configuration: null, claimed: false });
    },
    async close() { state.isOpen = false; },
    async selectConfiguration() { state.configuration = configuration; },
    async claimInterface() {
      if (usb === 'claim') refuse('NetworkError', 'Unable to claim interface.');
      state.claimed = true;
    },
    async selectAlternateInterface(number, alternate) {
      if (number !== 0 || alternate !== 0) refuse('NotFoundError', 'There is no such setting.');
    },
    controlTransferIn: (setup, length) => exchange(setup, length),
    controlTransferOut: (setup, bytes) => exchange(setup, [...bytes]),
  };
  give({
    async requestDevice({ filters }) {
      if (!navigator.userActivation.isActive) refuse('SecurityError', 'Must be handling a user gesture.');
      if (JSON.stringify(filters) !== '[{"vendorId":1155,"productId":57105}]') refuse('TypeError', 'other filters');
      if (usb === 'NotFoundError') refuse(usb, 'No device selected.');
      if (usb === 'SecurityError') refuse(usb, 'Access to the feature "usb" is disallowed by permissions policy.');
      return device;
    },
  });
}

/** A file whose CRC is right, whatever else is wrong. */
function withCrc(bytes) {
  const last = bytes.length - 4;
  let sum = 0xffffffff;
  for (let at = 0; at < last; at += 1) {
    for (let bit = 0; bit < 8; bit += 1) {
      const isOdd = (sum ^ bytes[at] >> bit) & 1;
      sum = (sum >>> 1) ^ (isOdd ? 0xedb88320 : 0);
    }
  }
  bytes.writeUInt32LE(sum >>> 0, last);
  return bytes;
}

/** What a server gives for a path: a case may have a file of its own in place of the image's. */
function content(url, found) {
  const file = path.join(site, decodeURIComponent(url));
  const bytes = fs.readFileSync(file);
  if (!found.file) return bytes;
  const image = path.join(site, 'release', found.board, `${found.axes}-axes`, 'leadscrew.dfu');
  const read = () => (found.hasCrc ? withCrc(fs.readFileSync(found.file)) : fs.readFileSync(found.file));
  if (file === image) return read();
  if (!found.hasSum || path.extname(file) !== '.html') return bytes;
  return Buffer.from(String(bytes).replaceAll(sha256(fs.readFileSync(image)), sha256(read())));
}

/** Serves the folder of the pages as any web server does. */
function serve(state) {
  const server = http.createServer((request, response) => {
    try {
      const bytes = content(request.url, state.found);
      const type = TYPES[path.extname(request.url)] ?? 'application/octet-stream';
      response.writeHead(200, { 'content-type': type }).end(bytes);
    } catch {
      response.writeHead(404).end();
    }
  });
  return new Promise((resolve) => {
    server.listen(0, '127.0.0.1', () => resolve(server));
  });
}

const sectionOf = (board) => `#${board.replaceAll('.', '\\.')}`;
const formOf = (board) => `${sectionOf(board)} form.install`;

const told = (page, board) => page.$eval(formOf(board), (form) => {
  const state = form.querySelector('[role=status]');
  return {
    text: state.textContent,
    kind: state.className,
    isFree: !form.querySelector('button').disabled,
    isBarHidden: form.querySelector('progress').hidden,
  };
});

/** Presses the button of a board, and waits for the end. */
async function press(page, board) {
  await page.click(`${formOf(board)} button`);
  await until(async () => (await told(page, board)).isFree, 'the installation ends', async () => (await told(page, board)).text);
  return told(page, board);
}

/** Chooses the number of axes. */
async function choose(page, { board, axes }) {
  const find = (options, count) => options.find((option) => option.textContent.startsWith(`${count} axes`)).value;
  const value = await page.$$eval(`${formOf(board)} option`, find, axes);
  await page.select(`${formOf(board)} select`, value);
}

async function tryCase(browser, address, found) {
  const page = await newPage(browser);
  const faults = [];
  page.on('pageerror', (error) => faults.push(error.message));
  page.on('console', (message) => {
    if (!message.text().includes('404')) faults.push(message.text());
  });
  page.on('request', (request) => {
    const url = request.url();
    if (!url.startsWith('data:') && !url.startsWith(address)) faults.push(`asks for ${url}`);
  });
  const device = { address: found.device };
  await page.exposeFunction('transfer', (setup, what) => transfer(device.address, setup, what));
  await page.evaluateOnNewDocument(replaceUsb, found.usb ?? 'device');
  await page.goto(`${address}install.html#${found.board}`);
  await until(() => page.evaluate(() => document.body.dataset.ready === 'yes'), 'the page is there');
  if (['none', 'insecure'].includes(found.usb)) {
    const seen = await told(page, found.board);
    check(seen.text.includes(found.says) && !seen.isFree, `${found.name}: ${JSON.stringify(seen)}`);
  } else {
    await choose(page, found);
    await judge(page, found, device, await press(page, found.board));
  }
  const isOpen = await page.$eval('#access', (details) => details.open);
  check(isOpen === ACCESS.includes(found.usb), `${found.name}: the words about access`);
  check(faults.length === 0, `${found.name}: ${faults.join()}`);
  await page.close();
}

/** Compares what the page says, and what the flash has, with what a case wants. */
async function judge(page, found, device, seen) {
  const words = `${found.name}: ${seen.text}`;
  check(seen.text.includes(found.says) && seen.isBarHidden, words);
  const { bytes } = await ask(`${device.address}/flash`, 'GET');
  const started = String((await ask(`${device.address}/started`, 'GET')).bytes);
  const wanted = fs.readFileSync(found.installed);
  if (found.isInstalled) {
    const isRight = bytes.equals(wanted) && started === found.start;
    check(seen.kind === 'good' && isRight, `${words}: the flash differs, ${started}`);
    return;
  }
  check(seen.kind === 'bad' && started === '', words);
  const isUntouched = bytes.every((byte) => byte === BEFORE);
  const saysNothing = seen.text.endsWith('Nothing was written.');
  check(saysNothing || seen.text.includes('is incomplete'), words);
  check(!saysNothing || isUntouched, `${words}: the flash has changed`);
  if (!found.again) {
    check(saysNothing === !found.isBegun, words);
    check(isUntouched || found.isBegun, `${words}: the flash has changed`);
    return;
  }
  [, found.stage] = /while the flash was ([a-z ]+) \(/.exec(seen.text) ?? [];
  check((found.stage === 'looked at') === saysNothing, words);
  const vectors = bytes.subarray(found.start - FLASH, found.start - FLASH + 4);
  check(found.stage !== 'written' || vectors.every((byte) => byte === 0xff), `${words}: half a program starts`);
  device.address = found.again;
  const after = await press(page, found.board);
  check(after.kind === 'good', `${found.name}, again: ${after.text}`);
  const flash = await ask(`${found.again}/flash`, 'GET');
  check(flash.bytes.equals(wanted), `${found.name}, again: the flash differs`);
}

/** Without a script, tables, files and steps are there, and nothing that needs one. */
async function withoutScript(browser, address) {
  const page = await newPage(browser);
  await page.setJavaScriptEnabled(false);
  await page.goto(`${address}install.html`);
  const visible = async (selector) => {
    const shown = await Promise.all((await page.$$(selector)).map((element) => element.isVisible()));
    return shown.filter(Boolean).length;
  };
  const targets = (selector) => page.$$eval(selector, (links) => links.map((link) => link.getAttribute('href')));
  const boards = (await targets('table.boards tbody a')).map((target) => target.slice(1));
  check(boards.length === BOARDS && await visible('section') === 0, `${boards} are offered`);
  for (const board of boards) {
    await page.click(`table.boards a[href="#${board}"]`);
    const here = sectionOf(board);
    check(await visible('section') === 1 && await visible(`${here} ol`) > 0, `${board} is shown`);
    check(await visible('form.install') === 0, 'what needs a script is not shown');
    const files = await targets(`${here} table a`);
    const axes = await page.$$eval(`${here} tbody tr`, (rows) => rows.length);
    check(files.length >= 2 * axes, `${board}: ${files}`);
    files.forEach((file) => check(fs.existsSync(path.join(site, file)), `${file} is there`));
  }
  await page.close();
}

/** Nothing is wider than the page; pictures are kept. */
async function look(browser, address, width) {
  const page = await newPage(browser);
  await page.setViewport({ width, height: 900 });
  for (const board of ['', 'blackpill-f411', 'btt-octopus-1.1-f446', 'nucleo-f446re']) {
    await page.goto(`${address}install.html#${board}`);
    await page.reload();
    await page.screenshot({ path: `install-${width}-${board}.png`, fullPage: true });
    const wide = await page.evaluate(() => document.documentElement.scrollWidth);
    check(wide <= width, `${board}: the page is ${wide} pixels wide, not ${width}`);
  }
  await page.goto(`${address}index.html`);
  await page.click('header a[href="install.html"]');
  await until(() => page.url().endsWith('/install.html'), 'the pages name each other');
  await page.close();
}

/** A board is chosen and written with keys alone. */
async function withKeys(browser, address, found) {
  const page = await newPage(browser);
  await page.exposeFunction('transfer', (setup, what) => transfer(found.device, setup, what));
  await page.evaluateOnNewDocument(replaceUsb, 'device');
  await page.goto(`${address}install.html`);
  const tabTo = async (wanted) => {
    for (let count = 0; count < 60; count += 1) {
      await page.keyboard.press('Tab');
      if (await page.evaluate((selector) => document.activeElement.matches(selector), wanted)) return;
    }
    throw new Error(`Tab does not lead to ${wanted}`);
  };
  await tabTo(`a[href="#${found.board}"]`);
  await page.keyboard.press('Enter');
  await tabTo('form.install select');
  await page.keyboard.press('ArrowDown');
  await tabTo('form.install button');
  await page.keyboard.press('Enter');
  await until(async () => ['good', 'bad'].includes((await told(page, found.board)).kind), 'the installation ends');
  await judge(page, found, { address: found.device }, await told(page, found.board));
  await page.close();
}

async function main() {
  const cases = JSON.parse(fs.readFileSync(list, 'utf8'));
  const state = { found: {} };
  const server = await serve(state);
  const browser = await browse();
  const address = `http://127.0.0.1:${server.address().port}/`;
  try {
    for (const found of cases.filter(({ keys }) => !keys)) {
      state.found = found;
      await tryCase(browser, address, found);
    }
    const stages = new Set(cases.map(({ stage }) => stage));
    STAGES.forEach((stage) => check(stages.has(stage), `no cable is pulled out while the flash is ${stage}`));
    state.found = {};
    await withoutScript(browser, address);
    for (const width of WIDTHS) await look(browser, address, width);
    await withKeys(browser, address, cases.find(({ keys }) => keys));
  } finally {
    await browser.close();
    server.close();
  }
  return [0, 0, 0];
}

run(main);
