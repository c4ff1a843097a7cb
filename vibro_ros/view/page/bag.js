/** The page of a recording: its motion stands in the page, and nothing else is needed. */

import {bytes, json} from "vibro/data.js";
import {Impacts} from "vibro/impacts.js";
import {Motion} from "vibro/motion.js";
import {note} from "vibro/said.js";
import {Scene} from "vibro/scene.js";

/**
 * Show the recording.
 * @param {object} setting of the page
 */
export async function startBag(setting) {
  const header = json("motion-header");
  const motion = new Motion(header, await bytes("motion-payload"));
  const scene = new Scene();
  scene.view.setMachine(setting.machine);
  scene.play(motion, new Impacts(header.impacts.length + 1, header.impacts));
  scene.player.playing = !globalThis.matchMedia("(prefers-reduced-motion: reduce)").matches;
  note((setting.notes ?? []).join(" "));
  scene.run();
}
