// @ts-check
// Asks the server. Where it wants to know who asks, the person signs in once: by name and password,
// which gives cookies, or by a key pair, which is kept for this tab.

const KEYS = "fleetledger-keys";
const TIMEOUT_MS = 10_000;

/** A refusal by the server, in its own words. */
export class Refused extends Error {
  /** @param {number} status @param {string} message */
  constructor(status, message) {
    super(message);
    this.status = status;
  }
}

/** @type {Promise<void> | null} */
let asking = null;

/** @returns {Record<string, string>} */
function keyHeaders() {
  const kept = sessionStorage.getItem(KEYS);
  if (!kept) return {};
  const { id, key } = JSON.parse(kept);
  return { "xyy-app-id": id, "xyy-app-key": key };
}

/** @param {string} id @returns {any} */
const byId = (id) => document.getElementById(id);

const WAYS = {
  user: {
    hint: "With the name and password that an admin gave you.",
    labels: ["User name", "Password"],
    other: "Use a key pair instead",
  },
  keys: {
    hint: "With a key pair. The server printed the first one to its log when it first started.",
    labels: ["App id", "App key"],
    other: "Use name and password instead",
  },
};

/** @type {"user" | "keys"} */
let way = "user";

/** @param {string} wrong */
function showWay(wrong) {
  byId("keys-hint").textContent = WAYS[way].hint;
  [byId("app-id-label").textContent, byId("app-key-label").textContent] = WAYS[way].labels;
  byId("keys-other").textContent = WAYS[way].other;
  byId("keys-wrong").textContent = wrong;
  byId("keys-wrong").hidden = !wrong;
}

/** @param {string} id @param {string} key @returns {Promise<string>} what is wrong; empty = nothing */
async function signIn(id, key) {
  if (way === "keys") {
    sessionStorage.setItem(KEYS, JSON.stringify({ id, key })); // the next call shows if it is right
    return "";
  }
  sessionStorage.removeItem(KEYS);
  const body = JSON.stringify({ username: id, password: key });
  const headers = { "Content-Type": "application/json" };
  const answer = await fetch("/api/sign-in", { method: "POST", headers, body });
  if (answer.ok) return "";
  const said = await answer.json().catch(() => ({}));
  return said.message ?? `The server answered ${answer.status}.`;
}

/** @returns {Promise<void>} resolved once the person signed in, rightly or not */
function askWho() {
  asking ??= new Promise((resolve) => {
    const dialog = /** @type {HTMLDialogElement} */ (byId("keys"));
    const wrongPair = sessionStorage.getItem(KEYS) !== null;
    if (wrongPair) way = "keys";
    showWay(wrongPair ? "The server knows no such pair." : "");
    const form = /** @type {HTMLFormElement} */ (dialog.querySelector("form"));
    dialog.oncancel = (event) => event.preventDefault();
    byId("keys-other").onclick = () => {
      way = way === "user" ? "keys" : "user";
      showWay("");
    };
    form.onsubmit = async (event) => {
      event.preventDefault();
      const wrong = await signIn(byId("app-id").value, byId("app-key").value).catch(String);
      if (wrong) return showWay(wrong);
      byId("app-key").value = "";
      dialog.close();
      asking = null;
      showWho();
      resolve();
    };
    dialog.showModal();
  });
  return asking;
}

/** Offers to sign out where a person signed in; the token itself is hidden from scripts. */
export function showWho() {
  const name = /(?:^|; )xzz-qyq-\d+=([^;]+)/.exec(document.cookie)?.[1];
  const button = byId("sign-out");
  button.hidden = !name || sessionStorage.getItem(KEYS) !== null;
  button.textContent = `Sign out ${name}`;
  button.onclick = async () => {
    await fetch("/api/sign-out", { method: "POST" });
    location.reload();
  };
}

/**
 * @param {string} path
 * @param {Record<string, string | number | boolean | null | undefined>} query what is null is left out
 * @returns {Promise<any>}
 */
export async function get(path, query = {}) {
  const asked = new URLSearchParams();
  for (const [name, value] of Object.entries(query)) {
    if (value !== null && value !== undefined) asked.set(name, String(value));
  }
  for (;;) {
    const answer = await fetch(`${path}?${asked}`, {
      headers: keyHeaders(),
      signal: AbortSignal.timeout(TIMEOUT_MS),
    });
    if (answer.status === 401) {
      await askWho();
      continue;
    }
    if (answer.ok) return answer.json();
    const said = await answer.json().catch(() => ({}));
    throw new Refused(answer.status, said.message ?? `The server answered ${answer.status}.`);
  }
}
