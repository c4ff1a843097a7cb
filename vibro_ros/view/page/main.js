/** The page begins: a recording or a live robot. */

import {startBag} from "vibro/bag.js";
import {json} from "vibro/data.js";
import {startLive} from "vibro/live.js";
import {say} from "vibro/said.js";

const setting = json("setting");
document.body.dataset.mode = setting.mode;
document.title = setting.title;
document.querySelector("#title").textContent = setting.title;

try {
  await (setting.mode === "bag" ? startBag(setting) : startLive());
} catch (error) {
  say("error", String(error.message ?? error));
  throw error;
}
