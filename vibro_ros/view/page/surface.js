/** The canvases: their size in pixels of the screen, and colours and fonts of the style sheet, in light and in dark. */

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

const NAMES = ["ink", "soft", "faint", "line", "panel", "upper", "inclined", "metal", "body", "edge", "dark", "flash",
  "force", "ground", "accent"];

/** Colours by name; read again when the reader changes between light and dark. */
export const theme = {};

/**
 * Read the colours from the style sheet, now and at each change.
 * @param {function(): void} changed is called after each change
 */
export function followTheme(changed) {
  const read = () => {
    const style = getComputedStyle(document.documentElement);
    for (const name of NAMES) {
      theme[name] = style.getPropertyValue(`--${name}`).trim();
    }
    theme.font = style.getPropertyValue("--font").trim();
    changed();
  };
  read();
  globalThis.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", read);
}

/**
 * A font of the canvases.
 * @param {number} size [px]
 * @param {string} weight
 * @returns {string}
 */
export function font(size, weight = "400") {
  return `${weight} ${size}px ${theme.font}`;
}
