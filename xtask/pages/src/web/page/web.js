/* The page that plays jobs: takes the files, and shows what the worker makes of them. */

const $ = (id) => document.getElementById(id);
// A list of settings has such lines, and none of G-code, which may set something too.
const SETTING = /^[<>\s]*\$\d+\s*=/m;
const CODE = /^\s*(N\d+\s*)?[GMTFSXYZ]\s*[-.\d]/im;
// How much of a file is read for it.
const HEAD_BYTES = 4096;

function grouped(number) {
  return String(number).replace(/\B(?=(\d{3})+$)/g, '\u202f');
}

function duration(seconds) {
  const [hours, minutes] = [Math.floor(seconds / 3600), Math.floor(seconds / 60) % 60];
  const rest = (seconds % 60).toFixed(1);
  if (hours) return `${hours} h ${minutes} min`;
  return minutes ? `${minutes} min ${rest} s` : `${rest} s`;
}

function element(name, text) {
  const made = document.createElement(name);
  made.textContent = text;
  return made;
}

/** Whether a dropped file is a list of settings. */
async function isSettings(file) {
  const head = new Uint8Array(await file.slice(0, HEAD_BYTES).arrayBuffer());
  // PowerShell writes UTF-16.
  const coding = head[0] === 0xff && head[1] === 0xfe ? 'utf-16le' : 'utf-8';
  const text = new TextDecoder(coding).decode(head);
  return SETTING.test(text) && !CODE.test(text);
}

/** The bytes of a pack: `deflate-raw`, written as base64. */
async function unpack(id) {
  const text = atob($(id).textContent);
  const bytes = new Uint8Array(text.length);
  for (let at = 0; at < text.length; at += 1) bytes[at] = text.charCodeAt(at);
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream('deflate-raw'));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

class Web {
  constructor() {
    this.rate = Number(document.body.dataset.rate);
    this.wasm = unpack('wasm');
    this.source = new Blob([$('worker').textContent], { type: 'text/javascript' });
    this.files = {};
    this.worker = null;
    this.kept = [];
    for (const name of ['program', 'settings']) {
      $(name).addEventListener('change', () => this.take(name, $(name).files[0]));
    }
    $('files').addEventListener('submit', (event) => {
      event.preventDefault();
      this.run();
    });
    $('cancel').addEventListener('click', () => this.cancel());
    this.connectDrop();
    // A browser may remember the files of the last visit.
    for (const name of ['program', 'settings']) this.take(name, $(name).files[0]);
  }

  take(name, file) {
    this.files[name] = file;
    this.show();
  }

  show() {
    $('run').disabled = !this.files.program || Boolean(this.worker);
    $('cancel').disabled = !this.worker;
    $('progress').hidden = !this.worker;
  }

  say(text, isBad = false) {
    $('state').textContent = text;
    $('state').className = isBad ? 'bad' : '';
  }

  connectDrop() {
    const over = (isOver) => document.body.classList.toggle('dropping', isOver);
    document.addEventListener('dragover', (event) => {
      event.preventDefault();
      over(true);
    });
    document.addEventListener('dragleave', (event) => { if (!event.relatedTarget) over(false); });
    document.addEventListener('drop', async (event) => {
      event.preventDefault();
      over(false);
      await this.drop([...event.dataTransfer.files]);
    });
  }

  /** Takes files as what they look like, and plays the program if there is one. */
  async drop(files) {
    for (const file of files) {
      const name = await isSettings(file) ? 'settings' : 'program';
      const list = new DataTransfer();
      list.items.add(file);
      $(name).files = list.files;
      this.take(name, file);
    }
    if (this.files.program) await this.run();
  }

  /** Plays the files, both as they are now. */
  async run() {
    const { program, settings } = this.files;
    if (!program) return;
    const read = async (file) => new Uint8Array(file ? await file.arrayBuffer() : 0);
    this.end();
    this.forget();
    this.say('reads the files');
    this.begun = {};
    const { begun } = this;
    let texts;
    try {
      texts = await Promise.all([read(program), read(settings)]);
    } catch (error) {
      this.say(`a file cannot be read: ${error.message}`, true);
      return;
    }
    // Another run may have begun meanwhile.
    if (begun !== this.begun) return;
    const encode = (text) => new TextEncoder().encode(text);
    await this.start([...texts, encode(program.name), encode(settings?.name ?? '')]);
  }

  /** Has a worker play a job of some texts. */
  async start(texts) {
    const wasm = await this.wasm;
    this.end();
    this.forget();
    const address = URL.createObjectURL(this.source);
    const worker = new Worker(address);
    URL.revokeObjectURL(address);
    this.worker = worker;
    this.length = texts[0].length;
    // What one has sent that is gone is of no interest.
    worker.onmessage = ({ data }) => { if (worker === this.worker) this.hear(data); };
    worker.onerror = (event) => {
      event.preventDefault();
      this.fail(`the simulator does not run here: ${event.message ?? 'the browser starts no thread for it'}`);
    };
    $('progress').value = 0;
    this.say('begins');
    this.show();
    worker.postMessage({ wasm, texts, rate: this.rate, hasSwitches: $('switches').checked });
  }

  hear({ progress, outcome, failure }) {
    if (progress) {
      const part = this.length ? Math.min(1, progress.bytes / this.length) : 1;
      $('progress').value = part;
      this.say(`${Math.floor(100 * part)} % of the program, ${duration(progress.seconds)} of the machine's time`);
    }
    if (failure) this.fail(failure.isRefused ? failure.text : `the simulator has a fault, please report it: ${failure.text}`);
    if (outcome) this.finish(outcome);
  }

  /** Lets go of the worker: whatever has happened in it, the next one begins anew. */
  end() {
    this.worker?.terminate();
    this.worker = null;
    this.show();
  }

  cancel() {
    this.end();
    this.say('cancelled');
  }

  fail(text) {
    this.end();
    this.say(text, true);
  }

  /** Takes away what the last job has left. */
  forget() {
    this.kept.forEach((address) => URL.revokeObjectURL(address));
    this.kept = [];
    $('frame').replaceChildren();
    $('outcome').hidden = true;
    $('save').hidden = true;
    delete document.body.dataset.hash;
  }

  finish({ summary, page }) {
    this.end();
    this.say('');
    const name = this.files.program?.name ?? 'job';
    const late = summary.late ? `, ${grouped(summary.late)} late` : '';
    $('facts').textContent = `${name}: ${grouped(summary.lines)} lines, ${duration(summary.motion_time_s)}, `
      + `${grouped(summary.events)} step events${late}, hash ${summary.hash}, ends in ${summary.end}`;
    $('warnings').replaceChildren(...summary.warnings.map((text) => element('li', text)));
    this.tabulate(summary);
    $('outcome').hidden = false;
    const address = URL.createObjectURL(new Blob([page], { type: 'text/html' }));
    this.kept.push(address);
    $('save').href = address;
    $('save').download = `${name}.html`;
    $('save').hidden = false;
    const frame = document.createElement('iframe');
    frame.title = 'View of the job';
    // A program's page gets nothing of this one.
    frame.sandbox = 'allow-scripts';
    frame.src = address;
    $('frame').replaceChildren(frame);
    document.body.dataset.hash = summary.hash;
  }

  /** The table of refusals: each cause once, the most frequent first. */
  tabulate({ refused, causes }) {
    const table = $('refusals');
    table.hidden = refused === 0;
    table.querySelector('summary').textContent = `${grouped(refused)} lines refused`;
    table.querySelector('tbody').replaceChildren(...causes.map((cause) => {
      const row = document.createElement('tr');
      const cells = [grouped(cause.count), cause.what, cause.why, cause.answer, grouped(cause.first)];
      row.append(...cells.map((text) => element('td', text)));
      return row;
    }));
  }
}

window.web = new Web();
document.body.dataset.ready = 'yes';
