/* Plays jobs in a thread of its own: the firmware's code as WebAssembly. */

// Changes of the machine at a time, and how often is told how far it is, ms.
const CHANGES = 20000;
const TOLD_MS = 100;
const TEXT = { failure: 0, summary: 1, page: 2 };

/** A job that is refused, or comes to no end. */
class Refused extends Error {}

class Machine {
  constructor(instance) {
    this.calls = instance.exports;
  }

  put(which, bytes) {
    const at = this.calls.room(which, bytes.length);
    // The memory may have grown, and so be another one.
    new Uint8Array(this.calls.memory.buffer, at, bytes.length).set(bytes);
  }

  text(which) {
    const at = this.calls.text(which);
    return new Uint8Array(this.calls.memory.buffer, at, this.calls.length(which)).slice();
  }

  read(which) {
    return new TextDecoder().decode(this.text(which));
  }

  check(isRefused) {
    if (isRefused) throw new Refused(this.read(TEXT.failure));
  }

  /** Plays the job of some texts: program, settings, and the names of both. */
  play(texts, { rate, hasSwitches }, progress) {
    texts.forEach((bytes, which) => this.put(which, bytes));
    this.check(this.calls.begin(rate, hasSwitches));
    let told = performance.now();
    while (!this.calls.pump(CHANGES)) {
      if (performance.now() - told < TOLD_MS) continue;
      told = performance.now();
      progress({ bytes: this.calls.read(), seconds: this.calls.seconds() });
    }
    this.check(this.calls.finish());
    return { summary: JSON.parse(this.read(TEXT.summary)), page: this.text(TEXT.page) };
  }
}

/** What the machine says of its own fault, beside what the browser says. */
function fault(machine, error) {
  let note = '';
  try {
    note = machine?.read(TEXT.failure) ?? '';
  } catch {
    // It cannot even say that.
  }
  return `${note || 'the simulator has stopped, perhaps for want of memory'} (${error})`;
}

self.onmessage = async ({ data: { wasm, texts, ...options } }) => {
  let machine;
  try {
    machine = new Machine((await WebAssembly.instantiate(wasm)).instance);
    const outcome = machine.play(texts, options, (progress) => self.postMessage({ progress }));
    self.postMessage({ outcome }, [outcome.page.buffer]);
  } catch (error) {
    const isRefused = error instanceof Refused;
    self.postMessage({ failure: { isRefused, text: isRefused ? error.message : fault(machine, error) } });
  }
};
