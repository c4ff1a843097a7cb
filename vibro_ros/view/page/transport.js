/** Slow motion: its clock, and the controls by mouse and by keyboard. */

import {Surface, clockDecimals, fixed, theme} from "vibro/text.js";

const FRAME = 1 / 60; // s, of time on the wall

/** The clock of slow motion: which instant of a motion is shown. */
export class Player {
  begin = 0; // s
  end = 0; // s
  time = 0; // s, the instant that is shown
  speed = 1; // robot time over time on the wall
  playing = false;

  /** Put another motion in. */
  load(begin, end) {
    this.begin = begin;
    this.end = end;
    this.time = begin;
  }

  /**
   * Go on.
   * @param {number} elapsed time on the wall [s]
   * @returns {boolean} whether the instant has changed
   */
  advance(elapsed) {
    if (!this.playing) {
      return false;
    }
    this.time += elapsed * this.speed;
    if (this.time >= this.end) {
      this.time = this.end;
      this.playing = false;
    }
    return true;
  }

  /** Play, from the start if the end is reached; or pause. */
  toggle() {
    if (!this.playing && this.time >= this.end) {
      this.time = this.begin;
    }
    this.playing = !this.playing;
  }

  /** Go to an instant, and stay there. */
  seek(time) {
    this.time = Math.min(this.end, Math.max(this.begin, time));
    this.playing = false;
  }

  /**
   * Go one picture on or back, as far as playing goes in a sixtieth of a second.
   * @param {number} count 1 or -1
   */
  frame(count) {
    this.seek(this.time + count * FRAME * this.speed);
  }

  /**
   * How much robot time the charts show: what passes in six seconds of watching.
   * @returns {number} [s]
   */
  get window() {
    return 6 * this.speed;
  }
}

// The controls of a motion, by mouse and by keyboard: play, pause, speed, the time line, from impact to impact.

const THUMB = 8; // px, half of the time line's handle, where its value begins
const CLICK = 4; // px that a pointer may move within a click
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

/** Impacts above the time line: in each pixel the hardest blow, its height the blow's force. */
export class Marks {
  #surface;
  #source;
  #impacts;

  constructor() {
    this.#surface = new Surface(document.querySelector("#marks"), () => this.draw());
    this.#source = null;
  }

  /**
   * @param {object | null} source with `begin` and `end` [s]; null for none
   * @param {object} impacts to mark
   */
  load(source, impacts) {
    this.#source = source;
    this.#impacts = impacts;
    this.draw();
  }

  /** Draw; called when size or colours change, too. */
  draw() {
    const context = this.#surface.begin();
    const {width, height} = this.#surface;
    if (!this.#source) {
      return;
    }
    const {begin, end} = this.#source;
    const hardest = new Map();
    for (const impact of this.#impacts.list) {
      const share = (impact.time - begin) / Math.max(1e-9, end - begin);
      const x = Math.round(THUMB + share * (width - 2 * THUMB));
      const so = hardest.get(x);
      if (!so || (so.peak_force ?? 0) < impact.peak_force) {
        hardest.set(x, impact);
      }
    }
    for (const [x, impact] of hardest) {
      const size = 3 + (height - 3) * Math.sqrt((impact.peak_force ?? this.#impacts.greatest) / this.#impacts.greatest);
      context.fillStyle = theme[impact.side];
      context.fillRect(x - 0.5, height - size, 1, size);
    }
  }
}

/**
 * Let a pointer choose the instant on the charts, while a motion is played.
 * @param {object} page whose player and picture are meant
 */
export function scrub(canvas, page) {
  let grip = null; // where the pointer went down
  canvas.addEventListener("pointerdown", (event) => {
    const [at, edge] = [page.picture.timeAt(event.offsetX), page.picture.timeAt(event.offsetX + 1)];
    if (page.motion && event.button === 0 && Number.isFinite(at)) {
      grip = {x: event.offsetX, time: page.player.time, at, pace: edge - at, moved: false};
      canvas.setPointerCapture(event.pointerId);
    }
  });
  canvas.addEventListener("pointermove", (event) => {
    if (grip && page.motion) {
      const way = event.offsetX - grip.x;
      grip.moved ||= Math.abs(way) > CLICK;
      if (grip.moved) {
        page.player.seek(grip.time - way * grip.pace);
      }
    }
  });
  canvas.addEventListener("pointerup", () => {
    if (grip && !grip.moved && page.motion) {
      page.player.seek(grip.at);
    }
    grip = null;
  });
  canvas.addEventListener("pointercancel", () => {
    grip = null;
  });
}
