// How near measured friction was to its target, as the daemon measures it: in words, and band by band.

const FULL = 1.5; // the gain that fills a bar
const GOOD = [0.8, 1.2];
const ROUNDING = 1e-9;

let shown = "";

// The score of `fidelity`, of `GET /status`; empty without sliding.
export const scoreWords = (fidelity) => fidelity?.said[0] ?? "";

// All that the daemon says of it, a sentence each line.
export const allWords = (fidelity) => (fidelity?.said ?? []).join(".\n");

// The latency from measured friction, beside what the rig's file says.
export function latencyWords({
  latency_measured_s,
  latency_error_s,
  latency_why,
  latency_budget_s,
}) {
  const { total, ...parts } = latency_budget_s,
    ms = (s) => (1e3 * s).toFixed(1);
  const shares = Object.entries(parts).map(([part, s]) => `${part.replaceAll("_", " ")} ${ms(s)}`);
  const budget = `${ms(total)} ms by the rig's file${shares.length ? `: ${shares.join(", ")}` : ""}`;
  if (latency_measured_s === null) return `${budget}; not measured: ${latency_why}`;
  return `${ms(latency_measured_s)} ± ${ms(latency_error_s)} ms measured, ${budget}`;
}

// A bar for the gain of each band; `edges_hz`: their edges. Grey where it lies above reach, or
// cannot be told.
export function showBands(list, fidelity, edges_hz) {
  const key = JSON.stringify([fidelity?.band_gain, fidelity?.band_coherence, edges_hz]);
  if (key === shown) return;
  shown = key;
  const centres_hz = (edges_hz ?? []).slice(1).map((edge, i) => Math.sqrt(edge * edges_hz[i]));
  list.replaceChildren(...centres_hz.map((hz, i) => bandOf(hz, i, fidelity)));
}

function bandOf(hz, i, fidelity) {
  const [item, box, bar, label] = ["li", "b", "i", "span"].map((tag) =>
    document.createElement(tag),
  );
  const gain = fidelity?.band_gain[i] ?? null;
  const beyond = Boolean(fidelity?.reach_hz) && hz > fidelity.reach_hz * (1 + ROUNDING);
  label.textContent = hz.toFixed(0);
  item.title = bandWords(hz, gain, fidelity?.band_coherence[i] ?? null, beyond);
  item.setAttribute("aria-label", item.title);
  if (beyond || gain === null) item.classList.add("unknown");
  else item.classList.toggle("off", gain < GOOD[0] || gain > GOOD[1]);
  bar.style.height = `${(100 * Math.min(gain ?? 0, FULL)) / FULL}%`;
  box.append(bar);
  item.append(box, label);
  return item;
}

function bandWords(hz, gain, coherence, beyond) {
  const at = `${hz.toFixed(0)} Hz`;
  if (gain === null)
    return `${at}: ${beyond ? "above what this rig can do" : "too little is asked for, or too short a time"}`;
  const words = `${at}: gain ${gain.toFixed(2)}, coherence ${coherence === null ? "unknown" : coherence.toFixed(2)}`;
  return beyond ? `${words}, above what this rig can do` : words;
}
