/* The tables of the job and its settings. */

/** A number as it stands in a cell. */
const fixed = (value) => value.toFixed(3);
const NUMBER = /^[-$\d]|^(error|ALARM):/;

/** Adds a table with a title and the heads of its columns, if it has rows. */
function table(parent, title, heads, rows) {
  if (!rows.length) return;
  const made = element('table');
  made.append(element('caption', title));
  const head = made.createTHead().insertRow();
  heads.forEach((text) => {
    const cell = element('th', text);
    cell.scope = 'col';
    head.append(cell);
  });
  const body = made.createTBody();
  rows.forEach(({ cells, line, kind = '' }) => {
    const row = element('tr', '', kind);
    cells.forEach((cell) => row.append(element('td', cell, NUMBER.test(cell) ? 'number' : '')));
    if (line) row.dataset.line = line;
    body.append(row);
  });
  parent.append(made);
}

/** Time and distance of feed moves and rapids, of which `sim --json` tells the same. */
function totals({ facts: { times }, path }) {
  const parts = [
    ['cutting', times.cutting, times.cutting_mm], ['rapids', times.rapids, times.rapid_mm],
    ['standing still', times.standstill], ['homing, probing, jogs', times.other],
    ['together', path.end, times.cutting_mm + times.rapid_mm],
  ];
  return parts.filter(([, seconds]) => seconds > 0)
    .map(([name, seconds, mm]) => ({ cells: [name, fixed(seconds), mm === undefined ? '' : fixed(mm)] }));
}

function ranges({ facts: { speeds_rpm: speeds, is_laser: isLaser }, path: { feedRange, feeds } }) {
  const row = (name, [least, most], unit) => ({ cells: [name, `${least}`, `${most}`, unit] });
  return [
    ...feeds ? [row('F', feedRange, 'mm/min')] : [],
    ...speeds ? [row('S', speeds, isLaser ? 'of $30' : 'rpm')] : [],
  ];
}

/** What each tool cuts. */
function tools({ path }) {
  const all = new Map(path.tools.map((tool) => [tool, { seconds: 0, mm: 0, line: 0 }]));
  for (let piece = 0; piece < path.pieces; piece += 1) {
    const of = all.get(path.tool[piece]);
    if (of && path.kind[piece] === KIND.FEED) {
      of.line = of.line || path.line[piece];
      of.seconds += path.time[piece + 1] - path.time[piece];
      of.mm += path.way[piece + 1] - path.way[piece];
    }
  }
  return [...all].map(([tool, { line, seconds, mm }]) => ({ line, cells: [`T${tool}`, `${line}`, fixed(seconds), mm.toFixed(1)] }));
}

/** The ends of the path on each axis, and how far they are outside the travel. */
function extents({ facts: { axes }, path }) {
  if (!path.count) return [];
  return axes.flatMap(({ letter, travel }, axis) => {
    const [low, high] = path.place[axis].reduce(([a, b], at) => [Math.min(a, at), Math.max(b, at)], [Infinity, -Infinity]);
    if (axis > 2 && low === high) return [];
    const outside = travel ? Math.max(0, travel[0] - low, high - travel[1]) : 0;
    const ends = travel ? travel.map((end) => `${+fixed(end)}`).join(' to ') : 'no limit';
    return [{ cells: [letter, fixed(low), fixed(high), fixed(high - low), ends, outside > 1e-3 ? fixed(outside) : 'none'] }];
  });
}

function corners({ facts: { corners: { count, slowest, fastest, most_of_allowed: most } } }) {
  const share = most === null ? '' : `${(100 * most).toFixed(1)} %`;
  return count ? [{ cells: [grouped(count), grouped(slowest), grouped(fastest), share] }] : [];
}

function showTables(view) {
  const { facts, path } = view;
  const at = ({ line, name, at: place }) => ({ line, cells: [`${line}`, name, place.map(fixed).join(' ')] });
  const refusals = (all) => all.slice(0, 1000).map(({ line, name, why }) => ({ line, kind: 'bad', cells: [`${line}`, name, why] }));
  const cut = path.count ? [0, 1, 2].map((axis) => ({
    cells: ['XYZ'[axis], fixed(path.cutLow[axis]), fixed(path.cutHigh[axis]), fixed(path.cutHigh[axis] - path.cutLow[axis])],
  })) : [];
  const fastest = view.curves.derived.map(({ axis, derivatives }) => ({
    cells: [`${axis.is_motor ? 'motor ' : ''}${axis.letter}`, ...derivatives.map(({ least, greatest }, index) => {
      const value = greatest.reduce((most, high, place) => Math.max(most, high, -least[place]), 0) * (index ? 1 : 60);
      const limit = axis.limits[index];
      return `${short(value)}${limit ? ` of ${short(limit)}` : ''}`;
    })],
  }));
  const job = $('job');
  const place = ['Line', 'Name', 'X Y Z, mm'];
  table(job, 'Alarms', ['Line', 'Alarm', 'Reason'], refusals(facts.alarms));
  table(job, `Refused lines (${grouped(facts.refused_count)})`, ['Line', 'Error', 'Reason'], refusals(facts.refused));
  table(job, 'Time and distance', ['Moves', 'Time, s', 'Distance, mm'], totals(view));
  table(job, 'Programmed', ['Word', 'Least', 'Greatest', 'Unit'], ranges(view));
  table(job, 'Tools', ['Tool', 'Line', 'Cuts, s', 'Cuts, mm'], tools(view));
  table(job, 'What is cut, machine position, mm', ['Axis', 'From', 'To', 'Size'], cut);
  table(job, 'The whole path, machine position, mm', ['Axis', 'From', 'To', 'Size', 'Travel', 'Outside'], extents(view));
  table(job, 'Corners of 5° and more, mm/min', ['Number', 'Slowest', 'Fastest', 'Most of $11'], corners(view));
  table(job, 'Greatest values, of the limit', ['Axis', 'Speed, mm/min', 'Acceleration, mm/s²', 'Jerk, mm/s³'], fastest);
  table(job, 'Work zeros', place, facts.work_zeros.map(at));
  table(job, 'Tool changes', place, facts.tool_changes.map(at));
  const holes = facts.holes.slice(0, 1000).map(({ line, name, bottom }) => at({ line, name, at: bottom }));
  table(job, `Holes (${grouped(facts.holes.length)})`, place, holes);
  table(job, 'The run', ['What', 'Value'], [
    { cells: ['step events', grouped(facts.events)] }, { cells: ['hash of them', facts.hash] },
    { cells: ['segments', grouped(facts.path.segments)] }, { cells: ['points of the path', grouped(facts.path.vertices)] },
    { cells: ['state at the end', facts.end] },
  ]);
  job.addEventListener('click', (event) => {
    const row = event.target.closest('tr[data-line]');
    if (row) view.choose(Number(row.dataset.line));
  });
  const rows = (changed) => facts.settings.filter(({ is_changed: is }) => is === changed)
    .map(({ text, name, unit }) => ({ kind: changed ? 'changed' : '', cells: [text, `${name}${unit ? `, ${unit}` : ''}`] }));
  table($('settings'), 'Settings that are not those of a new machine', ['Setting', 'Meaning'], rows(true));
  table($('settings'), 'All others', ['Setting', 'Meaning'], rows(false));
}
