/** The loop: sixty times a second the clock goes on, and what it shows is drawn. */

import {Player} from "vibro/clocks.js";
import {MeanSpeed} from "vibro/mean.js";
import {Readings} from "vibro/strips.js";
import {explain, sayExactness} from "vibro/said.js";
import {clockDecimals, fixed} from "vibro/ticks.js";
import {Marks, Transport, scrub} from "vibro/transport.js";
import {View} from "vibro/view.js";

const LONGEST = 0.1; // s between two pictures; a page that was hidden goes on where it was
const LIVE_WINDOW = 6; // s
const LIVE_CHARTS = 6; // of so many frames one has charts, so that a page takes little from the robot
const TABLE = "the numbers of the present are in the table that follows.";
const LATE = 0.021; // s between two frames, from which on the machine is behind
const WEIGHT = 0.05; // of the last interval
const WORSE = 0.3; // s of lateness, after which one more of some pictures is left out
const BETTER = 4; // s in time, after which one less is
const MOST = 5; // of so many frames at least one is drawn: twelve a second

/** How many pictures of a live robot are left out where the machine cannot draw them all: the robot on it keeps its time. */
export class Thrift {
  every = 1; // of so many frames one is drawn
  #count = 0; // frames since the last that was drawn
  #interval = 0; // s between frames, as it is of late
  #since = 0; // s for which it has been late, or in time where below 0

  /**
   * Take note of a frame.
   * @param {number} elapsed since the last one [s]
   * @returns {boolean} whether it is to be drawn
   */
  draws(elapsed) {
    this.#interval += (elapsed - this.#interval) * WEIGHT;
    this.#since = this.#interval > LATE ? Math.max(0, this.#since) + elapsed : Math.min(0, this.#since) - elapsed;
    if (this.#since > WORSE || this.#since < -BETTER) {
      this.every = Math.min(MOST, Math.max(1, this.every + Math.sign(this.#since)));
      this.#since = 0;
    }
    this.#count += 1;
    if (this.#count < this.every) {
      return false;
    }
    this.#count = 0;
    return true;
  }
}

/** What is drawn, and when. */
export class Scene {
  #clock;
  #readings;
  #meanSpeed;
  #live;
  #ring = null; // of a live robot
  #held;
  #text;

  constructor() {
    this.view = new View();
    this.player = new Player();
    this.marks = new Marks();
    this.transport = new Transport(this.player, () => this.view.change());
    this.motion = null; // what the player plays; null while the robot is live
    this.#clock = document.querySelector("#clock");
    this.#readings = new Readings();
    this.#meanSpeed = new MeanSpeed();
    this.#live = null;
    this.#held = Number.NaN; // instant that somebody asked to see
    for (const name of ["forces", "traces"]) {
      document.querySelector(`#${name}`).addEventListener("change", (event) => {
        this.view[name] = event.target.checked;
        this.view.change();
      });
    }
    const kind = document.querySelector("#kind");
    kind.addEventListener("change", () => {
      this.view.portraits = kind.value === "portraits";
      document.querySelector("#charts").setAttribute("aria-label", `${kind.selectedOptions[0].text}; ${TABLE}`);
      this.view.change();
    });
    explain((on) => {
      this.view.names = on;
      this.view.change();
    });
    scrub(document.querySelector("#charts"), this);
    globalThis.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.marks.draw());
    globalThis.vibro = {drawn: () => this.view.drawn(), show: (time) => this.show(time)};
  }

  /**
   * Play a motion.
   * @param {object} motion
   * @param {object} impacts of the same time
   */
  play(motion, impacts) {
    this.motion = motion;
    this.#load(motion, impacts, true);
    this.transport.load(motion, impacts);
    this.marks.load(motion, impacts);
  }

  /**
   * Follow a live robot.
   * @param {object} ring its samples
   * @param {object} impacts its impacts
   * @param {object} clock which instant to draw
   */
  follow(ring, impacts, clock) {
    this.motion = null;
    this.#live = clock;
    this.#ring = ring;
    this.#held = Number.NaN;
    this.#load(ring, impacts, false);
    this.transport.enable(false);
    this.marks.load(null, impacts);
  }

  #load(source, impacts, ahead) {
    this.view.load(source, impacts, ahead);
    this.#readings.load(source);
  }

  /** Begin; never ends. */
  run() {
    const thrift = new Thrift();
    let before = performance.now();
    const frame = (now) => {
      const elapsed = Math.min(LONGEST, Math.max(0, (now - before) / 1e3));
      before = now;
      this.#advance(elapsed);
      const due = thrift.draws(elapsed);
      if (this.motion) {
        this.#draw(now, Math.min(2, thrift.every));
      } else if (due) {
        this.#draw(now, Math.max(1, Math.round(LIVE_CHARTS / thrift.every)));
      }
      requestAnimationFrame(frame);
    };
    requestAnimationFrame(frame);
  }

  /**
   * Draw an instant and stay there.
   * @param {number} time [s]
   * @returns {{time: number, quantities: object}} what was drawn
   */
  show(time) {
    if (this.motion) {
      this.player.seek(time);
    } else {
      this.#held = time;
    }
    this.view.change();
    this.#draw(performance.now(), 1);
    return this.view.drawn();
  }

  #advance(elapsed) {
    if (this.motion) {
      this.player.advance(elapsed);
    } else if (this.#live) {
      this.#live.advance(elapsed);
    }
  }

  get #time() {
    if (this.motion) {
      return this.player.time;
    }
    return Number.isNaN(this.#held) ? this.#live?.time ?? Number.NaN : this.#held;
  }

  get #pace() {
    return this.motion ? {speed: this.player.speed, window: this.player.window} : {speed: 1, window: LIVE_WINDOW};
  }

  #draw(now, every) {
    const pace = this.#pace;
    this.view.draw(this.#time, pace, every);
    this.view.describe(now);
    this.transport.show();
    if (this.motion) {
      sayExactness(this.motion.exactAt(this.player.time), this.motion.header.why);
    }
    this.#readings.show(this.view.values, now);
    this.#meanSpeed.show(this.#ring ?? this.view.source, this.#time, now);
    const text = `${fixed(this.view.values.time, clockDecimals(pace.speed))} s`;
    if (text !== this.#text && Number.isFinite(this.view.values.time)) {
      this.#text = text;
      this.#clock.textContent = text;
    }
  }
}
