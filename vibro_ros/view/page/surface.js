/** A canvas that is as large as the page makes it, with all the pixels that the screen has. */

export class Surface {

  /**
   * @param {HTMLCanvasElement} canvas
   * @param {function(): void} resized is called when the size has changed
   */
  constructor(canvas, resized) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d");
    this.width = 0; // px of the page
    this.height = 0;
    new ResizeObserver((entries) => {
      const box = entries.at(-1).contentRect;
      [this.width, this.height] = [box.width, box.height];
      resized();
    }).observe(canvas);
  }

  /** @returns {CanvasRenderingContext2D} cleared, with the page's pixel as its unit */
  begin() {
    const ratio = globalThis.devicePixelRatio || 1;
    const [width, height] = [Math.round(this.width * ratio), Math.round(this.height * ratio)];
    if (this.canvas.width !== width || this.canvas.height !== height) {
      this.canvas.width = width;
      this.canvas.height = height;
    }
    this.context.setTransform(ratio, 0, 0, ratio, 0, 0);
    this.context.clearRect(0, 0, this.width, this.height);
    return this.context;
  }
}
