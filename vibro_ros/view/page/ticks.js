/** Round numbers for axes, and numbers as text. */

const MINUS = "\u2212";

/**
 * Round steps between two values.
 * @param {number} low
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
 * @returns {number}
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
 * @param {number} low
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

/**
 * A tick as text, with the decimals that its step needs.
 * @param {number} value
 * @param {number} step
 * @returns {string}
 */
export function tickText(value, step) {
  const decimals = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  return fixed(value, Math.min(decimals, 12));
}

/**
 * A number with so many decimals, a real minus sign, and no minus sign before zero.
 * @param {number} value
 * @param {number} decimals
 * @returns {string}
 */
export function fixed(value, decimals) {
  if (!Number.isFinite(value)) {
    return "–";
  }
  const text = Math.abs(value).toFixed(decimals);
  return value < 0 && Number(text) !== 0 ? MINUS + text : text;
}

/**
 * A number with about three digits, for labels.
 * @param {number} value
 * @returns {string}
 */
export function brief(value) {
  const size = Math.abs(value);
  const decimals = size >= 10 ? 1 : 2;
  return fixed(value, size >= 100 ? 0 : decimals);
}

/**
 * A force as text, in newton or kilonewton.
 * @param {number} force [N]
 * @returns {string}
 */
export function forceText(force) {
  return Math.abs(force) >= 1000 ? `${fixed(force / 1000, 1)} kN` : `${brief(force)} N`;
}

/**
 * The decimals in which one step of the player's clock can be seen.
 * @param {number} speed robot time over time [s/s]
 * @returns {number}
 */
export function clockDecimals(speed) {
  const slower = -Math.round(Math.log10(speed)); // powers of ten
  return Math.min(6, Math.max(3, 3 + slower));
}
