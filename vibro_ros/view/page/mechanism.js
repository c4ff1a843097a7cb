/** The mechanism drawn to scale: body, crank, rods, sliders, springs, masses and plates (lengths in m). */

import {CAP, RAIL, SLED, coil, guideEnd, sliderPosition} from "vibro/geometry.js";
import {font, theme} from "vibro/surface.js";
import {forceText} from "vibro/ticks.js";

const PIN = 0.0035;
const SLIDER = {width: 0.009, height: 0.008};
/** Size of a plate in the drawing [m]. */
export const PLATE = {width: 0.012, height: 0.004};
const GLOW = 0.034; // radius of a flash

/**
 * Draw the mechanism at an instant.
 * @param {CanvasRenderingContext2D} context
 * @param {object} stage fitted to the canvas
 * @param {object} values quantities by name
 * @param {object} lights side: how its plate flashes, {glow, impact, told}; `told`: whether the peak force is written
 */
export function drawMechanism(context, stage, values, lights) {
  const {machine} = stage;
  stage.enter(context);
  context.lineJoin = "round";
  drawBody(context, machine);
  for (const guide of machine.guides) {
    inGuide(context, guide, () => drawHousing(context, machine, guide, values));
  }
  drawDisc(context, machine);
  for (const guide of machine.guides) {
    inGuide(context, guide, () => drawMoving(context, machine, guide, values, lights[guide.side]));
  }
  drawCrank(context, machine, values.crank_angle || 0);
  context.restore();
  for (const guide of machine.guides) {
    drawPeak(context, stage, guide, values, lights[guide.side]);
  }
}

function inGuide(context, guide, draw) {
  context.save();
  context.rotate(guide.angle);
  draw();
  context.restore();
}

function drawBody(context, machine) {
  const [sole, top] = [-machine.hub_height, -machine.hub_height + SLED.height];
  context.fillStyle = theme.body;
  context.strokeStyle = theme.edge;
  context.lineWidth = 0.0007;
  polygon(context, [[-0.038, top], [0.03, top], [0.02, 0], [-0.02, 0]]);
  polygon(context, [[-SLED.back, sole], [SLED.front, sole], [SLED.front + SLED.overhang, top],
    [-SLED.back - SLED.overhang, top]]);
}

function drawHousing(context, machine, guide, values) {
  const end = guideEnd(machine, guide, guide.plate ? platePosition(guide, values) : guide.rod);
  context.fillStyle = theme.body;
  context.strokeStyle = theme.edge;
  context.lineWidth = 0.0007;
  rectangle(context, -RAIL, 0.012, 2 * RAIL, end - 0.012);
  context.fillStyle = theme.edge;
  rectangle(context, -RAIL, end, 2 * RAIL, CAP);
}

function drawDisc(context, machine) {
  context.fillStyle = theme.panel;
  context.strokeStyle = theme.edge;
  context.lineWidth = 0.0007;
  disc(context, 0, 0, machine.crank_radius + 0.006);
  context.stroke();
}

function drawMoving(context, machine, guide, values, light) {
  const psi = (values.crank_angle || 0) - guide.angle;
  const slider = sliderPosition(machine.crank_radius, guide.rod, psi);
  const mass = massPlace(machine, guide, values);
  context.strokeStyle = theme.dark;
  context.lineWidth = 0.0008;
  polyline(context, coil(slider + SLIDER.height / 2, mass, 6, 0.0065));
  if (guide.plate) {
    drawPlate(context, machine, guide, values, light);
  }
  context.strokeStyle = theme.metal;
  context.lineCap = "round";
  context.lineWidth = 0.0032;
  polyline(context, [[-machine.crank_radius * Math.sin(psi), machine.crank_radius * Math.cos(psi)], [0, slider]]);
  context.fillStyle = theme.metal;
  context.strokeStyle = theme.dark;
  context.lineWidth = 0.0007;
  rectangle(context, -SLIDER.width, slider - SLIDER.height / 2, 2 * SLIDER.width, SLIDER.height);
  context.fillStyle = theme[guide.side];
  context.beginPath();
  context.roundRect(-0.011, mass, 0.022, machine.mass_height, 0.0028);
  context.fill();
}

// The plate gives way under the mass, and lights up.
function drawPlate(context, machine, guide, values, light) {
  const plate = plateFace(machine, guide, values);
  const end = guideEnd(machine, guide, platePosition(guide, values));
  context.lineWidth = 0.0009;
  polyline(context, coil(plate + PLATE.height, end, 2, 0.008));
  const glow = light ? light.glow : 0;
  if (glow > 0) {
    const shine = context.createRadialGradient(0, plate, 0, 0, plate, GLOW);
    shine.addColorStop(0, theme.flash);
    shine.addColorStop(1, `${theme.flash}00`); // the same colour, of which nothing is seen
    context.fillStyle = shine;
    context.globalAlpha = 0.9 * glow;
    disc(context, 0, plate, GLOW);
    context.globalAlpha = 1;
  }
  context.fillStyle = glow > 0.25 ? theme.flash : theme.dark;
  context.strokeStyle = theme.dark;
  context.lineWidth = 0.0006;
  rectangle(context, -PLATE.width, plate, 2 * PLATE.width, PLATE.height);
}

function drawCrank(context, machine, angle) {
  const pin = [-machine.crank_radius * Math.sin(angle), machine.crank_radius * Math.cos(angle)];
  context.strokeStyle = theme.dark;
  context.lineCap = "round";
  context.lineWidth = 0.004;
  polyline(context, [[0, 0], pin]);
  context.fillStyle = theme.dark;
  disc(context, 0, 0, PIN);
  context.fillStyle = theme.panel;
  context.lineWidth = 0.0016;
  disc(context, ...pin, PIN);
  context.stroke();
}

// The peak force of a blow beside its plate, while the plate is lit.
function drawPeak(context, stage, guide, values, light) {
  if (!light?.told || !light.impact?.peak_force || light.glow < 0.05 || !guide.plate) {
    return;
  }
  const right = guide.angle < 0.2;
  const along = plateFace(stage.machine, guide, values) + PLATE.height + (right ? 0.01 : 0);
  const [x, y] = stage.point(guide.angle, right ? RAIL + 0.006 : -RAIL - 0.004, along);
  context.globalAlpha = Math.min(1, 3 * light.glow);
  context.fillStyle = theme[guide.side];
  context.font = font(15, "600");
  context.textAlign = right ? "left" : "right";
  context.textBaseline = right ? "middle" : "top";
  context.fillText(forceText(light.impact.peak_force), x, y);
  context.globalAlpha = 1;
}

/**
 * Where the drawing has a mass's inner end on its guide.
 * @param {object} machine
 * @param {object} guide
 * @param {object} values quantities by name
 * @returns {number} [m]
 */
export function massPlace(machine, guide, values) {
  const position = values[`${guide.side}_position`];
  return (Number.isFinite(position) ? position : guide.rod) + machine.free_length;
}

/**
 * Where the drawing has the face of a plate; a mass that presses pushes it out.
 * @param {object} machine
 * @param {object} guide
 * @param {object} values quantities by name
 * @returns {number} [m]
 */
export function plateFace(machine, guide, values) {
  const free = platePosition(guide, values) + machine.free_length;
  return Math.max(free, massPlace(machine, guide, values)) + machine.mass_height;
}

function platePosition(guide, values) {
  const position = values[`${guide.side}_plate_position`];
  return Number.isFinite(position) ? position : guide.rod;
}

function polyline(context, points) {
  context.beginPath();
  for (const [x, z] of points) {
    context.lineTo(x, z);
  }
  context.stroke();
}

function polygon(context, points) {
  context.beginPath();
  for (const [x, z] of points) {
    context.lineTo(x, z);
  }
  context.closePath();
  context.fill();
  context.stroke();
}

function rectangle(context, x, z, width, height) {
  context.beginPath();
  context.rect(x, z, width, height);
  context.fill();
  context.stroke();
}

function disc(context, x, z, radius) {
  context.beginPath();
  context.arc(x, z, radius, 0, 2 * Math.PI);
  context.fill();
}
