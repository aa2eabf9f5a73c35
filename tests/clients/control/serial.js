/*
 * `navigator.serial` for a browser that sees no port: its one port leads over a WebSocket to a machine. The page asks
 * for the port, and the worker of the page opens it, so that both get the same.
 */

'use strict';

/** Defines the port, in a page or in a worker: runs in the browser, and knows nothing but its arguments. */
function define(address, scope) {
  class Port {
    async open({ baudRate }) {
      if (!Number.isInteger(baudRate)) throw new TypeError('a port needs a baud rate');
      if (this.readable) throw new DOMException('The port is already open.', 'InvalidStateError');
      const socket = new WebSocket(address);
      socket.binaryType = 'arraybuffer';
      await new Promise((resolve, reject) => {
        socket.onopen = resolve;
        socket.onerror = () => reject(new DOMException('Failed to open serial port.', 'NetworkError'));
      });
      const lost = () => new DOMException('The device has been lost.', 'NetworkError');
      this.socket = socket;
      const begin = () => {
        this.readable = new ReadableStream({
          start(controller) {
            socket.onmessage = ({ data }) => {
              if (typeof data !== 'string') {
                controller.enqueue(new Uint8Array(data));
                return;
              }
              // The name of an error: the port has a new stream then, as browsers have it.
              begin();
              controller.error(new DOMException('The line is disturbed.', data));
            };
            socket.onclose = () => { try { controller.error(lost()); } catch { /* the page has cancelled it */ } };
          },
        });
      };
      begin();
      this.writable = new WritableStream({
        write(bytes) {
          if (socket.readyState !== WebSocket.OPEN) throw lost();
          socket.send(bytes);
        },
      });
    }

    async close() {
      // As the standard has it.
      if (this.readable?.locked || this.writable?.locked) throw new TypeError('Cannot cancel a locked stream');
      this.socket?.close();
      [this.readable, this.writable] = [null, null];
    }

    getInfo() {
      return { usbVendorId: 0x0483, usbProductId: 0x5740 };
    }
  }
  const port = new Port();
  let isGranted = typeof scope.window === 'undefined';
  const serial = {
    getPorts: async () => (isGranted ? [port] : []),
    requestPort: async () => {
      isGranted = true;
      return port;
    },
    addEventListener() {},
  };
  Object.defineProperty(Object.getPrototypeOf(scope.navigator), 'serial', { get: () => serial, configurable: true });
}

/** Has a page find a port that leads to the WebSocket at an address. */
async function mockSerial(page, address) {
  const text = `(${define})(${JSON.stringify(address)}, globalThis);`;
  await page.evaluateOnNewDocument(text);
  await page.evaluateOnNewDocument((before) => {
    const { Worker } = window;
    // What a page starts has the port, too.
    window.Worker = class extends Worker {
      constructor(script, options) {
        const parts = [before, `importScripts(${JSON.stringify(String(script))});`];
        super(URL.createObjectURL(new Blob(parts, { type: 'text/javascript' })), options);
      }
    };
  }, text);
}

module.exports = { mockSerial };
