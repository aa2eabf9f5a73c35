/* Finds text in the program, and goes to lines. */

class Search {
  constructor(view) {
    this.view = view;
    this.hits = [];
    const go = (id, act) => $(id).addEventListener('keydown', (event) => {
      if (event.key === 'Enter') act(event.shiftKey ? -1 : 1);
      else if (event.key === 'Escape') $('program').focus();
      else return;
      event.preventDefault();
    });
    $('search').addEventListener('input', () => this.find($('search').value));
    go('search', (step) => this.step(step));
    $('before').addEventListener('click', () => this.step(-1));
    $('after').addEventListener('click', () => this.step(1));
    $('goto').max = view.lines.length;
    go('goto', () => {
      const line = Math.round(Number($('goto').value));
      if (line >= 1) view.choose(Math.min(view.lines.length, line));
    });
  }

  /** Has the reader write into a field. */
  open(id) {
    $('tab-program').click();
    $(id).focus();
    $(id).select();
  }

  /** Marks the lines that contain a text, in upper or lower case, and goes to the next one. */
  find(text) {
    const { view: { lines, listing } } = this;
    const pattern = new RegExp(text.replace(/[^\w\s]/g, '\\$&'), 'i');
    this.hits = text ? lines.flatMap((line, index) => (pattern.test(line) ? [index + 1] : [])) : [];
    listing.found = new Set(this.hits);
    listing.render();
    const next = this.hits.findIndex((line) => line >= listing.current);
    this.show(Math.max(0, next));
  }

  /** Goes to the next hit or the one before, and from the last to the first. */
  step(by) {
    const { hits, view: { listing: { current } } } = this;
    if (by > 0) this.show(Math.max(0, hits.findIndex((line) => line > current)));
    else this.show(hits.filter((line) => line < current).length - 1);
  }

  show(index) {
    const { hits, view } = this;
    const at = index < 0 ? hits.length - 1 : index;
    if (hits.length) view.choose(hits[at]);
    const none = $('search').value ? 'none' : '';
    $('found').textContent = hits.length ? `${grouped(at + 1)} of ${grouped(hits.length)}` : none;
  }
}
