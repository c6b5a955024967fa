// The daemon's command channel for a page of one's own. This file stands alone.
//
//   import { Haptic } from "http://127.0.0.1:8470/page/haptic.js";
//   const haptic = await Haptic.open("http://127.0.0.1:8470/page/?token=TOKEN");
//   await haptic.arm();
//   await haptic.scene([{ do: "add", id: "key", shape: { kind: "circle", radius_mm: 8 }, origin_mm: [30, 20], cof: 0.7 }]);
//   haptic.move("key", 35, 20); // as often as one likes
//   haptic.off();
//
// Places are in millimetres from the screen's upper left corner. A page of another origin needs
// `haptic daemon run --allow-origin ORIGIN`. What the page armed is off when the page goes.

const RENEWALS_PER_LEASE = 4;
const ANSWER_MS = 5000;

export class Refusal extends Error {
  constructor({ code, message, hint }) {
    super(message);
    this.code = code;
    this.hint = hint;
  }
}

export class Haptic {
  // `address` is that of the daemon's page, with its token; without one it is this page's own.
  static open(address = location.href) {
    const page = new URL(address);
    const token = page.searchParams.get("token") ?? sessionStorage.getItem("token") ?? "";
    const socket = new WebSocket(`ws://${page.host}/commands?token=${encodeURIComponent(token)}`);
    return new Promise((opened, failed) => {
      const timer = setTimeout(() => socket.close(), ANSWER_MS); // which is an error
      socket.onopen = () => {
        clearTimeout(timer);
        opened(new Haptic(socket));
      };
      // A browser does not say which of these it was.
      const why = `no daemon answers at ${page.host}, or it refused the token or this page's address`;
      socket.onerror = () => failed(new Error(why));
    });
  }

  constructor(socket) {
    this.socket = socket;
    this.tick = 0; // from which on the last answer holds
    this.lost = (error) => console.error(error); // the lease has ended unasked: yours to replace
    this.holds = false; // a lease
    this.asked = 0;
    this.waiting = new Map(); // number -> [done, failed]
    this.moves = new Map(); // object -> its newest place, not said yet
    this.moving = false;
    socket.onmessage = ({ data }) => this.#hear(JSON.parse(data));
    socket.onclose = () => this.#close();
  }

  // One of the API's verbs, and what it is asked; what it answers, or a Refusal.
  ask(verb, asked = {}) {
    return new Promise((done, failed) => {
      if (this.socket.readyState !== WebSocket.OPEN) {
        failed(new Error("the daemon has gone"));
        return;
      }
      this.waiting.set(++this.asked, [done, failed]);
      this.socket.send(JSON.stringify({ id: this.asked, verb, asked }));
    });
  }

  async arm(lease_s = 2, holder = document.title || "a page") {
    const lease = await this.ask("arm", { lease_s, holder });
    this.holds = true;
    clearInterval(this.renewing);
    const period_ms = (1000 * lease_s) / RENEWALS_PER_LEASE;
    this.renewing = setInterval(() => this.ask("renew").catch((error) => this.#lose(error)), period_ms);
    return lease;
  }

  set(cof) {
    return this.ask("set", { cof });
  }

  play(name) {
    return this.ask("play", { name });
  }

  // Changes of the scene, all at one tick; `show` after OFF. `nearest`: a friction that is out of
  // reach is no refusal, and the nearest that can be had is rendered.
  scene(changes, show = false, nearest = false) {
    return this.ask("change_scene", { changes, show, nearest });
  }

  // Where an object is now. Places that come faster than they can be rendered replace each other.
  move(id, x_mm, y_mm) {
    this.moves.set(id, { do: "move", id, x_mm, y_mm });
    if (!this.moving) {
      this.moving = true;
      queueMicrotask(() => this.#say());
    }
  }

  off() {
    return this.ask("off");
  }

  disarm() {
    this.#letGo();
    return this.ask("disarm");
  }

  close() {
    this.#letGo();
    this.socket.close();
  }

  async #say() {
    try {
      while (this.moves.size) {
        const changes = [...this.moves.values()];
        this.moves.clear();
        await this.scene(changes);
      }
    } catch (error) {
      if (error instanceof Refusal) this.lost(error); // that the daemon has gone, `#close` says
    } finally {
      this.moving = false;
    }
  }

  #hear({ id, tick, answer, error }) {
    const [done, failed] = this.waiting.get(id) ?? [];
    this.waiting.delete(id);
    if (error) failed?.(new Refusal(error));
    else {
      this.tick = tick;
      done?.(answer);
    }
  }

  #letGo() {
    clearInterval(this.renewing);
    this.holds = false;
  }

  // Told once: a renewal may be on its way as the connection closes.
  #lose(error) {
    const held = this.holds;
    this.#letGo();
    if (held) this.lost(error);
  }

  #close() {
    const gone = new Error("the daemon has gone");
    for (const [, failed] of this.waiting.values()) failed(gone);
    this.waiting.clear();
    this.#lose(gone);
  }
}
