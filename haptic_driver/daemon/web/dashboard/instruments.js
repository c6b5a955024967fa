// How well each instrument answers: a row each, and one more in red for what is wrong with it.

const time = (s) =>
  s === null ? "–" : s < 1 ? `${Number((1e3 * s).toPrecision(2))} ms` : `${s.toFixed(1)} s`;

export function showInstruments(body, instruments) {
  body.closest("table").hidden = instruments.length === 0;
  body.replaceChildren(...instruments.flatMap(rows));
}

function rows({ name, age_s, read_s, missed, asked, every_s, jitter_s, wrong }) {
  const row = document.createElement("tr"),
    words = [name.replace(/[_.]/g, " "), time(age_s), time(read_s), `${missed}`];
  if (every_s !== null) words[2] += `, reports every ${time(every_s)} ± ${time(jitter_s)}`;
  for (const said of words) row.insertCell().textContent = said;
  row.lastChild.title = `of ${asked} questions`;
  if (!wrong) return [row];
  const below = document.createElement("tr"),
    cell = below.insertCell();
  cell.colSpan = words.length;
  cell.className = "some";
  cell.textContent = wrong;
  return [row, below];
}
