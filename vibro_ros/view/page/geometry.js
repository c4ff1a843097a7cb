/**
 * Geometry of the mechanism, as the model has it: lengths [m], angles [rad].
 * Turning by a positive angle leads from z (up) towards -x (backwards).
 */

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
 * @returns {number} [m]
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
 * @param {object} machine as the setting describes it
 * @param {object} guide one of its guides
 * @param {number} plate position of its plate [m], counted like the masses' positions
 * @returns {number} [m]
 */
export function guideEnd(machine, guide, plate) {
  return Math.max(guide.end, plate + machine.free_length + machine.mass_height + machine.headroom);
}

/**
 * The box around all that the mechanism can reach, with the crank's centre as its origin.
 * @param {object} machine as the setting describes it
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
 * @param {number} force [N]
 * @returns {number} [px]
 */
export function arrowLength(force) {
  return 14 * Math.log1p(Math.abs(force) / 2);
}
