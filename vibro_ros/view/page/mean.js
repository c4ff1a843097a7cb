/** How fast the robot gets along: its mean speed over ground. */

import {fixed} from "vibro/ticks.js";

const SECONDS = 5; // over which is averaged, or less where the run has begun later
const STEP = 2.5e-4; // s, between two looks at a motion that is known everywhere
const EVERY = 250; // ms between two readings
const RESET = 1; // rad, by which only a reset turns the crank less or more than its speeds before and after would
const NAMES = ["body_position", "crank_angle", "motor_speed"];

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
 * @param {object} source a `Ring` or a `Motion`
 * @param {number} time [s]
 * @returns {{seconds: number, speed: number}} time that was averaged over [s], mean speed over ground [m/s]; NaN where
 *     nothing is known
 */
export function meanSpeed(source, time) {
  let start = null;
  let before = null;
  source.path(NAMES, time - SECONDS, time, STEP, (at, [position, angle, turning]) => {
    if (!before || Number.isNaN(before.position) || isReset(before, {at, angle, turning})) {
      start = {at, position};
    }
    before = {at, position, angle, turning};
  });
  const seconds = start ? before.at - start.at : 0;
  return seconds > 0 ? {seconds, speed: (before.position - start.position) / seconds} : {seconds: 0, speed: Number.NaN};
}

/** The mean speed in the page's words. */
export class MeanSpeed {
  #speed = document.querySelector("#mean-speed");
  #over = document.querySelector("#mean-over");
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
    const {seconds, speed} = meanSpeed(source, time);
    this.#speed.textContent = `${fixed(speed * 1e3, 1)} mm/s`;
    this.#over.textContent = `mean of the last ${fixed(seconds, 1)} s`;
  }
}
