/** Which instant of a live robot is drawn: a little behind the newest sample, so that batches do not make it jerk. */

const BEHIND = 0.05; // s
const LOST = 0.4; // s away from where the clock should be, at which it jumps there
const PULL = 3; // 1/s, how fast smaller errors go
const SILENCE = 0.2; // s without samples, after which the newest is drawn: the robot is paused, or slow
const MEMORY = 1; // s, over which the robot's rate is averaged

export class LiveClock {
  #newest;
  #seen;
  #silence;

  constructor() {
    this.forget();
  }

  /** Begin anew, with another robot. */
  forget() {
    this.time = Number.NaN;
    this.rate = 1; // robot time over time on the wall
    this.#newest = Number.NaN;
    this.#seen = 0;
    this.#silence = 0; // s since the newest sample came
  }

  /**
   * Samples have come.
   * @param {number} newest time of the newest [s]
   * @param {number} now time on the wall [s]
   */
  hear(newest, now) {
    const elapsed = now - this.#seen;
    if (elapsed > 0 && elapsed < MEMORY && Number.isFinite(this.#newest)) {
      const weight = Math.min(1, elapsed / MEMORY);
      this.rate += weight * ((newest - this.#newest) / elapsed - this.rate);
    }
    this.#newest = newest;
    this.#seen = now;
    this.#silence = 0;
  }

  /**
   * Go on.
   * @param {number} elapsed time on the wall [s]
   * @returns {number} the instant to draw [s]; NaN before the first sample
   */
  advance(elapsed) {
    this.#silence += elapsed;
    const target = this.#newest + this.rate * (this.#silence - BEHIND);
    if (Number.isNaN(this.time) || Math.abs(target - this.time) > LOST * Math.max(1, this.rate)) {
      this.time = target;
    }
    this.time += elapsed * this.rate;
    this.time += (target - this.time) * Math.min(1, PULL * elapsed);
    if (this.#silence > SILENCE || this.time > this.#newest) {
      this.time = this.#newest;
    }
    return this.time;
  }
}
