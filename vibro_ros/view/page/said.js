/** What the robot says, for eyes and for screen readers; and what stands above the page. */

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
