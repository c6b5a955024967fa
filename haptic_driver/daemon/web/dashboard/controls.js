// What the user asks for: buttons, the lease, and why something cannot be asked for now. The daemon
// judges, not the page.

import { Refusal, ask } from "./connection.js";
import { fetchTile } from "./tiles.js";

const THUMBNAIL = { columns: 100, rows: 60, pitch_m: 2e-4 }; // 20 mm wide
const NO_PICTURE = "data:image/gif;base64,R0lGODlhAQABAAAAACwAAAAAAQABAAA=";
const RENEWALS = 5; // per lease
const SAME_REACH = 0.01; // of friction: the slider does not tremble with the load

const $ = (id) => document.getElementById(id);

// Who is at this page, for others who want the lease.
const HOLDER = `a page (${navigator.userAgent.match(/(Firefox|Edg|Chrome|Safari)\/\d+/)?.[0].replace("/", " ") ?? "browser"})`;

export class Controls {
  lease = null;
  arming = null;
  status = null;
  reach = null;

  // `chosen` is called with the name of a texture that is selected, `say` with what goes over the
  // open stream.
  constructor(chosen, say) {
    Object.assign(this, { chosen, say });
    this.reasons = {};
    $("off").addEventListener("click", () => this.off());
    document.addEventListener(
      "keydown",
      (event) => {
        if (event.key === "Escape") this.off();
      },
      true,
    );
    this.button("arm", () => {
      this.arming = this.arm().finally(() => {
        this.arming = null;
      });
      return this.arming;
    });
    this.button("disarm", () => this.disarm());
    this.button("reset", () => ask("POST", "/reset"));
    this.form("set", () =>
      this.holding("/set", { cof: $("cof").valueAsNumber, nearest: $("nearest").checked }),
    );
    this.form("play", () =>
      this.holding("/texture", { name: this.texture, nearest: $("nearest").checked }),
    );
    this.form("record", () =>
      ask("POST", "/record", { path: this.status?.recording ? null : $("path").value }),
    );
    this.form("mark", () => this.mark());
    this.form("use", () => ask("POST", "/model", { name: $("model").value }));
    $("cof-slider").addEventListener("input", () => {
      $("cof").value = $("cof-slider").value;
    });
    $("cof").addEventListener("input", () => {
      $("cof-slider").value = $("cof").value;
    });
    $("refusal-close").addEventListener("click", () => {
      $("refusal").hidden = true;
    });
    $("textures").addEventListener("change", () => this.choose());
    window.addEventListener("pagehide", () => {
      if (this.lease) ask("POST", "/disarm").catch(() => {});
    });
  }

  get texture() {
    return document.querySelector("#textures input:checked")?.value ?? "";
  }

  // --- asking ------------------------------------------------------------------------------------

  button(id, work) {
    $(id).addEventListener("click", () => this.unlessGrey($(id), work));
  }

  form(id, work) {
    $(id).addEventListener("submit", (event) => {
      event.preventDefault();
      this.unlessGrey($(id).querySelector("[type=submit]"), work);
    });
  }

  // A button that is grey says why.
  unlessGrey(button, work) {
    if (button.getAttribute("aria-disabled") === "true")
      this.refused(new Refusal("grey", button.title, ""));
    else this.command(work);
  }

  // Run one command; what the daemon refuses is shown, and a success takes an older refusal away.
  async command(work) {
    try {
      const status = await work();
      $("refusal").hidden = true;
      return status;
    } catch (error) {
      if (!(error instanceof Refusal)) throw error;
      this.refused(error);
      return null;
    }
  }

  refused(error) {
    $("refusal-message").textContent = error.message;
    $("refusal-hint").textContent = error.hint ?? "";
    $("refusal").hidden = false;
  }

  async off() {
    $("off").setAttribute("aria-busy", "true");
    this.say("off");
    const status = await this.command(() => ask("POST", "/off"));
    $("off").removeAttribute("aria-busy");
    if (status && status.output_on !== false)
      this.refused(
        new Refusal(
          "not_off",
          "Switching off was ordered, but nothing shows yet that the output is off.",
          "Look at the output above; use the emergency stop if it does not say OFF.",
        ),
      );
  }

  // Among the events, and so into the recording; without words it is a marker all the same.
  async mark() {
    await ask("POST", "/mark", { label: $("note").value.trim() || "mark", data: {} });
    $("note").value = "";
  }

  // --- the lease ---------------------------------------------------------------------------------

  async arm() {
    const lease = await ask("POST", "/arm", {
      lease_s: Number($("lease_s").value),
      holder: HOLDER,
    });
    this.drop();
    this.lease = {
      token: lease.token,
      seconds: lease.lease_s,
      timer: setInterval(() => this.renew(), (1000 * lease.lease_s) / RENEWALS),
    };
    this.show(this.status);
  }

  async disarm() {
    await ask("POST", "/disarm");
    this.drop();
    this.show(this.status);
  }

  drop() {
    clearInterval(this.lease?.timer);
    this.lease = null;
  }

  async renew() {
    const { lease } = this;
    if (!lease || lease.renewing || !this.status) return; // nobody keeps up what nobody sees
    lease.renewing = true;
    try {
      await ask("POST", "/renew", undefined, lease.token);
    } catch (error) {
      if (this.lease === lease && error.code !== "no_answer") {
        // the next may be heard in time
        this.drop();
        this.refused(new Refusal("lease", `The lease is gone: ${error.message}`, "Arm again."));
      }
    }
    lease.renewing = false;
  }

  async holding(path, body) {
    await this.arming?.catch(() => {}); // "armed" may be shown before the lease has come
    return ask("POST", path, body, this.lease?.token);
  }

  // --- what there is -----------------------------------------------------------------------------

  async fetchNames() {
    const { textures, scripts } = await ask("GET", "/textures");
    const { models } = await ask("GET", "/models");
    // by a person, perhaps: names are fetched again when the link comes back
    const chosen = $("model").value;
    $("model").replaceChildren(...models.map((name) => new Option(name)));
    $("model").value = models.includes(chosen) ? chosen : this.status?.model;
    const before = this.texture;
    $("textures").replaceChildren(
      ...textures.map((name) => thumbnail(name, before ? name === before : name === textures[0])),
    );
    this.choose();
    for (const name of scripts) labelOf(name)?.classList.add("script");
    for (const name of textures) if (!scripts.includes(name)) await drawThumbnail(name);
  }

  choose() {
    this.sayChosen();
    this.chosen(this.texture);
  }

  // What Play would play, and what plays, where that is another.
  sayChosen() {
    const chosen = this.texture || "–",
      playing = this.status?.texture
        ?.split("/")
        .pop()
        .replace(/[.]toml$/, "");
    say("chosen", playing && playing !== chosen ? `${chosen} (${playing} plays)` : chosen);
  }

  // --- showing -----------------------------------------------------------------------------------

  // `status`: the newest, null while nobody is heard.
  show(status) {
    this.status = status;
    if (!status) {
      this.grey(everything("the daemon is not heard"));
      return;
    }
    if (status.state === "fault") this.drop();
    else if (this.lease && status.state === "idle") this.endedSoon();
    else this.ending = 0;
    this.grey(this.why(status));
    say("lease", this.leaseWords(status));
    say("reach", `${status.reachable_cof[0].toFixed(2)} to ${status.reachable_cof[1].toFixed(2)}`);
    this.bound(status.reachable_cof);
    const stop = status.recording ? "Stop" : "Record";
    say($("record").querySelector("button"), stop);
    for (const label of document.querySelectorAll("#textures label"))
      label.classList.toggle("playing", label.dataset.name === status.texture);
    this.sayChosen();
  }

  // A frame that was on its way when the lease came says nothing about it.
  endedSoon() {
    this.ending = (this.ending ?? 0) + 1;
    if (this.ending > 4) this.drop();
  }

  leaseWords({ lease_holder, lease_left_s }) {
    if (this.lease)
      return `This page holds the lease of ${this.lease.seconds} s and renews it; without it the output ramps to zero.`;
    return lease_holder
      ? `Held by ${lease_holder}, for ${Math.ceil(lease_left_s ?? 0)} s if not renewed.`
      : "Nobody holds the lease.";
  }

  // Why a button would be refused, "" where it would not.
  why({ state, lease_holder, recording, fault }) {
    const armed = state === "armed" || state === "rendering";
    const ours = this.lease || (armed && this.arming && lease_holder === HOLDER);
    const unready =
      state === "fault"
        ? `In fault: ${fault}. Reset it first.`
        : state === "disconnected"
          ? "The rig is not connected yet."
          : "";
    const output =
      unready ||
      (ours
        ? ""
        : armed
          ? `${lease_holder} holds the lease. Disarm it, or wait for it to end.`
          : "Nobody has armed. Arm first.");
    return {
      arm:
        unready ||
        (armed
          ? ours
            ? "This page has armed already."
            : `${lease_holder} holds the lease. Disarm it, or wait for it to end.`
          : ""),
      disarm: armed ? "" : "Nobody has armed.",
      reset: state === "fault" ? "" : "There is no fault to reset.",
      set: output,
      play: output,
      record: "",
      mark: "",
      use:
        unready ||
        (armed
          ? "A model is changed while idle. Disarm first."
          : recording
            ? "A recording keeps its model. Stop it first."
            : ""),
    };
  }

  grey(reasons) {
    for (const [id, reason] of Object.entries(reasons)) {
      if (this.reasons[id] === reason) continue;
      this.reasons[id] = reason;
      const button = $(id).tagName === "FORM" ? $(id).querySelector("[type=submit]") : $(id);
      button.setAttribute("aria-disabled", `${reason !== ""}`);
      button.title = reason;
    }
  }

  // The slider covers what is within reach.
  bound([low, high]) {
    if (
      this.reach &&
      Math.abs(low - this.reach[0]) < SAME_REACH &&
      Math.abs(high - this.reach[1]) < SAME_REACH
    )
      return;
    if (document.activeElement === $("cof-slider") && $("cof-slider").matches(":active")) return;
    this.reach = [low, high];
    Object.assign($("cof-slider"), {
      min: low.toFixed(3),
      max: high.toFixed(3),
      value: $("cof").value,
    });
  }
}

const everything = (reason) =>
  Object.fromEntries(
    ["arm", "disarm", "reset", "set", "play", "record", "mark", "use"].map((id) => [id, reason]),
  );

function say(where, words) {
  const element = typeof where === "string" ? $(where) : where;
  if (element.textContent !== words) element.textContent = words;
}

function thumbnail(name, checked) {
  const label = document.createElement("label"),
    input = document.createElement("input"),
    image = document.createElement("img");
  Object.assign(input, { type: "radio", name: "texture", value: name, checked });
  Object.assign(image, {
    alt: "",
    width: THUMBNAIL.columns,
    height: THUMBNAIL.rows,
    src: NO_PICTURE,
  });
  label.dataset.name = name;
  label.append(input, image, name.replaceAll("_", "_\u200b"));
  return label;
}

const labelOf = (name) =>
  document.querySelector(`#textures label[data-name="${CSS.escape(name)}"]`);

async function drawThumbnail(name) {
  const image = labelOf(name)?.querySelector("img");
  if (!image) return;
  try {
    const { picture } = await fetchTile(
      name,
      0,
      0,
      THUMBNAIL.pitch_m,
      THUMBNAIL.columns,
      THUMBNAIL.rows,
    );
    image.src = picture.toDataURL(); // a canvas is drawn anew with every frame
  } catch (error) {
    if (!(error instanceof Refusal)) throw error;
    image.closest("label").setAttribute("title", error.message);
  }
}
