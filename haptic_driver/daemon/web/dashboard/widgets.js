// A slider with detents, a button and a list with inertia: what they look like and what they feel
// like move together. The page fills the touch screen's width, which is 100 mm here.

import { Haptic } from "./haptic.js";

const SMOOTH = 0.55, EDGE = 0.8, PRESSED = 0.7; // friction
const DETENTS = 9, LEFT_MM = 10, STEP_MM = 10;
const ROW_MM = 6, ROWS = 40, LIST = { x: 45, y: 22, width: 45, height: 36 };
const SLOWING_PER_S = 3; // of a list that is let go

const at = (id) => document.getElementById(id);
const screen = at("screen");
let haptic = null;

function drawn(parent, name, attributes, text = "") {
  const one = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) one.setAttribute(key, value);
  one.textContent = text;
  return parent.appendChild(one);
}

function place(event) {
  const { x, y } = new DOMPoint(event.clientX, event.clientY).matrixTransform(screen.getScreenCTM().inverse());
  return { x, y };
}

const rectangle = (id, x, y, width_mm, height_mm, cof) => ({
  do: "add", id, cof, origin_mm: [x, y], shape: { kind: "rectangle", width_mm, height_mm },
});

// --- the slider: a detent is a line of high friction

const detent = (k) => LEFT_MM + STEP_MM * k;
let level = 4;
for (let k = 0; k < DETENTS; k++) drawn(at("detents"), "rect", { x: detent(k) - 0.25, y: 9, width: 0.5, height: 6, fill: "#8593a3" });

function slide(x) {
  level = Math.max(0, Math.min(DETENTS - 1, Math.round((x - LEFT_MM) / STEP_MM)));
  at("thumb").setAttribute("x", detent(level) - 3);
  at("level").textContent = level;
  haptic?.move("thumb", detent(level), 12);
}

// --- the button: an edge all round, and another friction while it is pressed

function press(down) {
  at("key").setAttribute("fill", down ? "#7db8f0" : "#d3dae2");
  haptic?.scene([{ do: "set", id: "key", cof: down ? PRESSED : SMOOTH }], false, true).catch(tell);
}

// --- the list: lines between rows move with it

let offset_mm = 0, speed_mm_s = 0, last_s = 0, held = null;
for (let k = 0; k < ROWS; k++) {
  drawn(at("rows"), "text", { x: 2, y: k * ROW_MM + 1 }, `row ${k + 1}`);
  drawn(at("rows"), "rect", { y: (k + 0.5) * ROW_MM - 0.2, width: LIST.width, height: 0.4, fill: "#8593a3" });
}
const lines = Math.ceil(LIST.height / ROW_MM);

function scroll(to_mm) {
  offset_mm = Math.max(0, Math.min(ROWS * ROW_MM - LIST.height, to_mm));
  at("rows").setAttribute("transform", `translate(0 ${-offset_mm})`);
  for (let k = 0; k < lines; k++) {
    const y = k * ROW_MM - (offset_mm % ROW_MM) + ROW_MM / 2;
    haptic?.move(`line ${k}`, LIST.x + LIST.width / 2, LIST.y + Math.min(Math.max(y, 0), LIST.height));
  }
}

function roll(now_ms) {
  const step_s = Math.min(now_ms / 1000 - last_s, 0.05);
  last_s = now_ms / 1000;
  if (held === null && Math.abs(speed_mm_s) > 0.5) {
    scroll(offset_mm + speed_mm_s * step_s);
    speed_mm_s *= Math.exp(-SLOWING_PER_S * step_s);
  }
  requestAnimationFrame(roll);
}

// --- a finger

let touched = null;
screen.addEventListener("pointerdown", (event) => {
  touched = event.target.id;
  screen.setPointerCapture(event.pointerId);
  if (touched === "key") press(true);
  if (touched === "list") held = { ...place(event), time_ms: event.timeStamp };
  if (touched === "thumb") slide(place(event).x);
});
screen.addEventListener("pointermove", (event) => {
  const now = { ...place(event), time_ms: event.timeStamp };
  if (touched === "thumb") slide(now.x);
  if (held !== null) {
    const step_s = Math.max(now.time_ms - held.time_ms, 1) / 1000;
    speed_mm_s = (held.y - now.y) / step_s;
    scroll(offset_mm + held.y - now.y);
    held = now;
  }
});
for (const end of ["pointerup", "pointercancel"])
  screen.addEventListener(end, () => {
    if (touched === "key") press(false);
    touched = held = null;
  });

// --- the daemon

function tell(error) {
  at("said").textContent = [error.message, error.hint].filter(Boolean).join("; ");
}

async function arm() {
  try {
    if (haptic?.socket.readyState !== WebSocket.OPEN) haptic = await Haptic.open();
    haptic.lost = tell;
    await haptic.arm();
    const added = [{ do: "background", cof: SMOOTH }, rectangle("thumb", detent(level), 12, 6, 10, PRESSED)];
    for (let k = 0; k < DETENTS; k++) added.push(rectangle(`detent ${k}`, detent(k), 12, 1, 8, EDGE));
    for (const [id, radius_mm, cof] of [["rim", 10, EDGE], ["key", 8.5, SMOOTH]])
      added.push({ do: "add", id, cof, origin_mm: [22, 40], shape: { kind: "circle", radius_mm } });
    for (let k = 0; k < lines; k++) added.push(rectangle(`line ${k}`, LIST.x + LIST.width / 2, LIST.y + k * ROW_MM, LIST.width, 0.8, EDGE));
    await haptic.scene([{ do: "clear" }, ...added], true, true);
    at("said").textContent = "armed";
    scroll(offset_mm);
  } catch (error) {
    tell(error);
  }
}

at("arm").onclick = arm;
at("off").onclick = () => haptic?.disarm().then(() => (at("said").textContent = "off"), tell);
addEventListener("keydown", ({ key }) => key === "Escape" && at("off").click());
slide(detent(level));
scroll(0);
requestAnimationFrame(roll);
