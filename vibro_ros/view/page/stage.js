/** What the mechanism stands on: the scale of the picture, the ground that moves by, the height of a hop. */

import {SLED, bounds} from "vibro/geometry.js";
import {fixed} from "vibro/ticks.js";
import {font, theme} from "vibro/surface.js";

const MARGIN = 14; // px, beside the mechanism
const BELOW = 40; // px, for the ground's marks and the force from below
const ABOVE = 44; // px, for the state in words and what may be drawn
const LEAST_HOP = 1e-4; // m that is marked
const HEIGHT_ROOM = 60; // px, beside the sled, for the height of a hop
const FROM_SLED = 0.006; // m from the sled to that measure
const MARKS = 0.01; // m from mark to mark

export class Stage {
  /** @param {object} machine as the setting describes it */
  constructor(machine) {
    this.machine = machine;
    this.box = bounds(machine);
  }

  /**
   * Fit the mechanism into the canvas. The body stands still in the picture and the ground moves by.
   * @param {number} width [px]
   * @param {number} height [px]
   * @param {object} values quantities by name
   */
  fit(width, height, values) {
    const {box} = this;
    this.width = width;
    this.height = height;
    const [along, up] = [box.right - box.left, box.top - box.bottom]; // m
    const [cos, sin] = [Math.cos(this.machine.slope), Math.abs(Math.sin(this.machine.slope))];
    const ahead = this.machine.hops ? HEIGHT_ROOM : 0; // px
    const [beside, over] = [2 * MARGIN + ahead, BELOW + ABOVE]; // px
    const wide = (width - beside * cos - over * sin) / (along * cos + up * sin);
    const high = (height - beside * sin - over * cos) / (along * sin + up * cos);
    this.scale = Math.max(1, Math.min(wide, high)); // px/m
    this.middle = (width - ahead) / 2 - this.scale * (box.left + box.right) / 2; // px, where the crank's centre is
    this.body = values.body_position || 0;
    const lift = values.body_height || 0;
    const most = Math.max(0.02, 0.25 * up);
    const boxHeight = this.scale * up + over;
    const tilted = (this.scale * along + beside) * sin + boxHeight * cos; // px, its height on the slope
    this.ground = height - BELOW - (tilted - boxHeight) / 2;
    this.pivot = this.ground + BELOW - boxHeight / 2; // px, the height of the box's middle, about which it is tilted
    this.ground += this.scale * Math.max(0, lift - most); // the ground sinks below one that flies high
    this.reach = height * sin; // px, by which a tilted ground is longer to either side
    this.depth = height - this.ground + width * sin; // px, to where the last corner is filled
    this.hub = this.ground - this.scale * (this.machine.hub_height + lift);
    this.sole = this.ground - this.scale * lift;
  }

  /**
   * Have a context draw in pixels along the ground and across it; on a slope x points uphill, and down is down.
   * @param {CanvasRenderingContext2D} context
   */
  tilt(context) {
    context.save();
    context.translate(this.width / 2, this.pivot);
    context.rotate(-this.machine.slope);
    context.translate(-this.width / 2, -this.pivot);
  }

  /**
   * Have a context draw in metres from the crank's centre, x to the right and z up.
   * @param {CanvasRenderingContext2D} context
   */
  enter(context) {
    context.save();
    context.translate(this.middle, this.hub);
    context.scale(this.scale, -this.scale);
  }

  /**
   * A point of a guide's frame on the canvas.
   * @param {number} angle of the guide [rad]
   * @param {number} across [m], to the right when the guide is upright
   * @param {number} along [m], outwards
   * @returns {number[]} x, y [px]
   */
  point(angle, across, along) {
    const x = across * Math.cos(angle) - along * Math.sin(angle);
    const z = across * Math.sin(angle) + along * Math.cos(angle);
    return [this.middle + this.scale * x, this.hub - this.scale * z];
  }

  /** @param {CanvasRenderingContext2D} context */
  drawGround(context) {
    const {ground, width, scale, reach} = this;
    context.fillStyle = theme.ground;
    context.fillRect(-reach, ground, width + 2 * reach, this.depth);
    context.strokeStyle = theme.ink;
    context.lineWidth = 1.25;
    line(context, -reach, ground, width + reach, ground);
    const labelled = 150 / scale > 0.1 ? 0.1 : 0.05; // m
    const left = this.body - (this.middle + reach) / scale;
    const right = left + (width + 2 * reach) / scale;
    context.font = font(11);
    context.textAlign = "center";
    context.textBaseline = "top";
    context.lineWidth = 1;
    for (let mark = Math.floor((left - labelled) / MARKS); mark * MARKS <= right + labelled; mark += 1) {
      const x = this.middle + scale * (mark * MARKS - this.body);
      const long = mark % Math.round(labelled / MARKS) === 0;
      context.strokeStyle = long ? theme.soft : theme.faint;
      line(context, x, ground, x, ground + (long ? 8 : 4));
      if (long) {
        const text = `${fixed(mark * MARKS * 1e3, 0)} mm`;
        const half = context.measureText(text).width / 2 + 4;
        context.fillStyle = theme.soft;
        context.fillText(x > half - reach && x < width + reach - half ? text : "", x, ground + 11);
      }
    }
  }

  /**
   * The height of a hop, as a measure beside the sled.
   * @param {CanvasRenderingContext2D} context
   * @param {object} values quantities by name
   */
  drawHeight(context, values) {
    if (!(values.body_height > LEAST_HOP)) {
      return;
    }
    const x = this.middle + this.scale * (SLED.front + SLED.overhang + FROM_SLED);
    context.strokeStyle = theme.soft;
    context.fillStyle = theme.soft;
    context.lineWidth = 1;
    line(context, x - 4, this.sole, x + 4, this.sole);
    line(context, x, this.sole, x, this.ground);
    context.font = font(11);
    context.textAlign = "left";
    context.textBaseline = "middle";
    context.fillText(`${fixed(values.body_height * 1e3, 1)} mm`, x + 7, (this.sole + this.ground) / 2 - 6);
  }
}

/**
 * A straight line.
 * @param {CanvasRenderingContext2D} context
 * @param {number} x
 * @param {number} y
 * @param {number} toX
 * @param {number} toY
 */
export function line(context, x, y, toX, toY) {
  context.beginPath();
  context.moveTo(x, y);
  context.lineTo(toX, toY);
  context.stroke();
}
