/** The knobs: a number and a slider for each command. The robot, not the page, refuses a bad number. */

import {fixed} from "vibro/ticks.js";

const NAMES = {motor_speed: "motor speed", upper_gap: "upper gap", inclined_gap: "inclined gap"};
const PAUSE = 100; // ms between two commands of a slider that is being moved
const GAPS = [-0.005, 0.02]; // m, where a slider of a gap is useful; the number takes any
const MILLI = 1e3;

export class Knobs {
  #command;
  #box;
  #knobs;
  #made;

  /** @param {function(string, number): void} command is called with name and value */
  constructor(command) {
    this.#command = command;
    this.#box = document.querySelector("#knobs");
    this.#knobs = [];
  }

  /**
   * Make the knobs of a machine; those that are there already keep their values and the focus.
   * @param {object} machine as the robot message describes it
   */
  load(machine) {
    const wanted = JSON.stringify(machine.knobs.map((knob) => [knob.name, knob.unit, knob.from, knob.to]));
    if (this.#made !== wanted) {
      this.#made = wanted;
      this.#box.textContent = "";
      this.#knobs = machine.knobs.map((knob) => this.#make(knob, machine));
    }
    for (const [k, {value}] of machine.knobs.entries()) {
      const {number, slider} = this.#knobs[k];
      if (document.activeElement !== number && document.activeElement !== slider) {
        number.value = text(value);
        slider.value = value;
      }
    }
  }

  /** @param {boolean} on whether there is a robot to command */
  enable(on) {
    for (const {number, slider} of this.#knobs) {
      number.disabled = !on;
      slider.disabled = !on;
    }
  }

  /**
   * Show what is so now beside what was asked for.
   * @param {object} values quantities by name
   */
  show(values) {
    for (const knob of this.#knobs) {
      const now = knob.now(values);
      if (now !== knob.shown) {
        knob.shown = now;
        knob.output.textContent = now;
      }
    }
  }

  #make(knob, machine) {
    const row = element("div", {className: "knob"});
    this.#box.append(row);
    const name = NAMES[knob.name] ?? knob.name;
    row.append(element("label", {htmlFor: knob.name, textContent: name}));
    const gap = knob.unit === "m";
    const [min, max] = gap ? [Math.max(GAPS[0], knob.from), Math.min(GAPS[1], knob.to)] : [knob.from, knob.to];
    const slider = element("input", {type: "range", min, max, step: gap ? 1e-5 : 0.5});
    slider.setAttribute("aria-label", `${name}, slider`);
    const number = element("input", {type: "number", id: knob.name, step: "any", autocomplete: "off"});
    const output = element("span", {className: "now"});
    const unit = element("span", {className: "unit", id: `${knob.name}_unit`, textContent: knob.unit});
    number.setAttribute("aria-describedby", unit.id);
    row.append(number, unit, slider, output);
    const send = throttled((value) => this.#command(knob.name, value), PAUSE);
    slider.addEventListener("input", () => {
      number.value = text(Number(slider.value));
      send(Number(slider.value));
    });
    number.addEventListener("change", () => {
      if (Number.isFinite(number.valueAsNumber)) {
        slider.value = number.value;
        send(number.valueAsNumber);
      }
    });
    return {number, slider, output, now: nowOf(knob, machine)};
  }
}

// What of the samples a knob commands, as text.
function nowOf(knob, machine) {
  const guide = machine.guides.find((one) => knob.name === `${one.side}_gap`);
  if (guide) {
    return (values) => `now ${fixed((values[`${guide.side}_plate_position`] - guide.rod) * MILLI, 3)} mm`;
  }
  return (values) => `now ${fixed(values[knob.name], 1)} ${knob.unit}`;
}

// A number of six digits as an input has it.
function text(value) {
  return String(Number(value.toPrecision(6)));
}

function element(tag, properties) {
  return Object.assign(document.createElement(tag), properties);
}

/**
 * A function that is called at most so often, and in the end with the last value.
 * @param {function(number): void} call
 * @param {number} pause [ms]
 * @returns {function(number): void}
 */
export function throttled(call, pause) {
  let timer = 0;
  let last = null;
  const hand = () => {
    timer = 0;
    if (last !== null) {
      const value = last;
      last = null;
      timer = setTimeout(hand, pause);
      call(value);
    }
  };
  return (value) => {
    last = value;
    if (timer === 0) {
      hand();
    }
  };
}
