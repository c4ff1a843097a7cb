/** What the page says: numbers as text, round numbers for axes, words above and beside the picture; fonts and colours. */

const MINUS = "\u2212";

/**
 * Round steps between two values.
 * @param {number} high at least `low`
 * @param {number} most how many steps there may be
 * @returns {{step: number, ticks: number[]}} multiples, from `low` to `high`, of 1, 2 or 5 times a power of ten
 */
export function ticks(low, high, most) {
  const step = roundStep((high - low) / Math.max(1, most));
  const found = [];
  const last = Math.floor(high / step + 1e-9);
  for (let k = Math.ceil(low / step - 1e-9); k <= last; k += 1) {
    found.push(k * step);
  }
  return {step, ticks: found};
}

/**
 * The least of 1, 2, 5 times a power of ten that is no less than a number.
 * @param {number} least above 0; else 1 is returned
 */
export function roundStep(least) {
  if (!(least > 0 && least < Infinity)) {
    return 1;
  }
  const power = 10 ** Math.floor(Math.log10(least));
  const factor = [1, 2, 5, 10].find((one) => one * power >= least * (1 - 1e-9));
  return factor * power;
}

/**
 * The axis for values that reach from `low` to `high`: rounded outwards, and kept while it serves, lest it jitter.
 * @param {{low: number, high: number} | null} kept the axis so far
 * @param {number} high
 * @param {number} least the axis is at least so long
 * @returns {{low: number, high: number}}
 */
export function axisRange(kept, low, high, least) {
  if (!(low <= high)) {
    return kept ?? {low: 0, high: least};
  }
  const serves = kept && kept.low <= low && kept.high >= high;
  if (serves && (high - low > 0.5 * (kept.high - kept.low) || kept.high - kept.low <= least * 1.001)) {
    return kept;
  }
  const lack = Math.max(0, least - (high - low)) / 2;
  const [from, to] = [low - lack, high + lack];
  const step = roundStep((to - from) / 6);
  return {low: Math.floor(from / step + 1e-9) * step, high: Math.ceil(to / step - 1e-9) * step};
}

/** A tick as text, with the decimals that its step needs. */
export function tickText(value, step) {
  const decimals = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  return fixed(value, Math.min(decimals, 12));
}

/**
 * A number with so many decimals, a real minus sign, and no minus sign before zero.
 * @param {number} decimals
 */
export function fixed(value, decimals) {
  if (!Number.isFinite(value)) {
    return "–";
  }
  const text = Math.abs(value).toFixed(decimals);
  return value < 0 && Number(text) !== 0 ? MINUS + text : text;
}

/** A number with about three digits, for labels. */
export function brief(value) {
  const size = Math.abs(value);
  const decimals = size >= 10 ? 1 : 2;
  return fixed(value, size >= 100 ? 0 : decimals);
}

/** A force as text, in newton or kilonewton. */
export function forceText(force) {
  return Math.abs(force) >= 1000 ? `${fixed(force / 1000, 1)} kN` : `${brief(force)} N`;
}

/**
 * The decimals in which one step of the player's clock can be seen.
 * @param {number} speed robot time over time [s/s]
 */
export function clockDecimals(speed) {
  const slower = -Math.round(Math.log10(speed)); // powers of ten
  return Math.min(6, Math.max(3, 3 + slower));
}

// The canvases: their size in pixels of the screen, and colours and fonts of the style sheet, in light and in dark.

export class Surface {
  /** @param {function(): void} resized is called when the size has changed */
  constructor(canvas, resized) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d");
    this.width = 0; // px of the page
    this.height = 0;
    new ResizeObserver((entries) => {
      const box = entries.at(-1).contentRect;
      [this.width, this.height] = [box.width, box.height];
      resized();
    }).observe(canvas);
  }

  /** @returns {CanvasRenderingContext2D} cleared, with the page's pixel as its unit */
  begin() {
    const ratio = globalThis.devicePixelRatio || 1;
    const [width, height] = [Math.round(this.width * ratio), Math.round(this.height * ratio)];
    if (this.canvas.width !== width || this.canvas.height !== height) {
      this.canvas.width = width;
      this.canvas.height = height;
    }
    this.context.setTransform(ratio, 0, 0, ratio, 0, 0);
    this.context.clearRect(0, 0, this.width, this.height);
    return this.context;
  }
}

const COLOURS = ["ink", "soft", "faint", "line", "panel", "upper", "inclined", "metal", "body", "edge", "dark", "flash",
  "force", "ground", "accent"];

/** Colours by name; read again when the reader changes between light and dark. */
export const theme = {};

/**
 * Read the colours from the style sheet, now and at each change.
 * @param {function(): void} changed is called after each change
 */
export function followTheme(changed) {
  const read = () => {
    const style = getComputedStyle(document.documentElement);
    for (const name of COLOURS) {
      theme[name] = style.getPropertyValue(`--${name}`).trim();
    }
    theme.font = style.getPropertyValue("--font").trim();
    changed();
  };
  read();
  globalThis.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", read);
}

/**
 * A font of the canvases.
 * @param {number} size [px]
 * @param {string} weight
 */
export function font(size, weight = "400") {
  return `${weight} ${size}px ${theme.font}`;
}

// What stands in words: the lines of the robot, what stands above the page, and the state for those who listen.

const MOST = 30; // lines that are kept

/**
 * Add a line to what the robot has said.
 * @param {string} level "info", "warning" or "error"
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
  scrollToEnd(said);
  if (document.body.dataset.mode === "bag") {
    note(words);
  }
}

// Show the last lines, also after the page has got narrower and the lines take more room.
function scrollToEnd(said) {
  said.scrollTop = said.scrollHeight;
  if (!said.dataset.watched) {
    said.dataset.watched = "true";
    new ResizeObserver(() => scrollToEnd(said)).observe(said);
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

/** Whether an event is the press of a letter that nobody types into a field. */
export function pressed(event, letter) {
  const typing = event.ctrlKey || event.metaKey || event.altKey || event.target.matches("input[type=text], select");
  return event.key.toLowerCase() === letter && !typing;
}

/** What the body does. */
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
