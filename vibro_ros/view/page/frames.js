/** Binary frames of the live server. */

/** Rows of samples. */
export const SAMPLES = 1;
/** The payload of a motion. */
export const MOTION = 2;
const HEADER = 8; // bytes

/**
 * Take a frame apart.
 * @param {ArrayBuffer} buffer
 * @param {number} columns how many numbers a row of samples has
 * @returns {object | null} {type, number, rows or payload}; null for what is no frame
 */
export function decode(buffer, columns) {
  if (buffer.byteLength < HEADER) {
    return null;
  }
  const view = new DataView(buffer);
  const [type, number] = [view.getUint32(0, true), view.getUint32(4, true)];
  if (type === MOTION) {
    return {type, number, payload: buffer.slice(HEADER)};
  }
  if (type === SAMPLES && columns > 0 && buffer.byteLength === HEADER + 8 * columns * number) {
    return {type, number, rows: new Float64Array(buffer, HEADER)};
  }
  return null;
}
