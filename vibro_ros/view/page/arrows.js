/** Forces as arrows: their length grows with the logarithm of the force, and the number stands beside it. */

import {SLED, arrowLength} from "vibro/geometry.js";
import {massPlace, plateFace} from "vibro/mechanism.js";
import {font, theme} from "vibro/theme.js";
import {forceText} from "vibro/ticks.js";

const LEAST = 0.05; // N that is drawn
const HEAD = 7; // px

/**
 * Draw the forces of an instant: of the ground on the body, of drives and plates on the masses.
 * @param {CanvasRenderingContext2D} context
 * @param {object} stage fitted to the canvas
 * @param {object} values quantities by name
 */
export function drawForces(context, stage, values) {
  const {machine, middle, scale, sole} = stage;
  const behind = middle - scale * (SLED.back - 0.012);
  arrow(context, [behind, sole + arrowLength(values.normal_force)], [0, -1], values.normal_force, theme.force);
  const ahead = middle + scale * SLED.front;
  arrow(context, [ahead, sole + 5], [1, 0], -values.friction_force, theme.force);
  for (const guide of machine.guides) {
    const colour = theme[guide.side];
    const out = [-Math.sin(guide.angle), -Math.cos(guide.angle)];
    const mass = massPlace(machine, guide, values);
    const drive = values[`${guide.side}_drive_force`];
    arrow(context, stage.point(guide.angle, 0.0185, mass), out, drive, colour);
    if (guide.plate) {
      const face = plateFace(machine, guide, values);
      const plate = -values[`${guide.side}_plate_force`];
      arrow(context, stage.point(guide.angle, -0.0185, face), out, plate, colour);
    }
  }
}

// An arrow from a point along a direction, backwards for a negative force, with its number at the tip.
function arrow(context, [x, y], [toX, toY], force, colour) {
  if (!(Math.abs(force) > LEAST)) {
    return;
  }
  const sign = Math.sign(force);
  const [alongX, alongY] = [sign * toX, sign * toY];
  const length = Math.max(HEAD + 2, arrowLength(force));
  const [tipX, tipY] = [x + alongX * length, y + alongY * length];
  context.strokeStyle = colour;
  context.fillStyle = colour;
  context.lineWidth = 2;
  context.lineCap = "butt";
  context.beginPath();
  context.moveTo(x, y);
  context.lineTo(tipX - alongX * (HEAD - 1), tipY - alongY * (HEAD - 1));
  context.stroke();
  context.beginPath();
  context.moveTo(tipX, tipY);
  context.lineTo(tipX - alongX * HEAD - alongY * 4, tipY - alongY * HEAD + alongX * 4);
  context.lineTo(tipX - alongX * HEAD + alongY * 4, tipY - alongY * HEAD - alongX * 4);
  context.fill();
  label(context, forceText(Math.abs(force)), tipX + (alongX < -0.3 ? -5 : 6), tipY + 4 * alongY, alongX < -0.3);
}

// A text with a rim, so that it can be read on the drawing.
function label(context, text, x, y, left) {
  context.font = font(11, "600");
  context.textAlign = left ? "right" : "left";
  context.textBaseline = "middle";
  context.strokeStyle = theme.panel;
  context.lineWidth = 3;
  context.strokeText(text, x, y);
  context.fillText(text, x, y);
}
