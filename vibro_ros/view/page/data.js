/** What stands in the page beside its modules: the setting, and the motion of a recording. */

/**
 * Data of the page that are JSON.
 * @param {string} id of the element
 * @returns {object}
 */
export function json(id) {
  return JSON.parse(document.querySelector(`#${id}`).textContent);
}

/**
 * Data of the page that are bytes: deflated, and written in base 64.
 * @param {string} id of the element, whose text is let go
 * @returns {Promise<ArrayBuffer>}
 */
export async function bytes(id) {
  const element = document.querySelector(`#${id}`);
  const packed = Uint8Array.from(atob(element.textContent.trim()), (letter) => letter.codePointAt(0));
  element.remove();
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  return await new Response(stream).arrayBuffer();
}
