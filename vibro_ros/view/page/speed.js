/** How fast the robot gets along: its mean speed over ground, as a number and as a curve. */

import {countUpTo} from "vibro/samples.js";
import {fixed} from "vibro/text.js";

const SECONDS = 5; // over which is averaged, or less where the run has begun later
const STEP = 2.5e-4; // s, between two looks at a motion that is known everywhere
const EVERY = 250; // ms between two readings
const RESET = 1; // rad, by which only a reset turns the crank less or more than its speeds before and after would
const SPEED_NAMES = ["body_position", "crank_angle", "motor_speed"];

/**
 * Whether the crank was put elsewhere between two looks.
 * @param {{at: number, angle: number, turning: number}} before time [s], crank angle [rad] and its rate [rad/s]
 * @param {{at: number, angle: number, turning: number}} now the same, later
 * @returns {boolean} false where a rate is not known
 */
function isReset(before, now) {
  const turned = now.angle - before.angle;
  const rates = [before.turning, now.turning].map((rate) => rate * (now.at - before.at));
  return turned < Math.min(...rates) - RESET || turned > Math.max(...rates) + RESET;
}

/**
 * The mean speed over the seconds before an instant, from the last reset and the last gap of what is known on.
 * @param {object} source a `SampleBuffer` or a `Motion`
 * @returns {{seconds: number, speed: number}} time that was averaged over [s], mean speed over ground [m/s]; NaN where
 *     nothing is known
 */
export function meanSpeed(source, time) {
  let start = null;
  let before = null;
  source.path(SPEED_NAMES, time - SECONDS, time, STEP, (at, [position, angle, turning]) => {
    if (!before || Number.isNaN(before.position) || isReset(before, {at, angle, turning})) {
      start = {at, position};
    }
    before = {at, position, angle, turning};
  });
  const seconds = start ? before.at - start.at : 0;
  return seconds > 0 ? {seconds, speed: (before.position - start.position) / seconds} : {seconds: 0, speed: Number.NaN};
}

/** Time [s] over which the curve averages, because within a turn the body goes to and fro. */
export const CURVE_SECONDS = 1;
const SHORTEST = 0.1; // s, the least that is averaged over after a start, a reset or a gap
const APART = 0.01; // s, between two points, at least
const LOOK = 0.02; // s, between two looks, at most
const BLOCK = 4; // s, whose points are kept together

/** The mean speed of the second before each instant, as a curve. */
export class SpeedCurve {
  #source;
  #blocks;

  /**
   * @param {object} source a `SampleBuffer` or a `Motion`
   * @param {boolean} known whether the whole source is known, so that points can be kept
   */
  constructor(source, known) {
    this.#source = source;
    this.#blocks = known ? new Map() : null;
  }

  /** @returns {number[]} times [s] and speeds [m/s], one behind the other; NaN parts the curve */
  points(from, to) {
    if (!this.#blocks) {
      return this.#computed(from, to);
    }
    const found = [];
    for (let number = Math.floor(from / BLOCK); number * BLOCK <= to; number += 1) {
      if (!this.#blocks.has(number)) {
        this.#blocks.set(number, this.#computed(number * BLOCK, (number + 1) * BLOCK));
      }
      found.push(...this.#blocks.get(number));
    }
    return found;
  }

  #computed(from, to) {
    const points = [];
    let looks = []; // since the last reset or gap
    let first = 0; // the one that lies a second back, or the oldest
    let last = from - APART;
    this.#source.path(SPEED_NAMES, from - CURVE_SECONDS, to, LOOK, (at, [position, angle, turning]) => {
      const look = {at, position, angle, turning};
      if (looks.length > 0 && (Number.isNaN(position) || isReset(looks.at(-1), look))) {
        points.push(at, Number.NaN);
        looks = [];
        first = 0;
      }
      if (Number.isNaN(position)) {
        return;
      }
      looks.push(look);
      while (looks[first].at < at - CURVE_SECONDS) {
        first += 1;
      }
      const seconds = at - looks[first].at;
      if (at - last >= APART && seconds >= SHORTEST) {
        last = at;
        points.push(at, (position - looks[first].position) / seconds);
      }
    });
    return points;
  }
}

/**
 * @param {number[]} points times [s] and values, one behind the other
 * @returns {number} the last value that is no later than a time; NaN if all are
 */
export function latest(points, time) {
  return points[2 * countUpTo(points.length / 2, (k) => points[2 * k], time) - 1] ?? Number.NaN;
}

/** The mean speed in the page's words. */
export class MeanSpeed {
  #speed = document.querySelector("#mean-speed");
  #over = document.querySelector("#mean-over");
  #written = -EVERY;
  #time = Number.NaN; // that was read last

  /**
   * @param {object | null} source a `SampleBuffer` or a `Motion`
   * @param {number} time the instant that is shown [s]
   */
  show(source, time, now) {
    if (!source || !Number.isFinite(time) || now - this.#written < EVERY || time === this.#time) {
      return;
    }
    this.#written = now;
    this.#time = time;
    const {seconds, speed} = meanSpeed(source, time);
    this.#speed.textContent = `${fixed(speed * 1e3, 1)} mm/s`;
    this.#over.textContent = `mean of the last ${fixed(seconds, 1)} s`;
  }
}
