// Pictures of textures in tiles that the daemon makes, as fine as the screen shows them; kept while
// they may be needed.

import { Refusal, ask } from "./connection.js";
import { SCALE } from "./palette.js";

export const TILE = 256; // cells per side
const MOST_KEPT = 200;
const AGAIN_MS = 300,
  SELDOM_MS = 5000; // between attempts: longer and longer
const MOST_ATTEMPTS = 8;
// the daemon draws for somebody else, or its machine is busy
const PASSING = ["loading", "no_answer", "too_much"];

// The canvas of what `GET /tile` answered: a pixel per cell, clear where nothing is asked for.
function pictureOf({ columns, rows, levels }) {
  const canvas = document.createElement("canvas");
  canvas.width = columns;
  canvas.height = rows;
  const pen = canvas.getContext("2d"),
    image = pen.createImageData(columns, rows),
    bytes = atob(levels);
  for (let i = 0; i < bytes.length; i++) {
    const level = bytes.charCodeAt(i);
    if (level === 0) continue;
    const [r, g, b] = SCALE[Math.round(((level - 1) * 255) / 254)];
    image.data[4 * i] = r;
    image.data[4 * i + 1] = g;
    image.data[4 * i + 2] = b;
    image.data[4 * i + 3] = 255;
  }
  pen.putImageData(image, 0, 0);
  return canvas;
}

let queue = Promise.resolve(); // the daemon draws one at a time

// One picture of any size, as soon as it can be had. Throws Refusal.
export function fetchTile(...what) {
  const tile = queue.then(() => fetchNow(...what));
  queue = tile.catch(() => {});
  return tile;
}

async function fetchNow(name, x_m, y_m, pitch_m, columns, rows) {
  const query = new URLSearchParams({ name, x_m, y_m, pitch_m, columns, rows });
  for (let attempt = 1; ; attempt++) {
    try {
      const tile = await ask("GET", `/tile?${query}`);
      return { picture: pictureOf(tile), range: [tile.cof_low, tile.cof_high], x_m, y_m, pitch_m };
    } catch (error) {
      if (!(error instanceof Refusal) || !PASSING.includes(error.code) || attempt === MOST_ATTEMPTS)
        throw error;
      await new Promise((resolve) =>
        setTimeout(resolve, Math.min(AGAIN_MS * 2 ** attempt, SELDOM_MS)),
      );
    }
  }
}

// The tiles of one texture. `arrived` is called when there is another; `failed` once, when there
// will be none.
export class Tiles {
  range = null;

  constructor(name, arrived, failed) {
    Object.assign(this, { name, arrived, failed });
    this.kept = new Map();
    this.wanted = [];
    this.busy = this.over = false;
  }

  // Have tiles at this pitch fetched where they are missing, of the part of the plane from (x0, y0)
  // to (x1, y1).
  want(pitch_m, x0, y0, x1, y1) {
    const side_m = TILE * pitch_m;
    this.wanted = [];
    for (let j = Math.floor(y0 / side_m); j * side_m < y1; j++)
      for (let i = Math.floor(x0 / side_m); i * side_m < x1; i++)
        if (!this.kept.has(`${pitch_m} ${i} ${j}`)) this.wanted.push({ pitch_m, i, j });
    this.fetch();
  }

  // Those that are there, coarse ones first.
  all() {
    return [...this.kept.values()].sort((a, b) => b.pitch_m - a.pitch_m);
  }

  stop() {
    this.over = true;
  }

  async fetch() {
    if (this.busy) return;
    this.busy = true;
    try {
      while (this.wanted.length && !this.over) {
        const { pitch_m, i, j } = this.wanted.shift();
        const tile = await fetchTile(
          this.name,
          i * TILE * pitch_m,
          j * TILE * pitch_m,
          pitch_m,
          TILE,
          TILE,
        );
        this.kept.set(`${pitch_m} ${i} ${j}`, tile);
        if (this.kept.size > MOST_KEPT) this.kept.delete(this.kept.keys().next().value);
        this.range = tile.range;
        if (!this.over) this.arrived();
      }
    } catch (error) {
      if (!(error instanceof Refusal)) throw error;
      if (!this.over) this.failed(error);
    }
    this.busy = false;
  }
}
