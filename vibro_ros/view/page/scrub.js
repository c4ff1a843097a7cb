/** The charts as a time line: a click goes to an instant, dragging moves the curves. */

const CLICK = 4; // px that a pointer may move within a click

/**
 * Let a pointer choose the instant on the charts, while a motion is played.
 * @param {HTMLCanvasElement} canvas of the charts
 * @param {object} scene whose player and view are meant
 */
export function scrub(canvas, scene) {
  let grip = null; // where the pointer went down
  canvas.addEventListener("pointerdown", (event) => {
    if (scene.motion && event.button === 0) {
      const [at, edge] = [scene.view.timeAt(event.offsetX), scene.view.timeAt(event.offsetX + 1)];
      grip = {x: event.offsetX, time: scene.player.time, at, pace: edge - at, moved: false};
      canvas.setPointerCapture(event.pointerId);
    }
  });
  canvas.addEventListener("pointermove", (event) => {
    if (grip && scene.motion) {
      const way = event.offsetX - grip.x;
      grip.moved ||= Math.abs(way) > CLICK;
      if (grip.moved) {
        scene.player.seek(grip.time - way * grip.pace);
      }
    }
  });
  canvas.addEventListener("pointerup", () => {
    if (grip && !grip.moved && scene.motion) {
      scene.player.seek(grip.at);
    }
    grip = null;
  });
  canvas.addEventListener("pointercancel", () => {
    grip = null;
  });
}
