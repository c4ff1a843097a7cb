/** The page of a live robot: samples, commands, what the robot says, and slow motion of the last second. */

import {Impacts} from "vibro/impacts.js";
import {Knobs} from "vibro/knobs.js";
import {Motion} from "vibro/motion.js";
import {Page} from "vibro/page.js";
import {SampleBuffer, csv} from "vibro/samples.js";
import {fixed, note, pressed, say, sayAbsent} from "vibro/text.js";

const MOST_SAMPLES = 60_000; // that are kept: a minute of a robot that publishes 1000 a second
const MINUTE = 60; // s
const AWAY = "The view is away, and the robot may run on. A view that is started anew prints a new address; open it.";
const MOST_IMPACTS = 2000;
const SLOW = 1; // s of slow motion
const SLOW_SPEED = "0.03"; // until somebody chooses another one: two seconds for a turn of the crank

const AGAIN = 1000; // ms before another try
const LONGEST = 10_000; // ms between two of many tries
const SAMPLES = 1; // a binary frame of rows of samples
const MOTION = 2; // a binary frame of the payload of a motion
const HEADER = 8; // bytes

class Live {
  #page;
  #connection;
  #impacts;
  #knobs;
  #buttons;
  #identity;
  #samples;
  #offers;
  #paused;
  #commands = {}; // in force
  #machine;
  #setting;

  constructor(setting) {
    this.#setting = setting;
    this.#page = new Page();
    this.#connection = new Connection({
      robot: (message) => this.#meet(message), absent: ({words}) => this.#miss(words),
      commands: ({values}) => {
        this.#commands = values;
      },
      impacts: ({list}) => this.#impacts?.add(list), status: (message) => this.#tell(message),
      log: ({level, words}) => this.#say(level, words), answer: ({done, words}) => say(done ? "info" : "error", words),
      samples: (rows) => this.#take(rows), motion: (header, payload) => this.#slow(header, payload),
      lost: (reason) => this.#miss(reason || AWAY),
    });
    this.#knobs = new Knobs(({name, parameter}, value) => {
      this.#connection.ask({[parameter ? "parameter" : "command"]: name, value}, ({done, words}) => {
        if (!done) {
          this.#say("error", words);
        }
      });
    });
    this.#buttons = Object.fromEntries(["stop", "reset", "pause", "step", "record", "slow", "live", "save-samples"]
      .map((name) => [name, document.querySelector(`#${name}`)]));
    this.#wire();
    const speed = document.querySelector("#speed");
    speed.value = SLOW_SPEED;
    speed.dispatchEvent(new Event("change"));
  }

  /** Begin. */
  start() {
    sayAbsent("Waiting for the robot…");
    this.#connection.open();
    this.#page.run();
    const newest = {};
    setInterval(() => {
      this.#samples?.read(this.#samples.end, newest);
      this.#knobs.show(newest, this.#commands);
    }, 100);
  }

  #wire() {
    const {stop, reset, pause, step, record, slow, live, "save-samples": samples} = this.#buttons;
    stop.addEventListener("click", () => this.#connection.ask({command: "motor_speed", value: 0}, sayFailure));
    samples.addEventListener("click", () => {
      save(`${this.#setting.robot}_last_minute.csv`, csv(this.#samples, Object.keys(this.#machine.quantities), MINUTE));
    });
    for (const [button, call] of [[reset, "reset"], [step, "step"]]) {
      button.addEventListener("click", () => this.#connection.ask({call}));
    }
    reset.addEventListener("click", () => this.#knobs.settle());
    for (const [button, call] of [[pause, "pause"], [record, "record"]]) {
      button.addEventListener("click", () => this.#connection.ask({call, on: button.dataset.on !== "true"}));
    }
    slow.addEventListener("click", () => this.#connection.ask({slow_motion: SLOW}));
    live.addEventListener("click", () => this.#goLive());
    document.addEventListener("keydown", (event) => {
      if (event.key === "Escape" && this.#page.motion) {
        this.#goLive();
      } else if (pressed(event, "s")) {
        slow.click(); // does nothing while it is disabled
      } else if (pressed(event, "x")) {
        stop.click();
      }
    });
  }

  // A robot is there, the same as before or another one.
  #meet({name, machine, columns, origin, offers}) {
    this.#connection.columns = columns.length;
    const identity = JSON.stringify([name, origin, columns]);
    if (identity !== this.#identity) {
      this.#identity = identity;
      this.#samples = new SampleBuffer(columns, MOST_SAMPLES, Object.keys(machine.quantities));
      this.#impacts = new Impacts(MOST_IMPACTS);
      this.#page.picture.setMachine(machine);
      this.#goLive();
    }
    this.#page.picture.setMachine(machine);
    this.#machine = machine;
    this.#knobs.load(machine);
    this.#enable(true, offers);
    sayAbsent("");
  }

  #miss(words) {
    sayAbsent(this.#page.motion ? "" : words);
    note(this.#page.motion ? words : "");
    this.#enable(false, {});
  }

  #enable(on, offers) {
    this.#knobs.enable(on);
    this.#offers = offers;
    for (const name of ["reset", "pause", "record"]) {
      this.#buttons[name].disabled = !offers[name];
    }
    this.#buttons.step.disabled = !(offers.step && this.#paused);
    this.#buttons.slow.disabled = !on;
    this.#buttons["save-samples"].disabled = !this.#samples;
  }

  // Say what the robot says, unless a knob says it beside its field.
  #say(level, words) {
    if (!this.#knobs.sayAlready(words)) {
      say(level, words);
    }
  }

  #take(rows) {
    this.#samples.push(rows);
  }

  #tell({real_time_factor: factor, dropped_share: dropped, paused, recording}) {
    document.querySelector("#real-time-factor").textContent = number(factor, 1, 2, "×");
    document.querySelector("#dropped").textContent = number(dropped, 100, 1, " %");
    this.#paused = Boolean(paused);
    label(this.#buttons.pause, this.#paused, "Pause", "Resume");
    this.#buttons.step.disabled = !(this.#offers?.step && this.#paused);
    label(this.#buttons.record, Boolean(recording), "Record", "Stop recording");
    document.querySelector("#recording").textContent = recording ?? "";
  }

  #slow(header, payload) {
    const motion = new Motion(header, payload);
    this.#page.play(motion, new Impacts(header.impacts.length + 1, header.impacts));
    this.#page.player.playing = true;
    this.#show(true);
  }

  #goLive() {
    this.#page.follow(this.#samples, this.#impacts);
    this.#show(false);
    note("");
    document.querySelector("#exactness").textContent = "";
  }

  // Show the buttons for slow motion, or for the live robot.
  #show(slow) {
    const {live, slow: button} = this.#buttons;
    const focused = document.activeElement;
    document.body.dataset.slow = slow;
    live.hidden = !slow;
    button.hidden = slow;
    if (focused === live || focused === button) {
      (slow ? live : button).focus();
    }
  }
}

// Have the browser save a text as a file.
function save(name, text) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([text]));
  link.download = name.replaceAll(/[^\w.-]+/gu, "_").replace(/^_/u, "");
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 60_000);
}

// A number in other units as text; a dash for one that is not known.
function number(value, factor, decimals, unit) {
  return typeof value === "number" ? fixed(value * factor, decimals) + unit : "–";
}

// A command that was taken shows in the picture; one that was not is said.
function sayFailure({done, words}) {
  if (!done) {
    say("error", words);
  }
}

// Name a button by what a click does.
function label(button, on, begin, end) {
  button.dataset.on = String(on);
  button.textContent = on ? end : begin;
}

/** Show the robot of the server that this page came from. */
export function startLive(setting) {
  new Live(setting).start();
}

/** The web socket to the server of the live view; it is opened again when it is lost. */
class Connection {
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
 * @param {number} columns how many numbers a row of samples has
 * @returns {object | null} {type, number, rows or payload}; null for what is no frame
 */
export function decode(buffer, columns) {
  if (buffer.byteLength < HEADER) {
    return null;
  }
  const view = new DataView(buffer);
  const [type, count] = [view.getUint32(0, true), view.getUint32(4, true)];
  if (type === MOTION) {
    return {type, number: count, payload: buffer.slice(HEADER)};
  }
  if (type === SAMPLES && columns > 0 && buffer.byteLength === HEADER + 8 * columns * count) {
    return {type, number: count, rows: new Float64Array(buffer, HEADER)};
  }
  return null;
}
