/*
 * Plays a job with the worker of the page of `cargo xtask web`, under node.
 *
 * Its arguments are the page, where to write the view of the job, the program, and perhaps its settings. It prints
 * the summary, with the time that the processor has taken, s; or the failure.
 */

'use strict';

const fs = require('fs');
const path = require('path');
const zlib = require('zlib');

const [index, out, program, settings] = process.argv.slice(1);

/** What stands in the page's script of a name. */
function script(page, id) {
  const begin = page.indexOf('>', page.indexOf(`id="${id}"`)) + 1;
  return page.slice(begin, page.indexOf('</script>', begin));
}

const page = fs.readFileSync(index, 'utf8');
const rate = Number(/data-rate="(\d+)"/.exec(page)[1]);
const wasm = zlib.inflateRawSync(Buffer.from(script(page, 'wasm'), 'base64'));
const name = (file) => Buffer.from(file ? path.basename(file) : '');
const read = (file) => (file ? fs.readFileSync(file) : Buffer.from(''));

const begun = process.cpuUsage();
const self = {
  postMessage({ outcome, failure }) {
    if (failure) {
      console.log(JSON.stringify({ failure: failure.text }));
      process.exitCode = 1;
    }
    if (!outcome) return;
    const { user, system } = process.cpuUsage(begun);
    fs.writeFileSync(out, outcome.page);
    console.log(JSON.stringify({ ...outcome.summary, seconds: (user + system) * 1e-6 }));
  },
};
new Function('self', script(page, 'worker'))(self);
const texts = [read(program), read(settings), name(program), name(settings)];
self.onmessage({ data: { wasm, texts, rate, hasSwitches: false } });
