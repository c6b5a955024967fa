// How well each instrument answers: a row each, and below it how often a finger's tracker reports,
// and in red what is wrong.

const time = (s) =>
  s === null ? "–" : s < 1 ? `${Number((1e3 * s).toPrecision(2))} ms` : `${s.toFixed(1)} s`;

export function showInstruments(body, instruments) {
  body.closest("table").hidden = instruments.length === 0;
  body.replaceChildren(...instruments.flatMap(rows));
}

function rows({ name, age_s, read_s, missed, asked, every_s, jitter_s, wrong }) {
  const row = document.createElement("tr"),
    words = [name.replace(/[_.]/g, " "), time(age_s), time(read_s), `${missed}`];
  for (const said of words) row.insertCell().textContent = said;
  row.lastChild.title = `of ${asked} questions`;
  const all = [row];
  if (every_s !== null)
    all.push(below(`reports every ${time(every_s)} ± ${time(jitter_s)}`, "reports"));
  if (wrong) all.push(below(wrong, "some"));
  return all;
}

function below(said, kind) {
  const row = document.createElement("tr"),
    cell = row.insertCell();
  cell.colSpan = 4;
  cell.className = kind;
  cell.textContent = said;
  return row;
}
