// Measured against expected friction: a row of squares per condition, redder or bluer the farther off,
// paler the less is known.

const NAMES = {
  frequency_hz: ["frequency", "Hz"],
  voltage_v: ["voltage", "V"],
  normal_force_n: ["load", "N"],
  speed_m_s: ["speed", "m/s"],
};
const FULL = 0.1; // of friction: as red or blue as it gets
const KNOWN = 1e4; // weight of a cell that is no longer pale: 1 % of friction

let shown = "";

export function showAgreement(rows, cells) {
  const key = JSON.stringify(cells);
  if (key === shown) return;
  shown = key;
  rows.replaceChildren(
    ...Object.entries(NAMES).flatMap(([axis, [name, unit]]) => {
      const own = cells.filter((cell) => cell.axis === axis);
      if (!own.length) return [];
      const row = document.createElement("li"),
        label = document.createElement("span");
      label.textContent = name;
      row.append(label, ...own.map((cell) => square(cell, unit)));
      return [row];
    }),
  );
}

function square({ low, high, share, weight }, unit) {
  const element = document.createElement("i"),
    of = (value) => Number(value.toPrecision(3));
  const words = `${(100 * share).toFixed(1)} % at ${of(low)} to ${of(high)} ${unit}`;
  element.title = words;
  element.setAttribute("role", "img");
  element.setAttribute("aria-label", words);
  const strength = Math.round(100 * Math.min(Math.abs(share) / FULL, 1));
  element.style.background = `color-mix(in oklab, ${share > 0 ? "var(--red)" : "var(--blue)"} ${strength}%, var(--nothing))`;
  element.style.opacity = `${0.4 + 0.6 * Math.min(weight / KNOWN, 1)}`;
  return element;
}
