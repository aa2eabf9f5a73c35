/* The path: where the machine is at a time, what it does there, and for which line. */

const KIND = { STANDSTILL: 0, RAPID: 1, FEED: 2 };
const KIND_NAMES = ['standing still', 'rapid', 'feed', 'jog', 'probing', 'homing', 'parking'];
// A rotary axis that turns farther in a piece would be drawn as a chord.
const CHORD_DEGREES = 4;
// A machine that is so near to the path is on it, and how much farther away a piece may be that is a second nearer in
// time, mm: as in path_follower.rs.
const NEAR_MM = 0.1;
const SECOND_MM = 0.002;

/** Which part of a piece's way has been made at a part of its time: the speed changes evenly. */
function partOfWay(from, to, part) {
  const sum = from + to;
  return sum > 0 ? (2 * from * part + (to - from) * part * part) / sum : part;
}

/** The same path with more vertices, where a rotary axis turns far. */
function withChords(vertices, rotary) {
  const parts = (piece) => {
    const turned = rotary.map((axis) => Math.abs(vertices.place[axis][piece + 1] - vertices.place[axis][piece]));
    return Math.max(1, Math.ceil(Math.max(0, ...turned) / CHORD_DEGREES));
  };
  let count = 1;
  for (let piece = 0; piece + 1 < vertices.count; piece += 1) count += parts(piece);
  if (!vertices.count || count <= vertices.count) return vertices;
  const names = ['time', 'speed', 'line', 'programmed', 'powerBefore', 'power'];
  const all = { count, kind: new Uint8Array(count), place: vertices.place.map(() => new Float64Array(count)) };
  names.forEach((name) => { all[name] = new Float64Array(count); });
  let row = 0;
  for (let piece = 0; piece < vertices.count; piece += 1) {
    const pieces = piece + 1 < vertices.count ? parts(piece) : 1;
    for (let index = 0; index < pieces; index += 1, row += 1) {
      const part = index / pieces;
      const mix = (column) => (index ? column[piece] + (column[piece + 1] - column[piece]) * part : column[piece]);
      const [from, to] = [vertices.speed[piece], vertices.speed[piece + 1]];
      const way = index ? partOfWay(from, to, part) : 0;
      all.time[row] = mix(vertices.time);
      all.speed[row] = mix(vertices.speed);
      all.line[row] = vertices.line[piece];
      all.programmed[row] = vertices.programmed[piece];
      all.kind[row] = vertices.kind[piece];
      all.power[row] = index ? mix(vertices.power) : vertices.power[piece];
      all.powerBefore[row] = index ? all.power[row] : vertices.powerBefore[piece];
      vertices.place.forEach((column, axis) => {
        const delta = index ? (column[piece + 1] - column[piece]) * way : 0;
        all.place[axis][row] = column[piece] + delta;
      });
    }
  }
  return all;
}

class Path {
  constructor(vertices, facts) {
    const moves = (column) => column.some((value) => value !== column[0]);
    const rotary = facts.axes.map((axis, index) => index).filter((index) => facts.axes[index].is_rotary);
    this.rotary = rotary.filter((axis) => moves(vertices.place[axis]));
    Object.assign(this, withChords(vertices, this.rotary));
    this.facts = facts;
    this.pieces = Math.max(0, this.count - 1);
    this.end = this.count ? this.time[this.count - 1] : 0;
    this.follow();
    this.measure();
    this.index(facts.lines);
  }

  /** The tool of each piece; the speed of a spindle in place of its power. */
  follow() {
    const { facts: { programmed, is_laser: isLaser }, count, line } = this;
    this.tool = new Uint8Array(count);
    const rpm = new Float64Array(count);
    let at = 0;
    for (let row = 0; row < count && programmed.length; row += 1) {
      while (at + 1 < programmed.length && programmed[at + 1].line <= line[row]) at += 1;
      while (at > 0 && programmed[at].line > line[row]) at -= 1;
      this.tool[row] = programmed[at].tool;
      rpm[row] = programmed[at].rpm;
    }
    if (isLaser) return;
    const speeds = (powers, back) => powers.map((power, row) => (power > 0 ? rpm[Math.max(0, row - back)] : 0));
    [this.power, this.powerBefore] = [speeds(this.power, 0), speeds(this.powerBefore, 1)];
  }

  /** A power of the laser, or a speed of the spindle, in words. */
  strength(value) {
    if (this.facts.is_laser) return `${Math.round(100 * value)} %`;
    return value > 0 ? `${grouped(value)} rpm` : 'off';
  }

  /** A point as it is drawn: work on a rotary axis turns with it, about the machine's axes. */
  drawn(place) {
    let [x, y, z] = place;
    this.rotary.forEach((axis) => {
      const angle = place[axis] * Math.PI / 180;
      const [cos, sin] = [Math.cos(angle), Math.sin(angle)];
      const letter = this.facts.axes[axis].letter;
      if (letter === 'A') [y, z] = [y * cos + z * sin, z * cos - y * sin];
      if (letter === 'B') [z, x] = [z * cos + x * sin, x * cos - z * sin];
      if (letter === 'C') [x, y] = [x * cos + y * sin, y * cos - x * sin];
    });
    return [x, y, z];
  }

  measure() {
    const { count, place, kind } = this;
    this.xyz = new Float32Array(3 * count);
    this.way = new Float32Array(count);
    this.low = [Infinity, Infinity, Infinity];
    this.high = [-Infinity, -Infinity, -Infinity];
    this.cutLow = [...this.low];
    this.cutHigh = [...this.high];
    [this.fastest, this.fastestFeed, this.strongest, this.feeds, this.rapids] = [0, 0, 0, 0, 0];
    for (let row = 0; row < count; row += 1) {
      const at = this.drawn(place.map((column) => column[row]));
      this.xyz.set(at, 3 * row);
      const isCut = kind[row] === KIND.FEED || (row > 0 && kind[row - 1] === KIND.FEED);
      at.forEach((value, axis) => {
        this.low[axis] = Math.min(this.low[axis], value);
        this.high[axis] = Math.max(this.high[axis], value);
        if (isCut) {
          this.cutLow[axis] = Math.min(this.cutLow[axis], value);
          this.cutHigh[axis] = Math.max(this.cutHigh[axis], value);
        }
      });
      if (row > 0) {
        const before = this.xyz.subarray(3 * row - 3, 3 * row);
        this.way[row] = this.way[row - 1] + Math.hypot(at[0] - before[0], at[1] - before[1], at[2] - before[2]);
      }
      this.fastest = Math.max(this.fastest, this.speed[row]);
      if (isCut) this.fastestFeed = Math.max(this.fastestFeed, this.speed[row]);
      if (row + 1 < count) {
        this.strongest = Math.max(this.strongest, this.power[row]);
        this.feeds += kind[row] === KIND.FEED;
        this.rapids += kind[row] === KIND.RAPID;
      }
    }
    const isFeed = (value, piece) => kind[piece] === KIND.FEED;
    this.tools = [...new Set(this.tool.filter(isFeed))].sort((a, b) => a - b);
    const programmed = this.programmed.filter(isFeed);
    this.feedRange = programmed.reduce(([least, most], feed) => [Math.min(least, feed), Math.max(most, feed)], [Infinity, 0]);
    if (!this.feeds) [this.cutLow, this.cutHigh] = [[...this.low], [...this.high]];
  }

  /** The first and the last piece of each line; -1 for a line without one. */
  index(lines) {
    this.first = new Int32Array(lines + 2).fill(-1);
    this.last = new Int32Array(lines + 2).fill(-1);
    for (let piece = 0; piece < this.pieces; piece += 1) {
      const line = this.line[piece];
      if (line <= lines) {
        if (this.first[line] < 0) this.first[line] = piece;
        this.last[line] = piece;
      }
    }
  }

  pieceAt(time) {
    let [low, high] = [0, this.count - 1];
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (this.time[middle] <= time) low = middle; else high = middle;
    }
    return low;
  }

  /** What there is at a time. */
  at(time) {
    const piece = this.pieceAt(time);
    const next = Math.min(piece + 1, this.count - 1);
    const span = this.time[next] - this.time[piece];
    const part = span > 0 ? Math.min(1, Math.max(0, (time - this.time[piece]) / span)) : 0;
    return this.within(piece, part);
  }

  /** What there is at a part of the time of a piece. */
  within(piece, part) {
    const next = Math.min(piece + 1, this.count - 1);
    const [from, to] = [this.speed[piece], this.speed[next]];
    const way = partOfWay(from, to, part);
    const place = this.place.map((column) => column[piece] + (column[next] - column[piece]) * way);
    return {
      piece,
      place,
      xyz: this.drawn(place),
      speed: from + (to - from) * part,
      power: this.power[piece] + (this.powerBefore[next] - this.power[piece]) * part,
      time: this.time[piece] + (this.time[next] - this.time[piece]) * part,
      line: this.line[piece],
      kind: this.kind[piece],
      programmed: this.programmed[piece],
    };
  }

  /** At which part of its time a part of a piece's way has been made. */
  partOfTime(piece, part) {
    let [low, high] = [0, 1];
    for (let round = 0; round < 30; round += 1) {
      const middle = (low + high) / 2;
      if (partOfWay(this.speed[piece], this.speed[piece + 1], middle) < part) low = middle; else high = middle;
    }
    return (low + high) / 2;
  }

  /** The first piece and the one after the last that a machine may be on at a line: those of the line and its neighbours. */
  piecesFrom(line) {
    const moving = [];
    for (let next = Math.max(0, line - 1); next < this.first.length && moving.length < 4; next += 1) {
      if (this.first[next] >= 0) moving.push(next);
    }
    if (!moving.length) return [this.pieces, this.pieces];
    return [this.first[moving[0]], Math.max(...moving.map((next) => this.last[next] + 1))];
  }

  /** The time at which the path comes by a place, in some of its pieces; of several, that near an expected time. */
  timeNear([x, y, z], first, last, expected) {
    const { xyz, time } = this;
    let [best, least] = [null, Infinity];
    for (let piece = first; piece < last; piece += 1) {
      const from = 3 * piece;
      const [dx, dy, dz] = [xyz[from + 3] - xyz[from], xyz[from + 4] - xyz[from + 1], xyz[from + 5] - xyz[from + 2]];
      const [px, py, pz] = [x - xyz[from], y - xyz[from + 1], z - xyz[from + 2]];
      const whole = dx * dx + dy * dy + dz * dz;
      const part = whole > 0 ? Math.min(1, Math.max(0, (px * dx + py * dy + pz * dz) / whole)) : 0;
      const off = Math.hypot(px - part * dx, py - part * dy, pz - part * dz);
      if (off <= NEAR_MM) {
        const [begin, end] = [time[piece], time[piece + 1]];
        const there = whole > 0
          ? begin + (end - begin) * this.partOfTime(piece, part) : Math.min(end, Math.max(begin, expected));
        const score = off + SECOND_MM * Math.abs(there - expected);
        if (score < least) [best, least] = [there, score];
      }
    }
    return best;
  }

  /** The place before a line that moves nothing itself, such as one that is refused. */
  placeBefore(line) {
    let [low, high] = [-1, this.pieces];
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (this.line[middle] < line) low = middle; else high = middle;
    }
    return this.xyz.subarray(3 * (low + 1), 3 * (low + 1) + 3);
  }
}
