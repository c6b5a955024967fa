// The objects of a scene on the map: their outlines, and who may be dragged. Places are in mm, as
// in the API.

import { Refusal, ask } from "./connection.js";
import { colourOf } from "./palette.js";

const SVG = "http://www.w3.org/2000/svg";
const KEY_MM = 1; // by an arrow key with shift
const AGAIN_MS = 100; // between looks at a scene that others move

const element = (name, attributes) => {
  const made = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  return made;
};

// The outline of an object around 0, 0.
function outline(shape) {
  const { kind, width_mm: w, height_mm: h = w, radius_mm: r = 0 } = shape;
  switch (kind) {
    case "circle":
      return element("circle", { r });
    case "ellipse":
      return element("ellipse", { rx: w / 2, ry: h / 2 });
    case "polygon":
      return element("polygon", {
        points: shape.corners_mm.map((corner) => corner.join(",")).join(" "),
      });
    default:
      // a mask's frame
      return element("rect", { x: -w / 2, y: -h / 2, width: w, height: h, rx: r });
  }
}

export class SceneObjects {
  scene = null;
  rendering = false;
  selected = null;
  held = null; // {id, dx_mm, dy_mm}: what is dragged, and where on it
  shown = new Map();
  groups = new Map();
  sending = false;
  waiting = null;

  // `screen`: the map; `svg`: the layer on it; `over`: what is pointed at. `controls` have the
  // lease, `changed` is called with the scene.
  constructor(screen, svg, over, controls, changed) {
    Object.assign(this, { screen, svg, over, controls, changed });
    this.listen();
  }

  // --- what there is -----------------------------------------------------------------------------

  // Look again, soon: somebody has changed something.
  stir() {
    this.timer ??= setTimeout(() => {
      this.timer = null;
      this.look();
    }, AGAIN_MS);
  }

  async look() {
    try {
      const { scene, rendering } = await ask("GET", "/scene");
      Object.assign(this, { scene, rendering });
    } catch (error) {
      if (!(error instanceof Refusal)) throw error;
      return;
    }
    this.draw();
    this.changed(this.scene);
  }

  forget() {
    Object.assign(this, { scene: null, rendering: false, selected: null, held: null });
    this.draw();
  }

  draw() {
    const objects = (this.scene?.object ?? [])
      .filter((each) => each.enabled)
      .sort((a, b) => a.order - b.order);
    this.shown = new Map(objects.map((each) => [each.id, each]));
    this.svg.toggleAttribute("hidden", objects.length === 0);
    const before = this.groups;
    this.groups = new Map(objects.map((each) => [each.id, before.get(each.id) ?? {}]));
    for (const each of objects)
      Object.assign(this.groups.get(each.id), this.drawn(each, this.groups.get(each.id)));
    const wanted = objects.map((each) => this.groups.get(each.id).group);
    if (
      wanted.length !== this.svg.children.length ||
      wanted.some((group, k) => group !== this.svg.children[k])
    )
      this.svg.replaceChildren(...wanted);
    this.fit();
  }

  // The group of an object and what it looks like; the one before where it looks the same.
  drawn(each, before) {
    const looks = JSON.stringify([each.shape, each.cof, each.texture, this.screen.range]);
    if (before.looks === looks) {
      this.put(before.group, each);
      return before;
    }
    const group = element("g", { "data-id": each.id });
    const path = outline(each.shape),
      title = element("title", {});
    title.textContent = `${each.id}: ${each.texture ?? `friction ${each.cof}`}`;
    path.setAttribute(
      "fill",
      each.cof === null ? "transparent" : colourOf(each.cof, this.screen.range),
    );
    const label = element("text", { "text-anchor": "middle", "dominant-baseline": "middle" });
    label.textContent = each.id;
    group.append(path, label, title);
    this.put(group, each);
    return { group, looks };
  }

  put(group, { origin_mm: [x, y], rotation_deg, id }) {
    group.setAttribute("transform", `translate(${x} ${y})`);
    group.firstChild.setAttribute("transform", `rotate(${rotation_deg})`);
    group.classList.toggle("selected", id === this.selected);
  }

  // Where the map is; called when that has moved.
  fit() {
    const { x0, y0, x1, y1 } = this.screen.at;
    if (x1 > x0)
      this.svg.setAttribute("viewBox", [x0, y0, x1 - x0, y1 - y0].map((m) => 1e3 * m).join(" "));
  }

  // --- moving them -------------------------------------------------------------------------------

  place({ offsetX, offsetY }) {
    const { at } = this.screen;
    return [at.x0 + (offsetX - at.left) / at.scale, at.y0 + (offsetY - at.top) / at.scale].map(
      (m) => 1e3 * m,
    );
  }

  // The topmost object there.
  under([x_mm, y_mm]) {
    for (const group of [...this.svg.children].reverse()) {
      const {
          origin_mm: [x, y],
          rotation_deg,
          id,
        } = this.shown.get(group.dataset.id),
        angle = (rotation_deg * Math.PI) / 180;
      const [dx, dy] = [x_mm - x, y_mm - y],
        c = Math.cos(angle),
        s = Math.sin(angle);
      if (group.firstChild.isPointInFill(new DOMPoint(c * dx + s * dy, c * dy - s * dx))) return id;
    }
    return null;
  }

  listen() {
    const { over } = this;
    over.addEventListener("pointerdown", (event) => {
      const place = this.place(event),
        id = this.under(place);
      this.select(id);
      if (id === null || !this.controls.lease) return;
      const [x, y] = this.shown.get(id).origin_mm;
      this.held = { id, dx_mm: x - place[0], dy_mm: y - place[1] };
      this.screen.busy = true; // the map stays where it is
      over.setPointerCapture(event.pointerId);
      event.preventDefault();
    });
    over.addEventListener("pointermove", (event) => {
      const place = this.place(event),
        { held } = this;
      if (held) this.move(held.id, place[0] + held.dx_mm, place[1] + held.dy_mm);
      else over.style.cursor = this.controls.lease && this.under(place) !== null ? "move" : "";
    });
    for (const end of ["pointerup", "pointercancel"])
      over.addEventListener(end, () => {
        this.held = null;
        this.screen.busy = false;
      });
    over.addEventListener(
      "keydown",
      (event) => {
        const ids = [...this.shown.keys()],
          way = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[
            event.key
          ];
        if (event.key === "n" && ids.length)
          this.select(ids[(ids.indexOf(this.selected) + 1) % ids.length]);
        else if (event.shiftKey && way && this.shown.has(this.selected) && this.controls.lease) {
          const [x, y] = this.shown.get(this.selected).origin_mm;
          this.move(this.selected, x + KEY_MM * way[0], y + KEY_MM * way[1]);
        } else return;
        event.preventDefault();
        event.stopImmediatePropagation();
      },
      true,
    );
  }

  select(id) {
    this.selected = id;
    for (const group of this.svg.children)
      group.classList.toggle("selected", group.dataset.id === id);
  }

  // Shown at once; the daemon hears the newest place as soon as it has answered the one before.
  move(id, x_mm, y_mm) {
    const object = this.shown.get(id);
    if (!object) return;
    object.origin_mm = [x_mm, y_mm].map((mm) => Math.round(100 * mm) / 100);
    const group = [...this.svg.children].find((each) => each.dataset.id === id);
    this.put(group, object);
    this.waiting = { do: "move", id, x_mm: object.origin_mm[0], y_mm: object.origin_mm[1] };
    if (!this.sending) this.send();
  }

  async send() {
    this.sending = true;
    while (this.waiting) {
      const change = this.waiting;
      this.waiting = null;
      const done = await this.controls.command(() =>
        this.controls.holding("/scene", { changes: [change] }),
      );
      if (!done) this.held = this.waiting = null;
    }
    this.sending = false;
    if (!this.held) this.stir();
  }
}
