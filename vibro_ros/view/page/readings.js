/** The numbers of the charts as a table, for screen readers, once a second. */

import {stripsOf} from "vibro/strips.js";
import {fixed} from "vibro/ticks.js";

const EVERY = 1000; // ms

export class Readings {
  #body;
  #rows;
  #written;

  constructor() {
    this.#body = document.querySelector("#readings tbody");
    this.#rows = [];
    this.#written = 0;
  }

  /** @param {object} source a `Ring` or a `Motion`, whose quantities the table is to have */
  load(source) {
    this.#body.textContent = "";
    this.#rows = [];
    for (const strip of stripsOf(source)) {
      for (const series of strip.series) {
        const row = this.#body.insertRow();
        const head = document.createElement("th");
        head.scope = "row";
        head.textContent = series.name.replaceAll("_", " ");
        row.append(head);
        this.#rows.push({strip, series, cell: row.insertCell()});
      }
    }
  }

  /**
   * @param {object} values quantities by name
   * @param {number} now time on the wall [ms]
   */
  show(values, now) {
    if (now - this.#written < EVERY) {
      return;
    }
    this.#written = now;
    for (const {strip, series, cell} of this.#rows) {
      const value = values[series.name] * strip.scale * (series.sign ?? 1);
      cell.textContent = `${fixed(value, strip.decimals)} ${strip.unit}`;
    }
  }
}
