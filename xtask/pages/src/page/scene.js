/* The picture of the path: WebGL draws the pieces, two plain canvases what lies below and above them. */

const GRADIENT = ['#3155c4', '#1c9fb5', '#4fb548', '#e9b52c', '#d6402b'];
const OTHER = '#a05fc0';
const OUTSIDE = '#e0109f';
const EVERYWHERE = 1e9;
// Widths on the screen, pixels.
const WIDTHS = { feed: 2.4, rapid: 1.1, chosen: 4 };
// How opaque is what comes after the time that is shown.
const AHEAD = { played: 0.16, live: 0.5 };
// More pieces than this are drawn thin, and in motion coarsely.
const MANY = 100000;
const VIEWS = {
  iso: [-0.6, 0.6],
  top: [0, Math.PI / 2],
  front: [0, 0],
  side: [Math.PI / 2, 0],
};

const VERTEX_SHADER = `#version 300 es
uniform vec3 target, right, up, back;
uniform vec2 size;
uniform float zoom, depth, feedWidth, rapidWidth, rapids;
layout(location = 0) in vec3 from;
layout(location = 1) in vec3 to;
layout(location = 2) in vec2 fromTimeWay;
layout(location = 3) in vec2 toTimeWay;
layout(location = 4) in vec3 values;
out float time, way, value;
out vec3 place;
flat out float kind;
vec3 onScreen(vec3 point) {
  vec3 off = point - target;
  return vec3(dot(off, right) * zoom, dot(off, up) * zoom, -dot(off, back) / depth);
}
void main() {
  kind = values.z;
  bool isEnd = gl_VertexID > 1;
  vec3 a = onScreen(from), b = onScreen(to);
  vec2 along = b.xy - a.xy;
  float pixels = length(along);
  along = pixels > 0.001 ? along / pixels : vec2(1.0, 0.0);
  float width = 0.5 * (kind == 1.0 ? rapidWidth : feedWidth);
  float side = (gl_VertexID & 1) == 0 ? -width : width;
  vec3 at = isEnd ? b : a;
  // Longer by a part of its width, so that corners have no gaps.
  at.xy += vec2(-along.y, along.x) * side + along * (isEnd ? 0.6 : -0.6) * width;
  time = isEnd ? toTimeWay.x : fromTimeWay.x;
  way = isEnd ? toTimeWay.y : fromTimeWay.y;
  value = isEnd ? values.y : values.x;
  place = isEnd ? to : from;
  gl_Position = kind == 0.0 || kind == 1.0 && rapids == 0.0 ? vec4(2.0, 2.0, 2.0, 1.0) : vec4(2.0 * at.xy / size, at.z, 1.0);
}`;

const FRAGMENT_SHADER = `#version 300 es
precision highp float;
uniform vec3 gradient[5], rapidColour, otherColour, cutColour, outside, travelLow, travelHigh;
uniform vec4 chosen;
uniform float now, cut, ahead, dash;
in float time, way, value;
in vec3 place;
flat in float kind;
out vec4 colour;
vec3 ramp(float share) {
  float place = clamp(share, 0.0, 1.0) * 4.0;
  int index = min(int(place), 3);
  return mix(gradient[index], gradient[index + 1], place - float(index));
}
void main() {
  if (kind == 1.0 && chosen.a == 0.0 && mod(way, dash) > 0.55 * dash) discard;
  vec3 plain = kind == 1.0 ? rapidColour : kind == 2.0 ? ramp(value) : otherColour;
  if (kind != 1.0 && time < cut) plain = cutColour;
  if (any(lessThan(place, travelLow)) || any(greaterThan(place, travelHigh))) plain = outside;
  float alpha = time > now ? ahead : kind == 1.0 ? 0.75 : 1.0;
  colour = chosen.a > 0.0 ? chosen : vec4(plain * alpha, alpha);
}`;

function rgb(hex) {
  return [1, 3, 5].map((at) => parseInt(hex.slice(at, at + 2), 16) / 255);
}

/** The colour of a share, as the picture draws it. */
function ramp(share) {
  const place = Math.min(1, Math.max(0, share)) * 4;
  const index = Math.min(3, Math.floor(place));
  const [from, to] = [index, index + 1].map((at) => rgb(GRADIENT[at]));
  return `rgb(${from.map((part, at) => Math.round(255 * (part + (to[at] - part) * (place - index))))})`;
}

/** A step of 1, 2 or 5 times a power of ten that is at least so long. */
function roundStep(least) {
  const unit = 10 ** Math.floor(Math.log10(least));
  return [1, 2, 5, 10].find((step) => step * unit >= least) * unit;
}

/** Where one looks from: an angle about the vertical, one above the horizon, a point, pixels per mm. */
class Camera {
  constructor() {
    [this.yaw, this.pitch] = VIEWS.iso;
    this.target = [0, 0, 0];
    this.zoom = 1;
  }

  axes() {
    const [cy, sy] = [Math.cos(this.yaw), Math.sin(this.yaw)];
    const [cp, sp] = [Math.cos(this.pitch), Math.sin(this.pitch)];
    return { right: [cy, sy, 0], up: [-sy * sp, cy * sp, cp], back: [sy * cp, -cy * cp, sp] };
  }

  turn(yaw, pitch) {
    this.yaw += yaw;
    this.pitch = Math.min(Math.PI / 2, Math.max(-Math.PI / 2, this.pitch + pitch));
  }

  /** Moves what is seen, pixels. */
  pan(x, y) {
    const { right, up } = this.axes();
    this.target = this.target.map((value, axis) => value + (up[axis] * y - right[axis] * x) / this.zoom);
  }

  /** Comes nearer, with what is at a place, from the middle, staying there. */
  scale(factor, x = 0, y = 0) {
    this.pan(-x, -y);
    this.zoom = Math.min(1e5, Math.max(1e-3, this.zoom * factor));
    this.pan(x, y);
  }
}

class Scene {
  constructor(stage, path) {
    this.path = path;
    this.stage = stage;
    [this.below, this.canvas, this.above] = stage.querySelectorAll('canvas');
    this.legend = stage.querySelector('#legend');
    this.camera = new Camera();
    this.now = path.end;
    this.chosen = [];
    this.marks = { colours: {}, zeros: [], holes: [], changes: [], refused: [] };
    this.isMoving = false;
    this.hasRapids = true;
    const travels = path.facts.axes.slice(0, 3).map(({ travel }) => travel);
    // Work on a rotary axis is not drawn where the machine goes.
    this.hasTravel = path.count > 0 && !path.rotary.length && travels.some(Boolean);
    this.travel = [0, 1].map((end) => travels.map((travel, axis) => (
      travel ? travel[end] : [path.low, path.high][end][axis])));
    this.showsTravel = false;
    // A machine at work, and the time of the job up to which it has cut, s.
    this.live = null;
    this.cut = 0;
    this.unit = 'mm';
    this.values = new Float32Array(3 * path.count);
    this.gl = this.canvas.getContext('webgl2', { antialias: path.count < MANY, preserveDrawingBuffer: true });
    if (this.gl) this.prepare();
    this.colour('speed');
    new ResizeObserver(() => this.resize()).observe(stage);
    this.resize();
    this.fit();
  }

  prepare() {
    const { gl, path } = this;
    const program = gl.createProgram();
    [[gl.VERTEX_SHADER, VERTEX_SHADER], [gl.FRAGMENT_SHADER, FRAGMENT_SHADER]].forEach(([type, source]) => {
      const shader = gl.createShader(type);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    });
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
    gl.useProgram(program);
    gl.enable(gl.DEPTH_TEST);
    gl.depthFunc(gl.LEQUAL);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    this.uniform = (name) => gl.getUniformLocation(program, name);
    const timeWay = new Float32Array(2 * path.count);
    for (let row = 0; row < path.count; row += 1) timeWay.set([path.time[row], path.way[row]], 2 * row);
    const buffer = (numbers) => {
      const made = gl.createBuffer();
      gl.bindBuffer(gl.ARRAY_BUFFER, made);
      gl.bufferData(gl.ARRAY_BUFFER, numbers, gl.STATIC_DRAW);
      return made;
    };
    this.buffers = { xyz: buffer(path.xyz), timeWay: buffer(timeWay), values: gl.createBuffer() };
    gl.bindVertexArray(gl.createVertexArray());
    for (let place = 0; place < 5; place += 1) {
      gl.enableVertexAttribArray(place);
      gl.vertexAttribDivisor(place, 1);
    }
  }

  /** The shares of the gradient at both ends of a piece, by `speed`, `share`, `power`, `depth` or `tool`. */
  shares(by, piece, next) {
    const { path, path: { cutLow: [, , low], cutHigh: [, , high] } } = this;
    const of = (pair, whole) => pair.map((value) => (whole ? value / whole : 0));
    if (by === 'depth') return of([piece, next].map((row) => path.xyz[3 * row + 2] - low), high - low);
    if (by === 'tool') return of([0, 0].map(() => path.tools.indexOf(path.tool[piece])), path.tools.length - 1);
    if (by === 'power') return of([path.power[piece], path.powerBefore[next]], path.strongest);
    return of([path.speed[piece], path.speed[next]], by === 'share' ? path.programmed[piece] : path.fastestFeed);
  }

  /** Colours the feed moves. */
  colour(by) {
    const { path, values, gl } = this;
    for (let piece = 0; piece < path.count; piece += 1) {
      const next = Math.min(piece + 1, path.count - 1);
      values.set([...this.shares(by, piece, next), path.kind[piece]], 3 * piece);
    }
    if (gl) {
      gl.bindBuffer(gl.ARRAY_BUFFER, this.buffers.values);
      gl.bufferData(gl.ARRAY_BUFFER, values, gl.STATIC_DRAW);
    }
    this.ask();
  }

  resize() {
    const ratio = window.devicePixelRatio || 1;
    const { clientWidth: width, clientHeight: height } = this.stage;
    const before = this.size;
    this.size = [Math.max(1, width), Math.max(1, height)];
    [this.below, this.canvas, this.above].forEach((canvas) => {
      canvas.width = Math.round(this.size[0] * ratio);
      canvas.height = Math.round(this.size[1] * ratio);
    });
    if (before) {
      this.camera.zoom *= Math.min(...this.size) / Math.min(...before);
    }
    this.ask();
  }

  /** The least and the greatest of what is cut, or of where a machine has been; null if there is neither. */
  box() {
    const { path, live } = this;
    if (path.count) return [path.cutLow, path.cutHigh];
    return live && live.bounds();
  }

  /** Shows all of what is cut, and of the rest what is near it. */
  fit() {
    const { path, camera } = this;
    const box = this.box();
    if (!box) return;
    const reach = Math.max(...box[0].map((low, axis) => Math.max(1, box[1][axis] - low)));
    const been = (this.live && this.live.bounds()) || box;
    const [least, most] = path.count ? [path.low, path.high] : box;
    const low = box[0].map((value, axis) => Math.max(Math.min(least[axis], been[0][axis]), value - reach));
    const high = box[1].map((value, axis) => Math.min(Math.max(most[axis], been[1][axis]), value + reach));
    if (this.showsTravel) {
      this.travel[0].forEach((end, axis) => { low[axis] = Math.min(low[axis], end); });
      this.travel[1].forEach((end, axis) => { high[axis] = Math.max(high[axis], end); });
    }
    camera.target = low.map((value, axis) => (value + high[axis]) / 2);
    const { right, up } = camera.axes();
    const extent = (direction) => direction.reduce((sum, part, axis) => sum + Math.abs(part) * (high[axis] - low[axis]), 0);
    const [width, height] = [extent(right), extent(up)].map((value) => Math.max(value, 1e-3));
    const [left, over] = [70, 90];
    camera.zoom = Math.max(0.05, Math.min(
      Math.max(40, this.size[0] - left) / width,
      Math.max(40, this.size[1] - over) / height,
    ));
    this.ask();
  }

  view(name) {
    [this.camera.yaw, this.camera.pitch] = VIEWS[name];
    this.fit();
  }

  /** Draws once, with the next frame. */
  ask() {
    if (this.isAsked) return;
    this.isAsked = true;
    requestAnimationFrame(() => {
      this.isAsked = false;
      this.render();
    });
  }

  /** Draws coarsely for a while, if there is much. */
  move() {
    this.isMoving = true;
    clearTimeout(this.rest);
    this.rest = setTimeout(() => {
      this.isMoving = false;
      this.ask();
    }, 200);
    this.ask();
  }

  project(point) {
    const { right, up } = this.axes;
    const off = [0, 1, 2].map((axis) => point[axis] - this.camera.target[axis]);
    const along = (direction) => direction.reduce((sum, part, axis) => sum + part * off[axis], 0) * this.camera.zoom;
    return [this.size[0] / 2 + along(right), this.size[1] / 2 - along(up)];
  }

  render() {
    this.axes = this.camera.axes();
    this.drawn = this.gl ? this.renderPath() : 0;
    this.renderBelow();
    this.renderAbove();
    if (this.live) this.live.render(this);
  }

  renderPath() {
    const { gl, path, camera, size, uniform } = this;
    const ratio = this.canvas.width / size[0];
    const isThin = path.count > MANY;
    gl.viewport(0, 0, this.canvas.width, this.canvas.height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    Object.entries(this.axes).forEach(([name, direction]) => gl.uniform3fv(uniform(name), direction));
    const reach = Math.hypot(...path.high.map((high, axis) => high - path.low[axis]))
      + Math.hypot(...camera.target.map((value, axis) => value - path.low[axis])) + 1;
    gl.uniform3fv(uniform('target'), camera.target);
    gl.uniform2fv(uniform('size'), size);
    gl.uniform1f(uniform('zoom'), camera.zoom);
    gl.uniform1f(uniform('depth'), reach);
    gl.uniform1f(uniform('now'), this.now);
    gl.uniform1f(uniform('cut'), this.cut);
    gl.uniform1f(uniform('ahead'), this.live && this.live.isFollowed ? AHEAD.live : AHEAD.played);
    gl.uniform1f(uniform('dash'), 9 / camera.zoom);
    gl.uniform3fv(uniform('gradient'), GRADIENT.flatMap(rgb));
    gl.uniform3fv(uniform('rapidColour'), rgb(this.marks.colours.rapid || '#888888'));
    gl.uniform3fv(uniform('otherColour'), rgb(OTHER));
    gl.uniform3fv(uniform('cutColour'), rgb(this.marks.colours.cut || '#888888'));
    gl.uniform3fv(uniform('outside'), rgb(OUTSIDE));
    gl.uniform1f(uniform('rapids'), this.hasRapids);
    // Where a limit is, single precision may be off by less than a micrometre.
    [['travelLow', -1], ['travelHigh', 1]].forEach(([name, sign], end) => gl.uniform3fv(
      uniform(name),
      this.travel[end].map((value) => (this.showsTravel ? value + sign * 1e-3 : sign * EVERYWHERE)),
    ));
    gl.uniform4f(uniform('chosen'), 0, 0, 0, 0);
    const width = (name) => Math.max(1 / ratio, isThin ? 1.2 : WIDTHS[name]);
    gl.uniform1f(uniform('feedWidth'), width('feed'));
    gl.uniform1f(uniform('rapidWidth'), width('rapid'));
    const stride = this.isMoving ? Math.ceil(path.pieces / MANY) : 1;
    const drawn = this.drawPieces(0, path.pieces, Math.max(1, stride));
    gl.disable(gl.DEPTH_TEST);
    this.chosen.forEach(({ first, last, colour, line }) => {
      gl.uniform4f(uniform('chosen'), ...rgb(colour), 1);
      gl.uniform1f(uniform('rapids'), 1);
      ['feedWidth', 'rapidWidth'].forEach((name) => gl.uniform1f(uniform(name), WIDTHS.chosen));
      this.runs(first, last, line).forEach(([from, to]) => this.drawPieces(from, to - from, 1));
    });
    gl.enable(gl.DEPTH_TEST);
    return drawn;
  }

  /** The runs of pieces of a line: rounded corners may have others between them. */
  runs(first, last, line) {
    const runs = [];
    for (let piece = first; piece <= last; piece += 1) {
      if (this.path.line[piece] === line) {
        const newest = runs[runs.length - 1];
        if (newest && newest[1] === piece) newest[1] = piece + 1; else runs.push([piece, piece + 1]);
      }
    }
    return runs;
  }

  /** Draws pieces, or chords over as many of them. */
  drawPieces(first, count, stride) {
    const { gl, buffers } = this;
    const number = Math.floor(count / stride);
    if (number < 1) return 0;
    const point = (buffer, places, numbers) => {
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      places.forEach((place, index) => {
        const step = 4 * numbers;
        gl.vertexAttribPointer(place, numbers, gl.FLOAT, false, step * stride, step * (first + index * stride));
      });
    };
    point(buffers.xyz, [0, 1], 3);
    point(buffers.timeWay, [2, 3], 2);
    point(buffers.values, [4], 3);
    gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, number);
    return number;
  }

  plain(canvas) {
    const context = canvas.getContext('2d');
    const ratio = canvas.width / this.size[0];
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, ...this.size);
    context.font = '11px system-ui, sans-serif';
    context.textBaseline = 'middle';
    return context;
  }

  lines(context, pairs, colour, dash = []) {
    context.strokeStyle = colour;
    context.setLineDash(dash);
    context.beginPath();
    pairs.forEach(([from, to]) => {
      context.moveTo(...this.project(from));
      context.lineTo(...this.project(to));
    });
    context.stroke();
    context.setLineDash([]);
  }

  /**
   * A text on a plate, wholly inside of the picture, with a part of its width before a place; none where the place
   * is outside.
   */
  label(context, text, [x, y], colour, before = 0.5) {
    const [width, height] = this.size;
    if (x < 0 || y < 0 || x > width || y > height) return;
    // Beside the legend, unless it covers the whole text.
    const { offsetLeft, offsetTop, offsetHeight } = this.legend;
    const isLevel = y > offsetTop - 8 && y < offsetTop + offsetHeight + 8;
    const wide = context.measureText(text).width + 6;
    const wanted = x - 3 - before * (wide - 6);
    const right = isLevel && wanted < offsetLeft ? offsetLeft : width;
    const left = Math.max(2, Math.min(right - wide - 2, wanted));
    const middle = Math.max(10, Math.min(height - 10, y));
    context.globalAlpha = 0.75;
    context.fillStyle = this.marks.colours.page;
    context.fillRect(left, middle - 8, wide, 16);
    context.globalAlpha = 1;
    context.fillStyle = colour;
    context.textAlign = 'left';
    context.fillText(text, left + 3, middle);
  }

  /** The twelve edges between two corners. */
  edges(low, high) {
    const corner = (bits) => [0, 1, 2].map((axis) => (bits >> axis & 1 ? high[axis] : low[axis]));
    const all = [0, 1, 2, 3, 4, 5, 6, 7];
    return all.flatMap((bits) => [1, 2, 4].filter((bit) => !(bits & bit)).map((bit) => [corner(bits), corner(bits | bit)]));
  }

  /** A grid at the bottom, the box around what is cut, with its sizes, and the travel of the machine. */
  renderBelow() {
    const context = this.plain(this.below);
    const { marks: { colours } } = this;
    const box = this.box();
    if (!box) return;
    const [low, high] = box;
    context.lineWidth = 1;
    const step = roundStep(Math.max(26 / this.camera.zoom, Math.max(high[0] - low[0], high[1] - low[1]) / 60, 1e-3));
    const from = [0, 1].map((axis) => Math.floor(low[axis] / step) - 1);
    const to = [0, 1].map((axis) => Math.ceil(high[axis] / step) + 1);
    const grid = [];
    for (let x = from[0]; x <= to[0]; x += 1) grid.push([[x * step, from[1] * step, low[2]], [x * step, to[1] * step, low[2]]]);
    for (let y = from[1]; y <= to[1]; y += 1) grid.push([[from[0] * step, y * step, low[2]], [to[0] * step, y * step, low[2]]]);
    this.lines(context, grid, colours.grid);
    const corner = (bits) => [0, 1, 2].map((axis) => (bits >> axis & 1 ? high[axis] : low[axis]));
    this.lines(context, this.edges(low, high), colours.box);
    if (this.showsTravel) {
      this.lines(context, this.edges(...this.travel), colours.accent, [6, 4]);
      this.label(context, 'travel of the machine', this.project(this.travel[0]), colours.accent);
    }
    [[0, 1], [0, 2], [1, 4]].forEach(([bits, bit], axis) => {
      const [a, b] = [corner(bits), corner(bits | bit)];
      const [p, q] = [this.project(a), this.project(b)];
      if (Math.hypot(q[0] - p[0], q[1] - p[1]) < 24) return;
      const middle = this.project(a.map((value, index) => (value + b[index]) / 2));
      const away = this.project(low.map((value, index) => (value + high[index]) / 2));
      const off = [middle[0] - away[0], middle[1] - away[1]];
      const length = Math.hypot(...off) || 1;
      const text = `${'XYZ'[axis]} ${(high[axis] - low[axis]).toFixed(2)}`;
      this.label(context, text, [middle[0] + off[0] / length * 22, middle[1] + off[1] / length * 14], colours.faint);
    });
    this.label(context, `grid ${step} ${this.unit}`, [9, this.size[1] - 12], colours.faint, 0);
  }

  /** Zeros, holes, tool changes, refused lines, start, end, and the tool. */
  renderAbove() {
    const context = this.plain(this.above);
    const { path, marks, marks: { colours } } = this;
    this.triads(context);
    context.lineWidth = 1.4;
    const sign = (at, draw, text, colour) => {
      const [x, y] = this.project(at);
      [context.strokeStyle, context.fillStyle] = [colour, colour];
      context.beginPath();
      draw(x, y);
      context.stroke();
      if (text) this.label(context, text, [x - 9, y - 8], colour, 1);
    };
    const round = (radius) => (x, y) => context.arc(x, y, radius, 0, 2 * Math.PI);
    marks.holes.slice(0, 4000).forEach(({ top, bottom }) => {
      this.lines(context, [[top, bottom]], colours.hole);
      sign(top, round(4), '', colours.hole);
    });
    marks.changes.slice(0, 500).forEach(({ name, at }) => sign(at, (x, y) => {
      [[0, -6], [6, 0], [0, 6], [-6, 0], [0, -6]].forEach(([dx, dy], index) => (
        index ? context.lineTo(x + dx, y + dy) : context.moveTo(x + dx, y + dy)));
    }, name, colours.change));
    marks.refused.slice(0, 500).forEach(({ at }) => sign(at, (x, y) => {
      context.moveTo(x - 5, y - 5);
      context.lineTo(x + 5, y + 5);
      context.moveTo(x - 5, y + 5);
      context.lineTo(x + 5, y - 5);
    }, '', colours.bad));
    if (!path.count) return;
    sign(path.xyz.subarray(0, 3), round(5), 'start', colours.start);
    sign(path.xyz.subarray(3 * path.count - 3), (x, y) => context.rect(x - 5, y - 5, 10, 10), 'end', colours.end);
    this.tool(context);
  }

  tool(context) {
    const { path, marks: { colours } } = this;
    this.tip = path.at(this.now).xyz;
    if (this.live && this.live.isFollowed) return;
    const [x, y] = this.project(this.tip);
    context.fillStyle = colours.tool;
    context.strokeStyle = colours.page;
    context.lineWidth = 1.5;
    context.beginPath();
    context.moveTo(x, y);
    context.lineTo(x - 7, y - 17);
    context.lineTo(x + 7, y - 17);
    context.closePath();
    context.fill();
    context.stroke();
  }

  /** The axes at the work zeros, and the machine's zero. */
  triads(context) {
    const { marks: { colours, zeros } } = this;
    context.lineWidth = 1.6;
    const length = 34 / this.camera.zoom;
    zeros.slice(0, 12).forEach(({ name, at }) => {
      [0, 1, 2].forEach((axis) => {
        const tip = at.map((value, index) => value + (index === axis ? length : 0));
        this.lines(context, [[at, tip]], colours.axes[axis]);
        const [x, y] = this.project(tip);
        const [ox, oy] = this.project(at);
        if (Math.hypot(x - ox, y - oy) < 8) return;
        this.label(context, 'XYZ'[axis], [ox + (x - ox) * 1.25, oy + (y - oy) * 1.25], colours.axes[axis]);
      });
      const [x, y] = this.project(at);
      this.label(context, name, [x, y + 14], colours.text);
    });
    const [x, y] = this.project([0, 0, 0]);
    context.strokeStyle = colours.text;
    context.lineWidth = 1.2;
    context.beginPath();
    context.arc(x, y, 5, 0, 2 * Math.PI);
    context.moveTo(x - 8, y);
    context.lineTo(x + 8, y);
    context.moveTo(x, y - 8);
    context.lineTo(x, y + 8);
    context.stroke();
    const isApart = zeros.every(({ at }) => Math.hypot(...at) * this.camera.zoom > 30);
    if (isApart) this.label(context, 'machine zero', [x, y + 18], colours.faint);
  }

  /** The piece that is nearest to a place on the screen, and on which part of its way. */
  pick(x, y, reach = 9) {
    const { path, size, camera: { target, zoom } } = this;
    const { right, up, back } = this.camera.axes();
    const { xyz } = path;
    let best = null;
    let near = reach * reach;
    let [ax, ay, ad] = [0, 0, 0];
    for (let row = 0, at = 0; row < path.count; row += 1, at += 3) {
      const [dx, dy, dz] = [xyz[at] - target[0], xyz[at + 1] - target[1], xyz[at + 2] - target[2]];
      const bx = size[0] / 2 + (dx * right[0] + dy * right[1] + dz * right[2]) * zoom;
      const by = size[1] / 2 - (dx * up[0] + dy * up[1] + dz * up[2]) * zoom;
      const bd = dx * back[0] + dy * back[1] + dz * back[2];
      const kind = row > 0 ? path.kind[row - 1] : KIND.STANDSTILL;
      if (kind !== KIND.STANDSTILL && (kind !== KIND.RAPID || this.hasRapids)) {
        const [wx, wy] = [bx - ax, by - ay];
        const whole = wx * wx + wy * wy;
        const part = whole > 0 ? Math.min(1, Math.max(0, ((x - ax) * wx + (y - ay) * wy) / whole)) : 0;
        const [ex, ey] = [ax + part * wx - x, ay + part * wy - y];
        const off = ex * ex + ey * ey;
        const isHigher = best && ad + part * (bd - ad) > best.depth + 1e-4;
        // Of two that lie over each other, the one in front.
        if (off < near - 0.5 || (off <= near + 0.5 && off < reach * reach && (!best || isHigher))) {
          near = Math.min(near, off);
          best = { piece: row - 1, part, depth: ad + part * (bd - ad) };
        }
      }
      [ax, ay, ad] = [bx, by, bd];
    }
    return best;
  }
}
