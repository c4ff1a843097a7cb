/** How fast the robot gets along: its mean speed over ground, and how much of the time its body is in the air. */

import {fixed} from "vibro/ticks.js";

const SECONDS = 5; // over which is averaged, or less where the run has begun later
const STEP = 2.5e-4; // s, between two looks at a motion that is known everywhere
const EVERY = 250; // ms between two readings
const RESET = 1; // rad, by which only a reset turns the crank less or more than its speeds before and after would
const NAMES = ["body_position", "body_height", "crank_angle", "motor_speed"];

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
 * The means over the seconds before an instant, from the last reset and the last gap of what is known on.
 * @param {object} source a `Ring` or a `Motion`
 * @param {number} time [s]
 * @returns {{seconds: number, speed: number, airborne: number}} time that was averaged over [s], mean speed over ground
 *     [m/s], share of the time in the air; NaN where nothing is known
 */
export function means(source, time) {
  let start = null;
  let before = null;
  let airborne = 0;
  source.path(NAMES, time - SECONDS, time, STEP, (at, [position, height, angle, turning]) => {
    if (!before || Number.isNaN(before.position) || isReset(before, {at, angle, turning})) {
      start = {at, position};
      airborne = 0;
    } else {
      airborne += (at - before.at) * ((height > 0) + (before.height > 0)) / 2;
    }
    before = {at, position, height, angle, turning};
  });
  const seconds = start ? before.at - start.at : 0;
  return seconds > 0 ? {seconds, speed: (before.position - start.position) / seconds, airborne: airborne / seconds}
    : {seconds: 0, speed: Number.NaN, airborne: Number.NaN};
}

/** The means in the page's words. */
export class Means {
  #speed = document.querySelector("#mean-speed");
  #over = document.querySelector("#mean-over");
  #airborne = document.querySelector("#airborne");
  #written = -EVERY;
  #time = Number.NaN; // that was read last

  /**
   * @param {object | null} source a `Ring` or a `Motion`
   * @param {number} time the instant that is shown [s]
   * @param {number} now time on the wall [ms]
   */
  show(source, time, now) {
    if (!source || !Number.isFinite(time) || now - this.#written < EVERY || time === this.#time) {
      return;
    }
    this.#written = now;
    this.#time = time;
    const {seconds, speed, airborne} = means(source, time);
    this.#speed.textContent = `${fixed(speed * 1e3, 1)} mm/s`;
    this.#over.textContent = `mean of the last ${fixed(seconds, 1)} s`;
    this.#airborne.textContent = `${fixed(airborne * 100, 0)} %`;
  }
}
