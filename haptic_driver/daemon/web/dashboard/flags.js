// Flags and events: what each flag means, since when it is up, how often it went up; times by the
// clock on the wall.

const MOST_EVENTS = 300;
const MEANING = {
  overrun: "a tick was missed: the machine was too late",
  saturated_sensor: "a force sensor reads beyond its range; no output meanwhile",
  stale_sensor: "the finger's place or force is too old; no output meanwhile",
  unreachable: "the friction asked for was out of reach at this load",
  rejected: "the last gate refused a point beyond a limit",
  lease_lost: "the lease was not renewed in time; the output ramped to zero",
  tripped: "the rig switched off: the electrode was not as commanded",
  fault: "the daemon is or was in fault",
  outside_surface: "the finger presses harder or slides faster than the model was solved for",
  feedback_limit: "the finger's gain is at the end of what feedback may correct",
  underrun: "the analog envelope had a gap, at zero",
  friction_from_current: "no force sensor: friction is estimated from the electrode's current",
  latency: "friction follows more than 10 ms sooner or later than the rig's file says",
  event_line: "an edge of the event line is missing",
  by_time: "waves finer than the finger's place is known have their length, not their place",
  control_silent: "render did not hear control; the output ramped to zero",
};
// Kinds of events, beside "flag".
const TOLD_BY = {
  tripped: "trip",
  fault: "fault",
  lease_lost: "lease",
  latency: "latency",
  event_line: "event_line",
};

const $ = (id) => document.getElementById(id);
const time = (unixS) => new Date(1000 * unixS).toLocaleTimeString("en-GB");

export class Happened {
  events = [];
  wallS = null; // what to add to the daemon's clock
  shown = "";

  begin() {
    this.events = [];
    $("events").replaceChildren();
  }

  // The clock of events, against that on the wall.
  clock(wallS) {
    const first = this.wallS === null;
    this.wallS = wallS;
    if (first) this.events.forEach((event) => this.list(event));
  }

  add(event) {
    this.events.push(event);
    if (this.wallS !== null) this.list(event);
  }

  list({ time_s, kind, message }) {
    const item = document.createElement("li"),
      when = new Date(1000 * (time_s + this.wallS));
    const [at, what, words] = ["time", "span", "span"].map((tag) => document.createElement(tag));
    item.classList.add(kind);
    what.className = "kind";
    at.dateTime = when.toISOString();
    at.title = when.toLocaleString("en-GB");
    at.textContent = `${when.toLocaleTimeString("en-GB")}.${`${when.getMilliseconds()}`.padStart(3, "0")}`;
    what.textContent = kind;
    words.textContent = message;
    item.append(at, what, words);
    $("events").prepend(item);
    while ($("events").childElementCount > MOST_EVENTS) $("events").lastElementChild.remove();
  }

  showFlags(flags) {
    const key = `${flags} ${this.events.length} ${this.wallS === null}`;
    if (key === this.key) return;
    this.key = key;
    const said = flags.length ? flags.map((name) => this.words(name)) : ["none since arming"];
    if (this.shown === said.join("\n")) return;
    this.shown = said.join("\n");
    $("flags").replaceChildren(
      ...said.map((words) => {
        const item = document.createElement("li");
        item.textContent = words;
        item.classList.toggle("up", flags.length > 0);
        return item;
      }),
    );
  }

  words(name) {
    const told = this.events.filter(
      ({ kind, message }) => (kind === "flag" && message === name) || kind === TOLD_BY[name],
    );
    const since = told.length
      ? `; since ${time(told.at(-1).time_s + this.wallS)}, ${told.length === 1 ? "once" : `${told.length} times`} in the events`
      : "";
    return `▲ ${name.replaceAll("_", " ")}: ${MEANING[name] ?? "see the events"}${since}`;
  }
}
