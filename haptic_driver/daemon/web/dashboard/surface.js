// Friction over frequency and voltage as far as the rig may go; what is forbidden is hatched, and
// says by what.

import { begin, line, ring, scaleBar, steps, tag, text, upright } from "./drawing.js";
import { SCALE, levelOf, theme } from "./palette.js";

const LEFT = 46,
  RIGHT = 52,
  TOP = 8,
  BOTTOM = 36;
const HATCH = 9; // pixels between lines
const decade = (f) => (f >= 1e6 ? `${f / 1e6}M` : f >= 1e3 ? `${f / 1e3}k` : `${f}`);
const clamp = (v, low, high) => Math.min(Math.max(v, low), high);

export class Surface {
  // `map`: the canvas of the surface, `over`: that of the operating point; `said`: where words
  // about a place go.
  constructor(map, over, said) {
    Object.assign(this, { map, over, said });
    this.surface = this.point = this.probe = this.asked = null;
    this.trail = [];
    this.over.addEventListener("pointermove", (event) => this.ask(event.offsetX, event.offsetY));
    this.over.addEventListener("pointerleave", () => {
      this.probe = this.asked = null;
      this.drawPoint();
    });
    this.over.addEventListener("keydown", (event) => this.askByKey(event));
  }

  // `surface` as of `GET /surface`.
  show(surface) {
    const names = Object.keys(surface.limits_v);
    const lowest = surface.frequency_hz.map((_, i) =>
      Math.min(...names.map((name) => surface.limits_v[name][i] ?? Infinity)),
    );
    const allowed = surface.cof.flatMap((row, i) =>
      row.filter((cof, v) => cof !== null && surface.voltage_v[v] <= lowest[i]),
    );
    const range = [Math.min(...allowed), Math.max(...allowed)];
    this.surface = { ...surface, lowest, range, picture: pictureOf(surface.cof, range) };
    this.draw();
    this.drawPoint();
    if (this.asked) this.ask(...this.asked); // words of another surface, or of none
  }

  layout() {
    const { clientWidth: width, clientHeight: height } = this.map,
      { frequency_hz: f, voltage_v: v } = this.surface;
    const right = width - RIGHT,
      bottom = height - BOTTOM,
      span = Math.log(f.at(-1) / f[0]);
    return {
      right,
      bottom,
      width,
      height,
      x: (hz) => LEFT + (Math.log(hz / f[0]) / span) * (right - LEFT),
      y: (volt) => bottom - ((volt - v[0]) / (v.at(-1) - v[0])) * (bottom - TOP),
      hz: (x) => f[0] * Math.exp(((x - LEFT) / (right - LEFT)) * span),
      volt: (y) => v[0] + ((bottom - y) / (bottom - TOP)) * (v.at(-1) - v[0]),
    };
  }

  // --- asking about a place ----------------------------------------------------------------------

  ask(x, y) {
    this.asked = [x, y];
    if (!this.surface) return;
    const at = this.layout();
    if (x < LEFT || x > at.right || y < TOP || y > at.bottom) return;
    this.probe = { frequency_hz: at.hz(x), voltage_v: at.volt(y) };
    this.said.textContent = this.words(this.probe);
    this.drawPoint();
  }

  askByKey(event) {
    const [dx, dy] = {
      ArrowLeft: [-8, 0],
      ArrowRight: [8, 0],
      ArrowUp: [0, -8],
      ArrowDown: [0, 8],
    }[event.key] ?? [0, 0];
    if (!this.surface || (!dx && !dy)) return;
    event.preventDefault();
    const at = this.layout(),
      from = this.probe ?? this.point;
    const [x, y] = from
      ? [at.x(from.frequency_hz), at.y(from.voltage_v)]
      : [(LEFT + at.right) / 2, (TOP + at.bottom) / 2];
    this.ask(clamp(x + dx, LEFT, at.right), clamp(y + dy, TOP, at.bottom));
  }

  words({ frequency_hz, voltage_v }) {
    const { frequency_hz: f, voltage_v: v, cof, limits_v } = this.surface;
    const nearest = (axis, value) =>
      axis.reduce(
        (best, one, i) => (Math.abs(one - value) < Math.abs(axis[best] - value) ? i : best),
        0,
      );
    const i = nearest(f.map(Math.log), Math.log(frequency_hz)),
      there = cof[i][nearest(v, voltage_v)];
    const against = Object.entries(limits_v)
      .filter(([, most]) => most[i] !== null && most[i] < voltage_v)
      .map(([name, most]) => `${name} (at most ${most[i].toFixed(1)} V)`);
    const place = `${Number(frequency_hz.toPrecision(3))} Hz, ${voltage_v.toFixed(1)} V: friction ${there === null ? "unknown" : there.toFixed(2)}`;
    return against.length ? `${place}; forbidden by ${against.join(", ")}.` : `${place}; allowed.`;
  }

  // --- drawing -----------------------------------------------------------------------------------

  draw() {
    const { pen, width, height } = begin(this.map);
    if (!this.surface) {
      text(pen, "Waiting for the surface", width / 2, height / 2);
      return;
    }
    const { frequency_hz: f, voltage_v: v, lowest, picture, range } = this.surface,
      at = this.layout(),
      { x, y, right, bottom } = at;
    pen.imageSmoothingEnabled = true;
    pen.drawImage(picture, LEFT, TOP, right - LEFT, bottom - TOP);
    this.hatch(pen, at);
    pen.save();
    pen.beginPath();
    pen.rect(LEFT, TOP, right - LEFT, bottom - TOP);
    pen.clip();
    const edge = f.map((hz, i) => [x(hz), y(Math.min(lowest[i], 2 * v.at(-1)))]);
    line(pen, edge, { colour: "#000", width: 4 });
    line(pen, edge, { colour: "#fff", width: 2 });
    pen.restore();
    pen.strokeStyle = theme.edge;
    pen.lineWidth = 1;
    pen.strokeRect(LEFT - 0.5, TOP - 0.5, right - LEFT + 1, bottom - TOP + 1);
    for (let hz = 10 ** Math.ceil(Math.log10(f[0]) - 1e-9); hz <= f.at(-1) * 1.001; hz *= 10) {
      pen.beginPath();
      pen.moveTo(x(hz), bottom);
      pen.lineTo(x(hz), bottom + 4);
      pen.stroke();
      text(pen, decade(Math.round(hz)), x(hz), bottom + 12);
    }
    for (const volt of steps(v[0], v.at(-1), (bottom - TOP) / 40))
      text(pen, `${volt}`, LEFT - 5, y(volt), { align: "right" });
    text(pen, "frequency, Hz", (LEFT + right) / 2, height - 8);
    upright(pen, "voltage, V peak", 9, (TOP + bottom) / 2);
    scaleBar(pen, range, right + 8, TOP, bottom);
  }

  // What is above the lowest limit: paler, and hatched.
  hatch(pen, { x, y, right, bottom }) {
    const { frequency_hz: f, lowest } = this.surface;
    pen.save();
    pen.beginPath();
    pen.rect(LEFT, TOP, right - LEFT, bottom - TOP);
    pen.clip();
    pen.beginPath();
    pen.moveTo(LEFT, TOP - 1);
    f.forEach((hz, i) => pen.lineTo(x(hz), Math.max(y(lowest[i]), TOP - 1)));
    pen.lineTo(right, TOP - 1);
    pen.clip();
    pen.globalAlpha = 0.6;
    pen.fillStyle = theme.panel;
    pen.fillRect(LEFT, TOP, right - LEFT, bottom - TOP);
    pen.globalAlpha = 1;
    pen.strokeStyle = theme.ink;
    pen.lineWidth = 1;
    pen.beginPath();
    for (let i = LEFT - bottom; i < right; i += HATCH) {
      pen.moveTo(i, bottom);
      pen.lineTo(i + bottom - TOP, TOP);
    }
    pen.stroke();
    pen.restore();
  }

  // `point` {frequency_hz, voltage_v} or null while the output is off; `trail`: where it has been.
  operates(point, trail) {
    const key = JSON.stringify([point?.frequency_hz, point?.voltage_v]);
    if (key === this.key) return;
    Object.assign(this, { key, point, trail });
    this.drawPoint();
  }

  drawPoint() {
    const { pen } = begin(this.over),
      { point, probe } = this;
    if (!this.surface) return;
    const { x, y, right } = this.layout();
    if (probe) ring(pen, x(probe.frequency_hz), y(probe.voltage_v), 4);
    if (!point) {
      tag(pen, "output off", LEFT + 6, TOP + 14, LEFT, right);
      return;
    }
    pen.fillStyle = "#fff";
    pen.strokeStyle = "#000";
    pen.lineWidth = 1;
    for (const p of this.trail) {
      pen.beginPath();
      pen.arc(x(p.frequency_hz), y(p.voltage_v), 2, 0, 7);
      pen.stroke();
      pen.fill();
    }
    ring(pen, x(point.frequency_hz), y(point.voltage_v), 7, theme.red);
    tag(
      pen,
      `${point.voltage_v.toFixed(1)} V, ${point.frequency_hz.toPrecision(4)} Hz`,
      x(point.frequency_hz) + 14,
      Math.max(y(point.voltage_v) - 16, TOP + 14),
      LEFT,
      right,
    );
  }
}

// Of `cof[frequency][voltage]`, a pixel each, frequency to the right and voltage up.
function pictureOf(cof, range) {
  const canvas = document.createElement("canvas");
  canvas.width = cof.length;
  canvas.height = cof[0].length;
  const pen = canvas.getContext("2d"),
    image = pen.createImageData(canvas.width, canvas.height);
  cof.forEach((row, i) =>
    row.forEach((value, v) => {
      if (value === null) return;
      image.data.set(
        [...SCALE[levelOf(value, range)], 255],
        4 * ((canvas.height - 1 - v) * canvas.width + i),
      );
    }),
  );
  pen.putImageData(image, 0, 0);
  return canvas;
}
