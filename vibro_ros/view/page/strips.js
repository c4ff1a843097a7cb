/** Which strip charts there are: titles, units, and the quantities in them; and their numbers as a table. */

import {fixed} from "vibro/ticks.js";

const MILLI = 1e3;

/**
 * @typedef {object} Series
 * @property {string} name quantity
 * @property {string} colour of the theme
 * @property {string} [label] beside its value
 * @property {number} [sign] -1 turns it around
 * @property {boolean} [dashed]
 */

/**
 * @typedef {object} Strip
 * @property {string} title
 * @property {string} [short] title where there is little room
 * @property {string} unit
 * @property {number} scale from SI units to those of the chart
 * @property {number} least shortest axis, in units of the chart
 * @property {number} decimals of the values
 * @property {number} share of the height
 * @property {boolean} [impacts] whether impacts are marked
 * @property {Series[]} series
 */

/** @type {Strip[]} */
export const STRIPS = [
  {
    title: "body displacement", unit: "mm", scale: MILLI, least: 0.2, decimals: 2, share: 1,
    series: [{name: "body_position", colour: "ink"}],
  },
  {
    title: "masses, plates dashed, impacts ▾", short: "masses", unit: "mm",
    scale: MILLI, least: 1, decimals: 2, share: 1.4, impacts: true,
    series: [
      {name: "upper_plate_position", colour: "upper", dashed: true},
      {name: "inclined_plate_position", colour: "inclined", dashed: true},
      {name: "upper_position", colour: "upper", label: "upper"},
      {name: "inclined_position", colour: "inclined", label: "inclined"},
    ],
  },
  {
    title: "motor speed", unit: "rad/s", scale: 1, least: 10, decimals: 1, share: 0.8,
    series: [{name: "motor_speed", colour: "ink"}],
  },
  {
    title: "motor power", unit: "W", scale: 1, least: 1, decimals: 1, share: 0.9,
    series: [{name: "motor_power", colour: "ink"}],
  },
  {
    title: "motor voltage", unit: "V", scale: 1, least: 1, decimals: 2, share: 0.8,
    series: [{name: "motor_voltage", colour: "ink"}],
  },
  {
    title: "motor current", unit: "A", scale: 1, least: 0.1, decimals: 3, share: 0.8,
    series: [{name: "motor_current", colour: "ink"}],
  },
  {
    title: "force of the ground", short: "ground", unit: "N", scale: 1, least: 1, decimals: 1, share: 0.9,
    series: [
      {name: "normal_force", colour: "ink", label: "normal"},
      {name: "friction_force", colour: "force", label: "friction", sign: -1},
    ],
  },
];

/**
 * The strips of what a source knows.
 * @param {{has: function(string): boolean}} source
 * @returns {Strip[]}
 */
export function stripsOf(source) {
  const found = [];
  for (const strip of STRIPS) {
    const series = strip.series.filter((one) => source.has(one.name));
    if (series.length > 0) {
      found.push({...strip, series});
    }
  }
  return found;
}

/** ms between two readings of the table */
const EVERY = 1000;

/** The numbers of the charts as a table, for screen readers, once a second. */
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
