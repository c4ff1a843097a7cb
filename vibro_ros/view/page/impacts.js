/** The contacts of masses and plates, in the order of their times; the newest so many of them. */

import {countUpTo} from "vibro/samples.js";

export class Impacts {
  /**
   * @param {number} capacity how many are kept
   * @param {object[]} list of {time, end, side, peak_force} [s, s, "upper" or "inclined", N]; `end` may be missing, and
   *     the force of a rigid plate
   */
  constructor(capacity, list = []) {
    this.capacity = capacity;
    this.list = [];
    this.greatest = 1e-9; // peak force so far [N]
    this.add(list);
  }

  /** @param {object[]} list of impacts; those of a later message may be a little older than those of an earlier one */
  add(list) {
    for (const impact of list) {
      let place = this.list.length;
      while (place > 0 && this.list[place - 1].time > impact.time) {
        place -= 1;
      }
      this.list.splice(place, 0, impact);
      this.greatest = Math.max(this.greatest, impact.peak_force ?? 0);
    }
    if (this.list.length > this.capacity) {
      this.list.splice(0, this.list.length - this.capacity);
    }
  }

  /** @returns {number} number of the first impact later than that */
  after(time) {
    return countUpTo(this.list.length, (number) => this.list[number].time, time);
  }

  /** @returns {object | undefined} the next impact */
  next(time) {
    return this.list[this.after(time)];
  }

  /** @returns {object | undefined} the one before */
  previous(time) {
    let number = this.after(time) - 1;
    while (number >= 0 && this.list[number].time >= time) {
      number -= 1;
    }
    return this.list[number];
  }

  /**
   * @param {string} side "upper" or "inclined"
   * @param {number} since how far back it may lie [s]
   * @returns {object | null} the last impact on that side that has begun
   */
  last(side, time, since) {
    for (let number = this.after(time) - 1; number >= 0; number -= 1) {
      const impact = this.list[number];
      if (impact.side === side) {
        return impact;
      }
      if (impact.time < time - since) {
        break;
      }
    }
    return null;
  }

  /**
   * How brightly a plate flashes.
   * @param {number} fade in which the light goes out after the contact [s]
   * @returns {{glow: number, impact: object | null}} 0 (dark) to 1 (contact), and the impact that did it
   */
  light(side, time, fade) {
    const impact = this.last(side, time, 4 * fade);
    if (!impact) {
      return {glow: 0, impact};
    }
    const age = time - Math.max(impact.time, impact.end ?? impact.time);
    const glow = age <= 0 ? 1 : Math.exp(-age / fade);
    return glow < 0.02 ? {glow: 0, impact: null} : {glow, impact};
  }

  /** @returns {object[]} the impacts that begin in between */
  between(from, to) {
    return this.list.slice(this.after(from), this.after(to));
  }
}
