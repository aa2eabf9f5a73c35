/* The two kinds of hands that an operator of the page has: a mouse, and a keyboard. */

'use strict';

const { check, until } = require('../cncjs');
const {
  click, named, press, pressable, seen,
} = require('./operator');

/** Presses what has the focus. */
async function pressByKey(page, element, what) {
  await until(() => element.evaluate((found) => found.matches(':enabled')), `${what} can be pressed`, () => seen(page));
  await element.focus();
  check(await element.evaluate((found) => document.activeElement === found && found.tabIndex >= 0), `${what} takes the focus`);
  await page.keyboard.press(await element.evaluate((found) => (found.tagName === 'INPUT' ? 'Space' : 'Enter')));
}

const MOUSE = {
  name: 'mouse',
  press,
  click,
  /** Jogs by a step along an axis. */
  step: (page, axis, sign) => press(page, `${axis}${sign > 0 ? '+' : '−'}`),
};

const KEYS = {
  X: ['ArrowLeft', 'ArrowRight'], Y: ['ArrowDown', 'ArrowUp'], Z: ['PageDown', 'PageUp'],
};

const KEYBOARD = {
  name: 'keyboard',
  press: async (page, name) => pressByKey(page, await named(page, name), `a button ${name}`),
  click: async (page, selector) => pressByKey(page, await pressable(page, selector), selector),
  step: async (page, axis, sign) => {
    await page.focus('#pad');
    await page.keyboard.press(KEYS[axis][sign > 0 ? 1 : 0]);
  },
};

module.exports = { KEYBOARD, MOUSE };
