// Friction over time, with strips of normal force, voltage and current below.

import { begin, line, steps, tag, text, upright } from "./drawing.js";
import { theme } from "./palette.js";

const LEFT = 58,
  RIGHT = 8,
  AXIS = 20;
const STRIPS = [
  ["force", "force, N"],
  ["voltage", "voltage, V"],
  ["current", "current, µA"],
];
const STRIP_SHARE = 0.13; // of the height, each
const LEAST_STEPS = 3; // of friction: one number alone is no scale
const OUTLIERS = 0.01; // of the buckets at each end, which do not rule the scale

// `shown`: {periodS, buckets, nowS, wallS}; newest at the right, at `nowS`.
// `wallS`: what to add for the time on the wall.
export function drawTimePlot(canvas, shown, spanS) {
  const { nowS, wallS } = shown,
    { pen, width, height } = begin(canvas);
  const x = (t) => width - RIGHT - ((nowS - t) / spanS) * (width - LEFT - RIGHT);
  const strip = Math.max(STRIP_SHARE * height, 26),
    bottom = height - AXIS;
  const friction = { top: 6, bottom: bottom - STRIPS.length * strip - 6 };
  const buckets = shown.buckets.filter((b) => b.time_s >= nowS - spanS);
  const at = { pen, x, width, half: shown.periodS / 2, periodS: shown.periodS };
  drawFriction(at, buckets, friction);
  STRIPS.forEach(([field, name], i) => {
    const top = friction.bottom + 6 + i * strip;
    drawStrip(at, buckets, field, name, { top: top + 4, bottom: top + strip - 2 });
  });
  drawTimes(at, nowS, spanS, wallS, bottom);
}

function drawFriction(at, buckets, { top, bottom }) {
  const { pen, width } = at,
    [y0, y1] = scaleOf(buckets);
  const y = (v) => bottom - ((v - y0) / (y1 - y0)) * (bottom - top);
  pen.save();
  pen.beginPath();
  pen.rect(LEFT, top, width - LEFT - RIGHT, bottom - top);
  pen.clip();
  gaps(at, buckets, top, bottom);
  band(at, buckets, theme.reach, (b) => [b.reachLow.mean, b.reachHigh.mean], y);
  band(
    at,
    buckets,
    theme.five,
    (b) => (b.target.n ? [0.95 * b.target.low, 1.05 * b.target.high] : [null, null]),
    y,
  );
  const labels = steps(y0, y1, Math.max((bottom - top) / 40, LEAST_STEPS));
  grid(at, labels, y);
  pen.globalAlpha = 0.3;
  band(
    at,
    buckets,
    theme.blue,
    (b) => (b.measured.n > 1 ? [b.measured.low, b.measured.high] : [null, null]),
    y,
  );
  pen.globalAlpha = 1;
  const means = (field) => points(at, buckets, (b) => b[field].mean, y);
  line(pen, means("expected"), { colour: theme.grey, width: 1 });
  line(pen, means("measured"), { colour: theme.blue, width: 1.8 });
  line(pen, means("target"), { colour: theme.orange, width: 2, dash: [7, 4] });
  pen.restore();
  for (const v of labels) text(pen, v.toFixed(2), LEFT - 6, y(v), { align: "right" });
  upright(pen, "friction", 9, (top + bottom) / 2);
  pen.strokeStyle = theme.edge;
  pen.lineWidth = 1;
  pen.strokeRect(LEFT + 0.5, top + 0.5, width - LEFT - RIGHT - 1, bottom - top - 1);
  if (!buckets.some((b) => b.target.n || b.measured.n))
    text(
      pen,
      "No friction asked for and no finger sliding",
      (LEFT + width) / 2,
      (top + bottom) / 2,
      { fill: theme.ink },
    );
}

// No measurement is left out, but one outlier does not rule.
function scaleOf(buckets) {
  const targets = buckets.filter((b) => b.target.n),
    felt = buckets.filter((b) => b.measured.n);
  const lows = felt.map((b) => b.measured.low).sort((a, b) => a - b),
    highs = felt.map((b) => b.measured.high).sort((a, b) => a - b);
  const cut = Math.floor(OUTLIERS * felt.length);
  const ends = targets.flatMap((b) => [0.95 * b.target.low, 1.05 * b.target.high]);
  if (felt.length) ends.push(lows[cut], highs[highs.length - 1 - cut]);
  if (!ends.length) {
    const reach = buckets.findLast((b) => b.reachLow.n);
    ends.push(reach?.reachLow.mean ?? 0.5, reach?.reachHigh.mean ?? 0.7);
  }
  const low = ends.reduce((a, b) => Math.min(a, b)),
    high = ends.reduce((a, b) => Math.max(a, b));
  const margin = Math.max(0.06 * (high - low), 0.01),
    even = 0.02; // rounded, so that it does not tremble
  return [
    Math.max(Math.floor((low - margin) / even) * even, 0),
    Math.ceil((high + margin) / even) * even,
  ];
}

function drawStrip(at, buckets, field, name, { top, bottom }) {
  const { pen, width } = at;
  const most = buckets.reduce((found, b) => Math.max(found, b[field].n ? b[field].high : 0), 0);
  const high = most > 0 ? 1.1 * most : 1;
  const y = (v) => bottom - (v / high) * (bottom - top);
  pen.save();
  pen.beginPath();
  pen.rect(LEFT, top, width - LEFT - RIGHT, bottom - top);
  pen.clip();
  gaps(at, buckets, top, bottom);
  pen.globalAlpha = 0.3;
  band(
    at,
    buckets,
    theme.blue,
    (b) => (b[field].n > 1 ? [b[field].low, b[field].high] : [null, null]),
    y,
  );
  pen.globalAlpha = 1;
  line(
    pen,
    points(at, buckets, (b) => b[field].mean, y),
    { colour: theme.blue, width: 1.4 },
  );
  pen.restore();
  pen.strokeStyle = theme.edge;
  pen.lineWidth = 1;
  pen.strokeRect(LEFT + 0.5, top + 0.5, width - LEFT - RIGHT - 1, bottom - top - 1);
  text(pen, Number(high.toPrecision(2)).toString(), LEFT - 6, top + 6, { align: "right" });
  tag(pen, name, LEFT + 2, top + 10, LEFT + 2, width - RIGHT);
}

function drawTimes({ pen, x }, nowS, spanS, wallS, bottom) {
  const every = { 10: 2, 60: 10, 600: 120 }[spanS];
  for (let t = Math.ceil((nowS + wallS - spanS) / every) * every; t <= nowS + wallS; t += every) {
    const at = x(t - wallS);
    if (at > LEFT + 24 && at < x(nowS) - 20)
      text(pen, new Date(1000 * t).toLocaleTimeString("en-GB"), at, bottom + 12);
    pen.strokeStyle = theme.edge;
    pen.beginPath();
    pen.moveTo(at, bottom);
    pen.lineTo(at, bottom + 4);
    pen.stroke();
  }
}

function grid({ pen, width }, values, y) {
  pen.strokeStyle = theme.line;
  pen.lineWidth = 1;
  for (const v of values) {
    pen.beginPath();
    pen.moveTo(LEFT, y(v));
    pen.lineTo(width - RIGHT, y(v));
    pen.stroke();
  }
}

// Grey where no finger was, over its buckets' whole width.
function gaps({ pen, x, half }, buckets, top, bottom) {
  pen.fillStyle = theme.gap;
  for (const [first, last] of runs(buckets, (b) => b.touched === 0))
    pen.fillRect(
      x(first.time_s - half),
      top,
      x(last.time_s + half) - x(first.time_s - half),
      bottom - top,
    );
}

// Filled between two values of each bucket; nothing where they are null.
function band({ pen, x, half, periodS }, buckets, colour, ends, y) {
  pen.fillStyle = colour;
  for (const run of whole(buckets, (b) => ends(b)[0] !== null, periodS)) {
    pen.beginPath();
    run.forEach((b) => {
      pen.lineTo(x(b.time_s - half), y(ends(b)[1]));
      pen.lineTo(x(b.time_s + half), y(ends(b)[1]));
    });
    run.reverse().forEach((b) => {
      pen.lineTo(x(b.time_s + half), y(ends(b)[0]));
      pen.lineTo(x(b.time_s - half), y(ends(b)[0]));
    });
    pen.fill();
  }
}

function points({ x, periodS }, buckets, value, y) {
  return whole(buckets, (b) => value(b) !== null, periodS).flatMap((run) => [
    null,
    ...run.map((b) => [x(b.time_s), y(value(b))]),
  ]);
}

const runs = (buckets, holds) => whole(buckets, holds, Infinity).map((run) => [run[0], run.at(-1)]);

// Buckets in a row for which something holds, no further apart than a few periods.
function whole(buckets, holds, periodS) {
  const found = [];
  let run = null;
  for (const bucket of buckets) {
    if (!holds(bucket)) {
      run = null;
      continue;
    }
    if (run && bucket.time_s - run.at(-1).time_s <= 6 * periodS) run.push(bucket);
    else found.push((run = [bucket]));
  }
  return found;
}
