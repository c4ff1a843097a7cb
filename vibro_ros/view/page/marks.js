/** Impacts above the time line: in each pixel the hardest blow, its height the blow's force. */

import {theme} from "vibro/theme.js";
import {Surface} from "vibro/surface.js";

const THUMB = 8; // px, half of the time line's handle, where its value begins

export class Marks {
  #surface;
  #source;
  #impacts;

  constructor() {
    this.#surface = new Surface(document.querySelector("#marks"), () => this.draw());
    this.#source = null;
  }

  /**
   * @param {object | null} source with `begin` and `end` [s]; null for none
   * @param {object} impacts to mark
   */
  load(source, impacts) {
    this.#source = source;
    this.#impacts = impacts;
    this.draw();
  }

  /** Draw; called when size or colours change, too. */
  draw() {
    const context = this.#surface.begin();
    const {width, height} = this.#surface;
    if (!this.#source) {
      return;
    }
    const {begin, end} = this.#source;
    const hardest = new Map();
    for (const impact of this.#impacts.list) {
      const share = (impact.time - begin) / Math.max(1e-9, end - begin);
      const x = Math.round(THUMB + share * (width - 2 * THUMB));
      const so = hardest.get(x);
      if (!so || (so.peak_force ?? 0) < impact.peak_force) {
        hardest.set(x, impact);
      }
    }
    for (const [x, impact] of hardest) {
      const size = 3 + (height - 3) * Math.sqrt((impact.peak_force ?? this.#impacts.greatest) / this.#impacts.greatest);
      context.fillStyle = theme[impact.side];
      context.fillRect(x - 0.5, height - size, 1, size);
    }
  }
}
