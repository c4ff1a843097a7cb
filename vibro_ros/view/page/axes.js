/** What strip charts and phase portraits share: lines, numbers, titles and curves. */

import {line} from "vibro/stage.js";
import {font, theme} from "vibro/surface.js";
import {fixed, tickText, ticks} from "vibro/ticks.js";

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
 * @param {CanvasRenderingContext2D} context
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
 * @param {CanvasRenderingContext2D} context
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
 * @param {CanvasRenderingContext2D} context
 * @param {object} place of the chart
 * @param {object} strip as `STRIPS` has it
 * @param {object} values quantities by name
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
 * @param {CanvasRenderingContext2D} context
 * @param {object} place of the chart
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
 * @param {CanvasRenderingContext2D} context
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
