/**
 * The mechanism drawn to scale: its geometry, the stage on which it stands, its parts.
 *
 * Lengths are in m and angles in rad, as in the model; a positive angle turns from z (up) towards -x (backwards). In what
 * follows `context` is that of the canvas, `machine` and its `guide`s are as the setting describes them, `values` has the
 * quantities of an instant by name.
 */

import {fixed, font, forceText, theme} from "vibro/text.js";

/** Half the width of a guide [m]; like the outlines below, a size that only pictures have. */
export const RAIL = 0.014;

/** The sled [m]: how far its sole reaches behind and before the crank's centre, its top beyond that, its height. */
export const SLED = {back: 0.088, front: 0.052, overhang: 0.008, height: 0.008};

/** Thickness of the cap that ends a guide [m]. */
export const CAP = 0.005;

/** Room above the guides for a body that hops [m]. */
const HOP = 0.012;

/**
 * Distance of a slider from the crank's centre, along its guide.
 * @param {number} radius of the crank [m]
 * @param {number} rod its length, at least the radius [m]
 * @param {number} psi angle of the crank from the guide [rad]
 */
export function sliderPosition(radius, rod, psi) {
  const along = radius * Math.cos(psi);
  return along + Math.sqrt((rod - radius) * (rod + radius) + along * along); // factored: exact where rod = radius
}

/**
 * The outline of a coil spring along y.
 * @param {number} start where it begins [m]
 * @param {number} end where it ends [m]
 * @param {number} turns how often it goes left and right
 * @param {number} width how far it goes to either side [m]
 * @returns {number[][]} points [x, y], from start to end
 */
export function coil(start, end, turns, width) {
  const lead = 0.08 * (end - start);
  const pitch = (end - start - 2 * lead) / (2 * turns);
  const points = [[0, start], [0, start + lead]];
  for (let corner = 1; corner < 2 * turns; corner += 1) {
    points.push([corner % 2 === 1 ? width : -width, start + lead + corner * pitch]);
  }
  points.push([0, end - lead], [0, end]);
  return points;
}

/**
 * Distance of a guide's end from the crank's centre.
 * @param {number} plate position of its plate [m], counted like the masses' positions
 */
export function guideEnd(machine, guide, plate) {
  return Math.max(guide.end, plate + machine.free_length + machine.mass_height + machine.headroom);
}

/**
 * The box around all that the mechanism can reach, with the crank's centre as its origin.
 * @returns {{left: number, right: number, bottom: number, top: number}} [m]
 */
export function bounds(machine) {
  const box = {
    left: -SLED.back - SLED.overhang, right: SLED.front + SLED.overhang,
    bottom: -machine.hub_height, top: machine.crank_radius + HOP,
  };
  for (const guide of machine.guides) {
    const end = guide.end + CAP;
    for (const side of [-RAIL, RAIL]) {
      const x = side * Math.cos(guide.angle) - end * Math.sin(guide.angle);
      const z = side * Math.sin(guide.angle) + end * Math.cos(guide.angle);
      box.left = Math.min(box.left, x);
      box.right = Math.max(box.right, x);
      box.top = Math.max(box.top, z + HOP);
    }
  }
  return box;
}

/**
 * Length of a force's arrow: it grows with the logarithm, because a blow is a thousand times a weight.
 * @returns {number} [px]
 */
export function arrowLength(force) {
  return 14 * Math.log1p(Math.abs(force) / 2);
}

// What the mechanism stands on: the scale of the picture, the ground that moves by, the height of a hop.

const MARGIN = 14; // px, beside the mechanism
const BELOW = 40; // px, for the ground's marks and the force from below
const ABOVE = 44; // px, for the state in words and what may be drawn
const LEAST_HOP = 1e-4; // m that is marked
const HEIGHT_ROOM = 60; // px, beside the sled, for the height of a hop
const FROM_SLED = 0.006; // m from the sled to that measure
const MARKS = 0.01; // m from mark to mark

export class Stage {
  /** @param {object} machine as the setting describes it */
  constructor(machine) {
    this.machine = machine;
    this.box = bounds(machine);
  }

  /**
   * Fit the mechanism into the canvas. The body stands still in the picture and the ground moves by.
   * @param {number} width [px]
   * @param {number} height [px]
   */
  fit(width, height, values) {
    const {box} = this;
    this.width = width;
    this.height = height;
    const [along, up] = [box.right - box.left, box.top - box.bottom]; // m
    const [cos, sin] = [Math.cos(this.machine.slope), Math.abs(Math.sin(this.machine.slope))];
    const ahead = this.machine.hops ? HEIGHT_ROOM : 0; // px
    const [beside, over] = [2 * MARGIN + ahead, BELOW + ABOVE]; // px
    const wide = (width - beside * cos - over * sin) / (along * cos + up * sin);
    const high = (height - beside * sin - over * cos) / (along * sin + up * cos);
    this.scale = Math.max(1, Math.min(wide, high)); // px/m
    this.middle = (width - ahead) / 2 - this.scale * (box.left + box.right) / 2; // px, where the crank's centre is
    this.body = values.body_position || 0;
    const lift = values.body_height || 0;
    const most = Math.max(0.02, 0.25 * up);
    const boxHeight = this.scale * up + over;
    const tilted = (this.scale * along + beside) * sin + boxHeight * cos; // px, its height on the slope
    this.ground = height - BELOW - (tilted - boxHeight) / 2;
    this.pivot = this.ground + BELOW - boxHeight / 2; // px, the height of the box's middle, about which it is tilted
    this.ground += this.scale * Math.max(0, lift - most); // the ground sinks below one that flies high
    this.reach = height * sin; // px, by which a tilted ground is longer to either side
    this.depth = height - this.ground + width * sin; // px, to where the last corner is filled
    this.hub = this.ground - this.scale * (this.machine.hub_height + lift);
    this.sole = this.ground - this.scale * lift;
  }

  /** Have a context draw in pixels along the ground and across it; on a slope x points uphill, and down is down. */
  tilt(context) {
    context.save();
    context.translate(this.width / 2, this.pivot);
    context.rotate(-this.machine.slope);
    context.translate(-this.width / 2, -this.pivot);
  }

  /** Have a context draw in metres from the crank's centre, x to the right and z up. */
  enter(context) {
    context.save();
    context.translate(this.middle, this.hub);
    context.scale(this.scale, -this.scale);
  }

  /**
   * A point of a guide's frame on the canvas.
   * @param {number} angle of the guide [rad]
   * @param {number} across [m], to the right when the guide is upright
   * @param {number} along [m], outwards
   * @returns {number[]} x, y [px]
   */
  point(angle, across, along) {
    const x = across * Math.cos(angle) - along * Math.sin(angle);
    const z = across * Math.sin(angle) + along * Math.cos(angle);
    return [this.middle + this.scale * x, this.hub - this.scale * z];
  }

  /** @param {CanvasRenderingContext2D} context */
  drawGround(context) {
    const {ground, width, scale, reach} = this;
    context.fillStyle = theme.ground;
    context.fillRect(-reach, ground, width + 2 * reach, this.depth);
    context.strokeStyle = theme.ink;
    context.lineWidth = 1.25;
    line(context, -reach, ground, width + reach, ground);
    const labelled = 150 / scale > 0.1 ? 0.1 : 0.05; // m
    const left = this.body - (this.middle + reach) / scale;
    const right = left + (width + 2 * reach) / scale;
    context.font = font(11);
    context.textAlign = "center";
    context.textBaseline = "top";
    context.lineWidth = 1;
    for (let mark = Math.floor((left - labelled) / MARKS); mark * MARKS <= right + labelled; mark += 1) {
      const x = this.middle + scale * (mark * MARKS - this.body);
      const long = mark % Math.round(labelled / MARKS) === 0;
      context.strokeStyle = long ? theme.soft : theme.faint;
      line(context, x, ground, x, ground + (long ? 8 : 4));
      if (long) {
        const text = `${fixed(mark * MARKS * 1e3, 0)} mm`;
        const half = context.measureText(text).width / 2 + 4;
        context.fillStyle = theme.soft;
        context.fillText(x > half - reach && x < width + reach - half ? text : "", x, ground + 11);
      }
    }
  }

  /** The height of a hop, as a measure beside the sled. */
  drawHeight(context, values) {
    if (!(values.body_height > LEAST_HOP)) {
      return;
    }
    const x = this.middle + this.scale * (SLED.front + SLED.overhang + FROM_SLED);
    context.strokeStyle = theme.soft;
    context.fillStyle = theme.soft;
    context.lineWidth = 1;
    line(context, x - 4, this.sole, x + 4, this.sole);
    line(context, x, this.sole, x, this.ground);
    context.font = font(11);
    context.textAlign = "left";
    context.textBaseline = "middle";
    context.fillText(`${fixed(values.body_height * 1e3, 1)} mm`, x + 7, (this.sole + this.ground) / 2 - 6);
  }
}

/** A straight line. */
export function line(context, x, y, toX, toY) {
  context.beginPath();
  context.moveTo(x, y);
  context.lineTo(toX, toY);
  context.stroke();
}

// The mechanism drawn to scale: body, crank, rods, sliders, springs, masses and plates (lengths in m).

const PIN = 0.0035;
const SLIDER = {width: 0.009, height: 0.008};
/** Size of a plate in the drawing [m]. */
export const PLATE = {width: 0.012, height: 0.004};
const GLOW = 0.034; // radius of a flash

/**
 * Draw the mechanism at an instant.
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

/** Where the drawing has a mass's inner end on its guide. */
export function massPlace(machine, guide, values) {
  const position = values[`${guide.side}_position`];
  return (Number.isFinite(position) ? position : guide.rod) + machine.free_length;
}

/** Where the drawing has the face of a plate; a mass that presses pushes it out. */
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
