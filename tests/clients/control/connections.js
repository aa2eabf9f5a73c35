/* The connections from the control page to a machine. Each opens the page, and leaves the operator before *Connect*. */

'use strict';

const { serve } = require('../browser');
const { start } = require('../monitor');
const { bridged } = require('./line');
const {
  click, fill, isState, openPage,
} = require('./operator');
const { mockSerial } = require('./serial');

const SCREEN = { width: 1400, height: 900, scheme: 'light' };

/** The page as a file server has it. */
async function opened(browser, pageFile, screen, prepare) {
  const server = await serve(pageFile, []);
  const { page, faults } = await openPage(browser, `http://127.0.0.1:${server.address().port}/`, screen, prepare);
  return { page, faults, close: () => server.close() };
}

/** The virtual machine, in the page. */
async function virtual(browser, pageFile, screen = SCREEN) {
  const connection = await opened(browser, pageFile, screen);
  return { ...connection, connect: () => click(connection.page, '#connect') };
}

/** A WebSocket of the machine's own. */
async function socket(browser, pageFile, machine, screen = SCREEN) {
  const line = await bridged(machine);
  const connection = await opened(browser, pageFile, screen);
  const connect = async () => {
    await connection.page.select('#machine', 'socket');
    await fill(connection.page, '.connection input[type=url]', line.address);
    await click(connection.page, '#connect');
  };
  return { ...connection, line, connect };
}

/** A serial port. */
async function serial(browser, pageFile, machine, screen = SCREEN) {
  const line = await bridged(machine);
  const connection = await opened(browser, pageFile, screen, (page) => mockSerial(page, line.address));
  const connect = async () => {
    await connection.page.select('#machine', 'serial');
    await click(connection.page, '#connect');
  };
  return { ...connection, line, connect };
}

/** The program that serves the page, and has the machine: at a port or an address. */
async function served(browser, monitor, machine, screen = SCREEN) {
  const where = machine.includes('/') ? '--port' : '--tcp';
  const program = await start(monitor, ['--control', '--no-open', where, machine]);
  const { page, faults } = await openPage(browser, program.url, screen);
  return {
    page, faults, program, connect: async () => {}, close: () => program.child.kill(),
  };
}

/** Connects, and waits until the machine is there. It is locked as it was switched on, unless it got its settings after that. */
async function connect(connection, wanted = 'Alarm: locked') {
  await connection.connect();
  await isState(connection.page, wanted);
}

module.exports = {
  SCREEN, connect, serial, served, socket, virtual,
};
