// The finger on the screen: origin upper left, x to the right, y down, as in files and previews.

import { begin, line, scaleBar, steps, text, upright } from "./drawing.js";
import { colourOf, theme } from "./palette.js";
import { Tiles } from "./tiles.js";

const MARGIN = { left: 46, right: 50, top: 8, bottom: 32 };
const ZOOM_STEP = 2,
  MOST_ZOOM = 32;
const LARGEST_M = 1; // a place beyond is a slip of the tracker
const TRAIL_S = 1.5;
const TRAIL_GAP_S = 0.06; // a trail does not bridge longer ones
const PAN_SHARE = 0.2; // of what is shown, by an arrow key

export class Screen {
  // `map`: the canvas of the texture; `over`: what is pointed at, as large; `marks` {trailed,
  // marks, here, ahead, nobody}: elements
  // on top, the first a canvas as large as the trail.
  constructor(map, over, marks) {
    Object.assign(this, { map, over, ...marks });
    this.size_m = [0.1, 0.06];
    this.zoom = 1;
    this.centre_m = [0.05, 0.03];
    this.tiles = this.coarse = this.flat = null;
    this.words = "";
    this.finger = null;
    this.trail = [];
    this.busy = false; // something on it is dragged
    this.refitted = () => {};
    this.reach = [0.5, 0.7];
    this.measured();
    this.listen();
  }

  get range() {
    return this.tiles?.range ?? this.coarse?.range ?? this.reach;
  }

  // --- what to show ------------------------------------------------------------------------------

  // A texture of the library; `words` say what it is. `failed` is told when there are no tiles of
  // it.
  showTexture(name, words, failed) {
    this.words = words;
    if (this.tiles?.name !== name) {
      this.clear();
      this.tiles = new Tiles(name, () => this.draw(), failed);
    }
    this.draw();
  }

  // One friction everywhere.
  showFlat(cof, words) {
    this.clear();
    this.flat = cof;
    this.words = words;
    this.draw();
  }

  // A coarse map, {x_m, y_m, picture, range}, of what is in no library.
  showCoarse(coarse, words) {
    this.clear();
    this.coarse = coarse;
    this.words = words;
    this.draw();
  }

  showNothing(words) {
    this.clear();
    this.words = words;
    this.draw();
  }

  clear() {
    this.tiles?.stop();
    this.tiles = this.coarse = this.flat = null;
  }

  // --- where is what -----------------------------------------------------------------------------

  layout() {
    const { clientWidth: width, clientHeight: height } = this.map;
    const wide = width - MARGIN.left - MARGIN.right,
      high = height - MARGIN.top - MARGIN.bottom;
    const fit = Math.max(Math.min(wide / this.size_m[0], high / this.size_m[1]), 1),
      scale = fit * this.zoom;
    const w = Math.min(wide, this.size_m[0] * fit),
      h = Math.min(high, this.size_m[1] * fit);
    const left = MARGIN.left + Math.floor((wide - w) / 2),
      top = MARGIN.top + Math.floor((high - h) / 2);
    this.centre_m = [w, h].map((pixels, k) => {
      const half = pixels / scale / 2;
      return Math.min(Math.max(this.centre_m[k], half), Math.max(this.size_m[k] - half, half));
    });
    const x0 = this.centre_m[0] - w / scale / 2,
      y0 = this.centre_m[1] - h / scale / 2;
    return {
      scale,
      left,
      top,
      w,
      h,
      x0,
      y0,
      x1: x0 + w / scale,
      y1: y0 + h / scale,
      x: (m) => left + (m - x0) * scale,
      y: (m) => top + (m - y0) * scale,
    };
  }

  // The layout now, kept for what is drawn more often; the marks' own box follows.
  measured() {
    this.at = this.layout();
    const { left, top, w, h } = this.at;
    Object.assign(this.marks.style, {
      left: `${left}px`,
      top: `${top}px`,
      width: `${w}px`,
      height: `${h}px`,
    });
    Object.assign(this.nobody.style, { left: `${left + 8}px`, top: `${top + 8}px` });
    this.refitted();
    return this.at;
  }

  zoomBy(factor, place = this.centre_m) {
    const before = this.zoom;
    this.zoom = Math.min(Math.max(this.zoom * factor, 1), MOST_ZOOM);
    this.centre_m = this.centre_m.map((c, k) => place[k] + ((c - place[k]) * before) / this.zoom);
    this.drawAll();
  }

  fit() {
    this.zoom = 1;
    this.drawAll();
  }

  pan(dx_m, dy_m) {
    this.centre_m = [this.centre_m[0] + dx_m, this.centre_m[1] + dy_m];
    this.drawAll();
  }

  listen() {
    this.over.addEventListener("keydown", (event) => {
      const { at } = this,
        step = (PAN_SHARE * at.w) / at.scale;
      const does = {
        "+": () => this.zoomBy(ZOOM_STEP),
        "=": () => this.zoomBy(ZOOM_STEP),
        "-": () => this.zoomBy(1 / ZOOM_STEP),
        0: () => this.fit(),
        ArrowLeft: () => this.pan(-step, 0),
        ArrowRight: () => this.pan(step, 0),
        ArrowUp: () => this.pan(0, -step),
        ArrowDown: () => this.pan(0, step),
      }[event.key];
      if (!does || event.ctrlKey || event.metaKey || event.altKey) return;
      event.preventDefault();
      does();
    });
    this.over.addEventListener("pointermove", (event) => {
      if (!event.buttons || this.zoom === 1 || this.busy) return;
      const { scale } = this.at;
      this.pan(-event.movementX / scale, -event.movementY / scale);
    });
    this.over.addEventListener("dblclick", (event) => {
      const { at } = this;
      this.zoomBy(ZOOM_STEP, [
        at.x0 + (event.offsetX - at.left) / at.scale,
        at.y0 + (event.offsetY - at.top) / at.scale,
      ]);
    });
  }

  // --- drawing -----------------------------------------------------------------------------------

  drawAll() {
    this.draw();
    this.drawTrail();
    this.moved(this.finger);
  }

  // The texture, when something about it has changed.
  draw() {
    const { pen } = begin(this.map),
      at = this.measured(),
      { left, top, w, h } = at;
    if (w < 20 || h < 20) return;
    pen.save();
    pen.beginPath();
    pen.rect(left, top, w, h);
    pen.clip();
    pen.fillStyle = this.flat === null ? theme.nothing : colourOf(this.flat, this.range);
    pen.fillRect(left, top, w, h);
    this.drawTexture(pen, at);
    pen.restore();
    pen.strokeStyle = theme.edge;
    pen.lineWidth = 1;
    pen.strokeRect(left - 0.5, top - 0.5, w + 1, h + 1);
    for (const mm of steps(1e3 * at.x0, 1e3 * at.x1, w / 90))
      text(pen, `${mm}`, at.x(1e-3 * mm), top + h + 11);
    for (const mm of steps(1e3 * at.y0, 1e3 * at.y1, h / 60))
      text(pen, `${mm}`, left - 5, at.y(1e-3 * mm), { align: "right" });
    text(pen, "x, mm", left + w / 2, top + h + 24);
    upright(pen, "y, mm", left - 36, top + h / 2);
    if (this.tiles || this.coarse || this.flat !== null)
      scaleBar(pen, this.range, left + w + 6, top, top + h);
    this.over.dispatchEvent(
      new CustomEvent("shown", {
        detail: `${this.words}${this.zoom > 1 ? ` · zoom ${this.zoom}` : ""}`,
      }),
    );
  }

  drawTexture(pen, at) {
    pen.imageSmoothingEnabled = false; // a cell is a pixel
    if (this.coarse) {
      const { x_m, y_m, picture } = this.coarse,
        half = (x_m[1] - x_m[0]) / 2;
      pen.drawImage(
        picture,
        at.x(x_m[0] - half),
        at.y(y_m[0] - half),
        (x_m.at(-1) - x_m[0] + 2 * half) * at.scale,
        (y_m.at(-1) - y_m[0] + 2 * half) * at.scale,
      );
    }
    if (!this.tiles) return;
    const pitch_m = Math.max(1 / (at.scale * (window.devicePixelRatio || 1)), 1e-6);
    this.tiles.want(pitch_m, at.x0, at.y0, at.x1, at.y1);
    for (const { picture, x_m, y_m, pitch_m: of_m } of this.tiles.all()) {
      const side = picture.width * of_m * at.scale;
      if (
        at.x(x_m) < at.left + at.w &&
        at.x(x_m) + side > at.left &&
        at.y(y_m) < at.top + at.h &&
        at.y(y_m) + side > at.top
      )
        pen.drawImage(picture, at.x(x_m), at.y(y_m), side, side);
    }
  }

  // `finger`: {x_m, y_m, output_x_m, output_y_m, touching} or null. Marks move without anything
  // being drawn.
  moved(finger) {
    this.finger = finger;
    if (finger?.touching) this.hold([finger.x_m, finger.y_m]);
    const { at } = this,
      marked = (x_m, y_m) =>
        `translate(${(at.x(x_m) - at.left).toFixed(1)}px, ${(at.y(y_m) - at.top).toFixed(1)}px)`;
    this.here.hidden = this.ahead.hidden = !finger?.touching;
    const words = !finger?.touching
      ? "no finger"
      : this.sees(finger)
        ? ""
        : `finger at ${(1e3 * finger.x_m).toFixed(0)}, ${(1e3 * finger.y_m).toFixed(0)} mm, not in this part`;
    if (this.nobody.textContent !== words) this.nobody.textContent = words;
    if (!finger?.touching) return;
    this.here.style.transform = marked(finger.x_m, finger.y_m);
    // where it will be when the output acts
    this.ahead.style.transform = marked(finger.output_x_m, finger.output_y_m);
  }

  // Nobody says how large a screen is: it reaches at least as far as a finger has been.
  hold(place_m) {
    if (place_m.every((m, k) => m <= this.size_m[k] || m > LARGEST_M)) return;
    this.size_m = this.size_m.map((size, k) =>
      Math.max(size, Math.min(Math.ceil(100 * place_m[k]) / 100, LARGEST_M)),
    );
    this.measured();
    this.draw();
  }

  sees({ x_m, y_m }) {
    const { x0, x1, y0, y1 } = this.at;
    return x_m >= x0 && x_m <= x1 && y_m >= y0 && y_m <= y1;
  }

  // Places in order, {time_s, x_m, y_m, cof}, of a finger that touches; older ones are forgotten.
  follow(places, nowS) {
    this.trail.push(...places);
    const kept = this.trail.findIndex((place) => place.time_s > nowS - TRAIL_S);
    const had = this.trail.length;
    this.trail.splice(0, kept < 0 ? this.trail.length : kept);
    if (had) this.drawTrail();
  }

  // Coloured by measured friction on the scale of the texture, with an edge that is seen on any
  // colour.
  drawTrail() {
    const { at, trailed } = this;
    const points = this.trail.flatMap((p, i) => {
      const point = [at.x(p.x_m), at.y(p.y_m)];
      return i && p.time_s - this.trail[i - 1].time_s > TRAIL_GAP_S ? [null, point] : [point];
    });
    if (this.finger?.touching && points.length)
      points.push([at.x(this.finger.x_m), at.y(this.finger.y_m)]); // not measured yet
    const [left, right] = extent(points, 0, at.left, at.left + at.w),
      [top, bottom] = extent(points, 1, at.top, at.top + at.h);
    trailed.hidden = !(right > left && bottom > top);
    if (trailed.hidden) return;
    Object.assign(trailed.style, {
      left: `${left}px`,
      top: `${top}px`,
      width: `${right - left}px`,
      height: `${bottom - top}px`,
    });
    const { pen } = begin(trailed, right - left, bottom - top);
    pen.translate(-left, -top);
    line(pen, points, { colour: "#000", width: 9 });
    line(pen, points, { colour: "#fff", width: 6.5 });
    pen.lineWidth = 4.5;
    for (let i = 1; i < this.trail.length; i++) {
      const [from, to] = [this.trail[i - 1], this.trail[i]];
      if (to.cof === null || to.time_s - from.time_s > TRAIL_GAP_S) continue;
      pen.strokeStyle = colourOf(to.cof, this.range);
      pen.beginPath();
      pen.moveTo(at.x(from.x_m), at.y(from.y_m));
      pen.lineTo(at.x(to.x_m), at.y(to.y_m));
      pen.stroke();
    }
  }
}

// From where to where a trail goes along an axis, its width included, between two ends.
function extent(points, axis, low, high) {
  const along = points.filter((point) => point).map((point) => point[axis]);
  return [
    Math.max(Math.floor(Math.min(...along) - 6), Math.floor(low)),
    Math.min(Math.ceil(Math.max(...along) + 6), Math.ceil(high)),
  ];
}
