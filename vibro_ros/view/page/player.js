/** The clock of slow motion: which instant of a motion is shown. Knows no page. */

const FRAME = 1 / 60; // s, of time on the wall

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
