// The participant's page: shows what the experiment asks by markers, and answers by markers; see
// docs/experiments.md.

import { ask, Stream } from "./connection.js";

const at = (id) => document.getElementById(id);
let question = null; // the one that waits for an answer: { number, answers }
let newest = 0;
const TONE_HZ = 880,
  TONE_S = 0.15,
  TONE_LEVEL = 0.2;

function show(text, answers = []) {
  at("text").textContent = text;
  at("answers").replaceChildren(
    ...answers.map((answer, i) => {
      const button = document.createElement("button");
      button.type = "button";
      button.textContent = answer;
      button.setAttribute("aria-keyshortcuts", String(i + 1));
      button.onclick = () => choose(answer);
      return button;
    }),
  );
}

async function choose(answer) {
  if (!question) return;
  const { number } = question;
  question = null; // one answer, however often somebody presses
  show("…");
  try {
    await ask("POST", "/mark", { label: "answer", data: { question: number, answer } });
  } catch (refusal) {
    show(refusal.message);
  }
}

const HEARD = {
  "trial begins": () => {
    question = null;
    at("told").textContent = "";
    show("Get ready.");
  },
  "trial ends": () => {
    question = null;
  },
  question: ({ number, data }) => {
    question = null;
    const { text, answers } = data;
    if (
      typeof text !== "string" ||
      !Array.isArray(answers) ||
      !answers.every((one) => typeof one === "string")
    ) {
      // a marker of another program, which anyone may send
      show("Please wait: this question cannot be shown.");
      return;
    }
    question = { number };
    show(text, answers);
  },
  answer: ({ data }) => {
    if (question && data.question === question.number) {
      question = null;
      show("…");
    }
  },
  told: ({ data }) => {
    at("told").textContent = data.text;
  },
  "session ends": () => {
    question = null;
    show("This is the end. Thank you.");
  },
};

function hear(event) {
  if (event.number <= newest) return; // told again after the connection was lost
  newest = event.number;
  if (event.kind !== "marker") return;
  HEARD[event.message]?.(event);
  const interval = event.message.match(/^interval (\d) (begins|ends)$/);
  if (interval) showInterval(interval[1], interval[2] === "begins", event.data);
}

function showInterval(number, begins, { of = 2, sound = false }) {
  if (!begins) return show(Number(number) < of ? "Wait." : "…");
  show(of > 1 ? `${number}: slide your finger on the screen.` : "Slide your finger on the screen.");
  if (sound) ring();
}

// A browser lets a page sound once somebody has pressed something there.
let audio = null;
function ring() {
  audio ??= new AudioContext();
  const tone = audio.createOscillator(),
    level = audio.createGain();
  tone.frequency.value = TONE_HZ;
  level.gain.value = TONE_LEVEL;
  tone.connect(level).connect(audio.destination);
  tone.start();
  tone.stop(audio.currentTime + TONE_S);
}

addEventListener("keydown", ({ key, repeat }) => {
  if (!repeat) at("answers").children[Number(key) - 1]?.click();
});
at("stop").onclick = async () => {
  question = null;
  stream.say("disarm");
  try {
    const { output_on } = await ask("POST", "/disarm");
    show(
      output_on === false
        ? "Stopped. The screen is off."
        : "Take your finger off the screen and call for help.",
    );
  } catch {
    show("Take your finger off the screen and call for help.");
  }
};

const stream = new Stream("/events", {
  message: hear,
  lost: () => {
    newest = 0;
    question = null;
    show("Please wait: the experiment is not connected.");
  },
});
