/* The page: joins path, picture, program and curves, and follows the reader's hands. */

const $ = (id) => document.getElementById(id);
const TURN = 0.06;
const MOVE = 24;
const RATES = [0.1, 0.5, 1, 2, 5, 10, 50, 200];

function duration(seconds) {
  const [hours, minutes] = [Math.floor(seconds / 3600), Math.floor(seconds / 60) % 60];
  const rest = (seconds % 60).toFixed(seconds < 60 ? 2 : 1);
  if (hours) return `${hours} h ${minutes} min`;
  return seconds >= 60 ? `${minutes} min ${rest} s` : `${rest} s`;
}

function grouped(number) {
  return String(Math.round(number)).replace(/\B(?=(\d{3})+$)/g, '\u202f');
}

function element(name, text = '', kind = '') {
  const made = document.createElement(name);
  made.textContent = text;
  made.className = kind;
  return made;
}

class View {
  constructor(facts, vertices, curves, text) {
    this.facts = facts;
    this.path = new Path(vertices, facts);
    const lines = text.split('\n');
    lines.pop();
    const refused = new Map(facts.refused.map(({ line, name, why }) => [line, `${name}: ${why}`]));
    this.scene = new Scene($('stage'), this.path);
    this.curves = new Curves(document.querySelector('#curves canvas'), this.path, curves, facts.stretch_s);
    this.listing = new Listing($('program'), lines, refused);
    this.lines = lines;
    this.refused = refused;
    this.mark();
    this.dress();
    matchMedia('(prefers-color-scheme: dark)').addEventListener('change', () => this.dress());
    this.head();
    this.connectTransport();
    this.connectStage();
    this.connectListing();
    this.connectCurves();
    this.connectTabs();
    this.connectFilters();
    this.search = new Search(this);
    this.connectKeys();
    this.setTime(this.path.end);
    // The reader begins at the top of the program.
    this.select(0);
    this.listing.element.scrollTop = 0;
  }

  /** What is marked in the picture. */
  mark() {
    const { facts, path } = this;
    const apart = (all) => all.filter(({ at }, index) => (
      all.findIndex((other) => other.at.every((value, axis) => value === at[axis])) === index));
    this.scene.marks = {
      colours: {},
      zeros: apart(facts.work_zeros),
      holes: facts.holes,
      changes: facts.tool_changes,
      refused: path.count ? facts.refused.slice(0, 500).map(({ line }) => ({ at: path.placeBefore(line) })) : [],
    };
  }

  /** Takes the colours over from the style, in the dark and in the light. */
  dress() {
    const style = getComputedStyle(document.documentElement);
    const names = ['page', 'text', 'faint', 'bad', 'curve', 'grid', 'box', 'rapid', 'start', 'end', 'hole', 'change', 'tool', 'current', 'accent', 'cut', 'point'];
    const colours = Object.fromEntries(names.map((name) => [name, style.getPropertyValue(`--${name}`).trim()]));
    colours.axes = ['x', 'y', 'z'].map((name) => style.getPropertyValue(`--${name}`).trim());
    this.scene.marks.colours = colours;
    this.curves.colours = colours;
    this.scene.ask();
    this.curves.ask();
  }

  head() {
    const { facts, path } = this;
    const count = (number, what) => `${grouped(number)} ${what}${number === 1 ? '' : 's'}`;
    const refused = facts.refused_count ? `, ${count(facts.refused_count, 'line')} refused` : '';
    $('summary').textContent = `${count(facts.lines, 'line')}${refused}, ${duration(path.end)}`;
    if (facts.refused_count || facts.alarms.length) $('summary').classList.add('bad');
    $('alarm').textContent = facts.alarms.slice(0, 1).map(({ line, name, why }) => `line ${line}: ${name}, ${why}`).join('');
    const { cutting, rapids, standstill, other } = facts.times;
    const parts = [
      ['cutting', 'cutting', cutting], ['rapids', 'rapids', rapids],
      ['standstill', 'standing still', standstill], ['others', 'homing, probing, jogs', other],
    ];
    parts.filter(([, , seconds]) => seconds > 0).forEach(([kind, name, seconds]) => {
      const part = element('span');
      part.append(element('i', '', kind), `${name} ${duration(seconds)}`);
      $('times').append(part);
    });
    if (!(path.strongest > 0)) $('colour').querySelector('[value=power]').remove();
    else $('colour').querySelector('[value=power]').textContent = facts.is_laser ? 'laser power' : 'spindle speed';
    if (path.tools.length < 2) $('colour').querySelector('[value=tool]').remove();
    $('colour').addEventListener('change', () => this.colour($('colour').value));
    this.colour('speed');
    const hasOthers = path.kind.some((kind) => kind > KIND.FEED);
    document.querySelector('#kinds .other').hidden = !hasOthers;
    if (!this.scene.gl) this.tell('This browser draws no path: it has no WebGL 2.', 12, 60);
  }

  colour(by) {
    const { path } = this;
    $('colour').value = by;
    this.scene.colour(by);
    const ends = {
      speed: ['0', `${grouped(path.fastestFeed)} mm/min`],
      share: ['0', '100 %'],
      power: ['0', path.strength(path.strongest)],
      depth: [path.cutLow, path.cutHigh].map(([, , z]) => `Z ${z.toFixed(3)}`),
      tool: path.tools.map((tool) => `T${tool}`),
    }[by];
    $('ends').replaceChildren(...ends.map((end) => element('span', end)));
    // A tool has one colour, everything else all between two.
    const colours = by === 'tool' ? ends.flatMap((end, index) => (
      [index, index + 1].map((edge) => `${ramp(index / (ends.length - 1))} ${100 * edge / ends.length}%`))) : GRADIENT;
    $('ramp').style.background = `linear-gradient(90deg, ${colours.join(', ')})`;
  }

  /** Goes to a time; the picture, the curves and the program follow. */
  setTime(time) {
    const { path } = this;
    this.now = Math.min(path.end, Math.max(0, time));
    [this.scene.now, this.curves.now] = [this.now, this.now];
    $('slider').value = this.now;
    if (!path.count) return;
    this.state = path.at(this.now);
    const { place, speed, programmed, kind, line, power } = this.state;
    const places = place.map((value, axis) => `${this.facts.axes[axis].letter}${value.toFixed(3)}`).join(' ');
    const share = programmed && kind === KIND.FEED ? ` of ${grouped(programmed)}` : '';
    const strength = path.strongest > 0 ? `  ${this.facts.is_laser ? 'laser' : 'spindle'} ${path.strength(power)}` : '';
    $('moment').textContent = `${this.now.toFixed(3)} s  ${places}  ${grouped(speed)}${share} mm/min${strength}`;
    this.select(line);
    this.scene.ask();
    this.curves.ask();
  }

  /** Highlights a line, everywhere. */
  select(line) {
    if (line !== this.listing.current) this.listing.show(line);
    this.highlight();
    this.describe(this.hovered || line);
  }

  highlight() {
    const { path, scene } = this;
    const one = (line, colour) => {
      const first = path.first[line];
      return first >= 0 ? [{ first, last: path.last[line], line, colour }] : [];
    };
    const { colours } = scene.marks;
    const chosen = this.listing.current && this.now < path.end ? one(this.listing.current, colours.accent) : [];
    scene.chosen = [...chosen, ...(this.hovered ? one(this.hovered, colours.change) : [])];
    scene.ask();
  }

  hover(line) {
    this.hovered = line;
    this.listing.hover(line);
    this.highlight();
    this.describe(line || this.listing.current);
  }

  /** What a line did, in words. */
  summary(line) {
    const { path } = this;
    const why = this.refused.get(line);
    if (why) return `line ${line} is refused: ${why}`;
    const first = path.first[line];
    if (!line || first === undefined || first < 0) return line ? `line ${line} moves nothing` : '';
    const last = path.last[line];
    const kinds = new Set();
    let [least, most, programmed] = [Infinity, 0, 0];
    for (let piece = first; piece <= last; piece += 1) {
      if (path.line[piece] === line && path.kind[piece] !== KIND.STANDSTILL) {
        least = Math.min(least, path.speed[piece], path.speed[piece + 1]);
        most = Math.max(most, path.speed[piece], path.speed[piece + 1]);
        kinds.add(path.kind[piece]);
        if (path.kind[piece] === KIND.FEED) programmed = path.programmed[piece];
      }
    }
    const seconds = path.time[last + 1] - path.time[first];
    const speeds = most ? `actual ${grouped(least)} to ${grouped(most)} mm/min, ` : '';
    const names = [...kinds].map((kind) => KIND_NAMES[kind]).join(' and ') || KIND_NAMES[KIND.STANDSTILL];
    const wanted = programmed ? `programmed ${grouped(programmed)} mm/min, ` : '';
    return `line ${line}, ${names}: ${wanted}${speeds}${seconds.toFixed(3)} s from ${path.time[first].toFixed(3)} s`;
  }

  describe(line) {
    $('line').textContent = this.summary(line);
  }

  tell(text, x, y) {
    const tip = $('tip');
    tip.hidden = !text;
    if (!text) return;
    tip.textContent = text;
    const [width, height] = this.scene.size;
    tip.style.left = `${Math.min(x + 14, Math.max(0, width - tip.offsetWidth - 6))}px`;
    tip.style.top = `${Math.min(y + 12, Math.max(0, height - tip.offsetHeight - 6))}px`;
  }

  /** Goes to where a line begins. */
  choose(line) {
    const first = this.path.first[line];
    if (first >= 0) this.setTime(this.path.time[first]);
    this.select(line);
  }

  connectTransport() {
    const { path } = this;
    const slider = $('slider');
    slider.max = path.end;
    slider.addEventListener('input', () => {
      this.scene.move();
      this.setTime(Number(slider.value));
    });
    RATES.forEach((rate) => $('rate').append(element('option', `${rate} ×`)));
    // A job is seen in half a minute, at first.
    const wanted = RATES.findIndex((rate) => path.end / rate <= 30);
    $('rate').selectedIndex = wanted < 0 ? RATES.length - 1 : Math.max(2, wanted);
    $('play').addEventListener('click', () => this.play());
  }

  play(wants = !this.isPlaying) {
    if (wants && this.now >= this.path.end) this.setTime(0);
    this.isPlaying = wants;
    $('play').textContent = wants ? 'Pause' : 'Play';
    let before = performance.now();
    const frame = (time) => {
      if (!this.isPlaying) return;
      const rate = RATES[$('rate').selectedIndex];
      this.setTime(this.now + rate * Math.max(0, time - before) / 1000);
      before = time;
      if (this.now >= this.path.end) this.play(false); else requestAnimationFrame(frame);
    };
    if (wants) requestAnimationFrame(frame);
  }

  connectStage() {
    const { scene } = this;
    const stage = $('stage');
    const pointers = new Map();
    let [moved, pending] = [0, null];
    stage.addEventListener('contextmenu', (event) => event.preventDefault());
    stage.addEventListener('pointerdown', (event) => {
      if (event.target.closest('.over')) return;
      stage.setPointerCapture(event.pointerId);
      pointers.set(event.pointerId, event);
      moved = 0;
      this.tell('');
    });
    stage.addEventListener('pointermove', (event) => {
      const before = pointers.get(event.pointerId);
      if (before) {
        moved += Math.hypot(event.clientX - before.clientX, event.clientY - before.clientY);
        this.drag(pointers, before, event);
        pointers.set(event.pointerId, event);
      } else if (event.pointerType === 'mouse' && !event.target.closest('.over')) {
        if (!pending) requestAnimationFrame(() => { this.point(pending); pending = null; });
        pending = event;
      }
    });
    const release = (event) => {
      const isClick = pointers.delete(event.pointerId) && moved < 5 && event.type === 'pointerup';
      const place = this.placeOf(event);
      const hit = isClick && event.button === 0 ? scene.pick(...place, event.pointerType === 'mouse' ? 9 : 20) : null;
      if (hit) this.setTime(this.path.within(hit.piece, this.path.partOfTime(hit.piece, hit.part)).time);
    };
    stage.addEventListener('pointerup', release);
    stage.addEventListener('pointercancel', release);
    stage.addEventListener('pointerleave', () => { pending = pending && null; this.tell(''); this.hover(0); });
    stage.addEventListener('wheel', (event) => {
      event.preventDefault();
      const [x, y] = this.placeOf(event);
      scene.camera.scale(Math.exp(-event.deltaY / 500), x - scene.size[0] / 2, y - scene.size[1] / 2);
      scene.move();
    }, { passive: false });
    stage.addEventListener('dblclick', (event) => { if (!event.target.closest('.over')) scene.fit(); });
    document.querySelectorAll('[data-view]').forEach((button) => (
      button.addEventListener('click', () => scene.view(button.dataset.view))));
    $('fit').addEventListener('click', () => scene.fit());
  }

  placeOf(event) {
    const { left, top } = $('stage').getBoundingClientRect();
    return [event.clientX - left, event.clientY - top];
  }

  /** One finger or the left button turns, Shift or another button moves, two fingers move and zoom. */
  drag(pointers, before, event) {
    const { camera, size } = this.scene;
    const [x, y] = [event.clientX - before.clientX, event.clientY - before.clientY];
    if (pointers.size > 1) {
      const other = [...pointers.values()].find((pointer) => pointer.pointerId !== event.pointerId);
      const distance = (one) => Math.hypot(one.clientX - other.clientX, one.clientY - other.clientY) || 1;
      camera.pan(x / 2, y / 2);
      const middle = this.placeOf({ clientX: (event.clientX + other.clientX) / 2, clientY: (event.clientY + other.clientY) / 2 });
      camera.scale(distance(event) / distance(before), middle[0] - size[0] / 2, middle[1] - size[1] / 2);
    } else if (event.shiftKey || event.buttons & 6) {
      camera.pan(x, y);
    } else {
      camera.turn(-x / 150, y / 150);
    }
    this.scene.move();
  }

  /** Tells what is under the pointer. */
  point(event) {
    if (!event) return;
    const place = this.placeOf(event);
    const hit = this.scene.pick(...place);
    if (!hit) {
      this.tell('');
      this.hover(0);
      return;
    }
    const there = this.path.within(hit.piece, this.path.partOfTime(hit.piece, hit.part));
    const wanted = there.kind === KIND.FEED ? ` of ${grouped(there.programmed)}` : '';
    const text = there.line ? `${there.line}: ${this.lines[there.line - 1] ?? ''}` : 'no line';
    this.tell(`${text}\n${KIND_NAMES[there.kind]}, ${grouped(there.speed)}${wanted} mm/min at ${there.time.toFixed(3)} s`, ...place);
    this.hover(there.line);
  }

  connectListing() {
    const list = $('program');
    const lineOf = (event) => Number(event.target.closest('.row')?.dataset.line ?? 0);
    list.addEventListener('mousemove', (event) => this.hover(lineOf(event)));
    list.addEventListener('mouseleave', () => this.hover(0));
    list.addEventListener('click', (event) => { if (lineOf(event)) this.choose(lineOf(event)); });
    list.addEventListener('keydown', (event) => {
      const steps = { ArrowDown: 1, ArrowUp: -1, PageDown: 20, PageUp: -20, Home: -Infinity, End: Infinity };
      if (!(event.key in steps)) return;
      event.preventDefault();
      const wanted = this.listing.current + steps[event.key];
      this.choose(Math.min(this.lines.length, Math.max(1, wanted)));
    });
  }

  /** What is drawn of the path: rapids, and the travel with what lies outside. */
  connectFilters() {
    const { scene, facts } = this;
    $('rapids').addEventListener('change', () => {
      scene.hasRapids = $('rapids').checked;
      scene.ask();
    });
    const show = () => {
      scene.showsTravel = $('travel').checked;
      document.querySelector('#kinds .outside').hidden = !scene.showsTravel;
      scene.fit();
    };
    $('travel').parentElement.hidden = !scene.hasTravel;
    $('travel').addEventListener('change', show);
    // Without soft limits, where the travel lies is known only once the machine has homed.
    $('travel').checked = scene.hasTravel && facts.has_soft_limits;
    show();
  }

  connectCurves() {
    const { curves } = this;
    const { canvas } = curves;
    const choose = $('what');
    curves.choices().forEach(([value, name]) => {
      const option = element('option', name);
      option.value = value;
      choose.append(option);
    });
    choose.addEventListener('change', () => { curves.what = choose.value; curves.ask(); });
    const place = (event) => event.clientX - canvas.getBoundingClientRect().left;
    let [down, moved] = [null, 0];
    canvas.addEventListener('pointerdown', (event) => {
      canvas.setPointerCapture(event.pointerId);
      [down, moved] = [{ x: place(event), from: curves.range[0] }, 0];
    });
    canvas.addEventListener('pointermove', (event) => {
      if (!down) return;
      const off = place(event) - down.x;
      moved = Math.max(moved, Math.abs(off));
      if (moved > 4) curves.shift(down.from - off / curves.width * (curves.range[1] - curves.range[0]));
    });
    canvas.addEventListener('pointerup', (event) => {
      if (down && moved <= 4) this.setTime(curves.timeAt(place(event)));
      down = null;
    });
    canvas.addEventListener('wheel', (event) => {
      event.preventDefault();
      curves.zoom(Math.exp(event.deltaY / 400), curves.timeAt(place(event)));
    }, { passive: false });
    canvas.addEventListener('dblclick', () => curves.zoom(1e9, 0));
    canvas.addEventListener('keydown', (event) => {
      const length = curves.range[1] - curves.range[0];
      if (event.key === '+') curves.zoom(0.7, this.now);
      if (event.key === '-') curves.zoom(1.4, this.now);
      if (event.key === 'ArrowLeft') curves.shift(curves.range[0] - length / 8);
      if (event.key === 'ArrowRight') curves.shift(curves.range[0] + length / 8);
    });
  }

  connectTabs() {
    const tabs = [...document.querySelectorAll('[role=tab]')];
    tabs.forEach((tab, index) => {
      tab.addEventListener('click', () => {
        if (tab.id !== 'tab-program' && !this.hasTables) {
          this.hasTables = true;
          showTables(this);
        }
        $('find').hidden = tab.id !== 'tab-program';
        tabs.forEach((other) => {
          other.setAttribute('aria-selected', other === tab);
          $(other.getAttribute('aria-controls')).hidden = other !== tab;
        });
      });
      tab.addEventListener('keydown', (event) => {
        const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
        if (step) tabs[(index + step + tabs.length) % tabs.length].focus();
      });
    });
  }

  connectKeys() {
    const { scene } = this;
    const arrows = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
    $('stage').addEventListener('keydown', (event) => {
      const arrow = arrows[event.key];
      if (arrow && event.shiftKey) scene.camera.pan(arrow[0] * MOVE, arrow[1] * MOVE);
      else if (arrow) scene.camera.turn(-arrow[0] * TURN, arrow[1] * TURN);
      else if (event.key === '+' || event.key === '=') scene.camera.scale(1.2);
      else if (event.key === '-') scene.camera.scale(1 / 1.2);
      else return;
      event.preventDefault();
      scene.move();
    });
    document.addEventListener('keydown', (event) => {
      const writes = event.target.matches('input:not([type=checkbox]), select');
      // In the field itself, the keys are the browser's own search.
      if ((event.ctrlKey || event.metaKey) && event.key === 'f' && !writes) {
        event.preventDefault();
        this.search.open('search');
      }
      if (event.ctrlKey || event.metaKey || event.altKey || writes) return;
      const view = { 1: 'iso', 2: 'top', 3: 'front', 4: 'side' }[event.key];
      if (view) scene.view(view);
      else if (event.key === 'f' || event.key === 'F') scene.fit();
      else if (event.key === 'g') this.search.open('goto');
      else if (event.key === ' ' && !event.target.matches('button, input')) this.play();
      else return;
      event.preventDefault();
    });
  }
}
