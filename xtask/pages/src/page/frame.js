/* The page as a part of another one, which says what its machine does. It can say nothing else, and gets no answer. */

/** What a message of the page around this one says: a machine position, mm and degrees, and the line in execution. */
function reported(message) {
  if (typeof message !== 'string' || message.length > 1000) return null;
  let report;
  try {
    report = JSON.parse(message);
  } catch {
    return null;
  }
  const { machine, line, state } = report || {};
  const isPlace = Array.isArray(machine) && machine.length >= 3 && machine.every(Number.isFinite);
  const isLine = line === null || (Number.isInteger(line) && line >= 0);
  return isPlace && isLine && typeof state === 'string' ? { machine, line, state } : null;
}

class Frame {
  constructor() {
    this.latest = null;
    window.addEventListener('message', ({ source, data }) => {
      const report = source === window.parent ? reported(data) : null;
      if (!report) return;
      this.latest = report;
      if (this.view) this.take();
    });
  }

  /** There is a view now: the last report is for it. */
  begin(view) {
    this.view = view;
    if (this.latest) this.take();
  }

  take() {
    const { view, latest: { machine: place, line, state } } = this;
    const isFirst = !this.machine;
    if (isFirst) {
      this.machine = new Machine(view);
      this.showOutside();
    }
    const { machine } = this;
    [machine.at, machine.state] = [view.path.drawn(view.facts.axes.map((axis, index) => place[index] ?? 0)), state];
    const before = view.scene.cut;
    const time = this.cutBy(machine.at, line, state);
    // Before the job, all of its path is to be seen.
    if (before === 0 && time > 0) machine.follow(true);
    machine.cutTo(time);
    machine.ask();
  }

  /** Shows what lies outside the travel of a machine that homes: it knows where it stands. */
  showOutside() {
    const { scene, path, facts } = this.view;
    const [low, high] = scene.travel;
    const isOutside = path.low.some((at, axis) => at < low[axis] - 1e-3) || path.high.some((at, axis) => at > high[axis] + 1e-3);
    const homes = facts.settings.some(({ text }) => /^\$22=.*[1-9]/.test(text));
    if (!scene.hasTravel || !isOutside || !homes) return;
    $('travel').checked = true;
    $('travel').dispatchEvent(new Event('change'));
  }

  /** The time of the job up to which it has been cut, s. */
  cutBy(at, line, state) {
    const { path, scene: { cut } } = this.view;
    const isInJob = /^(Run|Hold|Door|Tool)/.test(state);
    if (!path.count || (!isInJob && (state !== 'Idle' || !cut))) return cut;
    const [first, last] = line === null ? [0, path.pieces] : path.piecesFrom(line);
    const time = path.timeNear(at, first, last, cut);
    // At rest, it may have been moved elsewhere since.
    if (!isInJob) return time !== null && time > cut && time < cut + 1 ? time : cut;
    if (time !== null || line === null) return time ?? cut;
    return Math.min(path.time[last], Math.max(path.time[first], cut));
  }
}

const frame = window.parent === window ? null : new Frame();
