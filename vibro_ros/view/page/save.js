/** What of the page becomes a file on the reader's disk: samples as CSV, and a motion as a page of its own. */

/**
 * Have the browser save a text.
 * @param {string} name of the file
 * @param {string} text
 */
export function save(name, text) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([text]));
  link.download = name.replaceAll(/[^\w.-]+/gu, "_").replace(/^_/u, "");
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 60_000);
}

/**
 * The newest rows as CSV: a line of names, then numbers in SI units that are read again bit for bit.
 * @param {object} ring of samples
 * @param {string[]} names of its quantities
 * @param {number} seconds [s]
 * @returns {string}
 */
export function csv(ring, names, seconds) {
  const columns = ["time", ...names];
  const lines = [columns.join(",")];
  for (let row = ring.row(ring.end - seconds) + 1; row < ring.count; row += 1) {
    lines.push(columns.map((name) => ring.at(name, row)).join(","));
  }
  return `${lines.join("\n")}\n`;
}

/**
 * The page of a recording that shows a motion, made of the page of a live robot.
 * @param {string} page as the server has sent it
 * @param {object} setting of the page to be
 * @param {object} header of the motion document
 * @param {ArrayBuffer} payload of the motion document
 * @returns {Promise<string>}
 */
export async function recordedPage(page, setting, header, payload) {
  const nonce = Array.from(crypto.getRandomValues(new Uint8Array(16)), (one) => one.toString(16)).join("");
  const {policy, ...rest} = setting;
  const data = [
    `<script id="setting" type="application/json">${json(rest)}</script>`,
    `<script id="motion-header" type="application/json">${json(header)}</script>`,
    `<script id="motion-payload" type="text/plain">${await packed(payload)}</script>`,
  ].join("\n");
  const meta = `<meta http-equiv="Content-Security-Policy" content="${policy.replaceAll("NONCE", nonce)}">`;
  return page.replaceAll(/ nonce="[^"]*"/gu, ` nonce="${nonce}"`).replace("<!-- policy -->", () => meta)
    .replace(/<script id="setting"[^]*?<\/script>/u, () => data);
}

// JSON that ends no script element.
function json(value) {
  return JSON.stringify(value).replaceAll("<", String.raw`\u003c`);
}

// Bytes, deflated and in base 64.
async function packed(bytes) {
  const stream = new Blob([bytes]).stream().pipeThrough(new CompressionStream("deflate"));
  const found = new Uint8Array(await new Response(stream).arrayBuffer());
  const letters = Array.from(found, (one) => String.fromCodePoint(one));
  return btoa(letters.join(""));
}
