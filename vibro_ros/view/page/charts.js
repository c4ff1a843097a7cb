/**
 * Strip charts on one canvas, and what they share with phase portraits.
 *
 * In what follows `context` is that of the canvas, `place` is where a chart is on it: left, width, top, height [px], and
 * `x`, which leads a number to its place; `values` has the quantities of the present by name.
 */

import {line} from "vibro/mechanism.js";
import {countUpTo} from "vibro/samples.js";
import {CURVE_SECONDS, SpeedCurve, latest} from "vibro/speed.js";
import {axisRange, fixed, font, theme, tickText, ticks} from "vibro/text.js";

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
 * @property {boolean} [speed] whether the mean speed is drawn that follows from the quantity
 * @property {Series[]} series
 */

/** @type {Strip[]} */
export const STRIPS = [
  {
    title: "body displacement", unit: "mm", scale: MILLI, least: 0.2, decimals: 2, share: 1,
    series: [{name: "body_position", colour: "ink"}],
  },
  {
    title: "speed over ground, mean of a second", short: "speed", unit: "mm/s",
    scale: MILLI, least: 1, decimals: 1, share: 0.9, speed: true, series: [{name: "body_position", colour: "ink"}],
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

  /** @param {object} source a `SampleBuffer` or a `Motion`, whose quantities the table is to have */
  load(source) {
    this.#body.textContent = "";
    this.#rows = [];
    for (const strip of stripsOf(source)) {
      for (const series of strip.speed ? [] : strip.series) { // the speed is among the numbers of the page
        const row = this.#body.insertRow();
        const head = document.createElement("th");
        head.scope = "row";
        head.textContent = series.name.replaceAll("_", " ");
        row.append(head);
        this.#rows.push({strip, series, cell: row.insertCell()});
      }
    }
  }

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

// What strip charts and phase portraits share: lines, numbers, titles and curves.

/** Room [px] beside and above a chart: at its right, for its title, between two charts. */
export const [RIGHT, TITLE, GAP] = [10, 20, 6];
/** Between the ticks of time [px], at least. */
export const TIME_TICK = 72;
const VALUE = 62; // px, for a value of the legend
const TICK = 22; // px between the ticks of a value, at least
const [LEFT, BESIDE, STEP] = [50, 6, 8]; // px left of a chart: the least; between number and chart; in so large steps

/**
 * Round numbers for an upright axis.
 * @param {{low: number, high: number}} range of the axis
 * @param {number} height of the chart [px]
 * @returns {{step: number, ticks: number[]}}
 */
export function upright(range, height) {
  return ticks(range.low, range.high, height / TICK);
}

/**
 * Room for the numbers of upright axes, so that the longest of them is not cut.
 * @param {object[]} axes ticks as `upright` gives them
 * @returns {number} [px], in steps, lest charts jitter
 */
export function roomBeside(context, axes) {
  context.font = font(11);
  let widest = 0;
  for (const {ticks: marks, step} of axes) {
    for (const mark of marks) {
      widest = Math.max(widest, context.measureText(tickText(mark, step)).width);
    }
  }
  return Math.max(LEFT, STEP * Math.ceil((widest + BESIDE + 2) / STEP));
}

/**
 * The lines of a chart, and the numbers of its upright axis.
 * @param {object} place of the chart: left, width, top, height [px] and x, which leads a number to its place
 * @param {{step: number, ticks: number[]}} marks of the upright axis
 * @param {function(number): number} y leads a number to its place [px]
 * @param {number[]} across where upright lines are
 */
export function drawGrid(context, place, marks, y, across) {
  const {left, width, top, height} = place;
  context.lineWidth = 1;
  context.strokeStyle = theme.line;
  for (const mark of across) {
    const x = Math.round(place.x(mark)) + 0.5;
    line(context, x, top, x, top + height);
  }
  context.font = font(11);
  context.fillStyle = theme.soft;
  context.textAlign = "right";
  context.textBaseline = "middle";
  for (const mark of marks.ticks) {
    const at = Math.round(y(mark)) + 0.5;
    line(context, left, at, left + width, at);
    context.fillText(tickText(mark, marks.step), left - BESIDE, at);
  }
}

/**
 * The title of a chart, and the values of the present at its right end.
 * @param {object} strip as `STRIPS` has it
 */
export function drawTitle(context, place, strip, values) {
  const base = place.top - 6;
  const legend = strip.series.filter((one) => !one.dashed).toReversed();
  context.font = font(12);
  const taken = legend.reduce((sum, one) => sum + VALUE + labelWidth(context, one), 0);
  context.textBaseline = "alphabetic";
  context.textAlign = "left";
  context.font = font(12, "600");
  context.fillStyle = theme.ink;
  const title = `${strip.title} [${strip.unit}]`;
  const fits = context.measureText(title).width + taken < place.width;
  context.fillText(fits ? title : `${strip.short ?? strip.title} [${strip.unit}]`, place.left, base);
  let right = place.left + place.width;
  context.font = font(12);
  context.textAlign = "right";
  for (const series of legend) {
    context.fillStyle = theme[series.colour];
    context.fillText(fixed(values[series.name] * strip.scale * (series.sign ?? 1), strip.decimals), right, base);
    right -= VALUE;
    context.fillText(series.label ?? "", right + 8, base);
    right -= labelWidth(context, series);
  }
}

function labelWidth(context, series) {
  return series.label ? context.measureText(series.label).width + 4 : 0;
}

/**
 * A curve through points, with a break where a value is no number.
 * @param {number[]} points across and upwards, one behind the other
 * @param {function(number): number} y leads a number to its place [px]
 * @param {number} first place of the first point
 * @param {number} end
 */
export function stroke(context, place, points, y, first, end) {
  let pen = false;
  context.beginPath();
  for (let k = first; k < end; k += 2) {
    const known = !Number.isNaN(points[k + 1]);
    if (known && pen) {
      context.lineTo(place.x(points[k]), y(points[k + 1]));
    } else if (known) {
      context.moveTo(place.x(points[k]), y(points[k + 1]));
    }
    pen = known;
  }
  context.stroke();
}

/**
 * The numbers of the axis below a chart; what is written next to them stands at its right end.
 * @param {object} frame left, width [px] and x, which leads a number to its place
 * @param {number} bottom of the chart [px]
 * @param {{step: number, ticks: number[]}} marks
 */
export function drawAxis(context, frame, bottom, marks) {
  context.font = font(11);
  context.fillStyle = theme.soft;
  context.textBaseline = "top";
  for (const mark of marks.ticks) {
    const x = frame.x(mark);
    const text = tickText(mark, marks.step);
    const half = context.measureText(text).width / 2;
    context.textAlign = "center";
    context.fillText(text, Math.min(x, frame.left + frame.width + RIGHT - half), bottom + 4);
  }
  context.textAlign = "right";
}

// Strip charts on one canvas, one above the other, with one axis of time.

const BOTTOM = 34; // px, for the axis of time
const FUTURE = 0.3; // share of the window that lies ahead, when what comes is known
const PALE = 0.35; // how strongly what comes is drawn

export class Charts {
  #strips = [];
  #ranges = new Map();
  #source = null;
  #speed = null;
  #ahead;
  #shown;

  /**
   * Show another source.
   * @param {object} source a `SampleBuffer` or a `Motion`
   * @param {boolean} ahead whether what comes is known and shown
   */
  load(source, ahead) {
    this.#source = source;
    this.#speed = new SpeedCurve(source, ahead);
    this.#ahead = ahead;
    this.#strips = stripsOf(source);
    this.#ranges.clear();
  }

  /**
   * Draw.
   * @param {object} surface to draw on
   * @param {number} time the present [s]
   * @param {number} window how much time is shown [s]
   * @param {object} impacts to mark
   */
  draw(surface, time, window, values, impacts) {
    const context = surface.begin();
    if (!this.#source || !Number.isFinite(time)) {
      return;
    }
    const [begin, end] = this.#span(time, window);
    const strips = this.#strips.filter((strip) => !strip.speed || window > CURVE_SECONDS);
    const shares = strips.reduce((sum, strip) => sum + strip.share, 0);
    const room = surface.height - BOTTOM - strips.length * (TITLE + GAP);
    const charts = strips.map((strip) => {
      const height = Math.max(20, room * strip.share / shares);
      const lines = strip.series.map((series) => this.#points(strip, series, begin, end, surface.width));
      const range = axisRange(this.#ranges.get(strip), ...extent(lines), strip.least);
      this.#ranges.set(strip, range);
      return {strip, height, lines, range, marks: upright(range, height)};
    });
    const left = roomBeside(context, charts.map(({marks}) => marks));
    const frame = {left, width: Math.max(10, surface.width - left - RIGHT), begin, end, time};
    this.#shown = frame;
    frame.x = (at) => left + (at - begin) / (end - begin) * frame.width;
    const timeTicks = ticks(frame.begin, end, Math.max(2, frame.width / TIME_TICK));
    let top = 0;
    for (const chart of charts) {
      const place = {...frame, top: top + TITLE, height: chart.height};
      this.#drawStrip(context, place, chart, {values, impacts, timeTicks: timeTicks.ticks});
      top += TITLE + chart.height + GAP;
    }
    drawAxis(context, frame, top - GAP, timeTicks);
    context.fillText("time [s]", frame.left + frame.width, top - GAP + 19);
  }

  /**
   * @param {number} x place on the canvas [px]
   * @returns {number} the instant that was drawn there last [s]
   */
  timeAt(x) {
    const {begin, end, left, width} = this.#shown;
    return begin + (end - begin) * (x - left) / width;
  }

  // What is shown: up to the present, or, of what is known as a whole, what lies around it.
  #span(time, window) {
    if (!this.#ahead) {
      return [time - window, time];
    }
    const {begin, end} = this.#source;
    const length = Math.max(1e-6, Math.min(window, end - begin));
    const first = Math.min(Math.max(time - (1 - FUTURE) * length, begin), Math.max(begin, end - length));
    return [first, first + length];
  }

  #drawStrip(context, place, {strip, lines, range, marks}, {values, impacts, timeTicks}) {
    const y = (value) => place.top + place.height * (range.high - value) / (range.high - range.low);
    drawGrid(context, place, marks, y, timeTicks);
    const shown = strip.speed ? {body_position: latest(lines[0], place.time) / strip.scale} : values;
    drawTitle(context, place, strip, shown);
    context.save();
    context.beginPath();
    context.rect(place.left, place.top - 1, place.width, place.height + 2);
    context.clip();
    const present = place.x(place.time);
    for (const [k, series] of strip.series.entries()) {
      context.strokeStyle = theme[series.colour];
      context.lineWidth = series.dashed ? 1 : 1.5;
      context.setLineDash(series.dashed ? [5, 4] : []);
      drawLine(context, place, lines[k], y, this.#ahead);
    }
    context.setLineDash([]);
    if (strip.impacts) {
      drawImpacts(context, place, impacts);
    }
    context.restore();
    if (this.#ahead) {
      context.strokeStyle = theme.accent;
      context.lineWidth = 1;
      line(context, present, place.top, present, place.top + place.height);
    }
  }

  // Times and values of a series within the window, one behind the other.
  #points(strip, series, begin, end, width) {
    if (strip.speed) {
      return this.#speed.points(begin, end).map((number, k) => k % 2 ? strip.scale * number : number);
    }
    const points = [];
    const factor = strip.scale * (series.sign ?? 1);
    this.#source.trace(series.name, begin, end, roundedStep((end - begin) / Math.max(10, width)), (time, value) => {
      points.push(time, factor * value);
    });
    return points;
  }
}

// The step of time that a curve is made of, two pixels or so: finer ones cost frames and show no more. It is a power of
// two, so that curves are kept while the window changes a little.
function roundedStep(step) {
  return 2 ** Math.ceil(Math.log2(1.5 * step));
}

/** Least and greatest of every other number of some lists, from their number `first` on. */
export function extent(lists, first = 1) {
  let [low, high] = [Infinity, -Infinity];
  for (const points of lists) {
    for (let k = first; k < points.length; k += 2) {
      if (points[k] < low) {
        low = points[k];
      }
      if (points[k] > high) {
        high = points[k];
      }
    }
  }
  return [low, high];
}

function drawLine(context, place, points, y, ahead) {
  const split = ahead ? 2 * countUpTo(points.length / 2, (k) => points[2 * k], place.time) : points.length;
  context.lineJoin = "bevel"; // cheap, where a curve is dense
  stroke(context, place, points, y, 0, split);
  if (ahead) {
    context.globalAlpha = PALE;
    stroke(context, place, points, y, Math.max(0, split - 2), points.length);
    context.globalAlpha = 1;
  }
}

function drawImpacts(context, place, impacts) {
  const found = impacts.between(place.begin, place.end);
  const half = Math.min(3.5, Math.max(0.75, place.width / Math.max(1, found.length) / 4));
  for (const impact of found) {
    const x = place.x(impact.time);
    context.fillStyle = theme[impact.side];
    context.beginPath();
    context.moveTo(x - half, place.top);
    context.lineTo(x + half, place.top);
    context.lineTo(x, place.top + 6);
    context.fill();
  }
}
