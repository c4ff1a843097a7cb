/** The knobs: a number and a slider for each command. The robot, not the page, refuses a number beyond its limits. */

import {fixed} from "vibro/text.js";

const NAMES = {
  "motor_speed": "motor speed", "upper_gap": "upper gap", "inclined_gap": "inclined gap",
  "ground.friction": "floor friction",
};
const PAUSE = 100; // ms between two commands of a slider that is being moved
const SETTLED = 1000; // ms after which a knob that nobody moves shows what is in force
const REFUSED = 5000; // ms after which it does so where it was refused: so long the words can be read
const GAPS = [-5, 20]; // mm, where a slider of a gap is useful; the number takes any
const FRICTION = 1; // up to which a slider is useful
const MILLI = 1e3;
const NUMBER = /^[+-]?(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?$/iu;

// One knob. It shows its unit, in which it is typed: mm of a gap, whose message is in m.
class Knob {
  initial = Number.NaN; // what is in force before the first command and the first sample [SI]
  #knob;
  #scale;
  #now;
  #number;
  #slider;
  #output;
  #words;
  #force = ""; // what is in force, as the field has it
  #typing = false; // whether somebody has typed what has not been sent
  #until = 0; // when it is to show what is in force again [ms]

  constructor(knob, machine, box, ask) {
    const gap = knob.unit === "m";
    this.#knob = knob;
    this.#scale = gap ? MILLI : 1;
    this.#now = nowOf(knob, machine);
    const name = NAMES[knob.name] ?? knob.name;
    const unit = gap ? "mm" : knob.unit;
    const id = knob.name.replace(".", "_");
    const [from, to] = [this.#scale * knob.from, this.#scale * knob.to];
    const [min, max] = gap ? [Math.max(GAPS[0], from), Math.min(GAPS[1], to)]
      : [from, knob.parameter ? Math.min(FRICTION, to) : to];
    const step = knob.parameter || gap ? 0.01 : 0.5;
    const label = make("label", {htmlFor: id, textContent: unit ? `${name} [${unit}]` : name});
    this.#number = make("input", {type: "text", inputMode: "decimal", id, autocomplete: "off", spellcheck: false});
    this.#slider = make("input", {type: "range", min, max, step, ariaLabel: `${name}, slider`});
    this.#output = make("span", {className: "now", id: `${id}_now`});
    this.#words = make("span", {className: "refusal", id: `${id}_words`, role: "alert"});
    this.#number.setAttribute("aria-describedby", `${id}_words ${id}_now`);
    const row = make("div", {className: "knob"});
    row.append(label, this.#number, this.#output, this.#slider, this.#words);
    box.append(row);
    this.#listen((value) => ask(knob, value / this.#scale));
  }

  #listen(call) {
    const send = throttled(call, PAUSE);
    this.#slider.addEventListener("input", () => {
      this.#take(Number(this.#slider.value), send);
    });
    this.#number.addEventListener("input", () => {
      this.#typing = true;
      this.#words.textContent = "";
    });
    this.#number.addEventListener("change", () => this.#read(send));
    this.#number.addEventListener("blur", () => {
      this.#typing = false;
    });
    this.#number.addEventListener("keydown", (event) => {
      if (event.key === "Escape" && this.#typing) {
        event.stopPropagation();
        this.settle();
      }
    });
  }

  enable(on) {
    this.#number.disabled = !on;
    this.#slider.disabled = !on;
  }

  show(values, commands) {
    const now = this.#now(values);
    const value = commands[this.#knob.name] ?? (Number.isFinite(now) ? now : this.initial);
    const words = this.#knob.parameter ? "" : `now ${fixed(now * this.#scale, this.#scale === 1 ? 1 : 3)}`;
    put(this.#output, "textContent", words);
    this.#force = text(value * this.#scale);
    if (!this.#typing && performance.now() > this.#until) {
      this.settle();
    }
  }

  // Send what has been typed, if it is a number.
  #read(send) {
    const typed = this.#number.value;
    const value = numberOf(typed);
    this.#typing = false;
    if (Number.isNaN(value)) {
      this.#refuse(`“${typed.slice(0, 20)}” is no number; type one such as 4.5`);
    } else {
      this.#slider.value = value;
      this.#take(value, send);
    }
  }

  #take(value, send) {
    this.#until = performance.now() + SETTLED;
    this.#number.value = text(value);
    this.#words.textContent = "";
    const [from, to] = [this.#scale * this.#knob.from, this.#scale * this.#knob.to];
    if (value < from || value > to) {
      this.#refuse(`${text(value)} is refused; the robot takes ${text(from)} to ${text(to)}`);
    }
    send(value);
  }

  // Say why what stands in the field has no effect, for as long as it stands there.
  #refuse(words) {
    this.#words.textContent = words;
    this.#until = performance.now() + REFUSED;
  }

  /** Whether the robot's words are on a number that the knob itself has refused beside its field. */
  saysAlready(words) {
    return this.#words.textContent !== "" && words.includes(this.#knob.name);
  }

  // Show what is in force.
  settle() {
    this.#typing = false;
    this.#until = 0;
    put(this.#words, "textContent", "");
    put(this.#number, "value", this.#force);
    put(this.#slider, "value", this.#force);
  }
}

export class Knobs {
  #ask;
  #box;
  #knobs;
  #made;

  /** @param {function(object, number): void} ask is called with a knob, as the machine has it, and a value [SI] */
  constructor(ask) {
    this.#ask = ask;
    this.#box = document.querySelector("#knobs");
    this.#knobs = [];
  }

  /**
   * Make the knobs of a machine; those that are there already keep the focus.
   * @param {object} machine as the robot message describes it
   */
  load(machine) {
    const wanted = JSON.stringify(machine.knobs.map((knob) => [knob.name, knob.unit, knob.from, knob.to]));
    if (this.#made !== wanted) {
      this.#made = wanted;
      this.#box.textContent = "";
      this.#knobs = machine.knobs.map((knob) => new Knob(knob, machine, this.#box, this.#ask));
    }
    for (const [k, {value}] of machine.knobs.entries()) {
      this.#knobs[k].initial = value;
    }
  }

  /** Whether a knob says already why the robot refuses a number, so that the robot's own words would say it twice. */
  sayAlready(words) {
    return this.#knobs.some((knob) => knob.saysAlready(words));
  }

  /** Forget what was typed and refused: the robot is back at its start. */
  settle() {
    for (const knob of this.#knobs) {
      knob.settle();
    }
  }

  /** @param {boolean} on whether there is a robot to command */
  enable(on) {
    for (const knob of this.#knobs) {
      knob.enable(on);
    }
  }

  /**
   * Show what is in force.
   * @param {object} commands values [SI] by the name of their knob, of those that have been given
   */
  show(values, commands) {
    for (const knob of this.#knobs) {
      knob.show(values, commands);
    }
  }
}

// What of the samples a knob commands [SI].
function nowOf(knob, machine) {
  const guide = machine.guides.find((one) => knob.name === `${one.side}_gap`);
  return guide ? (values) => values[`${guide.side}_plate_position`] - guide.rod : (values) => values[knob.name];
}

// A number of six digits as a field has it.
function text(value) {
  return String(Number(value.toPrecision(6)));
}

function put(element, property, value) {
  if (element[property] !== value) {
    element[property] = value;
  }
}

function make(tag, properties) {
  return Object.assign(document.createElement(tag), properties);
}

/**
 * A number as people type it, with a decimal point or a decimal comma.
 * @returns {number} NaN for anything else: thousands cannot be told from decimals where both signs stand
 */
export function numberOf(typed) {
  const plain = typed.trim().replace("\u2212", "-").replace(/^[^.,]*,[^.,]*$/u, (one) => one.replace(",", "."));
  const value = NUMBER.test(plain) ? Number(plain) : Number.NaN;
  return Number.isFinite(value) ? value : Number.NaN;
}

/**
 * A function that is called at most so often, and in the end with the last value.
 * @param {function(number): void} call
 * @param {number} pause [ms]
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
