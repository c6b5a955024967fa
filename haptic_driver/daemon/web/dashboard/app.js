// The page: hears the daemon's state, and has everything shown that has changed.

import { showAgreement } from "./agreement.js";
import { Refusal, Stream, ask } from "./connection.js";
import { Controls } from "./controls.js";
import { allWords, latencyWords, scoreWords, showBands } from "./fidelity.js";
import { Happened } from "./flags.js";
import { History } from "./history.js";
import { showInstruments } from "./instruments.js";
import { SCALE, levelOf, readTheme } from "./palette.js";
import { rippleWords } from "./ripple.js";
import { SceneObjects } from "./scene.js";
import { Screen } from "./screen.js";
import { Surface } from "./surface.js";
import { drawTimePlot } from "./timeplot.js";
import { Why } from "./why.js";

const SPANS_S = [10, 60, 600];
const FRAME_S = 0.1; // between frames: each wakes four processes of the browser
const COLUMNS = [
  "tick",
  "time_s",
  "in_contact",
  "output_on",
  "target_cof",
  "measured_cof",
  "expected_cof",
  "normal_force_n",
  "voltage_v",
  "position_x_m",
  "position_y_m",
];
// between looks at what seldom changes: the surface, a texture that is in no library
const SLOW_MS = 1000;
const TRAIL_EVERY = 8; // ticks
const POINTS = 30; // frames of which the operating point is remembered
// numbers that change faster are not read, and a plot of 10 s need not be drawn more often
const READ_MS = 480;
const LATE_S = 10; // frames of which the ticks are summed up

const $ = (id) => document.getElementById(id);
const page = {
  status: null,
  newest: null,
  frames: [],
  linked: false,
  awaited: 0,
  newestS: 0,
  wallS: 0,
  carrier: null,
  surfaceOf: null,
  textures: null,
  scripts: [],
  selected: "",
  textureOf: null,
  history: new History(SPANS_S),
  spanS: SPANS_S[0],
  paused: null,
  readMs: 0,
  plotMs: 0,
  state: "",
};
readTheme();
const screen = new Screen($("texture-map"), $("finger"), {
  trailed: $("trail"),
  marks: $("marks"),
  here: $("here"),
  ahead: $("ahead"),
  nobody: $("nobody"),
});
const surface = new Surface($("surface-map"), $("surface"), $("surface-said"));
const controls = new Controls(
  (name) => {
    page.selected = name;
    showTexture();
  },
  (words) => stream.say(words),
);
const happened = new Happened();
const objects = new SceneObjects(screen, $("objects"), $("finger"), controls, () => {
  showTexture();
  if (screen.coarse) showPlaying();
});
screen.refitted = () => objects.fit();
const inSight = new Set();
const why = new Why(controls);

// --- what there is to show -----------------------------------------------------------------------

// Refusals are as good as silence here: what is shown stays, and the next look may do.
async function quietly(work) {
  try {
    return await work();
  } catch (error) {
    if (!(error instanceof Refusal)) throw error;
    return null;
  }
}

async function fetchSurface() {
  const of = page.status?.surface_hash;
  if (!page.linked || of === page.surfaceOf) return;
  const found = await quietly(() => ask("GET", "/surface"));
  if (!found) return;
  page.surfaceOf = of;
  surface.show(found);
}

// The ticks themselves: textures are too fast for the frames.
function take(columns) {
  if (!columns.tick.length) return;
  const {
      reachable_cof: [reachLow, reachHigh],
      current_rms_a,
    } = page.status,
    places = [];
  columns.tick.forEach((tick, i) => {
    const on = columns.output_on[i],
      touching = columns.in_contact[i] > 0;
    page.history.add({
      time_s: columns.time_s[i],
      touching,
      target: columns.target_cof[i],
      measured: columns.measured_cof[i],
      expected: on ? columns.expected_cof[i] : null,
      reachLow,
      reachHigh,
      force: touching ? columns.normal_force_n[i] : null,
      voltage: columns.voltage_v[i],
      current: on && current_rms_a !== null ? 1e6 * current_rms_a : null,
    });
    if (tick % TRAIL_EVERY === 0 && touching && columns.position_x_m[i] !== null)
      places.push({
        time_s: columns.time_s[i],
        x_m: columns.position_x_m[i],
        y_m: columns.position_y_m[i],
        cof: columns.measured_cof[i],
      });
  });
  page.newestS = columns.time_s.at(-1);
  screen.follow(places, page.newestS);
  if (page.paused || performance.now() - page.plotMs < READ_MS) return;
  page.plotMs = performance.now();
  showTime();
}

// What plays, or what is selected while nothing does.
function showTexture() {
  const { status, selected } = page;
  if (!status || !page.textures) return;
  screen.reach = status.reachable_cof;
  const playing = status.state === "rendering",
    name = playing ? status.texture : selected;
  const inScene = playing && objects.scene !== null;
  const of = JSON.stringify([
    playing,
    name,
    playing && name === null ? status.target_cof : 0,
    inScene,
  ]);
  if (of === page.textureOf) return;
  page.textureOf = of;
  if (playing && name === null) screen.showFlat(status.target_cof, `friction ${status.target_cof}`);
  else if (!name) screen.showNothing("no texture");
  else if (inScene) showPlaying();
  else if (playing && !hasPicture(name)) showPlaying();
  else if (!hasPicture(name)) screen.showNothing(`${name}, not playing`);
  else
    screen.showTexture(
      name,
      playing ? name : `${name}, not playing`,
      playing ? showPlaying : () => screen.showNothing(`${name}, not playing`),
    );
}

const hasPicture = (name) => page.textures.includes(name) && !page.scripts.includes(name);

// What plays is in no library, or changes with time: the daemon's coarse map of it.
async function showPlaying() {
  const map = await quietly(() => ask("GET", "/texture")),
    { status } = page;
  if (!map || status?.state !== "rendering" || !status.texture) return;
  const values = map.cof.flat().filter((cof) => cof !== null),
    ends = [Math.min(...values), Math.max(...values)];
  const range = ends[1] > ends[0] ? ends : status.reachable_cof;
  const picture = document.createElement("canvas");
  [picture.width, picture.height] = [map.x_m.length, map.y_m.length];
  const pen = picture.getContext("2d"),
    image = pen.createImageData(picture.width, picture.height);
  map.cof.flat().forEach((cof, i) => {
    if (cof !== null) image.data.set([...SCALE[levelOf(cof, range)], 255], 4 * i);
  });
  pen.putImageData(image, 0, 0);
  screen.showCoarse({ ...map, picture, range }, `${status.texture}, coarse`);
  objects.draw();
}

async function fetchNames() {
  await quietly(async () => {
    Object.assign(page, await ask("GET", "/textures"));
    showTexture();
    await controls.fetchNames();
    page.carrier = await ask("GET", "/carrier");
  });
}

setInterval(fetchSurface, SLOW_MS);
setInterval(() => {
  if (page.linked && !page.textures) fetchNames();
}, SLOW_MS);
setInterval(() => {
  if (screen.coarse && page.linked) showPlaying();
}, SLOW_MS);

// --- the daemon is heard -------------------------------------------------------------------------

function onFrame({ time_s, unix_time_s, status, newest, ticks, samples }) {
  const first = !page.linked,
    now = performance.now() / 1000;
  Object.assign(page, { linked: true, status, newest, wallS: unix_time_s - time_s });
  const { overruns, underruns } = status;
  page.frames.push({ time_s: now, newest, ticks, overruns, underruns });
  while (page.frames[0].time_s < now - LATE_S) page.frames.shift();
  if (first) {
    $("link").textContent = "connected";
    document.body.dataset.link = "up";
    happened.clock(page.wallS);
    fetchNames();
    fetchSurface();
    objects.stir();
  }
  take(samples);
  if (!page.awaited) page.awaited = requestAnimationFrame(show);
}

function onLost() {
  Object.assign(page, {
    linked: false,
    frames: [],
    status: null,
    newest: null,
    textureOf: null,
    surfaceOf: null,
  });
  page.history.clear();
  objects.forget();
  document.body.dataset.link = "lost";
  $("link").textContent = "connection lost";
  show();
}

const stream = new Stream(
  `/state?${new URLSearchParams([["period_s", FRAME_S], ...COLUMNS.map((name) => ["column", name])])}`,
  { message: onFrame, lost: onLost, chatty: true },
);
const OF_TARGETS = ["scene", "texture", "target", "state"];
new Stream("/events", {
  opened: () => happened.begin(),
  message: (event) => {
    if (OF_TARGETS.includes(event.kind) && !objects.held) objects.stir();
    if (event.kind !== "scene") happened.add(event);
    showInterval(event);
  },
});

// --- showing -------------------------------------------------------------------------------------

const fixed = (value, digits, unit = "") =>
  value === null || value === undefined ? "–" : `${value.toFixed(digits)}${unit}`;
const brief = (s) =>
  s === null || s === undefined
    ? "–"
    : s >= 1e-3
      ? `${(s * 1e3).toFixed(1)} ms`
      : `${Math.round(s * 1e6)} µs`;
const percent = (share, digits = 0) => `${(100 * share).toFixed(digits)} %`;

function say(id, words) {
  if ($(id).textContent !== words) $(id).textContent = words;
}

function show() {
  page.awaited = 0;
  const { status, newest } = page;
  const state = `${status?.state} ${status?.output_on} ${status?.lease_holder}`,
    changed = state !== page.state;
  if (changed || performance.now() - page.readMs > READ_MS) {
    Object.assign(page, { state, readMs: performance.now() });
    showState(status);
    controls.show(status);
    if (status) showTexture();
    if (status) showFigures(status, newest);
    const on = page.frames
      .slice(-POINTS)
      .map((f) => f.newest)
      .filter((n) => n?.output_on && n.frequency_hz > 0);
    if (inSight.has($("surface")))
      surface.operates(newest?.output_on && newest.frequency_hz > 0 ? newest : null, on);
  }
  screen.moved(finger(newest));
}

function finger(newest) {
  if (!newest || newest.position_x_m === null) return null;
  const { position_x_m: x_m, position_y_m: y_m, output_x_m, output_y_m, in_contact } = newest;
  return { x_m, y_m, output_x_m, output_y_m, touching: in_contact > 0 };
}

// Which interval of an experiment's trial runs.
function showInterval({ kind, message, data }) {
  const [, number, how] =
    (kind === "marker" && message.match(/^interval (\d) (begins|ends)$/)) || [];
  if (number)
    say("interval", how === "begins" ? `interval ${number}${data.of ? ` of ${data.of}` : ""}` : "");
}

function showState(status) {
  const state = status?.state ?? "unknown";
  const output = { true: "on", false: "off" }[status?.output_on] ?? "unknown";
  document.body.dataset.state = state;
  say("state", state.toUpperCase());
  say("output", output.toUpperCase());
  $("output").title = status?.output_said ?? "";
  if ($("output").className !== `pill ${output}`) $("output").className = `pill ${output}`;
  const title = `${output === "on" ? "● " : ""}${state.toUpperCase()} – haptic-driver`;
  if (document.title !== title) document.title = title;
  let alarm = "";
  if (!status)
    alarm =
      "Connection to the daemon lost: what this page shows is not known to be true, and the output may be on. The daemon ramps to zero by itself when the lease runs out.";
  else {
    if (state === "fault") alarm = `Fault: ${status.fault}. Remove the cause, then reset. `;
    if (output === "unknown")
      alarm += "Nobody knows whether the output is on. Use the emergency stop.";
  }
  say("alarm", alarm);
  $("alarm").hidden = alarm === "";
}

function showFigures(status, newest) {
  $("simulated").hidden = !status.simulated;
  say("rig", `rig ${status.rig}${status.texture ? `, texture ${status.texture}` : ""}`);
  say("target_cof", fixed(status.target_cof, 3));
  const estimated = status.estimated_cof !== null;
  say("felt", estimated ? "Estimated" : "Measured");
  say(
    "measured_cof",
    estimated
      ? `${fixed(status.estimated_cof, 3)} ± ${fixed(status.estimated_cof_std, 3)}`
      : fixed(status.measured_cof, 3),
  );
  const error = status.fidelity?.relative_error_rms ?? null;
  say("error", error === null ? "–" : percent(error, 1));
  say("score", scoreWords(status.fidelity));
  $("score").title = allWords(status.fidelity);
  showBands($("bands"), status.fidelity, page.carrier?.bands_hz);
  say("voltage_v", fixed(status.voltage_v, 1, " V"));
  say(
    "frequency_hz",
    status.frequency_hz === null ? "–" : `${Number(status.frequency_hz.toPrecision(4))} Hz`,
  );
  showRipple(status);
  $("contacts").hidden = status.contacts === null;
  say("contacts", `Fingers and palms on the screen: ${status.contacts}`);
  showLoad(status.load);
  say(
    "current_rms_a",
    status.current_rms_a === null ? "–" : `${(1e6 * status.current_rms_a).toFixed(1)} µA`,
  );
  say("normal_force_n", newest?.in_contact ? fixed(newest.normal_force_n, 2, " N") : "–");
  say("feedback_gain", fixed(newest?.feedback_gain, 3));
  say("speed", newest?.in_contact ? `${(newest.speed_m_s * 1e3).toFixed(0)} mm/s` : "no finger");
  say("actuator", status.actuator);
  say("real_time", status.real_time ? "real time" : "not real time");
  say("latency", latencyWords(status));
  say(
    "recording",
    status.recording_fault
      ? `${status.recording ?? "waiting"}; a part is missing: ${status.recording_fault}`
      : (status.recording ?? "none"),
  );
  say(
    "surface_hash",
    `${status.model.split("/").at(-1)}, surface ${status.surface_hash.slice(0, 12)}`,
  );
  showInstruments($("instruments"), status.instruments);
  happened.showFlags(status.flags);
  showAgreement($("agreement"), status.agreement);
  why.show(status);
  say(
    "disagreement",
    status.disagreement ??
      (status.agreement.length
        ? "As the model expects."
        : "Not known yet: a minute of sliding tells."),
  );
  showTicks(status);
}

// What the carrier leaves in friction while there is any voltage.
function showRipple({ frequency_hz, voltage_v }) {
  const known = page.carrier && frequency_hz !== null && voltage_v > 0;
  say("ripple", known ? rippleWords(frequency_hz, page.carrier) : "–");
}

// What the load stage does; nothing on a rig without one.
function showLoad(load) {
  $("load").hidden = !load;
  if (!load) return;
  const phase = load.phase.replace("_", " "),
    asked = load.target_n === null ? "" : ` ${load.target_n} N`;
  say("load", `Load stage: ${phase}${asked}, ${fixed(load.load_n, 2, " N")} measured`);
  $("load").classList.toggle("some", load.phase === "may_press");
}

// All about the ticks in one line; in red while some were missed within the last seconds.
function showTicks(status) {
  const late = page.frames.map((f) => f.ticks.lateness_max_s ?? 0),
    last = page.frames.at(-1).ticks;
  const { overruns, underruns } = page.frames[0];
  const missed = status.overruns - overruns,
    gaps = status.underruns - underruns;
  const since = `${status.overruns} and ${status.underruns} in ${status.ticks.toLocaleString("en")} ticks`;
  const inTime =
    status.timing.in_time === null ? "" : `${percent(status.timing.in_time)} in time, `;
  say(
    "ticks",
    `Ticks: ${inTime}${brief(last.lateness_median_s)} late, ${brief(Math.max(...late))} at most in 10 s; ${brief(last.compute_median_s)} computing; ` +
      `${missed} overruns, ${gaps} underruns meanwhile, ${since}`,
  );
  $("ticks").classList.toggle("some", missed + gaps > 0);
}

// What the plot shows of now.
function present() {
  const { history, spanS, newestS: nowS, wallS } = page;
  return { ...history.shown(spanS), nowS, wallS };
}

function showTime() {
  const shown = page.paused ?? present();
  if (!inSight.has($("friction")) || document.hidden) return;
  drawTimePlot($("friction"), shown, page.spanS);
}

// --- what the user looks at ----------------------------------------------------------------------

const watching = new IntersectionObserver((entries) => {
  for (const { target, isIntersecting } of entries) {
    if (isIntersecting) inSight.add(target);
    else inSight.delete(target);
  }
  showTime();
});
for (const id of ["friction", "surface"]) watching.observe($(id));

$("pause").addEventListener("click", () => {
  page.paused = page.paused ? null : present();
  $("pause").setAttribute("aria-pressed", `${page.paused !== null}`);
  say("pause", page.paused ? "Resume" : "Pause");
  showTime();
});
$("spans").addEventListener("change", ({ target }) => {
  page.spanS = Number(target.value);
  if (page.paused) page.paused = { ...page.paused, ...page.history.shown(page.spanS) };
  showTime();
});
$("zoom-in").addEventListener("click", () => screen.zoomBy(2));
$("zoom-out").addEventListener("click", () => screen.zoomBy(0.5));
$("zoom-fit").addEventListener("click", () => screen.fit());
$("finger").addEventListener("shown", ({ detail }) => say("shown", detail));

function drawAll() {
  readTheme();
  screen.drawAll();
  surface.draw();
  surface.drawPoint();
  showTime();
}

const THEMES = { auto: "light dark", light: "light", dark: "dark" };
function setTheme(name) {
  document.documentElement.style.colorScheme = THEMES[name];
  localStorage.setItem("theme", name);
  say("theme", `◐ ${name}`);
  $("theme").setAttribute("aria-label", `Colours: ${name}`);
  drawAll();
}
$("theme").addEventListener("click", () => {
  const names = Object.keys(THEMES);
  setTheme(names[(names.indexOf(localStorage.getItem("theme") ?? "auto") + 1) % names.length]);
});
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", drawAll);
new ResizeObserver(() => requestAnimationFrame(drawAll)).observe(document.querySelector("main"));
setTheme(localStorage.getItem("theme") ?? "auto");
show();
