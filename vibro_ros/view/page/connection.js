/** The web socket to the server of the live view; it is opened again when it is lost. */

const AGAIN = 1000; // ms before another try
const LONGEST = 10_000; // ms between two of many tries
const SAMPLES = 1; // a binary frame of rows of samples
const MOTION = 2; // a binary frame of the payload of a motion
const HEADER = 8; // bytes

export class Connection {
  /** Numbers in a row of samples; 0 while they are not known. */
  columns = 0;
  #hear;
  #pause = AGAIN;
  #number;
  #header;
  #waiting;
  #socket;

  /**
   * @param {object} hear functions by the kind of a message, and `samples(rows)`, `motion(header, payload)`, `lost()`
   */
  constructor(hear) {
    this.#hear = hear;
    this.#number = 0;
    this.#header = null;
    this.#waiting = new Map();
  }

  /** Connect, now and whenever the connection is lost. */
  open() {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    const token = new URLSearchParams(location.search).get("token") ?? "";
    const socket = new WebSocket(`${scheme}://${location.host}/live?token=${encodeURIComponent(token)}`);
    socket.binaryType = "arraybuffer";
    socket.addEventListener("open", () => {
      this.#pause = AGAIN;
    });
    socket.addEventListener("message", (event) => this.#take(event.data));
    socket.addEventListener("close", (event) => this.#lost(event));
    this.#socket = socket;
  }

  /**
   * Ask the server for something.
   * @param {object} request
   * @param {function(object): void} [answered] is called with the answer, instead of `hear.answer`
   */
  ask(request, answered) {
    if (this.#socket?.readyState !== WebSocket.OPEN) {
      this.#hear.lost("");
      return;
    }
    this.#number += 1;
    if (answered) {
      this.#waiting.set(this.#number, answered);
    }
    this.#socket.send(JSON.stringify({id: this.#number, ...request}));
  }

  #lost(event) {
    this.columns = 0;
    this.#header = null;
    this.#waiting.clear();
    this.#hear.lost(event.reason);
    this.#pause = Math.min(LONGEST, 1.5 * this.#pause);
    setTimeout(() => this.open(), this.#pause);
  }

  #take(data) {
    if (typeof data === "string") {
      this.#takeText(JSON.parse(data));
      return;
    }
    const frame = decode(data, this.columns);
    if (frame?.type === SAMPLES) {
      this.#hear.samples(frame.rows);
    } else if (frame?.type === MOTION && this.#header?.id === frame.number) {
      this.#hear.motion(this.#header.header, frame.payload);
      this.#header = null;
    }
  }

  #takeText(message) {
    if (message.kind === "motion") {
      this.#header = message;
    } else if (message.kind === "answer") {
      const answered = this.#waiting.get(message.id) ?? this.#hear.answer;
      this.#waiting.delete(message.id);
      answered(message);
    } else {
      this.#hear[message.kind]?.(message);
    }
  }
}

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
