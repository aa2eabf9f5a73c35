/* The program: only the rows in sight exist. */

const ROW = 20;
// Browsers know no higher element.
const HIGHEST = 8e6;

class Listing {
  constructor(element, lines, refused) {
    this.element = element;
    this.rows = element.firstElementChild;
    this.lines = lines;
    this.refused = refused;
    this.current = 0;
    this.hovered = 0;
    this.found = new Set();
    this.made = new Map();
    this.height = Math.min(HIGHEST, lines.length * ROW);
    this.rows.style.height = `${this.height}px`;
    element.addEventListener('scroll', () => this.render());
    new ResizeObserver(() => this.render()).observe(element);
  }

  /** The first row in sight, which may be a part of one. */
  top() {
    const { scrollTop, clientHeight } = this.element;
    const hidden = this.height - clientHeight;
    const whole = this.lines.length - clientHeight / ROW;
    return hidden > 0 ? scrollTop / hidden * whole : 0;
  }

  /** Makes the rows in sight, and moves those that are there: a row that is clicked must stay the same. */
  render() {
    const { element, rows, lines, made } = this;
    const top = this.top();
    const first = Math.max(1, Math.floor(top) - 1);
    const last = Math.min(lines.length, Math.ceil(top + element.clientHeight / ROW) + 3);
    made.forEach((row, number) => {
      if (number >= first && number <= last) return;
      row.remove();
      made.delete(number);
    });
    for (let number = first; number <= last; number += 1) {
      if (!made.has(number)) {
        made.set(number, this.row(number));
        rows.append(made.get(number));
      }
      const row = made.get(number);
      row.style.transform = `translateY(${element.scrollTop + (number - 1 - top) * ROW}px)`;
      row.classList.toggle('current', number === this.current);
      row.classList.toggle('hovered', number === this.hovered);
      row.classList.toggle('found', this.found.has(number));
      row.setAttribute('aria-selected', number === this.current);
    }
    if (made.has(this.current)) element.setAttribute('aria-activedescendant', `line-${this.current}`);
    else element.removeAttribute('aria-activedescendant');
  }

  row(number) {
    const row = document.createElement('div');
    const why = this.refused.get(number);
    row.className = why ? 'row refused' : 'row';
    row.dataset.line = number;
    row.id = `line-${number}`;
    row.setAttribute('role', 'option');
    if (why) row.title = why;
    const label = document.createElement('span');
    label.textContent = number;
    const text = document.createElement('code');
    text.textContent = this.lines[number - 1];
    row.append(label, text);
    return row;
  }

  /** Marks a line as the current one, and comes to it if it is out of sight. */
  show(number) {
    this.current = number;
    if (!number) {
      this.render();
      return;
    }
    const [top, seen] = [this.top(), this.element.clientHeight / ROW];
    if (number - 1 < top || number > top + seen) {
      const whole = this.lines.length - seen;
      const wanted = Math.min(Math.max(0, number - 1 - seen / 2), Math.max(0, whole));
      this.element.scrollTop = whole > 0 ? wanted / whole * (this.height - this.element.clientHeight) : 0;
    }
    this.render();
  }

  hover(number) {
    if (number === this.hovered) return;
    this.hovered = number;
    this.render();
  }
}
