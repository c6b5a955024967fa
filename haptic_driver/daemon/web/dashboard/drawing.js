// What the pictures share: a canvas made ready, axes, words.

import { SCALE, theme } from "./palette.js";

const FONT = "12px system-ui, 'DejaVu Sans', sans-serif";

// A clean picture as large as a canvas is shown, or as said, with a pen in its pixels; the canvas
// gets it once all of it is drawn.
// A canvas that is drawn on itself is composed anew in every frame of the page, also while nothing
// is drawn.
export function begin(canvas, width = canvas.clientWidth, height = canvas.clientHeight) {
  const ratio = window.devicePixelRatio || 1;
  const picture = new OffscreenCanvas(
    Math.max(Math.round(width * ratio), 1),
    Math.max(Math.round(height * ratio), 1),
  );
  queueMicrotask(() =>
    canvas.getContext("bitmaprenderer").transferFromImageBitmap(picture.transferToImageBitmap()),
  );
  const pen = picture.getContext("2d");
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.font = FONT;
  pen.lineJoin = pen.lineCap = "round";
  return { pen, width, height };
}

// Round numbers from low to high, at most so many steps.
export function steps(low, high, most) {
  const rough = (high - low) / Math.max(most, 1),
    power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((f) => f * power).find((s) => s >= rough * (1 - 1e-9));
  const found = [];
  for (let i = Math.ceil(low / step - 1e-9); i * step <= high + 1e-9 * step; i++)
    found.push(Number((i * step).toPrecision(6)));
  return found;
}

export function text(
  pen,
  words,
  x,
  y,
  { align = "center", base = "middle", fill = theme.soft } = {},
) {
  pen.fillStyle = fill;
  pen.textAlign = align;
  pen.textBaseline = base;
  pen.fillText(words, x, y);
}

export function upright(pen, words, x, y) {
  pen.save();
  pen.translate(x, y);
  pen.rotate(-Math.PI / 2);
  text(pen, words, 0, 0);
  pen.restore();
}

// Words on a plate of their own, kept between left and right.
export function tag(pen, words, x, y, left, right) {
  const w = pen.measureText(words).width + 10,
    at = Math.max(Math.min(x, right - w), left);
  pen.fillStyle = theme.panel;
  pen.fillRect(at, y - 9, w, 18);
  text(pen, words, at + 5, y, { align: "left", fill: theme.ink });
}

// The scale of friction from `range` at the right of a picture.
export function scaleBar(pen, range, x, top, bottom) {
  for (let y = Math.round(top); y < bottom; y++) {
    pen.fillStyle = `rgb(${SCALE[Math.round((255 * (bottom - 1 - y)) / Math.max(bottom - top - 1, 1))] ?? SCALE[0]})`;
    pen.fillRect(x, y, 10, 1);
  }
  text(pen, range[1].toFixed(2), x + 14, top + 6, { align: "left" });
  text(pen, range[0].toFixed(2), x + 14, bottom - 6, { align: "left" });
  upright(pen, "friction", x + 21, (top + bottom) / 2);
}

// A line between points that may be null, which end it.
export function line(pen, points, { colour, width = 1.6, dash = [] }) {
  pen.strokeStyle = colour;
  pen.lineWidth = width;
  pen.setLineDash(dash);
  pen.beginPath();
  let on = false;
  for (const point of points) {
    if (point === null) {
      on = false;
      continue;
    }
    if (on) pen.lineTo(...point);
    else pen.moveTo(...point);
    on = true;
  }
  pen.stroke();
  pen.setLineDash([]);
}

// A marker seen on any colour: dark, light, dark.
export function ring(pen, x, y, radius, fill) {
  pen.beginPath();
  pen.arc(x, y, radius, 0, 7);
  if (fill) {
    pen.fillStyle = fill;
    pen.fill();
  }
  for (const [colour, width] of [
    ["#000", 5],
    ["#fff", 2.5],
  ]) {
    pen.strokeStyle = colour;
    pen.lineWidth = width;
    pen.stroke();
  }
}
