// Colours: those of the page's theme, as canvases need them, and the scale of friction.

const NAMES = [
  "ink",
  "soft",
  "line",
  "edge",
  "panel",
  "nothing",
  "blue",
  "orange",
  "grey",
  "red",
  "five",
  "reach",
  "gap",
];
// From dark to light in even steps of lightness (viridis), so that it reads without colour too.
const STOPS = [
  [68, 1, 84],
  [65, 68, 135],
  [42, 120, 142],
  [34, 168, 132],
  [122, 209, 81],
  [253, 231, 37],
];

export const theme = {};
export const SCALE = Array.from({ length: 256 }, (_, level) => {
  const at = (level / 255) * (STOPS.length - 1),
    i = Math.min(Math.floor(at), STOPS.length - 2);
  return STOPS[i].map((low, k) => Math.round(low + (STOPS[i + 1][k] - low) * (at - i)));
});

// The theme as it is now; canvases do not know `light-dark()`.
export function readTheme() {
  const probe = document.createElement("span");
  document.body.append(probe);
  for (const name of NAMES) {
    probe.style.color = `var(--${name})`;
    theme[name] = getComputedStyle(probe).color;
  }
  probe.remove();
}

// The place of a friction on the scale, 0 to 255.
export const levelOf = (cof, [low, high]) =>
  Math.round(255 * Math.min(Math.max(high > low ? (cof - low) / (high - low) : 0.5, 0), 1));

export const colourOf = (cof, range) => `rgb(${SCALE[levelOf(cof, range)]})`;
