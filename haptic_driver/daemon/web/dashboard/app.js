// The page: hears the daemon's state, shows it, and hands over what the user asks for. The daemon judges, not the page.

import { Refusal, Stream, ask } from "./connection.js";
import { drawFinger, drawFriction, drawLateness, drawSurface, limits, picture } from "./plots.js";

const SPAN_S = 10; // what the plots show
const TRAIL = 30; // frames
const LEASE_S = 2; // browsers slow hidden pages down to about one action per second
const MOST_EVENTS = 300;
const TEXTURE_MS = 1000; // between looks at a texture that plays; scripts change theirs
const SAMPLES_MS = 250; // between looks at the ticks themselves
const MOST_SAMPLES = 500;

const $ = (id) => document.getElementById(id);
const page = {
  frames: [], samples: [], newestTick: 0, fetching: false, status: null, surface: null, surfaceOf: null, texture: null, textureOf: null,
  lease: null, linked: false, awaited: 0,
};

// --- commands ---------------------------------------------------------------------------------------------------

function showRefusal(error) {
  $("refusal-message").textContent = error.message;
  $("refusal-hint").textContent = error.hint ?? "";
  $("refusal").hidden = false;
}

// Run one command; what the daemon refuses is shown, and a success takes an older refusal away.
async function command(work) {
  try {
    const status = await work();
    $("refusal").hidden = true;
    return status;
  } catch (error) {
    if (!(error instanceof Refusal)) throw error;
    showRefusal(error);
    return null;
  }
}

async function off() {
  $("off").setAttribute("aria-busy", "true");
  const status = await command(() => ask("POST", "/off"));
  $("off").removeAttribute("aria-busy");
  if (status && status.output_on !== false)
    showRefusal(new Refusal("not_off", "Switching off was ordered, but nothing shows yet that the output is off.",
      "Look at the output above; use the emergency stop if it does not say OFF."));
}

function dropLease(words) {
  clearInterval(page.lease?.timer);
  page.lease = null;
  $("lease").textContent = words;
}

async function renew() {
  const lease = page.lease;
  if (!lease || lease.renewing || !page.linked) return; // nobody keeps up what nobody sees
  lease.renewing = true;
  try {
    await ask("POST", "/renew", undefined, lease.token);
  } catch (error) {
    if (page.lease === lease) dropLease(`The lease is gone: ${error.message}`);
  }
  lease.renewing = false;
}

async function arm() {
  const lease = await command(() => ask("POST", "/arm", { lease_s: LEASE_S }));
  if (!lease) return;
  dropLease("");
  page.lease = { token: lease.token, timer: setInterval(renew, (1000 * lease.lease_s) / 5) };
  $("lease").textContent = `This page holds the lease and renews it; without it the output ramps to zero within ${lease.lease_s} s.`;
}

async function disarm() {
  if (await command(() => ask("POST", "/disarm"))) dropLease("This page holds no lease.");
}

async function askHolding(path, body) {
  await page.arming; // "armed" may be shown before the lease has come
  return ask("POST", path, body, page.lease?.token);
}

function submit(id, work) {
  $(id).addEventListener("submit", (event) => {
    event.preventDefault();
    command(work);
  });
}

$("off").addEventListener("click", off);
document.addEventListener("keydown", (event) => { if (event.key === "Escape") off(); }, true);
$("arm").addEventListener("click", () => { page.arming = arm(); });
$("disarm").addEventListener("click", disarm);
$("reset").addEventListener("click", () => command(() => ask("POST", "/reset")));
$("refusal-close").addEventListener("click", () => { $("refusal").hidden = true; });
submit("set", () => askHolding("/set", { cof: $("cof").valueAsNumber }));
submit("play", () => askHolding("/texture", { name: $("texture").value }));
window.addEventListener("pagehide", () => { if (page.lease) ask("POST", "/disarm").catch(() => {}); });

// --- what there is to show ----------------------------------------------------------------------------------------

async function fetchOnce() {
  try {
    const { textures } = await ask("GET", "/textures");
    const chosen = $("texture").value;
    $("texture").replaceChildren(...textures.map((name) => new Option(name, name, false, name === chosen)));
  } catch (error) {
    showRefusal(error);
  }
}

async function fetchSurface() {
  if (!page.linked) return;
  const of = page.status.surface_hash;
  if (of === page.surfaceOf) return;
  try {
    const surface = await ask("GET", "/surface");
    const columns = surface.voltage_v.map((_, v) => surface.cof.map((row) => row[v]));
    page.surface = { ...surface, shown: picture(columns) };
    page.surfaceOf = of;
  } catch (error) {
    if (!(error instanceof Refusal)) throw error;
  }
}

async function fetchTexture() {
  if (!page.linked) return;
  const { state, texture, target_cof } = page.status;
  const playing = state === "rendering", wanted = playing ? (texture ?? `friction ${target_cof}`) : "nothing";
  if (wanted === page.textureOf && !(playing && texture)) return;
  try {
    const map = await ask("GET", "/texture");
    const cof = playing ? map.cof : map.cof.map((row) => row.map(() => null));
    page.texture = { ...map, shown: picture(cof) };
    page.textureOf = wanted;
  } catch (error) {
    if (!(error instanceof Refusal)) throw error;
  }
}

// What the friction plot shows: every other tick, since textures are too fast for the frames.
async function fetchSamples() {
  if (!page.linked || document.hidden || page.fetching) return;
  page.fetching = true;
  try {
    const columns = await ask("GET", `/samples?since=${page.newestTick}&most=${MOST_SAMPLES}`);
    columns.tick.forEach((tick, i) => {
      page.newestTick = tick;
      if (tick % 2) return;
      page.samples.push({ time_s: columns.time_s[i], target: columns.target_cof[i], measured: columns.measured_cof[i],
        expected: columns.output_on[i] ? columns.expected_cof[i] : null });
    });
    const oldest = page.samples.findIndex((sample) => sample.time_s >= page.samples.at(-1).time_s - SPAN_S);
    page.samples.splice(0, Math.max(oldest, 0));
  } catch (error) {
    if (!(error instanceof Refusal)) throw error;
  }
  page.fetching = false;
}

setInterval(fetchSurface, TEXTURE_MS);
setInterval(fetchTexture, TEXTURE_MS);
setInterval(fetchSamples, SAMPLES_MS);

function onFrame({ status, newest, ticks }) {
  const first = !page.linked;
  page.linked = true;
  page.status = status;
  const now = performance.now() / 1000;
  page.frames.push({ time_s: now, newest, ticks });
  while (page.frames[0].time_s < now - SPAN_S) page.frames.shift();
  if (first) {
    $("link").textContent = "connected";
    document.body.dataset.link = "up";
    fetchOnce();
    fetchSurface();
    fetchTexture();
  }
  if (page.lease && (status.state === "idle" || status.state === "fault")) dropLease("The lease has ended.");
  if (!page.awaited) page.awaited = requestAnimationFrame(show);
}

function onLost() {
  page.linked = false;
  page.frames = [];
  page.samples = [];
  page.newestTick = 0;
  page.status = null;
  page.textureOf = null;
  document.body.dataset.link = "lost";
  $("link").textContent = "connection lost";
  show();
}

function onEvent(event) {
  const item = document.createElement("li");
  const time = document.createElement("time"), kind = document.createElement("span"), words = document.createElement("span");
  item.className = kind.className = "";
  item.classList.add(event.kind);
  kind.classList.add("kind");
  time.textContent = `${event.time_s.toFixed(2)} s`;
  kind.textContent = event.kind;
  words.textContent = event.message;
  item.append(time, kind, words);
  $("events").prepend(item);
  while ($("events").childElementCount > MOST_EVENTS) $("events").lastElementChild.remove();
}

new Stream("/state", { message: onFrame, lost: onLost, chatty: true });
new Stream("/events", { opened: () => $("events").replaceChildren(), message: onEvent });

// --- showing ------------------------------------------------------------------------------------------------------

const fixed = (value, digits, unit = "") => (value === null || value === undefined ? "–" : `${value.toFixed(digits)}${unit}`);
const brief = (s) => (s === null || s === undefined ? "–" : s >= 1e-3 ? `${(s * 1e3).toFixed(1)} ms` : `${Math.round(s * 1e6)} µs`);

function say(id, words) {
  if ($(id).textContent !== words) $(id).textContent = words;
}

function showState(status) {
  const state = status?.state ?? "unknown";
  const output = { true: "on", false: "off" }[status?.output_on] ?? "unknown";
  document.body.dataset.state = state;
  say("state", state.toUpperCase());
  say("output", output.toUpperCase());
  $("output").className = `pill ${output}`;
  document.title = `${output === "on" ? "● " : ""}${state.toUpperCase()} – haptic-driver`;
  let alarm = "";
  if (!status) alarm = "Connection to the daemon lost: what this page shows is not known to be true, and the output may be on. The daemon ramps to zero by itself when the lease runs out.";
  else if (state === "fault") alarm = `Fault: ${status.fault}. Remove the cause, then reset.`;
  else if (output === "unknown") alarm = "Nobody knows whether the output is on. Use the emergency stop.";
  say("alarm", alarm);
  $("alarm").hidden = alarm === "";
}

function showFigures(status, newest) {
  $("simulated").hidden = !status.simulated;
  say("rig", `rig ${status.rig}${status.texture ? `, texture ${status.texture}` : ""}`);
  say("target_cof", fixed(status.target_cof, 3));
  say("measured_cof", fixed(status.measured_cof, 3));
  say("voltage_v", fixed(status.voltage_v, 1, " V"));
  say("frequency_hz", status.frequency_hz === null ? "–" : `${Number(status.frequency_hz.toPrecision(4))} Hz`);
  say("normal_force_n", fixed(newest?.normal_force_n, 2, " N"));
  say("feedback_gain", fixed(newest?.feedback_gain, 3));
  say("speed", newest?.in_contact ? `${(newest.speed_m_s * 1e3).toFixed(0)} mm/s` : "");
  say("actuator", status.actuator);
  say("real_time", status.real_time ? "real time" : "not real time");
  const { total, ...parts } = status.latency_budget_s;
  const shares = Object.entries(parts).map(([part, s]) => `${part.replaceAll("_", " ")} ${(s * 1e3).toFixed(1)}`);
  say("latency", `${fixed(total === undefined ? null : total * 1e3, 1, " ms")}${shares.length ? `: ${shares.join(", ")}` : ""}`);
  say("tick_count", status.ticks.toLocaleString("en"));
  say("recording", status.recording ?? "none");
  say("surface_hash", `${status.model.split("/").at(-1)}, surface ${status.surface_hash.slice(0, 12)}`);
  showFlags(status.flags);
}

function showFlags(flags) {
  const words = flags.length ? flags.map((name) => `▲ ${name.replaceAll("_", " ")}`) : ["none since arming"];
  if ($("flags").textContent === words.join("")) return;
  $("flags").replaceChildren(...words.map((word) => {
    const item = document.createElement("li");
    item.textContent = word;
    item.classList.toggle("up", flags.length > 0);
    return item;
  }));
}

function showTicks(status, frames) {
  const edges = frames.at(-1)?.ticks.lateness_edges_s ?? [];
  const counts = edges.map((_, i) => frames.reduce((sum, f) => sum + f.ticks.lateness_counts[i], 0));
  drawLateness($("lateness"), edges, counts);
  const last = frames.at(-1)?.ticks;
  say("lateness_median", brief(last?.lateness_median_s));
  say("lateness_most", brief(limits(frames.map((f) => f.ticks.lateness_max_s))?.[1]));
  say("compute_median", brief(last?.compute_median_s));
  for (const name of ["overruns", "underruns"]) {
    say(name, `${status?.[name] ?? "–"}`);
    $(name).classList.toggle("some", (status?.[name] ?? 0) > 0);
  }
}

const there = (newest) => ({ x_m: newest.position_x_m, y_m: newest.position_y_m });

function show() {
  page.awaited = 0;
  const { status, frames } = page, newest = frames.at(-1)?.newest ?? null;
  showState(status);
  if (status) showFigures(status, newest);
  const recent = frames.slice(-TRAIL).map((f) => f.newest).filter((n) => n !== null);
  const touching = recent.filter((n) => n.in_contact && n.position_x_m !== null);
  const on = recent.filter((n) => n.output_on && n.frequency_hz > 0);
  drawFriction($("friction"), page.samples, newest?.time_s ?? page.samples.at(-1)?.time_s ?? 0, SPAN_S);
  drawSurface($("surface"), page.surface, newest?.output_on && newest.frequency_hz > 0 ? newest : null, on);
  drawFinger($("finger"), page.texture, finger(newest), touching.map(there));
  showTicks(status, frames);
}

function finger(newest) {
  if (!newest || newest.position_x_m === null) return null;
  return { ...there(newest), output_x_m: newest.output_x_m, output_y_m: newest.output_y_m, touching: newest.in_contact };
}

window.addEventListener("resize", show);
show();
