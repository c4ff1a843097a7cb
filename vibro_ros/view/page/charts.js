/** Strip charts on one canvas, one above the other, with one axis of time. */

import {GAP, RIGHT, TIME_TICK, TITLE, drawAxis, drawGrid, drawTitle, roomBeside, stroke, upright} from "vibro/axes.js";
import {stripsOf} from "vibro/strips.js";
import {line} from "vibro/stage.js";
import {theme} from "vibro/surface.js";
import {axisRange, ticks} from "vibro/ticks.js";

const BOTTOM = 34; // px, for the axis of time
const FUTURE = 0.3; // share of the window that lies ahead, when what comes is known
const PALE = 0.35; // how strongly what comes is drawn

export class Charts {
  #strips;
  #ranges;
  #source;
  #ahead;
  #shown;

  constructor() {
    this.#strips = [];
    this.#ranges = [];
    this.#source = null;
  }

  /**
   * Show another source.
   * @param {object} source a `Ring` or a `Motion`
   * @param {boolean} ahead whether what comes is known and shown
   */
  load(source, ahead) {
    this.#source = source;
    this.#ahead = ahead;
    this.#strips = stripsOf(source);
    this.#ranges = this.#strips.map(() => null);
  }

  /**
   * Draw.
   * @param {object} surface to draw on
   * @param {number} time the present [s]
   * @param {number} window how much time is shown [s]
   * @param {object} values quantities at the present, by name
   * @param {object} impacts to mark
   */
  draw(surface, time, window, values, impacts) {
    const context = surface.begin();
    if (!this.#source || !Number.isFinite(time)) {
      return;
    }
    const [begin, end] = this.#span(time, window);
    const shares = this.#strips.reduce((sum, strip) => sum + strip.share, 0);
    const room = surface.height - BOTTOM - this.#strips.length * (TITLE + GAP);
    const charts = this.#strips.map((strip, number) => {
      const height = Math.max(20, room * strip.share / shares);
      const lines = strip.series.map((series) => this.#points(series, strip.scale, begin, end, surface.width));
      this.#ranges[number] = axisRange(this.#ranges[number], ...extent(lines), strip.least);
      return {strip, height, lines, range: this.#ranges[number], marks: upright(this.#ranges[number], height)};
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
    drawTitle(context, place, strip, values);
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
  #points(series, scale, begin, end, width) {
    const points = [];
    const factor = scale * (series.sign ?? 1);
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

function extent(lines) {
  let [low, high] = [Infinity, -Infinity];
  for (const points of lines) {
    for (let k = 1; k < points.length; k += 2) {
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
  const split = ahead ? firstAfter(points, place.time) : points.length;
  context.lineJoin = "bevel"; // cheap, where a curve is dense
  stroke(context, place, points, y, 0, split);
  if (ahead) {
    context.globalAlpha = PALE;
    stroke(context, place, points, y, Math.max(0, split - 2), points.length);
    context.globalAlpha = 1;
  }
}

// Place of the first point that is later than a time.
function firstAfter(points, time) {
  let [low, high] = [0, points.length / 2];
  while (low < high) {
    const middle = (low + high) >> 1;
    if (points[2 * middle] <= time) {
      low = middle + 1;
    } else {
      high = middle;
    }
  }
  return 2 * low;
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
