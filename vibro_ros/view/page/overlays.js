/** What is drawn over the mechanism on demand: forces, the names of the parts. */

import {PLATE, RAIL, SLED, arrowLength, massPlace, plateFace, sliderPosition} from "vibro/mechanism.js";
import {font, forceText, theme} from "vibro/text.js";

const LEAST = 0.05; // N, of a force that is drawn
const HEAD = 7; // px, of an arrow
const LINE = 14; // px, between two names
const BESIDE = 0.0185; // m from the middle of a guide to the arrows of the forces on its mass and its plate
const [PUSHED, OVER] = [0.036, 0.01]; // m, where the arrow of a push begins: beside the crank's centre, over the sled

/**
 * Draw the forces of an instant as arrows: of the ground on the body, of drives and plates on the masses, on a slope the
 * weight. Their length grows with the logarithm of the force, and the number stands beside it.
 */
export function drawForces(context, stage, values) {
  const {machine, middle, scale, sole} = stage;
  if (machine.slope) {
    const down = [-Math.sin(machine.slope), Math.cos(machine.slope)];
    arrow(context, [middle, stage.hub], down, machine.weight, {colour: theme.soft, name: "weight "});
  }
  const behind = middle - scale * (SLED.back - 0.012);
  arrow(context, [behind, sole + arrowLength(values.normal_force)], [0, -1], values.normal_force, {colour: theme.force});
  const ahead = middle + scale * SLED.front;
  arrow(context, [ahead, sole + 5], [1, 0], -values.friction_force, {colour: theme.force});
  for (const guide of machine.guides) {
    const colour = theme[guide.side];
    const [sin, cos] = [Math.sin(guide.angle), Math.cos(guide.angle)];
    const mass = massPlace(machine, guide, values);
    const drive = values[`${guide.side}_drive_force`];
    arrow(context, stage.point(guide.angle, BESIDE, mass), [-sin, -cos], drive, {colour, away: [cos, -sin]});
    if (guide.plate) {
      const face = plateFace(machine, guide, values);
      const plate = -values[`${guide.side}_plate_force`];
      arrow(context, stage.point(guide.angle, -BESIDE, face), [-sin, -cos], plate, {colour, away: [-cos, sin]});
    }
  }
}

/**
 * Draw a push from outside as an arrow over the sled.
 * @param {{force_x: number, force_z: number} | undefined} push none if nothing pushes
 */
export function drawPush(context, stage, push) {
  if (push) {
    const force = Math.hypot(push.force_x, push.force_z);
    const x = push.force_x < 0 ? -PUSHED : PUSHED;
    const from = [stage.middle + stage.scale * x, stage.sole - stage.scale * (SLED.height + OVER)];
    arrow(context, from, [push.force_x / force, -push.force_z / force], force, {colour: theme.accent, name: "push "});
  }
}

/** Write beside the parts what they are called. */
export function drawNames(context, stage, values) {
  const {machine} = stage;
  for (const guide of machine.guides) {
    const slider = sliderPosition(machine.crank_radius, guide.rod, (values.crank_angle || 0) - guide.angle);
    const mass = massPlace(machine, guide, values);
    const parts = {rod: slider / 2, slider, spring: (slider + mass) / 2,
      [`${guide.side} mass`]: mass + machine.mass_height / 2};
    if (guide.plate) {
      parts.plate = plateFace(machine, guide, values) + PLATE.height / 2;
    }
    const right = guide.angle < 0.2;
    let free = Number.NaN; // px, where the last name stands
    context.fillStyle = theme.ink;
    for (const [name, along] of Object.entries(parts)) {
      const [x, y] = stage.point(guide.angle, right ? RAIL + 0.004 : -RAIL - 0.004, along);
      free = Math.min(y, Number.isNaN(free) ? y : free - LINE);
      label(context, name, x, free, !right);
    }
  }
  context.fillStyle = theme.ink;
  label(context, "crank", ...stage.point(0, 0.006, -0.012), false);
  const [left, over] = [stage.middle - stage.scale * SLED.back, stage.sole - stage.scale * (SLED.height + 0.008)];
  label(context, "body", left, over, false);
}

// An arrow from a point along a direction, backwards for a negative force, with its name and number at the tip. `away` is
// the direction in which a label hides nothing; without it the label stands beside the arrow.
function arrow(context, [x, y], [toX, toY], force, {colour, name = "", away = null}) {
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
  const text = name + forceText(Math.abs(force));
  if (away) {
    label(context, text, tipX + 6 * away[0], tipY + 12 * away[1], away[0] < 0);
  } else {
    label(context, text, tipX + (alongX < -0.3 ? -5 : 6), tipY + 4 * alongY, alongX < -0.3);
  }
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
