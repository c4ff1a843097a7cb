/** Phase portraits: speed over place of each mass, and of the body's hops. */

import {
  GAP, RIGHT, TIME_TICK, TITLE, drawAxis, drawGrid, drawTitle, extent, roomBeside, stroke, upright,
} from "vibro/charts.js";
import {line} from "vibro/mechanism.js";
import {axisRange, theme, ticks} from "vibro/text.js";

const MILLI = 1e3;
const AXIS = 20; // px, for the numbers below
const LEAST = [1, 0.1]; // mm and m/s, of an axis
const DOT = 1.5; // px, of a sample

const PORTRAITS = [
  {title: "upper mass: position [mm], plate dashed, and speed", short: "upper mass", colour: "upper",
    x: "upper_position", y: "upper_velocity", plate: "upper_plate_position"},
  {title: "inclined mass: position [mm], plate dashed, and speed", short: "inclined mass", colour: "inclined",
    x: "inclined_position", y: "inclined_velocity", plate: "inclined_plate_position"},
  {title: "body: height [mm], and upward speed", short: "body", colour: "ink",
    x: "body_height", y: "body_vertical_velocity"},
];

export class Portraits {
  #source = null;
  #ahead = false;
  #portraits = [];
  #ranges = [];

  /**
   * Show another source.
   * @param {object} source a `SampleBuffer` or a `Motion`
   * @param {boolean} ahead whether what lies between samples is known
   * @param {boolean} hops whether the body can leave the ground
   */
  load(source, ahead, hops) {
    this.#source = source;
    this.#ahead = ahead;
    this.#portraits = PORTRAITS.filter(({x}) => source.has(x) && (hops || x !== "body_height"));
    this.#ranges = this.#portraits.map(() => [null, null]);
  }

  /**
   * Draw.
   * @param {object} surface to draw on
   * @param {number} time the present [s]
   * @param {number} window how much time is shown, up to the present [s]
   */
  draw(surface, time, window, values) {
    const context = surface.begin();
    const height = surface.height / this.#portraits.length - TITLE - AXIS - GAP;
    const charts = this.#portraits.map((portrait, number) => {
      const points = [];
      const step = window / Math.max(10, surface.width);
      this.#source.path([portrait.x, portrait.y], time - window, time, step, (_, [x, y]) => {
        points.push(x * MILLI, y);
      });
      const ranges = this.#ranges[number].map((range, part) => axisRange(range, ...extent([points], part), LEAST[part]));
      this.#ranges[number] = ranges;
      return {portrait, points, ranges, marks: upright(ranges[1], height)};
    });
    const left = roomBeside(context, charts.map(({marks}) => marks));
    const width = Math.max(10, surface.width - left - RIGHT);
    for (const [number, chart] of charts.entries()) {
      const [across, up] = chart.ranges;
      const top = number * (height + TITLE + AXIS + GAP) + TITLE;
      this.#drawOne(context, {
        left, width, top, height, x: (x) => left + (x - across.low) / (across.high - across.low) * width,
        y: (y) => top + height * (up.high - y) / (up.high - up.low),
      }, {...chart, values});
    }
  }

  #drawOne(context, place, {portrait, points, ranges: [across], marks: upwards, values}) {
    const marks = ticks(across.low, across.high, place.width / TIME_TICK);
    drawGrid(context, place, upwards, place.y, marks.ticks);
    const series = [{name: portrait.y, colour: portrait.colour}];
    drawTitle(context, place, {...portrait, unit: "m/s", scale: 1, decimals: 3, series}, values);
    drawAxis(context, place, place.top + place.height, marks);
    context.strokeStyle = theme[portrait.colour];
    context.fillStyle = theme[portrait.colour];
    context.lineWidth = 1;
    const plate = this.#source.has(portrait.plate) ? place.x(values[portrait.plate] * MILLI) : Number.NaN;
    if (plate > place.left && plate < place.left + place.width) {
      context.setLineDash([5, 4]);
      line(context, plate, place.top, plate, place.top + place.height);
      context.setLineDash([]);
    }
    if (this.#ahead) {
      stroke(context, place, points, place.y, 0, points.length);
    }
    for (let k = 0; k < points.length && !this.#ahead; k += 2) { // nothing is invented between samples
      context.fillRect(place.x(points[k]) - DOT / 2, place.y(points[k + 1]) - DOT / 2, DOT, DOT);
    }
    context.fillStyle = theme.accent;
    context.beginPath();
    context.arc(place.x(values[portrait.x] * MILLI), place.y(values[portrait.y]), 4, 0, 2 * Math.PI);
    context.fill();
  }
}
