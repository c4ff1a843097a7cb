/** Curves of more points than a screen has pixels. */

/** What of a step of time is drawn: the least and the greatest value, in their order. */
export class Cell {
  /** @param {number} number which step of time it is */
  constructor(number) {
    this.number = number;
    this.lowTime = Number.NaN;
    this.low = Infinity;
    this.highTime = Number.NaN;
    this.high = -Infinity;
  }

  /**
   * @param {number} time [s]
   * @param {number} value NaN where nothing is known
   */
  add(time, value) {
    if (value < this.low) {
      this.low = value;
      this.lowTime = time;
    }
    if (value > this.high) {
      this.high = value;
      this.highTime = time;
    }
  }

  /** @param {function(number, number): void} point is called for one or two points: time [s], value */
  hand(point) {
    if (this.low > this.high) {
      return;
    }
    if (this.lowTime === this.highTime) {
      point(this.lowTime, this.low);
    } else if (this.lowTime < this.highTime) {
      point(this.lowTime, this.low);
      point(this.highTime, this.high);
    } else {
      point(this.highTime, this.high);
      point(this.lowTime, this.low);
    }
  }
}
