/*
 * The line to a machine as the scripts have it: a terminal or a TCP address, and bytes with their times. Over a line, a
 * page reaches the machine by a WebSocket, also where it takes that for a serial port.
 */

'use strict';

const fs = require('fs');
const net = require('net');
const tty = require('tty');
const { WebSocketServer } = require('ws');

const { check } = require('../cncjs');

/** Opens a terminal: reads go to `take`. */
function openTerminal(name, take) {
  const descriptor = fs.openSync(name, fs.constants.O_RDWR | fs.constants.O_NOCTTY);
  check(tty.isatty(descriptor), `${name} is a terminal`);
  const terminal = new tty.ReadStream(descriptor);
  terminal.setRawMode(true);
  terminal.on('data', take);
  return { write: (bytes) => fs.writeSync(descriptor, bytes), end: () => terminal.destroy() };
}

/** Opens a TCP address such as `127.0.0.1:2323`. */
function openAddress(address, take, leave) {
  const [host, port] = address.split(':');
  const socket = net.connect(port, host);
  socket.setNoDelay();
  socket.on('data', take);
  socket.on('error', () => {});
  socket.on('close', leave);
  return { write: (bytes) => socket.write(bytes), end: () => socket.destroy() };
}

const open = (name, take, leave) => (name.includes('/') ? openTerminal(name, take) : openAddress(name, take, leave));

/** What has passed on a line: bytes as Latin-1 with the time, ms. */
class Passed {
  constructor() {
    this.all = [];
  }

  take(isSent, bytes) {
    this.all.push({ ms: performance.now(), isSent, text: bytes.toString('latin1') });
  }

  /** What was sent to the machine from a time on, without the questions for reports. */
  sentSince(ms) {
    const sent = this.all.filter((piece) => piece.isSent && piece.ms >= ms);
    return sent.map((piece) => piece.text).join('').replaceAll('?', '');
  }
}

/** A TCP address that leads to a machine. Whoever connects is cut off by `cut`. */
async function tapped(machine) {
  const passed = new Passed();
  const connected = new Set();
  const server = net.createServer((socket) => {
    connected.add(socket);
    socket.setNoDelay();
    const line = open(machine, (bytes) => {
      passed.take(false, bytes);
      socket.write(bytes);
    }, () => socket.destroy());
    socket.on('data', (bytes) => {
      passed.take(true, bytes);
      line.write(bytes);
    });
    socket.on('error', () => {});
    socket.on('close', () => {
      connected.delete(socket);
      line.end();
    });
  });
  await new Promise((listens) => { server.listen(0, '127.0.0.1', listens); });
  return {
    passed,
    address: `127.0.0.1:${server.address().port}`,
    cut: () => connected.forEach((socket) => socket.resetAndDestroy()),
    close: () => server.close(),
  };
}

/**
 * A WebSocket as controllers have one, that leads to a machine; `cut` is as if the cable were out, and `say` sends a
 * message beside the bytes of the machine.
 */
async function bridged(machine) {
  const passed = new Passed();
  const server = new WebSocketServer({ host: '127.0.0.1', port: 0 });
  await new Promise((listens) => { server.on('listening', listens); });
  server.on('connection', (socket) => {
    const line = open(machine, (bytes) => {
      passed.take(false, bytes);
      socket.send(bytes);
    }, () => socket.terminate());
    socket.on('message', (bytes) => {
      passed.take(true, bytes);
      line.write(bytes);
    });
    socket.on('close', () => line.end());
  });
  return {
    passed,
    address: `ws://127.0.0.1:${server.address().port}/`,
    cut: () => server.clients.forEach((socket) => socket.terminate()),
    say: (text) => server.clients.forEach((socket) => socket.send(text)),
    close: () => server.close(),
  };
}

module.exports = { bridged, tapped };
