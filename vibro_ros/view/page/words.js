/** The robot's state in words, for those who listen. */

import {fixed} from "vibro/ticks.js";

/**
 * What the body does.
 * @param {object} values quantities by name
 * @returns {string}
 */
export function bodyState(values) {
  if (values.body_height > 0) {
    return "body in the air";
  }
  if (values.normal_force <= 0) {
    return "ground unloaded";
  }
  if (Math.abs(values.body_velocity) < 1e-9) {
    return "body stands";
  }
  return values.body_velocity < 0 ? "body slides backwards" : "body slides forwards";
}

/**
 * The picture in a sentence or two.
 * @param {object} values quantities by name
 * @param {string[]} struck sides whose plates flash
 * @returns {string}
 */
export function stateWords(values, struck) {
  if (!Number.isFinite(values.time)) {
    return "The mechanism; nothing is known of its state yet.";
  }
  const parts = [
    `At ${fixed(values.time, 2)} seconds the body is at ${fixed(values.body_position * 1e3, 1)} millimetres`,
    bodyState(values),
    `the motor turns at ${fixed(values.motor_speed, 1)} radians per second`,
  ];
  const blows = struck.map((side) => ` The ${side} mass strikes its plate.`);
  return `${parts.join(", ")}.${blows.join("")}`;
}
