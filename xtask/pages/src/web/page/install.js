/* The page of a release: installs an image over USB, from what the page's tables say of it. */

const NOTHING = 'Nothing was written.';
const INCOMPLETE = 'The firmware in the board is incomplete. Its bootloader is in the chip and cannot be lost: start it again by BOOT0, and install again; where BOOT0 cannot be reached, use the SD card or UF2.';

const STARTED = 'The firmware starts by itself; where it does not, switch the board off and on.';

/** Why no board can be reached from here, if none can. */
function obstacle() {
  if (!window.isSecureContext) return 'Browsers reach a board only from a page that came by https, or from this computer (localhost).';
  if (!navigator.usb) return 'This browser cannot reach a board over USB: Chrome and Edge can. Or take the file, as below.';
  return '';
}

/** The file of an image, which must be the one of the release. */
async function fetchImage({ file, sha256 }) {
  const response = await reach(fetch(file, { cache: 'no-cache' }), 'The file cannot be fetched');
  need(response.ok, `The file cannot be fetched: ${response.status} ${response.statusText}.`);
  const bytes = new Uint8Array(await reach(response.arrayBuffer(), 'The file cannot be fetched'));
  const digest = new Uint8Array(await crypto.subtle.digest('SHA-256', bytes));
  const found = [...digest].map((byte) => byte.toString(16).padStart(2, '0')).join('');
  need(found === sha256, 'The file is not the one of this release: its SHA-256 is another. Load this page again; if that repeats, do not use the file.');
  return bytes;
}

/** A refusal of a flash that a chip does not have; chips whose flash is the same cannot be told apart. */
function checkChip(dfuse, { chip, flashes }) {
  const found = dfuse.sectors.map(({ bytes }) => bytes / 1024).join();
  const isRight = flashes.split(' ').includes(found) && dfuse.sectors[0].address === FLASH;
  need(isRight, `The chip at USB is another one than the ${chip} of this board. It calls its flash "${dfuse.name}".`);
}

class Installer {
  constructor(form) {
    this.form = form;
    this.choice = form.querySelector('select');
    this.bar = form.querySelector('progress');
    this.state = form.querySelector('[role=status]');
    form.addEventListener('submit', (event) => {
      event.preventDefault();
      this.run();
    });
    form.hidden = false;
    this.say(obstacle());
    this.enable(!obstacle());
  }

  enable(isFree) {
    this.form.querySelector('button').disabled = !isFree;
    this.choice.disabled = !isFree;
  }

  say(text, kind = '') {
    this.state.textContent = text;
    this.state.className = kind;
  }

  report(verb, part) {
    this.bar.value = part;
    // Whoever has it read out hears each tenth.
    const text = `${verb}: ${10 * Math.floor(10 * part)} %. Leave board and page alone.`;
    if (text !== this.state.textContent) this.say(text);
  }

  async run() {
    const { board } = this.form.dataset;
    const image = { ...this.form.dataset, ...this.choice.selectedOptions[0].dataset };
    Installer.all.forEach((installer) => installer.enable(false));
    this.bar.value = 0;
    this.bar.hidden = false;
    this.say('Choose the board in the list of the browser.');
    let device = null;
    const written = { isBegun: false };
    try {
      device = await this.choose();
      this.say('Checking the file and the chip.');
      const bytes = await this.install(device, image, written);
      this.say(`Installed ${board}: ${bytes} bytes, read back and compared. ${STARTED}`, 'good');
    } catch (error) {
      this.say(`${error.message} ${written.isBegun ? INCOMPLETE : NOTHING}`, 'bad');
      document.getElementById('access').open ||= error.message.includes('No access');
    }
    window.removeEventListener('beforeunload', keep);
    await device?.close().catch(() => {});
    this.bar.hidden = true;
    Installer.all.forEach((installer) => installer.enable(true));
  }

  choose() {
    const filters = [{ vendorId: VENDOR, productId: PRODUCT }];
    const none = 'No board was chosen, or the browser does not permit its use';
    return reach(navigator.usb.requestDevice({ filters }), none, 'Where the list is empty: see "No access" below.');
  }

  async install(device, image, written) {
    const start = Number(image.start);
    const end = image.flashes.split(' ')[0].split(',').reduce((sum, kib) => sum + kib * 1024, FLASH);
    const segments = readSegments(await fetchImage(image), { title: image.board, start, end });
    const dfuse = new Dfuse(device);
    await dfuse.open();
    checkChip(dfuse, image);
    window.addEventListener('beforeunload', keep);
    written.isBegun = true;
    return install(dfuse, segments, (verb, part) => this.report(verb, part));
  }
}

/** Has the browser ask before the page is left. */
function keep(event) {
  event.preventDefault();
}

Installer.all = [...document.querySelectorAll('form.install')].map((form) => new Installer(form));
document.body.dataset.ready = 'yes';
