/** Colours and fonts of the canvases: the custom properties of the style sheet, in light and in dark. */

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
