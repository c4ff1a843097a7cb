/** What is seen at an instant: reads a source, draws mechanism and charts, and says in words what it shows. */

import {Charts} from "vibro/charts.js";
import {Impacts} from "vibro/impacts.js";
import {drawForces, drawNames, drawPush, drawTraces} from "vibro/annotations.js";
import {drawMechanism} from "vibro/mechanism.js";
import {Portraits} from "vibro/portraits.js";
import {Stage} from "vibro/stage.js";
import {Surface, followTheme, font, theme} from "vibro/surface.js";
import {bodyState, stateWords} from "vibro/said.js";
import {fixed} from "vibro/ticks.js";

const FADE = 0.05; // s of watching, in which a flash fades
const FAST = 0.5; // robot time over time on the wall, from which on peak forces would only flicker
const TRACE = 1; // s, the longest trace
const WORDS = 1000; // ms between two descriptions in words

export class View {
  #stage;
  #charts;
  #portraits;
  #changed;
  #spoken;
  #lit;
  #skipped = 0; // pictures since the last that had charts
  #words;
  #picture;
  #strips;
  #time;

  constructor() {
    this.values = {time: Number.NaN};
    this.impacts = new Impacts(1);
    this.forces = false;
    this.traces = false;
    this.names = false;
    this.portraits = false; // in place of the strip charts
    this.source = null;
    this.#stage = null;
    this.#charts = new Charts();
    this.#portraits = new Portraits();
    this.#changed = true;
    this.#spoken = 0;
    this.#lit = {};
    const change = () => this.change();
    this.#picture = new Surface(document.querySelector("#mechanism"), change);
    this.#strips = new Surface(document.querySelector("#charts"), change);
    followTheme(change);
  }

  /** Draw at the next occasion, though the instant is the same. */
  change() {
    this.#changed = true;
  }

  /**
   * Show another machine.
   * @param {object} machine as the setting describes it
   */
  setMachine(machine) {
    this.#stage = new Stage(machine);
    document.querySelector("#air").hidden = !machine.hops;
    this.change();
  }

  /**
   * Show another source.
   * @param {object | null} source a `Ring` or a `Motion`
   * @param {Impacts} impacts of the same time
   * @param {boolean} ahead whether what comes is known
   */
  load(source, impacts, ahead) {
    this.source = source;
    this.impacts = impacts;
    if (source) {
      this.#charts.load(source, ahead);
      this.#portraits.load(source, ahead, this.#stage.machine.hops);
    }
    this.values = {time: Number.NaN};
    this.change();
  }

  /**
   * Draw an instant, if anything has changed.
   * @param {number} time [s]
   * @param {{speed: number, window: number}} pace robot time over time on the wall; what the charts show of it [s]
   * @param {number} every of how many pictures one has charts: dense curves cost ten times what the mechanism does
   */
  draw(time, pace, every) {
    if (!this.source || !this.#stage || !Number.isFinite(time)) {
      return;
    }
    const before = this.values.time;
    this.source.read(time, this.values);
    if (this.values.time === before && !this.#changed && time === this.#time) {
      return;
    }
    const skip = this.#skipped + 1 < every;
    this.#skipped = skip ? this.#skipped + 1 : 0;
    this.#changed = skip;
    this.#time = time;
    this.#lit = this.#lights(this.values.time, pace.speed);
    this.#drawPicture(this.#lit, Math.min(TRACE, pace.window));
    if (!skip) {
      (this.portraits ? this.#portraits : this.#charts)
        .draw(this.#strips, time, pace.window, this.values, this.impacts);
    }
  }

  #lights(time, speed) {
    const lights = {};
    const told = speed < FAST;
    for (const {side} of this.#stage.machine.guides) {
      const light = this.impacts.light(side, time, FADE * speed);
      if (light.impact) {
        light.glow *= 0.4 + 0.6 * Math.sqrt((light.impact.peak_force ?? this.impacts.greatest) / this.impacts.greatest);
      }
      lights[side] = {...light, told};
    }
    return lights;
  }

  #drawPicture(lights, window) {
    const context = this.#picture.begin();
    const {width, height} = this.#picture;
    this.#stage.fit(width, height, this.values);
    this.#stage.tilt(context);
    this.#stage.drawGround(context);
    drawMechanism(context, this.#stage, this.values, lights);
    this.#stage.drawHeight(context, this.values);
    if (this.traces) {
      drawTraces(context, this.#stage, this.source, this.#time, window);
    }
    if (this.names) {
      drawNames(context, this.#stage, this.values);
    }
    if (this.forces) {
      drawForces(context, this.#stage, this.values);
    }
    drawPush(context, this.#stage, this.source.pushAt?.(this.values.time));
    context.restore();
    const {slope} = this.#stage.machine;
    const words = [bodyState(this.values), slope && `slope of ${fixed(slope * 180 / Math.PI, 1)}°`,
      this.forces && "arrows: logarithm of the force"];
    context.font = font(12);
    context.fillStyle = theme.soft;
    context.textAlign = "left";
    context.textBaseline = "top";
    for (const [number, line] of words.filter(Boolean).entries()) {
      context.fillText(line, 12, 10 + 18 * number);
    }
  }

  /**
   * Say in words what the picture shows, once a second.
   * @param {number} now time on the wall [ms]
   */
  describe(now) {
    if (now - this.#spoken < WORDS) {
      return;
    }
    this.#spoken = now;
    const struck = Object.keys(this.#lit).filter((side) => this.#lit[side].glow > 0.2);
    const words = stateWords(this.values, struck);
    if (words !== this.#words) {
      this.#words = words;
      this.#picture.canvas.setAttribute("aria-label", words);
    }
  }

  /**
   * @param {number} x place on the charts' canvas [px]
   * @returns {number} the instant that is drawn there [s]; NaN where charts have no axis of time
   */
  timeAt(x) {
    return this.portraits ? Number.NaN : this.#charts.timeAt(x);
  }

  /** @returns {{time: number, quantities: object}} what the last picture shows */
  drawn() {
    const {time, ...quantities} = this.values;
    return {time, quantities};
  }
}
