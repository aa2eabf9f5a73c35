/*
 * DfuSe over WebUSB: reads a file of an image, and writes it into the flash of a chip by the bootloader in its ROM.
 *
 * ST UM0391 has the file, ST AN3156 the commands, USB DFU 1.1 the requests and states. What is thrown has words for the
 * user. Nothing is erased before the file and the chip are what they have to be.
 */

const FLASH = 0x08000000;
const [VENDOR, PRODUCT] = [0x0483, 0xdf11];
// Bytes before the first element of a file, and after the last one.
const [HEAD, SUFFIX] = [11 + 274, 16];
// Requests, states, and commands that are sent as block 0.
const [DNLOAD, UPLOAD, GETSTATUS, CLRSTATUS, ABORT] = [1, 2, 3, 4, 6];
const [IDLE, BUSY, DOWNLOADING, FAILED] = [2, 4, 5, 10];
const [SET_ADDRESS, ERASE] = [0x21, 0x41];
// The block at the address that was set. Which length counts in the address of the next one is read in two ways.
const BLOCK = 2;
// The types of descriptors, and English.
const [CONFIGURATION, STRING, INTERFACE, DFU] = [2, 3, 4, 0x21];
const ENGLISH = 0x0409;
// How long a busy bootloader is waited for: a sector of 128 KiB is erased in 4 s at most, by the data sheets.
const [MOST_POLLS, LEAST_POLL_MS] = [2000, 4];
// The error of a bootloader whose chip is protected, and what is said then.
const VENDOR_ERROR = 11;
const PROTECTED = 'The chip is protected against reading and takes no firmware: STM32CubeProgrammer ends that, and erases the chip.';

function need(claim, words) {
  if (!claim) throw new Error(words);
}

/** What a promise gives; its failure is told in words, with those of the browser and with advice. */
async function reach(promise, words, advice = '') {
  try {
    return await promise;
  } catch (error) {
    throw new Error(`${words} (${error.message.replace(/\.$/, '')}). ${advice}`.trim(), { cause: error });
  }
}

function hex(number) {
  return `0x${number.toString(16).padStart(8, '0')}`;
}

/** The CRC of a file's suffix: that of Ethernet without its last inversion. */
function crc(bytes) {
  let sum = 0xffffffff;
  for (const byte of bytes) {
    sum ^= byte;
    for (let bit = 0; bit < 8; bit += 1) sum = sum & 1 ? (sum >>> 1) ^ 0xedb88320 : sum >>> 1;
  }
  return sum >>> 0;
}

/**
 * The segments of a DfuSe file: it must be whole, of the board of a title, begin at `start`, and end before `end`.
 */
function readSegments(bytes, { title, start, end }) {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.length);
  const word = (at) => view.getUint32(at, true);
  const half = (at) => view.getUint16(at, true);
  const text = (at, length) => String.fromCharCode(...bytes.subarray(at, at + length));
  const whole = (claim, what) => need(claim, `The file is damaged: ${what}.`);
  const last = bytes.length - SUFFIX;
  whole(last > HEAD, 'it is too short');
  whole(text(last + 8, 3) === 'UFD' && bytes[last + 11] === SUFFIX, 'its suffix is missing');
  whole(word(last + 12) === crc(bytes.subarray(0, last + 12)), 'its CRC is wrong');
  whole(half(last + 6) === 0x011a && half(last + 4) === VENDOR && half(last + 2) === PRODUCT, 'it is for another bootloader');
  whole(text(0, 5) === 'DfuSe' && bytes[5] === 1 && bytes[10] === 1 && word(6) === last, 'its prefix is wrong');
  whole(text(11, 6) === 'Target' && bytes[17] === 0 && word(277) === last - HEAD, 'its target is wrong');
  const name = text(22, 255).split('\0')[0];
  need(name === title, `The file is for another board: ${name}.`);
  const segments = [];
  let at = HEAD;
  let free = start;
  for (let count = word(281); count > 0; count -= 1) {
    whole(at + 8 <= last, 'a part of it is missing');
    const [address, length] = [word(at), word(at + 4)];
    at += 8;
    need(segments.length > 0 || address === start, `The file is for another place: ${hex(address)} instead of ${hex(start)}.`);
    need(address >= free && address + length <= end, `The file has something at ${hex(address)} that does not belong there.`);
    segments.push({ address, bytes: bytes.subarray(at, at + length) });
    [at, free] = [at + length, address + length];
  }
  whole(at === last, 'its parts do not fill it');
  return segments;
}

/** The sectors of a flash by what the bootloader calls it: `@Internal Flash  /0x08000000/04*016Kg,01*064Kg`. */
function readSectors(name) {
  const [, start, list] = /^@Internal Flash *\/(0x[0-9a-f]{8})\/([^/]*)$/i.exec(name) ?? [];
  const sectors = [];
  let at = Number(start);
  for (const part of (list ?? '').split(',')) {
    const [, count, kib] = /^(\d+)\*(\d+)Kg$/.exec(part) ?? [];
    for (let left = Number(count ?? 0); left > 0; left -= 1) {
      sectors.push({ address: at, bytes: kib * 1024 });
      at += kib * 1024;
    }
  }
  return sectors;
}

/** The bootloader of a chip, through a device of WebUSB. */
class Dfuse {
  constructor(device) {
    this.device = device;
    // What happens to the flash, for the words of a failure.
    this.doing = 'was looked at';
  }

  /** Connects, and reads what the bootloader says of the flash and of its transfers. */
  async open() {
    const { device } = this;
    await reach(device.open(), 'Your system does not let the browser open the board', 'See "No access" below.');
    if (!device.configuration) await reach(device.selectConfiguration(1), 'The board cannot be configured');
    this.index = device.configuration.interfaces[0].interfaceNumber;
    await reach(device.claimInterface(this.index), 'Another program uses the board', 'Close it, and try again.');
    await reach(device.selectAlternateInterface(this.index, 0), 'The board does not give its flash');
    const descriptors = await this.describe(CONFIGURATION, 0, 0, 0xff);
    for (let at = 0; at + 2 < descriptors.byteLength && descriptors.getUint8(at) > 0; at += descriptors.getUint8(at)) {
      const type = descriptors.getUint8(at + 1);
      if (type === INTERFACE && descriptors.getUint8(at + 3) === 0) this.label = descriptors.getUint8(at + 8);
      if (type === DFU) this.most = descriptors.getUint16(at + 5, true);
    }
    need(this.label && this.most, 'This is no bootloader of an STM32: it does not describe its flash.');
    const label = await this.describe(STRING, this.label, ENGLISH, 0xff);
    this.name = '';
    for (let at = 2; at + 1 < label.byteLength; at += 2) this.name += String.fromCharCode(label.getUint16(at, true));
    this.sectors = readSectors(this.name);
    await this.point(FLASH);
    const shown = this.device.controlTransferIn(this.setup(UPLOAD, BLOCK), 4);
    await this.transfer(shown, PROTECTED);
    await this.idle();
  }

  describe(type, number, index, length) {
    const setup = { requestType: 'standard', recipient: 'device', request: 6, value: type << 8 | number, index };
    return this.transfer(this.device.controlTransferIn(setup, length));
  }

  setup(request, value) {
    return { requestType: 'class', recipient: 'interface', request, value, index: this.index };
  }

  async transfer(promise, refused = `The bootloader refuses a request while the flash ${this.doing}: start it again.`) {
    const broken = `The connection to the board broke while the flash ${this.doing}`;
    const result = await reach(promise, broken);
    need(result.status === 'ok', refused);
    return result.data;
  }

  send(request, value, bytes = new Uint8Array()) {
    return this.transfer(this.device.controlTransferOut(this.setup(request, value), bytes));
  }

  async status() {
    const status = await this.transfer(this.device.controlTransferIn(this.setup(GETSTATUS, 0), 6));
    return { code: status.getUint8(0), pollMs: status.getUint32(0, true) >>> 8, state: status.getUint8(4) };
  }

  /** Ends whatever was begun, perhaps by a program before this one. */
  async idle() {
    const { state } = await this.status();
    if (state === FAILED) await this.send(CLRSTATUS, 0);
    else if (state !== IDLE) await this.send(ABORT, 0);
    const now = await this.status();
    need(now.state === IDLE, `The bootloader does not come to rest (state ${now.state}): start it again.`);
  }

  /** Sends a block, and waits until the bootloader has done with it. */
  async download(block, bytes) {
    await this.send(DNLOAD, block, bytes);
    let now = await this.status();
    for (let polls = 0; now.state === BUSY && polls < MOST_POLLS; polls += 1) {
      const { pollMs } = now;
      await new Promise((resolve) => { setTimeout(resolve, Math.max(pollMs, LEAST_POLL_MS)); });
      now = await this.status();
    }
    need(now.code !== VENDOR_ERROR, PROTECTED);
    need(now.state === DOWNLOADING, `The bootloader reports error ${now.code}, state ${now.state}, while the flash ${this.doing}.`);
  }

  command(code, address) {
    const bytes = new DataView(new ArrayBuffer(5));
    bytes.setUint8(0, code);
    bytes.setUint32(1, address, true);
    return this.download(0, new Uint8Array(bytes.buffer));
  }

  async erase(address) {
    this.doing = 'was erased';
    await this.command(ERASE, address);
  }

  /** Sets the address of the next block, and comes to rest. */
  async point(address) {
    await this.idle();
    await this.command(SET_ADDRESS, address);
    await this.idle();
  }

  async write({ address, bytes }) {
    this.doing = 'was written';
    await this.point(address);
    // A block has two bytes at least, and what is erased stays so.
    const even = new Uint8Array(bytes.length + bytes.length % 2).fill(0xff);
    even.set(bytes);
    await this.download(BLOCK, even);
  }

  async compare({ address, bytes }) {
    this.doing = 'was read back';
    await this.point(address);
    const request = this.device.controlTransferIn(this.setup(UPLOAD, BLOCK), bytes.length + bytes.length % 2);
    const read = await this.transfer(request);
    need(read.byteLength >= bytes.length, `The bootloader does not show the flash at ${hex(address)}.`);
    const isEqual = bytes.every((byte, index) => byte === read.getUint8(index));
    need(isEqual, `The flash at ${hex(address)} is not what was written: if that repeats, the chip is worn.`);
  }

  /** Starts the program at an address: the bootloader leaves at the question for its state, perhaps without an answer. */
  async leave(address) {
    await this.point(address);
    await this.send(DNLOAD, 0);
    await this.status();
  }
}

/**
 * Writes segments by a bootloader that was opened: erases their sectors and no other, writes, compares, leaves. The
 * vectors are erased first and written last: where the cable is pulled out in between, no half of a program starts.
 */
async function install(dfuse, segments, report) {
  const touched = dfuse.sectors.filter((sector) => segments.some(({ address, bytes }) => address < sector.address + sector.bytes && address + bytes.length > sector.address));
  const blocks = segments.flatMap(({ address, bytes }) => {
    const starts = Array.from({ length: Math.ceil(bytes.length / dfuse.most) }, (_, index) => index * dfuse.most);
    return starts.map((at) => ({ address: address + at, bytes: bytes.subarray(at, at + dfuse.most) }));
  });
  const sum = (parts, size) => parts.reduce((all, part) => all + size(part), 0);
  const bytes = sum(blocks, (block) => block.bytes.length);
  const all = sum(touched, (sector) => sector.bytes) + 2 * bytes;
  let done = 0;
  const advance = (verb, more) => {
    done += more;
    report(verb, done / all);
  };
  for (const sector of touched) {
    await dfuse.erase(sector.address);
    advance('Erasing', sector.bytes);
  }
  for (const block of blocks.toReversed()) {
    await dfuse.write(block);
    advance('Writing', block.bytes.length);
  }
  for (const block of blocks) {
    await dfuse.compare(block);
    advance('Comparing', block.bytes.length);
  }
  // Where this fails, the program is there all the same: it starts when the board is switched off and on.
  await dfuse.leave(segments[0].address).catch(() => {});
  return bytes;
}
