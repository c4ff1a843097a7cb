/** Rows of numbers, the newest so many of them: the samples of a live robot; and curves of more points than pixels. */

/**
 * How many of `count` ascending numbers are no greater than a limit.
 * @param {function(number): number} at gives a number by its place
 */
export function countUpTo(count, at, limit) {
  let [low, high] = [0, count];
  while (low < high) {
    const middle = (low + high) >> 1;
    if (at(middle) <= limit) {
      low = middle + 1;
    } else {
      high = middle;
    }
  }
  return low;
}

/** What of a step of time is drawn: the least and the greatest value, in their order. */
export class Extremes {
  /** @param {number} number which step of time it is */
  constructor(number) {
    this.number = number;
    this.lowTime = Number.NaN;
    this.low = Infinity;
    this.highTime = Number.NaN;
    this.high = -Infinity;
  }

  /** @param {number} value NaN where nothing is known */
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

/** The newest rows. */
export class SampleBuffer {
  #first;
  #known;
  #index;
  #data;

  /**
   * @param {string[]} columns names; the first is `time` [s], which never decreases
   * @param {number} capacity how many rows are kept
   * @param {string[]} [known] the quantities that this robot has, if not all columns
   */
  constructor(columns, capacity, known = columns) {
    this.columns = columns;
    this.capacity = capacity;
    this.count = 0;
    this.#first = 0;
    this.#known = new Set(known);
    this.#index = new Map(columns.map((name, index) => [name, index]));
    this.#data = columns.map(() => new Float64Array(capacity));
  }

  /** @returns {boolean} whether there is such a column, and the robot has that quantity */
  has(name) {
    return this.#index.has(name) && this.#known.has(name);
  }

  /** @returns {number} time of the oldest row [s]; NaN when empty */
  get begin() {
    return this.count ? this.at("time", 0) : Number.NaN;
  }

  /** @returns {number} time of the newest row [s]; NaN when empty */
  get end() {
    return this.count ? this.at("time", this.count - 1) : Number.NaN;
  }

  /**
   * Take rows; the oldest give way. Rows that go back in time, as those of another robot would, are left out.
   * @param {Float64Array} rows one behind the other
   * @returns {number} how many rows were taken
   */
  push(rows) {
    const width = this.columns.length;
    let taken = 0;
    for (let start = 0; start + width <= rows.length; start += width) {
      if (this.count && !(rows[start] > this.end)) {
        continue;
      }
      const place = (this.#first + this.count) % this.capacity;
      for (let column = 0; column < width; column += 1) {
        this.#data[column][place] = rows[start + column];
      }
      if (this.count < this.capacity) {
        this.count += 1;
      } else {
        this.#first = (this.#first + 1) % this.capacity;
      }
      taken += 1;
    }
    return taken;
  }

  /**
   * @param {string} name a column
   * @param {number} row from 0, the oldest
   * @returns {number} NaN for a column that there is not
   */
  at(name, row) {
    const column = this.#data[this.#index.get(name)];
    return column ? column[(this.#first + row) % this.capacity] : Number.NaN;
  }

  /** @returns {number} number of the last row that is no later; -1 if all are */
  row(time) {
    return countUpTo(this.count, (row) => this.at("time", row), time) - 1;
  }

  /**
   * The last sample no later than a time, or the first: nothing is invented between samples.
   * @param {object} values filled: each quantity by its name
   * @returns {number} the time of the sample [s]
   */
  read(time, values) {
    const row = Math.max(0, this.row(time));
    for (const name of this.columns) {
      values[name] = this.at(name, row);
    }
    return values.time;
  }

  /**
   * A quantity as a polyline; of many samples in one step the least and the greatest.
   * @param {number} step shortest time that can be seen [s]
   * @param {function(number, number): void} point is called for each point: time [s], value
   */
  trace(name, from, to, step, point) {
    const column = this.#data[this.#index.get(name)];
    const [times] = this.#data;
    const last = Math.min(this.count - 1, this.row(to) + 1);
    let cell = new Extremes(Number.NaN);
    for (let row = Math.max(0, this.row(from)); row <= last; row += 1) {
      const place = (this.#first + row) % this.capacity;
      const number = Math.floor(times[place] / step);
      if (number !== cell.number) {
        cell.hand(point);
        cell = new Extremes(number);
      }
      cell.add(times[place], column[place]);
    }
    cell.hand(point);
  }

  /**
   * Quantities at the same instants: those of the samples.
   * @param {string[]} names
   * @param {number} _ step that a motion needs
   * @param {function(number, number[]): void} point is called for each sample: time [s], values
   */
  path(names, from, to, _, point) {
    const last = this.row(to);
    for (let row = this.row(from) + 1; row <= last; row += 1) {
      point(this.at("time", row), names.map((name) => this.at(name, row)));
    }
  }
}

/**
 * The newest rows as CSV: a line of names, then numbers in SI units that are read again bit for bit.
 * @param {SampleBuffer} samples
 * @param {string[]} names of its quantities
 */
export function csv(samples, names, seconds) {
  const columns = ["time", ...names];
  const lines = [columns.join(",")];
  for (let row = samples.row(samples.end - seconds) + 1; row < samples.count; row += 1) {
    lines.push(columns.map((name) => samples.at(name, row)).join(","));
  }
  return `${lines.join("\n")}\n`;
}
