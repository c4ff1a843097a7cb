/** What stands in words: the lines of the robot, what stands above the page, and the state for those who listen. */

import {fixed} from "vibro/ticks.js";

const MOST = 30; // lines that are kept

/**
 * Add a line to what the robot has said.
 * @param {string} level "info", "warning" or "error"
 * @param {string} words
 */
export function say(level, words) {
  if (!words) {
    return;
  }
  const said = document.querySelector("#said");
  const line = document.createElement("p");
  line.className = level;
  line.textContent = words;
  said.append(line);
  while (said.childElementCount > MOST) {
    said.firstElementChild.remove();
  }
  said.scrollTop = said.scrollHeight;
  if (document.body.dataset.mode === "bag") {
    note(words);
  }
}

/**
 * Say something above the page, until it is taken away.
 * @param {string} words none to take it away
 */
export function note(words) {
  put("#note", words);
}

/**
 * Say across the mechanism that there is no robot.
 * @param {string} words none when there is one
 */
export function sayAbsent(words) {
  put("#absent", words);
}

function put(selector, words) {
  const element = document.querySelector(selector);
  element.textContent = words;
  element.hidden = !words;
}

/**
 * Say how exact the picture is.
 * @param {boolean} exact
 * @param {string} why not
 */
export function sayExactness(exact, why) {
  const element = document.querySelector("#exactness");
  const words = exact ? "exact between samples" : `interpolated here: ${why}`;
  if (element.textContent !== words) {
    element.textContent = words;
    element.title = words;
    element.classList.toggle("warns", !exact);
  }
}

/**
 * Let a button, and the key H, open and close the words about what is seen.
 * @param {function(boolean): void} changed is called with whether they are open
 */
export function explain(changed) {
  const [button, words, close] = ["#explain", "#about", "#close"].map((one) => document.querySelector(one));
  const show = (on) => {
    words.hidden = !on;
    button.setAttribute("aria-expanded", String(on));
    (on ? close : button).focus();
    changed(on);
  };
  button.addEventListener("click", () => show(words.hidden));
  close.addEventListener("click", () => show(false));
  document.addEventListener("keydown", (event) => {
    if (event.key === "Escape" && !words.hidden) {
      event.stopImmediatePropagation();
      show(false);
    } else if (pressed(event, "h")) {
      show(words.hidden);
    }
  });
}

/**
 * Whether an event is the press of a letter that nobody types into a field.
 * @param {KeyboardEvent} event
 * @param {string} letter
 * @returns {boolean}
 */
export function pressed(event, letter) {
  const typing = event.ctrlKey || event.metaKey || event.altKey || event.target.matches("input[type=text], select");
  return event.key.toLowerCase() === letter && !typing;
}

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
