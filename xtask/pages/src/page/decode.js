/* From the packed text of the page to numbers. */

/** The bytes of a pack: `deflate-raw`, written as base64. */
async function unpack(name) {
  const text = atob(document.getElementById(`pack-${name}`).textContent);
  const bytes = new Uint8Array(text.length);
  for (let at = 0; at < text.length; at += 1) bytes[at] = text.charCodeAt(at);
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream('deflate-raw'));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/** Reads columns of varints, see columns.rs. */
class Columns {
  constructor(bytes) {
    this.bytes = bytes;
    this.at = 0;
  }

  varint() {
    let [value, unit, byte] = [0, 1, 0];
    do {
      byte = this.bytes[this.at];
      this.at += 1;
      value += (byte & 127) * unit;
      unit *= 128;
    } while (byte > 127);
    return value;
  }

  /** A column of differences, each with its sign in the lowest bit. */
  sums(count, scale = 1) {
    const column = new Float64Array(count);
    let sum = 0;
    for (let row = 0; row < count; row += 1) {
      const value = this.varint();
      sum += value % 2 ? -(value + 1) / 2 : value / 2;
      column[row] = sum * scale;
    }
    return column;
  }

  plain(count) {
    const column = new Uint8Array(count);
    for (let row = 0; row < count; row += 1) column[row] = this.varint();
    return column;
  }
}

/** The vertices of the path, in the order of Path::finish in recording.rs. */
function decodePath(bytes, facts) {
  const columns = new Columns(bytes);
  const count = facts.path.vertices;
  const time = columns.sums(count, 1e-6);
  const place = facts.axes.map((axis) => columns.sums(count, 1 / axis.scale));
  const speed = columns.sums(count);
  const line = columns.sums(count);
  const kind = columns.plain(count);
  const programmed = columns.sums(count);
  const [powerBefore, power] = [columns.sums(count, 1e-3), columns.sums(count, 1e-3)];
  return { count, time, place, speed, line, kind, programmed, powerBefore, power };
}

/** Least and greatest values of speed, acceleration and jerk of each axis that moves, and the corners. */
function decodeCurves(bytes, facts) {
  const columns = new Columns(bytes);
  const moving = facts.axes.filter((axis) => axis.levels);
  // The curves are equally long; the last byte of each number has no high bit.
  const corners = facts.corners.written;
  const numbers = bytes.reduce((sum, byte) => sum + (byte < 128), 0) - 3 * corners;
  const count = moving.length ? numbers / (6 * moving.length) : 0;
  const derived = moving.map((axis) => ({
    axis,
    derivatives: axis.levels.map((level) => ({
      least: columns.sums(count, level),
      greatest: columns.sums(count, level),
    })),
  }));
  const [times, speeds, allowed] = [1e-6, 1, 1].map((scale) => columns.sums(corners, scale));
  return { derived, corners: [...times].map((time, index) => ({ time, speed: speeds[index], allowed: allowed[index] })) };
}
