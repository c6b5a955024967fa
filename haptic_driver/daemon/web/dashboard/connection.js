// What the page says to the daemon and hears from it. Refusals are `Refusal`s; silence is an error
// like any other.

const SILENCE_MS = 1000; // no frame for so long: the connection counts as lost
const RETRY_MS = 500;
const ANSWER_MS = 5000;

export class Refusal extends Error {
  constructor(code, message, hint) {
    super(message);
    this.code = code;
    this.hint = hint;
  }
}

// The address holds the token once, after # or ?; it goes into this tab's storage and out of the
// address.
function token() {
  for (const part of [location.hash.slice(1), location.search.slice(1)]) {
    const given = new URLSearchParams(part).get("token");
    if (given) {
      sessionStorage.setItem("token", given);
      history.replaceState(null, "", location.pathname);
    }
  }
  return sessionStorage.getItem("token") ?? "";
}

const TOKEN = token();

export async function ask(method, path, body, lease) {
  const headers = { "Content-Type": "application/json" };
  if (TOKEN) headers.Authorization = `Bearer ${TOKEN}`;
  if (lease) headers["X-Haptic-Lease"] = lease;
  let response, said;
  try {
    response = await fetch(path, {
      method,
      headers,
      keepalive: method === "POST",
      cache: "no-store",
      body: body === undefined ? undefined : JSON.stringify(body),
      signal: AbortSignal.timeout(ANSWER_MS),
    });
    said = await response.json();
  } catch (error) {
    throw new Refusal(
      "no_answer",
      `The daemon does not answer (${error.message}).`,
      "Whether this was done is unknown. Use the emergency stop if the output must be off.",
    );
  }
  if (!response.ok) {
    const { code = "unknown", message = response.statusText, hint = "" } = said.error ?? {};
    throw new Refusal(code, message, hint);
  }
  return said;
}

// A WebSocket that is opened again whenever it closes, falls silent or is not answered.
export class Stream {
  constructor(path, { opened = () => {}, message, lost = () => {}, chatty = false }) {
    Object.assign(this, { path, opened, message, lost, chatty });
    this.open();
  }

  // What switches off goes this way too: an open connection waits for no other.
  say(words) {
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(words);
  }

  open() {
    const address = new URL(this.path, location.href);
    address.protocol = "ws:";
    if (TOKEN) address.searchParams.set("token", TOKEN);
    const socket = (this.socket = new WebSocket(address));
    let over = false;
    const end = () => {
      if (over) return;
      over = true;
      clearTimeout(timer);
      socket.close();
      this.lost();
      setTimeout(() => this.open(), RETRY_MS);
    };
    let timer = setTimeout(end, ANSWER_MS);
    const alive = () => {
      clearTimeout(timer);
      if (this.chatty) timer = setTimeout(end, SILENCE_MS);
    };
    socket.onopen = () => {
      alive();
      this.opened();
    };
    socket.onmessage = ({ data }) => {
      if (!over) {
        alive();
        this.message(JSON.parse(data));
      }
    };
    socket.onclose = socket.onerror = end;
  }
}
