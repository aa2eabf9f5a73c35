/* Curves over time on a plain canvas. Of what changes within a pixel, the least and the greatest is drawn. */

const LEFT = 62;
const TIMES = 20;
const GAP = 6;
const QUANTITIES = [
  { name: 'axis speed', unit: 'min', scale: 60, title: 'speed' },
  { name: 'acceleration', unit: 's²', scale: 1, title: 'acceleration' },
  { name: 'jerk', unit: 's³', scale: 1, title: 'jerk' },
];

/** A number for an axis of a curve. */
function short(value) {
  const size = Math.abs(value);
  if (size >= 1e6) return `${+(value / 1e6).toPrecision(3)}M`;
  if (size >= 1e4) return `${+(value / 1e3).toPrecision(3)}k`;
  return `${+value.toPrecision(3)}`;
}

class Curves {
  constructor(canvas, path, { derived, corners }, stretch) {
    Object.assign(this, { canvas, path, derived, corners, stretch });
    this.context = canvas.getContext('2d');
    this.range = [0, Math.max(path.end, 1e-3)];
    this.what = 'speed';
    this.now = path.end;
    this.colours = { axes: [] };
    new ResizeObserver(() => this.ask()).observe(canvas.parentElement);
  }

  /** What can be shown. */
  choices() {
    const power = this.path.strongest > 0 ? [['power', this.path.facts.is_laser ? 'Laser power' : 'Spindle speed']] : [];
    const corners = this.corners.length ? [['corners', 'Corners']] : [];
    const rotary = this.path.rotary.length ? [['rotary', 'Rotary axes']] : [];
    return [
      ['speed', 'Speed along the path'], ['0', 'Speed of each axis'], ['1', 'Acceleration'], ['2', 'Jerk'],
      ...corners, ...power, ...rotary,
    ];
  }

  ask() {
    if (this.isAsked) return;
    this.isAsked = true;
    requestAnimationFrame(() => {
      this.isAsked = false;
      this.render();
    });
  }

  /** Least and greatest values in each pixel, of something that is known at the ends of pieces. */
  ofPieces(width, begin, end) {
    const { path, range } = this;
    const bands = [new Float32Array(width).fill(NaN), new Float32Array(width).fill(NaN)];
    const scale = width / (range[1] - range[0]);
    const put = (pixel, value) => {
      if (pixel < 0 || pixel >= width) return;
      if (!(bands[0][pixel] <= value)) bands[0][pixel] = value;
      if (!(bands[1][pixel] >= value)) bands[1][pixel] = value;
    };
    for (let piece = path.pieceAt(range[0]); piece < path.pieces; piece += 1) {
      const [from, to] = [path.time[piece], path.time[piece + 1]];
      if (from > range[1]) break;
      const [a, b] = [begin(piece), end(piece)];
      const [p, q] = [(from - range[0]) * scale, (to - range[0]) * scale];
      put(Math.floor(p), a);
      put(Math.floor(q), b);
      for (let pixel = Math.max(0, Math.ceil(p)); pixel <= Math.min(width - 1, q); pixel += 1) {
        const value = a + (b - a) * (q > p ? (pixel - p) / (q - p) : 0);
        put(pixel, value);
        if (pixel > p) put(pixel - 1, value);
      }
    }
    return bands;
  }

  ofStretches(width, { least, greatest }, scale) {
    const { range, stretch } = this;
    const bands = [new Float32Array(width).fill(NaN), new Float32Array(width).fill(NaN)];
    const seconds = (range[1] - range[0]) / width;
    for (let pixel = 0; pixel < width; pixel += 1) {
      const from = Math.max(0, Math.floor((range[0] + pixel * seconds) / stretch));
      const to = Math.min(least.length - 1, Math.max(from, Math.ceil((range[0] + (pixel + 1) * seconds) / stretch) - 1));
      for (let index = from; index <= to; index += 1) {
        if (!(bands[0][pixel] <= least[index] * scale)) bands[0][pixel] = least[index] * scale;
        if (!(bands[1][pixel] >= greatest[index] * scale)) bands[1][pixel] = greatest[index] * scale;
      }
    }
    return bands;
  }

  /** The lanes below each other: what each shows, its colour, range and limit. */
  lanes(width) {
    const { path, colours, what } = this;
    const { facts } = path;
    const isRotaryOnly = path.low.every((low, axis) => low === path.high[axis]) && path.rotary.length > 0;
    const unit = isRotaryOnly ? '°' : 'mm';
    if (what === 'speed') {
      const top = Math.max(path.fastest, 1) * 1.08;
      const programmed = this.ofPieces(width, ...[0, 1].map(() => (piece) => (
        path.kind[piece] === KIND.FEED ? path.programmed[piece] : NaN)));
      const bands = this.ofPieces(width, (piece) => path.speed[piece], (piece) => path.speed[piece + 1]);
      return [{
        title: `speed along the path, ${unit}/min; dotted: programmed`, bands, beside: programmed, colour: colours.curve, range: [0, top],
      }];
    }
    if (what === 'power') {
      const scale = facts.is_laser ? 100 : 1;
      const bands = this.ofPieces(width, (piece) => scale * path.power[piece], (piece) => scale * path.powerBefore[piece + 1]);
      const title = facts.is_laser ? 'laser, % of full power' : 'programmed speed of the spindle, rpm';
      return [{ title, bands, colour: colours.curve, range: [0, facts.is_laser ? 105 : path.strongest * 1.08] }];
    }
    if (what === 'corners') {
      const top = 1.3 * this.corners.reduce((most, { speed }) => Math.max(most, speed), 1);
      return [{
        title: `speed in corners of 5° and more, ${unit}/min; dashes: allowed by $11`, corners: this.corners, colour: colours.curve, range: [0, top],
      }];
    }
    if (what === 'rotary') {
      return path.rotary.map((axis) => {
        const column = path.place[axis];
        const bands = this.ofPieces(width, (piece) => column[piece], (piece) => column[piece + 1]);
        const ends = [Math.min(...bands[0].filter(Number.isFinite)), Math.max(...bands[1].filter(Number.isFinite))];
        const room = (ends[1] - ends[0]) * 0.08 + 1;
        return {
          title: `${facts.axes[axis].letter}, degrees`, bands, colour: colours.axes[axis % 3], range: [ends[0] - room, ends[1] + room],
        };
      });
    }
    const index = Number(what);
    const { unit: per, scale, title } = QUANTITIES[index];
    return this.derived.map(({ axis, derivatives }) => {
      const bands = this.ofStretches(width, derivatives[index], scale);
      const limit = axis.limits[index];
      const greatest = bands[1].reduce((most, value, pixel) => Math.max(most, value || 0, -bands[0][pixel] || 0), 0);
      const isBeyond = limit && greatest > 1.02 * limit;
      const top = isBeyond ? Math.min(greatest * 1.1, 3 * limit) : Math.max((limit || 0) * 1.25, greatest * 1.1, 1e-3);
      const note = limit ? `limit ${short(limit)}` : `no limit is set, greatest ${short(greatest)}`;
      const beyond = isBeyond ? `; up to ${short(greatest)}` : '';
      const name = `${title} of ${axis.is_motor ? 'motor ' : ''}${axis.letter}, ${axis.is_rotary ? '°' : 'mm'}/${per}; ${note}${beyond}`;
      const number = 'XYZABC'.indexOf(axis.letter);
      return { title: name, bands, colour: colours.axes[number % 3], range: [-top, top], limit };
    });
  }

  render() {
    const { canvas, context, colours, range } = this;
    const ratio = window.devicePixelRatio || 1;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    if (width < LEFT + 20 || height < 40) return;
    [canvas.width, canvas.height] = [Math.round(width * ratio), Math.round(height * ratio)];
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.font = '11px system-ui, sans-serif';
    context.textBaseline = 'middle';
    this.width = width - LEFT - 8;
    this.covered = document.getElementById('what').offsetWidth;
    const lanes = this.lanes(Math.floor(this.width));
    const each = (height - TIMES) / Math.max(1, lanes.length);
    lanes.forEach((lane, index) => this.lane(lane, index * each, each - GAP));
    context.fillStyle = colours.faint;
    context.textAlign = 'center';
    const step = roundStep((range[1] - range[0]) / Math.max(2, this.width / 90));
    for (let time = Math.ceil(range[0] / step) * step; time <= range[1]; time += step) {
      const text = `${+time.toPrecision(6)} s`;
      context.fillText(text, Math.min(this.pixel(time), width - context.measureText(text).width / 2), height - TIMES / 2);
    }
    const x = this.pixel(this.now);
    if (x >= LEFT && x <= width) {
      context.strokeStyle = colours.text;
      context.lineWidth = 1;
      context.beginPath();
      context.moveTo(x, 0);
      context.lineTo(x, height - TIMES);
      context.stroke();
    }
  }

  lane(lane, top, height) {
    const { context, colours } = this;
    const title = 14;
    const [low, high] = lane.range;
    const y = (value) => top + title + (high - value) / (high - low) * (height - title);
    context.strokeStyle = colours.grid;
    context.lineWidth = 1;
    context.strokeRect(LEFT + 0.5, Math.round(top + title) + 0.5, this.width, Math.round(height - title));
    context.fillStyle = colours.faint;
    context.textAlign = 'right';
    const step = roundStep((high - low) / Math.max(1.5, (height - title) / 26));
    for (let value = Math.ceil(low / step) * step; value <= high; value += step) {
      context.fillText(short(Math.abs(value) < step / 1e3 ? 0 : value), LEFT - 5, y(value));
      context.beginPath();
      context.moveTo(LEFT, y(value));
      context.lineTo(LEFT + this.width, y(value));
      context.stroke();
    }
    context.textAlign = 'left';
    context.fillStyle = colours.text;
    // Beside the field that chooses.
    const free = top < title ? this.width - this.covered : this.width;
    context.fillText(lane.title, LEFT, top + 6, free);
    context.save();
    context.beginPath();
    context.rect(LEFT, top + title - 1, this.width, height - title + 2);
    context.clip();
    if (lane.limit && lane.limit <= high) {
      context.strokeStyle = colours.bad;
      context.setLineDash([5, 4]);
      [lane.limit, -lane.limit].forEach((limit) => {
        context.beginPath();
        context.moveTo(LEFT, y(limit));
        context.lineTo(LEFT + this.width, y(limit));
        context.stroke();
      });
      context.setLineDash([]);
    }
    if (lane.beside) {
      context.setLineDash([2, 3]);
      this.band(lane.beside, y, colours.faint);
      context.setLineDash([]);
    }
    if (lane.bands) this.band(lane.bands, y, lane.colour); else this.bars(lane.corners, y, lane.colour);
    context.restore();
  }

  band([least, greatest], y, colour) {
    const { context } = this;
    context.strokeStyle = colour;
    context.fillStyle = colour;
    context.lineWidth = 1.4;
    context.beginPath();
    let isBegun = false;
    least.forEach((low, pixel) => {
      const high = greatest[pixel];
      if (!(low <= high)) {
        isBegun = false;
        return;
      }
      const x = LEFT + pixel + 0.5;
      if (isBegun) context.lineTo(x, y(low)); else context.moveTo(x, y(low));
      if (high > low) context.lineTo(x, y(high));
      isBegun = true;
    });
    context.stroke();
  }

  /** The speeds of corners as bars, and what is allowed as dashes across them. */
  bars(corners, y, colour) {
    const { context, colours } = this;
    const stroke = (ink, width, draw) => {
      [context.strokeStyle, context.lineWidth] = [ink, width];
      context.beginPath();
      corners.forEach((corner) => draw(this.pixel(corner.time), corner));
      context.stroke();
    };
    stroke(colour, 1.4, (x, { speed }) => {
      context.moveTo(x, y(0));
      context.lineTo(x, y(speed));
    });
    stroke(colours.bad, 1.6, (x, { allowed }) => {
      context.moveTo(x - 4, y(allowed));
      context.lineTo(x + 4, y(allowed));
    });
  }

  pixel(time) {
    return LEFT + (time - this.range[0]) / (this.range[1] - this.range[0]) * this.width;
  }

  timeAt(x) {
    const share = Math.min(1, Math.max(0, (x - LEFT) / this.width));
    return this.range[0] + share * (this.range[1] - this.range[0]);
  }

  /** Shows a shorter or longer time, in which a time stays where it is. */
  zoom(factor, time) {
    const whole = Math.max(this.path.end, 1e-3);
    const length = Math.min(whole, Math.max(0.005, (this.range[1] - this.range[0]) * factor));
    const share = (time - this.range[0]) / (this.range[1] - this.range[0]);
    this.shift(time - share * length, length);
  }

  shift(from, length = this.range[1] - this.range[0]) {
    const whole = Math.max(this.path.end, 1e-3);
    const begin = Math.min(whole - length, Math.max(0, from));
    this.range = [begin, begin + length];
    this.ask();
  }
}
