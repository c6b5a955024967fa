// Mending the model while it renders, and the diagnosis of what was rendered: asked for, waited
// for, shown, used.

import { ask } from "./connection.js";

const LOOK_MS = 1000; // while it runs

const $ = (id) => document.getElementById(id);

export class Why {
  // `controls` shows what the daemon refuses.
  constructor(controls) {
    this.controls = controls;
    $("adapt").addEventListener("click", () =>
      controls.command(() =>
        ask("POST", "/adapt", { on: $("adapt").getAttribute("aria-pressed") !== "true" }),
      ),
    );
    $("why").addEventListener("click", () => this.begin());
    $("answer-show").addEventListener("click", () => this.open());
    $("answer-use").addEventListener("click", () =>
      controls.command(() => ask("POST", "/model", { name: this.model })),
    );
    $("report-close").addEventListener("click", () => $("report").close());
  }

  show({ adaptation }) {
    $("adapt").setAttribute("aria-pressed", `${adaptation !== null}`);
    $("adaptation").hidden = adaptation === null;
    $("adaptation").textContent = adaptation ?? "";
  }

  async begin() {
    let answer = await this.controls.command(() => ask("POST", "/why", {}));
    while (answer) {
      this.tell(answer);
      if (answer.state !== "running") return;
      await new Promise((over) => setTimeout(over, LOOK_MS));
      answer = await this.controls.command(() => ask("GET", "/why"));
    }
  }

  tell({ state, said, suspects, more, model, effects }) {
    const names = Object.entries(suspects).map(
      ([name, share]) => `${name.replaceAll("_", " ")} ${Math.round(100 * share)} %`,
    );
    const further = more.map((purpose) => `haptic investigate could add what ${purpose}.`);
    $("answer").hidden = false;
    $("answer-said").textContent = [
      said,
      names.length ? `Most probable: ${names.join(", ")}.` : "",
      ...further,
    ].join(" ");
    $("answer-show").hidden = state !== "done";
    $("answer-use").hidden = state !== "done" || !effects.length;
    this.model = model;
  }

  async open() {
    const page = await this.controls.command(() => ask("GET", "/why/page"));
    if (!page) return;
    $("report-page").srcdoc = page.html;
    $("report").showModal();
  }
}
