/** How many pictures of a live robot are left out where the machine cannot draw them all: the robot on it keeps its time. */

const LATE = 0.021; // s between two frames, from which on the machine is behind
const WEIGHT = 0.05; // of the last interval
const WORSE = 0.3; // s of lateness, after which one more of some pictures is left out
const BETTER = 4; // s in time, after which one less is
const MOST = 5; // of so many frames at least one is drawn: twelve a second

export class Thrift {
  every = 1; // of so many frames one is drawn
  #count = 0; // frames since the last that was drawn
  #interval = 0; // s between frames, as it is of late
  #since = 0; // s for which it has been late, or in time where below 0

  /**
   * Take note of a frame.
   * @param {number} elapsed since the last one [s]
   * @returns {boolean} whether it is to be drawn
   */
  draws(elapsed) {
    this.#interval += (elapsed - this.#interval) * WEIGHT;
    this.#since = this.#interval > LATE ? Math.max(0, this.#since) + elapsed : Math.min(0, this.#since) - elapsed;
    if (this.#since > WORSE || this.#since < -BETTER) {
      this.every = Math.min(MOST, Math.max(1, this.every + Math.sign(this.#since)));
      this.#since = 0;
    }
    this.#count += 1;
    if (this.#count < this.every) {
      return false;
    }
    this.#count = 0;
    return true;
  }
}
