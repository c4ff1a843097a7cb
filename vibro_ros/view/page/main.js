/** The page begins: a recording, which stands in the page, or a live robot. */

import {Impacts} from "vibro/impacts.js";
import {startLive} from "vibro/live.js";
import {Motion} from "vibro/motion.js";
import {Page} from "vibro/page.js";
import {note, say} from "vibro/text.js";

const setting = json("setting");
document.body.dataset.mode = setting.mode;
document.title = setting.title;
document.querySelector("#title").textContent = setting.title;

try {
  if (setting.mode === "bag") {
    showBag(json("motion-header"), await bytes("motion-payload"));
  } else {
    startLive(setting);
  }
} catch (error) {
  say("error", String(error.message ?? error));
  throw error;
}

// Show the recording.
function showBag(header, payload) {
  const motion = new Motion(header, payload);
  const page = new Page();
  page.picture.setMachine(setting.machine);
  page.play(motion, new Impacts(header.impacts.length + 1, header.impacts));
  page.player.playing = !globalThis.matchMedia("(prefers-reduced-motion: reduce)").matches;
  note((setting.notes ?? []).join(" "));
  page.run();
}

// Data of the page that are JSON, by the id of their element.
function json(id) {
  return JSON.parse(document.querySelector(`#${id}`).textContent);
}

// Data of the page that are bytes: deflated, and written in base 64. The element is removed, to free its text.
async function bytes(id) {
  const element = document.querySelector(`#${id}`);
  const packed = Uint8Array.from(atob(element.textContent.trim()), (letter) => letter.codePointAt(0));
  element.remove();
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  return await new Response(stream).arrayBuffer();
}
