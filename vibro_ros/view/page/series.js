/** Chebyshev series with integer coefficients, and how a payload holds them; `vibro_ros/view/motion.py` writes it. */

/** Degree of a quantity about which nothing is known. */
export const UNKNOWN = 255;

/**
 * A Chebyshev series by Clenshaw's recurrence.
 * @param {ArrayLike<number>} coefficients
 * @param {number} first place of the first coefficient
 * @param {number} degree
 * @param {number} s where, from -1 to 1
 * @returns {number}
 */
export function chebyshev(coefficients, first, degree, s) {
  let [next, beyond] = [0, 0];
  for (let k = degree; k >= 1; k -= 1) {
    const value = 2 * s * next - beyond + coefficients[first + k];
    beyond = next;
    next = value;
  }
  return s * next - beyond + coefficients[first];
}

/**
 * Integers of seven bits a byte, the lowest first; the eighth bit says that more follow, the lowest bit is the sign.
 * @param {Uint8Array} data
 * @param {number} count how many integers to read
 * @returns {Float64Array}
 */
export function varints(data, count) {
  const found = new Float64Array(count);
  let place = 0;
  for (let k = 0; k < count; k += 1) {
    let [folded, worth, byte] = [0, 1, 128];
    while (byte >= 128) {
      if (place === data.length) {
        throw new RangeError("motion: the data end too early; the file is damaged");
      }
      byte = data[place];
      place += 1;
      folded += byte % 128 * worth;
      worth *= 128;
    }
    found[k] = folded % 2 === 0 ? folded / 2 : -(folded + 1) / 2;
  }
  return found;
}

/**
 * Where the series begin.
 * @param {Uint8Array} degrees of all series, `UNKNOWN` where there is none
 * @returns {Uint32Array} place of the first coefficient of each
 */
export function places(degrees) {
  const found = new Uint32Array(degrees.length);
  let place = 0;
  for (let k = 0; k < degrees.length; k += 1) {
    found[k] = place;
    place += degrees[k] === UNKNOWN ? 0 : degrees[k] + 1;
  }
  return found;
}

/**
 * Put the constants of the series in the place of the steps that are written for them: the step leads from where the
 * quantity was at the end of the last piece that knew it to where it is at the begin of this one.
 * @param {Float64Array} integers changed in place
 * @param {Uint8Array} degrees piece by piece
 * @param {Uint32Array} starts places of the series
 * @param {number} width quantities of a piece
 */
export function sumConstants(integers, degrees, starts, width) {
  const before = new Float64Array(width);
  for (let series = 0; series < degrees.length; series += 1) {
    if (degrees[series] === UNKNOWN) {
      continue;
    }
    const first = starts[series];
    let [alternating, sum] = [0, 0];
    for (let k = 1; k <= degrees[series]; k += 1) {
      alternating += k % 2 === 0 ? integers[first + k] : -integers[first + k];
      sum += integers[first + k];
    }
    integers[first] += before[series % width] - alternating;
    before[series % width] = integers[first] + sum;
  }
}
