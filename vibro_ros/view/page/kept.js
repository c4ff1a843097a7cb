/** A memory of bounded size. */

/** What was computed last, so many pieces of it. */
export class Kept {
  #map;

  /** @param {number} capacity */
  constructor(capacity = 2000) {
    this.capacity = capacity;
    this.#map = new Map();
  }

  /**
   * @param {string} key
   * @param {function(): object} make is called if nothing is kept under that key
   * @returns {object}
   */
  get(key, make) {
    let found = this.#map.get(key);
    if (found === undefined) {
      found = make();
      if (this.#map.size >= this.capacity) {
        this.#map.delete(this.#map.keys().next().value); // the oldest
      }
      this.#map.set(key, found);
    }
    return found;
  }
}
