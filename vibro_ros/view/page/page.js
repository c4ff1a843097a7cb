/** What the page shows: the loop that goes on in time, and the picture of an instant. */

import {Charts, Readings} from "vibro/charts.js";
import {Impacts} from "vibro/impacts.js";
import {Stage, drawMechanism} from "vibro/mechanism.js";
import {drawForces, drawNames, drawPush} from "vibro/overlays.js";
import {Portraits} from "vibro/portraits.js";
import {MeanSpeed} from "vibro/speed.js";
import {Surface, bodyState, clockDecimals, explain, fixed, followTheme, font, sayExactness, theme} from "vibro/text.js";
import {Marks, Player, Transport, scrub} from "vibro/transport.js";

const LONGEST = 0.1; // s between two pictures; a page that was hidden goes on where it was
const LIVE = {speed: 1, window: 6, charts: 100}; // pace of a live robot, whose page takes little from the robot
const TABLE = "the numbers of the present are in the table that follows.";
const FADE = 0.05; // s of watching, in which a flash fades
const FAST = 0.5; // robot time over time on the wall, from which on peak forces would only flicker

/** What is drawn, and when. */
export class Page {
  // oxlint-disable-next-line no-use-before-define -- a field is made with the first Page, when all classes are there
  picture = new Picture();
  player = new Player();
  marks = new Marks();
  transport = new Transport(this.player, () => this.picture.change());
  /** What the player plays; null while the robot is live. */
  motion = null;
  #clock = document.querySelector("#clock");
  #readings = new Readings();
  #meanSpeed = new MeanSpeed();
  #samples = null; // of a live robot
  #held = Number.NaN; // instant that somebody asked to see
  #text;

  constructor() {
    document.querySelector("#forces").addEventListener("change", (event) => {
      this.picture.forces = event.target.checked;
      this.picture.change();
    });
    const kind = document.querySelector("#kind");
    kind.addEventListener("change", () => {
      this.picture.portraits = kind.value === "portraits";
      document.querySelector("#charts").setAttribute("aria-label", `${kind.selectedOptions[0].text}; ${TABLE}`);
      this.picture.change();
    });
    explain((on) => {
      this.picture.names = on;
      this.picture.change();
    });
    scrub(document.querySelector("#charts"), this);
    globalThis.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.marks.draw());
    globalThis.vibro = {drawn: () => this.picture.drawn(), show: (time) => this.show(time)};
  }

  /** Play a `Motion`, with the impacts of the same time. */
  play(motion, impacts) {
    this.motion = motion;
    this.#load(motion, impacts, true);
    this.transport.load(motion, impacts);
    this.marks.load(motion, impacts);
  }

  /** Follow a live robot: draw the newest of its samples, a `SampleBuffer`, and its impacts. */
  follow(samples, impacts) {
    this.motion = null;
    this.#samples = samples;
    this.#held = Number.NaN;
    this.#load(samples, impacts, false);
    this.transport.enable(false);
    this.marks.load(null, impacts);
  }

  #load(source, impacts, ahead) {
    this.picture.load(source, impacts, ahead);
    this.#readings.load(source);
  }

  /** Begin; never ends. */
  run() {
    let before = performance.now();
    const frame = (now) => {
      if (this.motion) {
        this.player.advance(Math.min(LONGEST, Math.max(0, (now - before) / 1e3)));
      }
      before = now;
      this.#draw(now);
      requestAnimationFrame(frame);
    };
    requestAnimationFrame(frame);
  }

  /** Draw the instant `time` [s], stay there, and return what was drawn. */
  show(time) {
    if (this.motion) {
      this.player.seek(time);
    } else {
      this.#held = time;
    }
    this.picture.change();
    this.#draw(performance.now());
    return this.picture.drawn();
  }

  get #time() {
    if (this.motion) {
      return this.player.time;
    }
    return Number.isNaN(this.#held) ? this.#samples?.end ?? Number.NaN : this.#held;
  }

  #draw(now) {
    const pace = this.motion ? {speed: this.player.speed, window: this.player.window, charts: 0} : LIVE;
    this.picture.draw(this.#time, pace, now);
    this.transport.show();
    if (this.motion) {
      sayExactness(this.motion.exactAt(this.player.time), this.motion.header.why);
    }
    const {values} = this.picture;
    this.#readings.show(values, now);
    this.#meanSpeed.show(this.#samples ?? this.motion, this.#time, now);
    const text = `${fixed(values.time, clockDecimals(pace.speed))} s`;
    if (text !== this.#text && Number.isFinite(values.time)) {
      this.#text = text;
      this.#clock.textContent = text;
    }
  }
}

/** What is seen at an instant: mechanism and charts. */
class Picture {
  values = {time: Number.NaN};
  impacts = new Impacts(1);
  forces = false;
  names = false;
  /** Whether phase portraits take the place of the strip charts. */
  portraits = false;
  source = null;
  #stage = null;
  #charts = new Charts();
  #portraits = new Portraits();
  #changed = true;
  #time = Number.NaN; // of the drawing [s]
  #chartTime = Number.NaN; // of the charts [s]
  #charted = -Infinity; // when the charts were drawn last [ms]
  #drawing;
  #plot;

  constructor() {
    const change = () => this.change();
    this.#drawing = new Surface(document.querySelector("#mechanism"), change);
    this.#plot = new Surface(document.querySelector("#charts"), change);
    followTheme(change);
  }

  /** Draw at the next occasion, though the instant is the same. */
  change() {
    this.#changed = true;
  }

  /** Show another machine, as the setting describes it. */
  setMachine(machine) {
    this.#stage = new Stage(machine);
    document.querySelector("#air").hidden = !machine.hops;
    this.change();
  }

  /** Show another source, a `SampleBuffer` or a `Motion`; `ahead` says whether what comes is known. */
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
   * @param {{speed: number, window: number, charts: number}} pace robot time over time on the wall; what the charts show
   *     of it [s]; how long charts stay [ms], because dense curves cost ten times what the mechanism does
   */
  draw(time, pace, now) {
    if (!this.source || !this.#stage || !Number.isFinite(time)) {
      return;
    }
    const changed = this.#changed;
    this.#changed = false;
    if (changed || time !== this.#time) {
      this.#time = time;
      this.source.read(time, this.values);
      this.#drawMechanism(this.#lights(this.values.time, pace.speed));
    }
    if (changed || (time !== this.#chartTime && now - this.#charted >= pace.charts)) {
      this.#chartTime = time;
      this.#charted = now;
      const charts = this.portraits ? this.#portraits : this.#charts;
      charts.draw(this.#plot, time, pace.window, this.values, this.impacts);
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

  #drawMechanism(lights) {
    const context = this.#drawing.begin();
    const {width, height} = this.#drawing;
    this.#stage.fit(width, height, this.values);
    this.#stage.tilt(context);
    this.#stage.drawGround(context);
    drawMechanism(context, this.#stage, this.values, lights);
    this.#stage.drawHeight(context, this.values);
    if (this.names) { // in place of forces, whose numbers would lie on the names
      drawNames(context, this.#stage, this.values);
    } else if (this.forces) {
      drawForces(context, this.#stage, this.values);
    }
    drawPush(context, this.#stage, this.source.pushAt?.(this.values.time));
    context.restore();
    const {slope} = this.#stage.machine;
    const words = [bodyState(this.values), slope && `slope of ${fixed(slope * 180 / Math.PI, 1)}°`,
      this.forces && !this.names && "arrows: logarithm of the force"];
    context.font = font(12);
    context.fillStyle = theme.soft;
    context.textAlign = "left";
    context.textBaseline = "top";
    for (const [number, line] of words.filter(Boolean).entries()) {
      context.fillText(line, 12, 10 + 18 * number);
    }
  }

  /** The instant [s] that the charts have at `x` [px]; NaN where they have no axis of time. */
  timeAt(x) {
    return this.portraits ? Number.NaN : this.#charts.timeAt(x);
  }

  /** What the last picture shows: {time [s], quantities by name}. */
  drawn() {
    const {time, ...quantities} = this.values;
    return {time, quantities};
  }
}
