/*
 * A day at the control page, by each way to the machine: the page is served by `monitor --control` at the machine's
 * port, takes the port itself for a serial port, or reaches it by a WebSocket.
 *
 * Its arguments are the machine's port, and which machine it is; the environment has way, page and monitor.
 */

'use strict';

const { check, measured, run } = require('./cncjs');
const { browse } = require('./browser');
const { day } = require('./control/day');
const { KEYBOARD, MOUSE } = require('./control/hands');
const ways = require('./control/ways');

const [, , port, place] = process.argv;
const { CONTROL_WAY, CONTROL_PAGE, MONITOR } = process.env;

const open = {
  served: (browser) => ways.served(browser, MONITOR, port),
  serial: (browser) => ways.serial(browser, CONTROL_PAGE, port),
  socket: (browser) => ways.socket(browser, CONTROL_PAGE, port),
};

// What is said on a line beside the bytes of the machine: an error of a serial port, and what FluidNC says to its page.
const SAID = { serial: 'FramingError', socket: 'PING:0' };

async function main() {
  const browser = await browse();
  const way = await open[CONTROL_WAY](browser);
  try {
    await ways.connect(way);
    if (way.line) way.line.say(SAID[CONTROL_WAY]);
    const hands = CONTROL_WAY === 'served' ? MOUSE : KEYBOARD;
    const isEmulated = place === 'qemu';
    const end = await day(way.page, hands, { measured, hasBlock: !isEmulated, feed: isEmulated ? 3000 : 6000 });
    check(way.faults.length === 0, way.faults.join('\n'));
    return end;
  } finally {
    await way.page.screenshot({ path: 'control.png', fullPage: true });
    await browser.close();
    way.close();
  }
}

run(main);
