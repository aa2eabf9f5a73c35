/*
 * A day at the control page, by each connection to the machine: the page is served by `monitor --control` at the machine's
 * port, takes the port itself for a serial port, or reaches it by a WebSocket.
 *
 * Its arguments are the machine's port, and which machine it is; the environment has connection, page and monitor.
 */

'use strict';

const { check, measured, run } = require('./cncjs');
const { browse } = require('./browser');
const { day } = require('./control/day');
const { KEYBOARD, MOUSE } = require('./control/hands');
const connections = require('./control/connections');

const [, , port, place] = process.argv;
const { CONTROL_CONNECTION, CONTROL_PAGE, MONITOR } = process.env;

const open = {
  served: (browser) => connections.served(browser, MONITOR, port),
  serial: (browser) => connections.serial(browser, CONTROL_PAGE, port),
  socket: (browser) => connections.socket(browser, CONTROL_PAGE, port),
};

// What is said on a line beside the bytes of the machine: an error of a serial port, and what FluidNC says to its page.
const SAID = { serial: 'FramingError', socket: 'PING:0' };

async function main() {
  const browser = await browse();
  const connection = await open[CONTROL_CONNECTION](browser);
  try {
    const isEmulated = place === 'qemu';
    await connections.connect(connection, isEmulated ? 'Idle' : undefined);
    if (connection.line) connection.line.say(SAID[CONTROL_CONNECTION]);
    const hands = CONTROL_CONNECTION === 'served' ? MOUSE : KEYBOARD;
    const end = await day(connection.page, hands, { measured, hasBlock: !isEmulated, feed: isEmulated ? 3000 : 6000 });
    check(connection.faults.length === 0, connection.faults.join('\n'));
    return end;
  } finally {
    await connection.page.screenshot({ path: 'control.png', fullPage: true });
    await browser.close();
    connection.close();
  }
}

run(main);
