/* A browser without a window, for the scripts that look at pages. */

'use strict';

const fs = require('fs');
const http = require('http');
const path = require('path');

const puppeteer = require('puppeteer-core');

const { TIMEOUT_MS } = require('./cncjs');

// For one answer, which may be a picture of the whole page.
const PROTOCOL_TIMEOUT_MS = 600000;

/**
 * A browser that sees nothing but this machine, and that ends with the script. A page that needs no `drawing` in
 * three dimensions does without, as processors would draw it here. Of the usual arguments some can be left out.
 */
function browse(what = '', without = []) {
  const drawing = what === 'drawing'
    ? ['--use-angle=swiftshader', '--enable-unsafe-swiftshader']
    : ['--disable-3d-apis'];
  return puppeteer.launch({
    executablePath: process.env.CHROMIUM,
    ignoreDefaultArgs: without,
    pipe: true,
    timeout: TIMEOUT_MS,
    protocolTimeout: PROTOCOL_TIMEOUT_MS,
    userDataDir: fs.mkdtempSync(path.resolve('profile-')),
    defaultViewport: { width: 1600, height: 1800 },
    args: [
      // It opens one page, and that page is ours: root, and a container, can have no sandbox.
      '--no-sandbox',
      '--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1',
      '--disable-dev-shm-usage',
      ...drawing,
    ],
  });
}

/** A new page, which may take as long as anything else. */
async function newPage(browser) {
  const page = await browser.newPage();
  page.setDefaultTimeout(TIMEOUT_MS);
  return page;
}

/** Serves the folder of the page as any web server does; what else is asked for is kept. */
function serve(pageFile, asked) {
  const server = http.createServer((request, response) => {
    if (request.url !== '/') {
      asked.push(request.url);
      response.writeHead(404).end();
      return;
    }
    response.writeHead(200, { 'content-type': 'text/html' }).end(fs.readFileSync(pageFile));
  });
  return new Promise((resolve) => {
    server.listen(0, '127.0.0.1', () => resolve(server));
  });
}

module.exports = { browse, newPage, serve };
