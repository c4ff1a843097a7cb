/**
 * A motion, exact at every instant: pieces of time, and on each piece each quantity as a Chebyshev series.
 * `vibro_ros/view/motion.py` says how a document holds them.
 */

import {Extremes, countUpTo} from "vibro/samples.js";

/** Degree of a quantity about which nothing is known. */
const UNKNOWN = 255;

/** Steps of time that are computed and kept together. */
const BLOCK = 64;
/** Instants at which a piece is looked at within a step of time: enough to find how high a short blow goes. */
const LOOKS = 3;
/** Between two pieces [s], from which on nothing is known in between. */
const GAP = 1e-9;

/** Blocks that are kept. */
const MOST_BLOCKS = 2000;

export class Motion {
  #borders;
  #degrees;
  #coefficients;
  #places;
  #width;
  #index;
  #piece;
  #blocks;

  /**
   * @param {object} header of the motion document
   * @param {ArrayBuffer} payload of the motion document
   */
  constructor(header, payload) {
    this.header = header;
    this.begin = header.begin;
    this.end = header.end;
    const {pieces, coefficients, quantities} = header;
    this.#width = quantities.length;
    this.#borders = new Float64Array(payload, 0, 2 * pieces); // little-endian, as all browsers' machines are
    this.#coefficients = new Float64Array(payload, 16 * pieces, coefficients);
    this.#degrees = new Uint8Array(payload, 8 * (2 * pieces + coefficients), pieces * this.#width);
    this.#places = places(this.#degrees);
    this.#index = new Map(quantities.map((name, index) => [name, index]));
    this.#piece = 0;
    this.#blocks = new Map();
  }

  /** @returns {boolean} whether the motion tells this quantity */
  has(name) {
    return this.#index.has(name);
  }

  /** @returns {number} number of the last piece that begins no later; 0 before the first */
  piece(time) {
    const borders = this.#borders;
    const guess = this.#piece;
    if (borders[2 * guess] <= time && time < borders[2 * guess + 1]) {
      return guess;
    }
    this.#piece = Math.max(0, countUpTo(this.header.pieces, (piece) => borders[2 * piece], time) - 1);
    return this.#piece;
  }

  /**
   * @param {number} time [s]; within a gap between pieces the end of the piece before is returned
   * @returns {number} the quantity; NaN where nothing is known
   */
  value(name, time) {
    const index = this.#index.get(name);
    return index === undefined ? Number.NaN : this.#value(this.piece(time), index, time);
  }

  /**
   * The device at an instant.
   * @param {object} values filled: each quantity by its name
   * @returns {number} the time within the motion that was read [s]
   */
  read(time, values) {
    const at = Math.min(this.end, Math.max(this.begin, time));
    const piece = this.piece(at);
    for (const [name, index] of this.#index) {
      values[name] = this.#value(piece, index, at);
    }
    values.time = at;
    return at;
  }

  #value(piece, index, time) {
    const place = piece * this.#width + index;
    const degree = this.#degrees[place];
    if (degree === UNKNOWN) {
      return Number.NaN;
    }
    const [begin, end] = [this.#borders[2 * piece], this.#borders[2 * piece + 1]];
    const s = end > begin ? Math.min(1, Math.max(-1, ((time - begin) - (end - time)) / (end - begin))) : 0;
    return chebyshev(this.#coefficients, this.#places[place], degree, s);
  }

  /** @returns {boolean} whether what is shown there is what the simulator computes, not an interpolation */
  exactAt(time) {
    const {exact, exact_spans: spans} = this.header;
    return exact || (spans ?? []).some(([begin, end]) => begin <= time && time <= end);
  }

  /** @returns {{force_x: number, force_z: number} | undefined} what pushes the body from outside [N], if it is known */
  pushAt(time) {
    return this.header.pushes?.find(({begin, end}) => begin <= time && time < end);
  }

  /**
   * A quantity as a polyline; of each step of time the least and the greatest value, short blows included.
   * @param {number} step shortest time that can be seen [s]
   * @param {function(number, number): void} point is called for each point: time [s], value
   */
  trace(name, from, to, step, point) {
    const length = BLOCK * step;
    const last = Math.floor(Math.min(to, this.end) / length);
    for (let number = Math.floor(Math.max(from, this.begin) / length); number <= last; number += 1) {
      const points = this.#block(name, step, number);
      for (let k = 0; k < points.length; k += 2) {
        point(points[k], points[k + 1]);
      }
    }
  }

  /**
   * Quantities at the same instants: both ends of each piece, and so many in between that no step is longer.
   * @param {string[]} names
   * @param {number} step longest time between two instants [s]
   * @param {function(number, number[]): void} point is called for each instant: time [s], values; NaN in a gap
   */
  path(names, from, to, step, point) {
    const indices = names.map((name) => this.#index.get(name));
    let known = Math.max(from, this.begin);
    for (let piece = this.piece(from); piece < this.header.pieces && this.#borders[2 * piece] <= to; piece += 1) {
      const begin = Math.max(from, this.#borders[2 * piece]);
      const end = Math.min(to, this.#borders[2 * piece + 1]);
      if (begin - known > GAP) {
        point(begin, names.map(() => Number.NaN));
      }
      const steps = Math.max(1, Math.ceil((end - begin) / step));
      const last = begin <= end ? steps : -1;
      for (let k = 0; k <= last; k += 1) {
        const time = begin + (end - begin) * k / steps;
        point(time, indices.map((index) => this.#value(piece, index, time)));
      }
      known = Math.max(known, end);
    }
  }

  // Points of one block of steps; the steps lie at fixed instants, so that a curve that moves by does not shimmer.
  #block(name, step, number) {
    const key = `${name} ${step} ${number}`;
    let found = this.#blocks.get(key);
    if (!found) {
      found = this.#computed(name, step, number);
      if (this.#blocks.size >= MOST_BLOCKS) {
        this.#blocks.delete(this.#blocks.keys().next().value); // the oldest
      }
      this.#blocks.set(key, found);
    }
    return found;
  }

  #computed(name, step, number) {
    const points = [];
    const hand = (time, value) => points.push(time, value);
    for (let k = number * BLOCK; k < (number + 1) * BLOCK; k += 1) {
      this.#cell(name, k, step, hand).hand(hand);
    }
    return Float64Array.from(points);
  }

  // One step of time; where nothing was recorded in between, a value that is no number parts the curve.
  #cell(name, number, step, hand) {
    const cell = new Extremes(number);
    const index = this.#index.get(name);
    const [from, to] = [Math.max(number * step, this.begin), Math.min((number + 1) * step, this.end)];
    if (!(from <= to)) {
      return cell;
    }
    for (let piece = this.piece(from); piece < this.header.pieces && this.#borders[2 * piece] <= to; piece += 1) {
      const begin = Math.max(from, this.#borders[2 * piece]);
      if (piece > 0 && begin === this.#borders[2 * piece] && begin - this.#borders[2 * piece - 1] > GAP) {
        hand(begin, Number.NaN);
      }
      const end = Math.min(to, this.#borders[2 * piece + 1]);
      const looks = begin <= end ? LOOKS : 0;
      for (let k = 0; k < looks; k += 1) {
        const time = begin + (end - begin) * k / (LOOKS - 1);
        cell.add(time, this.#value(piece, index, time));
      }
    }
    return cell;
  }
}

/**
 * A Chebyshev series by Clenshaw's recurrence.
 * @param {ArrayLike<number>} coefficients
 * @param {number} first place of the first coefficient
 * @param {number} degree
 * @param {number} s where, from -1 to 1
 */
export function chebyshev(coefficients, first, degree, s) {
  let [next, beyond] = [0, 0];
  for (let k = degree; k >= 1; k -= 1) {
    const value = 2 * s * next - beyond + coefficients[first + k];
    beyond = next;
    next = value;
  }
  return s * next - beyond + coefficients[first];
}

// The place of the first coefficient of each series.
function places(degrees) {
  const found = new Uint32Array(degrees.length);
  let place = 0;
  for (let k = 0; k < degrees.length; k += 1) {
    found[k] = place;
    place += degrees[k] === UNKNOWN ? 0 : degrees[k] + 1;
  }
  return found;
}
