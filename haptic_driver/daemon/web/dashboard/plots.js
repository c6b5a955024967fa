// Pictures on canvases. Each function draws all of one picture from the numbers that it is given.

const INK = "#14202e", SOFT = "#4a5a6b", LINE = "#dfe5eb", ORANGE = "#b34700", BLUE = "#0b5394", GREY = "#6b7785", RED = "#b5001a";
const FONT = "12px system-ui, 'DejaVu Sans', sans-serif";
const NOTHING = "#e4e8ed"; // where there is no number
const GAP_S = 0.05; // lines do not bridge longer ones
// From dark to light in even steps of lightness, so that it reads without colour too.
const SCALE = [[68, 1, 84], [65, 68, 135], [42, 120, 142], [34, 168, 132], [122, 209, 81], [253, 231, 37]];

function begin(canvas) {
  const ratio = window.devicePixelRatio || 1;
  const { clientWidth: width, clientHeight: height } = canvas;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  const pen = canvas.getContext("2d");
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  pen.font = FONT;
  pen.lineJoin = "round";
  return { pen, width, height };
}

function colour(share) {
  const at = Math.min(Math.max(share, 0), 1) * (SCALE.length - 1);
  const i = Math.min(Math.floor(at), SCALE.length - 2);
  return SCALE[i].map((low, k) => Math.round(low + (SCALE[i + 1][k] - low) * (at - i)));
}

function steps(low, high, most) {
  const rough = (high - low) / most, power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((f) => f * power).find((s) => s >= rough);
  const found = [];
  for (let i = Math.ceil(low / step - 1e-9); i * step <= high + 1e-9 * step; i++) found.push(Number((i * step).toPrecision(6)));
  return found;
}

function text(pen, words, x, y, { align = "center", base = "middle", fill = SOFT } = {}) {
  pen.fillStyle = fill;
  pen.textAlign = align;
  pen.textBaseline = base;
  pen.fillText(words, x, y);
}

function upright(pen, words, x, y) {
  pen.save();
  pen.translate(x, y);
  pen.rotate(-Math.PI / 2);
  text(pen, words, 0, 0);
  pen.restore();
}

export function limits(values) {
  let low = Infinity, high = -Infinity;
  for (const v of values) {
    if (v === null || v === undefined) continue;
    if (v < low) low = v;
    if (v > high) high = v;
  }
  return low <= high ? [low, high] : null;
}

// Newest at the right. `samples`: {time_s, target, measured, expected}, null where there is nothing.
export function drawFriction(canvas, samples, nowS, spanS) {
  const { pen, width, height } = begin(canvas);
  const left = 58, right = width - 8, top = 8, bottom = height - 24;
  const [low, high] = limits(samples.flatMap((f) => [f.target, f.measured, f.expected])) ?? [0.5, 0.7];
  const margin = Math.max(0.12 * (high - low), 0.02), y0 = Math.max(low - margin, 0), y1 = high + margin;
  const x = (t) => right - ((nowS - t) / spanS) * (right - left);
  const y = (v) => bottom - ((v - y0) / (y1 - y0)) * (bottom - top);

  pen.lineWidth = 1;
  for (const v of steps(y0, y1, Math.max(height / 45, 2))) {
    pen.strokeStyle = LINE;
    pen.beginPath(); pen.moveTo(left, y(v)); pen.lineTo(right, y(v)); pen.stroke();
    text(pen, `${v}`, left - 6, y(v), { align: "right" });
  }
  for (let s = 0; s <= spanS; s += 2) text(pen, s ? `−${s} s` : "now", Math.min(x(nowS - s), right - 12), bottom + 12);
  upright(pen, "friction coefficient", 9, (top + bottom) / 2);
  pen.strokeStyle = SOFT;
  pen.strokeRect(left, top, right - left, bottom - top);

  pen.save();
  pen.beginPath(); pen.rect(left, top, right - left, bottom - top); pen.clip();
  for (const [name, stroke, thick, dash] of [["expected", GREY, 1, []], ["measured", BLUE, 1.5, []], ["target", ORANGE, 1.5, [5, 3]]]) {
    pen.strokeStyle = stroke;
    pen.lineWidth = thick;
    pen.setLineDash(dash);
    pen.beginPath();
    let lastS = -Infinity; // of what the line goes on from
    for (const sample of samples) {
      const v = sample[name], t = sample.time_s;
      if (v === null) { lastS = -Infinity; continue; }
      if (t - lastS < GAP_S) pen.lineTo(x(t), y(v)); else pen.moveTo(x(t), y(v));
      lastS = t;
    }
    pen.stroke();
  }
  pen.restore();
  if (!samples.some((f) => f.target !== null || f.measured !== null))
    text(pen, "No friction asked for and no finger sliding", (left + right) / 2, (top + bottom) / 2);
}

// A picture of `values[row][column]`, one pixel each; made once per map.
export function picture(values, range = limits(values.flat())) {
  const canvas = document.createElement("canvas");
  canvas.width = values[0].length;
  canvas.height = values.length;
  const pen = canvas.getContext("2d"), image = pen.createImageData(canvas.width, canvas.height);
  const [low, high] = range ?? [0, 1], spread = high - low || 1;
  values.flat().forEach((v, i) => {
    const [r, g, b] = v === null ? [228, 232, 237] : colour((v - low) / spread);
    image.data.set([r, g, b, 255], 4 * i);
  });
  pen.putImageData(image, 0, 0);
  return { canvas, low, high, empty: range === null };
}

function scaleBar(pen, shown, x, top, bottom) {
  const fill = pen.createLinearGradient(0, bottom, 0, top);
  SCALE.forEach((c, i) => fill.addColorStop(i / (SCALE.length - 1), `rgb(${c})`));
  pen.fillStyle = fill;
  pen.fillRect(x, top, 10, bottom - top);
  text(pen, shown.high.toFixed(2), x + 14, top + 5, { align: "left" });
  text(pen, shown.low.toFixed(2), x + 14, bottom - 5, { align: "left" });
  upright(pen, "friction", x + 20, (top + bottom) / 2);
}

function tag(pen, words, x, y, left, right) {
  const w = pen.measureText(words).width + 10, at = Math.min(Math.max(x + 10, left), right - w);
  pen.fillStyle = "rgba(255,255,255,0.92)";
  pen.fillRect(at, y - 22, w, 17);
  text(pen, words, at + 5, y - 13, { align: "left", fill: INK });
}

const decade = (f) => (f >= 1e6 ? `${f / 1e6}M` : f >= 1e3 ? `${f / 1e3}k` : `${f}`);

// `map`: {frequency_hz, voltage_v, shown}; `point` and its `trail`: {frequency_hz, voltage_v}.
export function drawSurface(canvas, map, point, trail) {
  const { pen, width, height } = begin(canvas);
  const left = 46, right = width - 50, top = 8, bottom = height - 34;
  if (!map) return text(pen, "Waiting for the surface", width / 2, height / 2);
  const [f0, f1] = [map.frequency_hz[0], map.frequency_hz.at(-1)], [v0, v1] = [map.voltage_v[0], map.voltage_v.at(-1)];
  const x = (f) => left + (Math.log(f / f0) / Math.log(f1 / f0)) * (right - left);
  const y = (v) => bottom - ((v - v0) / (v1 - v0)) * (bottom - top);
  pen.imageSmoothingEnabled = true;
  pen.save();
  pen.translate(left, bottom);
  pen.scale(1, -1);
  pen.drawImage(map.shown.canvas, 0, 0, right - left, bottom - top);
  pen.restore();
  pen.strokeStyle = SOFT;
  pen.lineWidth = 1;
  pen.strokeRect(left, top, right - left, bottom - top);
  for (let f = 10 ** Math.ceil(Math.log10(f0) - 1e-9); f <= f1 * 1.001; f *= 10) {
    pen.beginPath(); pen.moveTo(x(f), bottom); pen.lineTo(x(f), bottom + 4); pen.stroke();
    text(pen, decade(Math.round(f)), x(f), bottom + 12);
  }
  for (const v of steps(v0, v1, 4)) text(pen, `${v}`, left - 5, y(v), { align: "right" });
  text(pen, "frequency, Hz", (left + right) / 2, height - 7);
  upright(pen, "voltage, V peak", 8, (top + bottom) / 2);
  scaleBar(pen, map.shown, right + 8, top, bottom);
  if (!point) return text(pen, "output off", (left + right) / 2, top + 14, { fill: "#ffffff" });
  pen.fillStyle = "rgba(255,255,255,0.55)";
  for (const p of trail) { pen.beginPath(); pen.arc(x(p.frequency_hz), y(p.voltage_v), 2, 0, 7); pen.fill(); }
  const [px, py] = [x(point.frequency_hz), y(point.voltage_v)];
  marker(pen, px, py, RED);
  tag(pen, `${point.voltage_v.toFixed(1)} V, ${point.frequency_hz.toPrecision(4)} Hz`, px, Math.max(py, top + 24), left + 2, right - 2);
  return undefined;
}

function marker(pen, x, y, fill) {
  pen.beginPath(); pen.arc(x, y, 6.5, 0, 7);
  pen.fillStyle = fill; pen.fill();
  pen.lineWidth = 2; pen.strokeStyle = "#ffffff"; pen.stroke();
}

// `map`: {x_m, y_m, shown}; `finger`: {x_m, y_m, output_x_m, output_y_m, touching}, or null; `trail`: [{x_m, y_m}].
export function drawFinger(canvas, map, finger, trail) {
  const { pen, width, height } = begin(canvas);
  if (!map) return text(pen, "Waiting for the screen", width / 2, height / 2);
  const pitch = map.x_m.length > 1 ? map.x_m[1] - map.x_m[0] : 0.001;
  const wide = map.x_m.at(-1) + pitch / 2, high = map.y_m.at(-1) + pitch / 2;
  const bar = map.shown.empty ? 0 : 44, scale = Math.min((width - 30 - bar) / wide, (height - 38) / high);
  const left = 26 + Math.max((width - 30 - bar - wide * scale) / 2, 0), right = left + wide * scale;
  const top = 6 + Math.max((height - 42 - high * scale) / 2, 0), bottom = top + high * scale;
  const x = (m) => left + m * scale, y = (m) => bottom - m * scale;
  pen.fillStyle = NOTHING;
  pen.fillRect(left, top, right - left, bottom - top);
  if (!map.shown.empty) {
    pen.imageSmoothingEnabled = false;
    pen.save();
    pen.translate(left, bottom);
    pen.scale(1, -1);
    pen.drawImage(map.shown.canvas, 0, 0, right - left, bottom - top);
    pen.restore();
    scaleBar(pen, map.shown, right + 6, top, bottom);
  }
  pen.strokeStyle = SOFT;
  pen.lineWidth = 1;
  pen.strokeRect(left, top, right - left, bottom - top);
  for (const mm of steps(0, wide * 1e3, 5)) text(pen, `${mm}`, x(mm * 1e-3), bottom + 11);
  for (const mm of steps(0, high * 1e3, 3)) text(pen, `${mm}`, left - 5, y(mm * 1e-3), { align: "right" });
  text(pen, "mm", (left + right) / 2, Math.min(bottom + 26, height - 6));
  pen.save();
  pen.beginPath(); pen.rect(left, top, right - left, bottom - top); pen.clip();
  pen.lineWidth = 3;
  trail.slice(1).forEach((p, i) => {
    pen.strokeStyle = `rgba(181,0,26,${(0.6 * (i + 1)) / trail.length})`;
    pen.beginPath(); pen.moveTo(x(trail[i].x_m), y(trail[i].y_m)); pen.lineTo(x(p.x_m), y(p.y_m)); pen.stroke();
  });
  if (finger?.touching) {
    marker(pen, x(finger.x_m), y(finger.y_m), RED);
    pen.strokeStyle = INK; // where it will be when the output acts
    pen.beginPath(); pen.arc(x(finger.output_x_m), y(finger.output_y_m), 11, 0, 7); pen.stroke();
  }
  pen.restore();
  if (!finger?.touching) tag(pen, "no finger", (left + right) / 2 - 45, (top + bottom) / 2 + 12, left, right);
  return undefined;
}

const duration = (s) => (s >= 1e-3 ? `${s * 1e3} ms` : `${Math.round(s * 1e6)} µs`);

// `counts` of ticks from `edges_s[i]` on; bars on a logarithmic scale, since the rare late ones matter.
export function drawLateness(canvas, edgesS, counts) {
  const { pen, width, height } = begin(canvas);
  const left = 50, right = width - 6, top = 16, bottom = height - 32;
  const most = Math.max(...counts, 10), decades = Math.ceil(Math.log10(most));
  const step = (right - left) / Math.max(counts.length, 1);
  const y = (n) => bottom - (Math.log10(Math.max(n, 0.6)) - Math.log10(0.6)) / (decades - Math.log10(0.6)) * (bottom - top);
  for (let d = 0; d <= decades; d++) {
    pen.strokeStyle = LINE;
    pen.lineWidth = 1;
    pen.beginPath(); pen.moveTo(left, y(10 ** d)); pen.lineTo(right, y(10 ** d)); pen.stroke();
    text(pen, decade(10 ** d), left - 5, y(10 ** d), { align: "right" });
  }
  counts.forEach((n, i) => {
    const x = left + i * step, late = edgesS[i] >= 1e-3;
    if (n > 0) {
      pen.fillStyle = late ? RED : BLUE;
      pen.fillRect(x + 1.5, y(n), step - 3, bottom - y(n));
      text(pen, n >= 1000 ? `${(n / 1000).toFixed(1)}k` : `${n}`, x + step / 2, y(n) - 7);
    }
    const words = i === counts.length - 1 ? `≥${duration(edgesS[i])}` : duration(edgesS[i]);
    if (i % 2 === (counts.length - 1) % 2) text(pen, words, i === counts.length - 1 ? right : x, bottom + 11, { align: i === counts.length - 1 ? "right" : "center" });
  });
  text(pen, "late by at least (red: a period or more)", (left + right) / 2, height - 7);
  upright(pen, "ticks", 8, (top + bottom) / 2);
}

