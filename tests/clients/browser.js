/* A browser without a window, for the scripts that look at pages. */

'use strict';

const path = require('path');

const puppeteer = require('puppeteer-core');

/** A browser that sees nothing but this machine, and that ends with the script. */
function browse() {
  return puppeteer.launch({
    executablePath: process.env.CHROMIUM,
    pipe: true,
    userDataDir: path.resolve('profile'),
    defaultViewport: { width: 1600, height: 1800 },
    args: [
      // It opens one page, and that page is ours: root, and a container, can have no sandbox.
      '--no-sandbox',
      '--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1',
      '--disable-dev-shm-usage',
      // The page can do without its drawing, and processors would draw it here.
      '--disable-3d-apis',
    ],
  });
}

module.exports = { browse };
