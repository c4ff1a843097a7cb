/** Which instant is drawn: of a motion that is played, and of a live robot. Knows no page. */

const FRAME = 1 / 60; // s, of time on the wall
const BEHIND = 0.05; // s
const LOST = 0.4; // s away from where the clock should be, at which it jumps there
const PULL = 3; // 1/s, how fast smaller errors go
const SILENCE = 0.2; // s without samples, after which the newest is drawn: the robot is paused, or slow
const MEMORY = 1; // s, over which the robot's rate is averaged

/** The clock of slow motion: which instant of a motion is shown. */
export class Player {
  begin = 0; // s
  end = 0; // s
  time = 0; // s, the instant that is shown
  speed = 1; // robot time over time on the wall
  playing = false;

  /**
   * Put another motion in.
   * @param {number} begin [s]
   * @param {number} end [s]
   */
  load(begin, end) {
    this.begin = begin;
    this.end = end;
    this.time = begin;
  }

  /**
   * Go on.
   * @param {number} elapsed time on the wall [s]
   * @returns {boolean} whether the instant has changed
   */
  advance(elapsed) {
    if (!this.playing) {
      return false;
    }
    this.time += elapsed * this.speed;
    if (this.time >= this.end) {
      this.time = this.end;
      this.playing = false;
    }
    return true;
  }

  /** Play, from the start if the end is reached; or pause. */
  toggle() {
    if (!this.playing && this.time >= this.end) {
      this.time = this.begin;
    }
    this.playing = !this.playing;
  }

  /**
   * Go to an instant, and stay there.
   * @param {number} time [s]
   */
  seek(time) {
    this.time = Math.min(this.end, Math.max(this.begin, time));
    this.playing = false;
  }

  /**
   * Go one picture on or back, as far as playing goes in a sixtieth of a second.
   * @param {number} count 1 or -1
   */
  frame(count) {
    this.seek(this.time + count * FRAME * this.speed);
  }

  /**
   * How much robot time the charts show: what passes in six seconds of watching.
   * @returns {number} [s]
   */
  get window() {
    return 6 * this.speed;
  }
}

/** Which instant of a live robot is drawn: a little behind the newest sample, so that batches do not make it jerk. */
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
