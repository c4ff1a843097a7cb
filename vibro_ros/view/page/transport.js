/** Play, pause, speed, the time line, from impact to impact: the controls of a motion, by mouse and by keyboard. */

import {clockDecimals, fixed} from "vibro/ticks.js";

const KEYS = {" ": "play", "ArrowLeft": "previous", "ArrowRight": "next", ",": "back", ".": "on"};

export class Transport {
  #changed;
  #play;
  #speed;
  #timeline;
  #controls;
  #actions;
  #enabled;
  #shown;

  /**
   * @param {object} player the clock
   * @param {function(): void} changed is called when somebody has moved the clock
   */
  constructor(player, changed) {
    this.player = player;
    this.impacts = null;
    this.#changed = changed;
    this.#play = document.querySelector("#play");
    this.#speed = document.querySelector("#speed");
    this.#timeline = document.querySelector("#timeline");
    this.#controls = ["#play", "#previous", "#next", "#timeline"].map((one) => document.querySelector(one));
    this.#actions = {
      play: () => player.toggle(),
      previous: () => this.#jump(this.impacts.previous(player.time)),
      next: () => this.#jump(this.impacts.next(player.time)),
      back: () => player.frame(-1),
      on: () => player.frame(1),
    };
    for (const name of ["play", "previous", "next"]) {
      document.querySelector(`#${name}`).addEventListener("click", () => this.#do(name));
    }
    this.#speed.addEventListener("change", () => this.#takeSpeed());
    this.#timeline.addEventListener("input", () => {
      player.seek(Number(this.#timeline.value));
      changed();
    });
    document.addEventListener("keydown", (event) => this.#press(event));
    this.#takeSpeed();
    this.enable(false);
  }

  /**
   * Take another motion.
   * @param {object} source with `begin` and `end` [s]
   * @param {object} impacts of the same time
   */
  load(source, impacts) {
    this.impacts = impacts;
    this.player.load(source.begin, source.end);
    this.#timeline.min = source.begin;
    this.#timeline.max = source.end;
    this.enable(true);
  }

  /** @param {boolean} on whether there is a motion to play */
  enable(on) {
    this.#enabled = on;
    for (const control of this.#controls) {
      control.disabled = !on;
    }
  }

  /** Show where the clock is. */
  show() {
    const {player} = this;
    const playing = String(player.playing);
    if (this.#play.dataset.playing !== playing) {
      this.#play.dataset.playing = playing;
      this.#play.setAttribute("aria-label", player.playing ? "Pause" : "Play");
    }
    if (this.#shown !== player.time) {
      this.#shown = player.time;
      this.#timeline.value = player.time;
      this.#timeline.setAttribute("aria-valuetext", `${fixed(player.time, clockDecimals(player.speed))} seconds`);
    }
  }

  #takeSpeed() {
    this.player.speed = Number(this.#speed.value);
    this.#changed();
  }

  #jump(impact) {
    if (impact) {
      this.player.seek(impact.time);
    }
  }

  #do(name) {
    if (this.#enabled) {
      this.#actions[name]();
      this.#changed();
    }
  }

  #press(event) {
    const name = KEYS[event.key];
    if (!name || !this.#enabled || event.ctrlKey || event.metaKey || event.altKey || keeps(event.target, event.key)) {
      return;
    }
    event.preventDefault();
    this.#do(name);
  }
}

// Whether an element needs a key for itself.
function keeps(element, key) {
  if (element.id === "timeline") {
    return false;
  }
  if (element.matches("input[type=checkbox], button, summary")) {
    return key === " ";
  }
  if (element.matches("select")) {
    return key !== "," && key !== ".";
  }
  return element.matches("input, textarea");
}
