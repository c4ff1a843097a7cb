/** The page of a live robot: samples, commands, what the robot says, and slow motion of the last second. */

import {Connection} from "vibro/connection.js";
import {Impacts} from "vibro/impacts.js";
import {Knobs} from "vibro/knobs.js";
import {LiveClock} from "vibro/clocks.js";
import {Motion} from "vibro/motion.js";
import {Ring} from "vibro/ring.js";
import {note, pressed, say, sayAbsent} from "vibro/said.js";
import {csv, recordedPage, save} from "vibro/save.js";
import {Scene} from "vibro/scene.js";
import {fixed} from "vibro/ticks.js";

const SAMPLES = 60_000; // that are kept: a minute of a robot that publishes 1000 a second
const MINUTE = 60; // s
const AWAY = "The view is away, and the robot may run on. A view that is started anew prints a new address; open it.";
const IMPACTS = 2000;
const SLOW = 1; // s of slow motion
const SLOW_SPEED = "0.03"; // until somebody chooses another one: two seconds for a turn of the crank

class Live {
  #scene;
  #clock;
  #connection;
  #impacts;
  #knobs;
  #buttons;
  #identity;
  #ring;
  #offers;
  #paused;
  #commands = {}; // in force
  #machine;
  #setting;
  #page;
  #shown; // what slow motion plays: header and payload

  /**
   * @param {object} setting of the page
   * @param {string} page as the server has sent it
   */
  constructor(setting, page) {
    this.#setting = setting;
    this.#page = page;
    this.#scene = new Scene();
    this.#clock = new LiveClock();
    this.#connection = new Connection({
      robot: (message) => this.#meet(message), absent: ({words}) => this.#miss(words),
      commands: ({values}) => {
        this.#commands = values;
      },
      impacts: ({list}) => this.#impacts?.add(list), status: (message) => this.#tell(message),
      log: ({level, words}) => say(level, words), answer: ({done, words}) => say(done ? "info" : "error", words),
      samples: (rows) => this.#take(rows), motion: (header, payload) => this.#slow(header, payload),
      lost: (reason) => this.#miss(reason || AWAY),
    });
    this.#knobs = new Knobs(({name, parameter}, value) => {
      this.#connection.ask({[parameter ? "parameter" : "command"]: name, value}, sayFailure);
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
    this.#scene.run();
    const newest = {};
    setInterval(() => {
      this.#ring?.read(this.#ring.end, newest);
      this.#knobs.show(newest, this.#commands);
    }, 100);
  }

  #wire() {
    const {stop, reset, pause, step, record, slow, live, "save-samples": samples} = this.#buttons;
    stop.addEventListener("click", () => this.#connection.ask({command: "motor_speed", value: 0}, sayFailure));
    samples.addEventListener("click", () => {
      save(`${this.#setting.robot}_last_minute.csv`, csv(this.#ring, Object.keys(this.#machine.quantities), MINUTE));
    });
    document.querySelector("#save-page").addEventListener("click", () => this.#savePage());
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
      if (event.key === "Escape" && this.#scene.motion) {
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
      this.#ring = new Ring(columns, SAMPLES, Object.keys(machine.quantities));
      this.#impacts = new Impacts(IMPACTS);
      this.#clock.forget();
      this.#scene.view.setMachine(machine);
      this.#goLive();
    }
    this.#scene.view.setMachine(machine);
    this.#machine = machine;
    this.#knobs.load(machine);
    this.#enable(true, offers);
    sayAbsent("");
  }

  #miss(words) {
    sayAbsent(this.#scene.motion ? "" : words);
    note(this.#scene.motion ? words : "");
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
    this.#buttons["save-samples"].disabled = !this.#ring;
  }

  #take(rows) {
    if (this.#ring.push(rows)) {
      this.#clock.hear(this.#ring.end, performance.now() / 1e3);
    }
  }

  #tell({real_time_factor: factor, dropped_share: dropped, paused, recording}) {
    document.querySelector("#real-time-factor").textContent = number(factor, 1, 2, "×");
    document.querySelector("#dropped").textContent = number(dropped, 100, 1, " %");
    this.#paused = Boolean(paused);
    name(this.#buttons.pause, this.#paused, "Pause", "Resume");
    this.#buttons.step.disabled = !(this.#offers?.step && this.#paused);
    name(this.#buttons.record, Boolean(recording), "Record", "Stop recording");
    document.querySelector("#recording").textContent = recording ?? "";
  }

  #slow(header, payload) {
    const motion = new Motion(header, payload);
    this.#shown = [header, payload];
    this.#scene.play(motion, new Impacts(header.impacts.length + 1, header.impacts));
    this.#scene.player.playing = true;
    this.#show(true);
  }

  async #savePage() {
    const title = `${this.#setting.robot} in slow motion`;
    const setting = {...this.#setting, mode: "bag", title, machine: this.#machine};
    save(`${title}.html`, await recordedPage(this.#page, setting, ...this.#shown));
  }

  #goLive() {
    this.#scene.follow(this.#ring, this.#impacts, this.#clock);
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
function name(button, on, begin, end) {
  button.dataset.on = String(on);
  button.textContent = on ? end : begin;
}

/**
 * Show the robot of the server that this page came from.
 * @param {object} setting of the page
 * @param {string} page as the server has sent it
 */
export function startLive(setting, page) {
  new Live(setting, page).start();
}
