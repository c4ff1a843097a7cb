/** The page of a live robot: samples, commands, what the robot says, and slow motion of the last second. */

import {Connection} from "vibro/connection.js";
import {Impacts} from "vibro/impacts.js";
import {Knobs} from "vibro/knobs.js";
import {LiveClock} from "vibro/clocks.js";
import {Motion} from "vibro/motion.js";
import {Ring} from "vibro/ring.js";
import {note, say, sayAbsent} from "vibro/said.js";
import {Scene} from "vibro/scene.js";
import {fixed} from "vibro/ticks.js";

const SAMPLES = 30_000; // that are kept: 6 s of a robot that publishes 5000 a second
const AWAY = "The view is away. A view that is started anew prints a new address; open that one.";
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

  constructor() {
    this.#scene = new Scene();
    this.#clock = new LiveClock();
    this.#connection = new Connection({
      robot: (message) => this.#meet(message), absent: ({words}) => this.#miss(words),
      impacts: ({list}) => this.#impacts?.add(list), status: (message) => this.#tell(message),
      log: ({level, words}) => say(level, words), answer: ({done, words}) => say(done ? "info" : "error", words),
      samples: (rows) => this.#take(rows), motion: (header, payload) => this.#slow(header, payload),
      lost: (reason) => this.#miss(reason || AWAY),
    });
    this.#knobs = new Knobs((command, value) => this.#connection.ask({command, value}, sayFailure));
    this.#buttons = Object.fromEntries(["reset", "pause", "step", "record", "slow", "live"]
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
    setInterval(() => this.#knobs.show(this.#scene.view.values), 100);
  }

  #wire() {
    const {reset, pause, step, record, slow, live} = this.#buttons;
    for (const [button, call] of [[reset, "reset"], [step, "step"]]) {
      button.addEventListener("click", () => this.#connection.ask({call}));
    }
    for (const [button, call] of [[pause, "pause"], [record, "record"]]) {
      button.addEventListener("click", () => {
        const on = button.getAttribute("aria-pressed") !== "true";
        this.#connection.ask({call, on});
      });
    }
    slow.addEventListener("click", () => this.#connection.ask({slow_motion: SLOW}));
    live.addEventListener("click", () => this.#goLive());
    document.addEventListener("keydown", (event) => {
      const chord = event.ctrlKey || event.metaKey || event.altKey;
      const typing = chord || event.target.matches("input[type=number], select");
      if (event.key === "Escape" && this.#scene.motion) {
        this.#goLive();
      } else if (event.key === "s" && !typing && !slow.disabled) {
        slow.click();
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
    press(this.#buttons.pause, this.#paused);
    this.#buttons.step.disabled = !(this.#offers?.step && this.#paused);
    press(this.#buttons.record, Boolean(recording));
    document.querySelector("#recording").textContent = recording ?? "";
    document.querySelector("#recording").title = recording ?? "";
  }

  #slow(header, payload) {
    const motion = new Motion(header, payload);
    this.#scene.play(motion, new Impacts(header.impacts.length + 1, header.impacts));
    this.#scene.player.playing = true;
    this.#show(true);
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

function press(button, on) {
  button.setAttribute("aria-pressed", String(on));
}

/** Show the robot of the server that this page came from. */
export function startLive() {
  new Live().start();
}
