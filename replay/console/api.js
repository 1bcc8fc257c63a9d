// @ts-check
// Asks the server. Where it wants a key pair, asks the person once and keeps it for this tab.

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

/** @returns {Promise<void>} resolved once a pair was typed in */
function askForKeys() {
  asking ??= new Promise((resolve) => {
    const dialog = /** @type {HTMLDialogElement} */ (byId("keys"));
    byId("keys-wrong").hidden = !sessionStorage.getItem(KEYS);
    const form = /** @type {HTMLFormElement} */ (dialog.querySelector("form"));
    dialog.addEventListener("cancel", (event) => event.preventDefault(), { once: true });
    form.onsubmit = (event) => {
      event.preventDefault();
      const pair = { id: byId("app-id").value, key: byId("app-key").value };
      sessionStorage.setItem(KEYS, JSON.stringify(pair));
      dialog.close();
      asking = null;
      resolve();
    };
    dialog.showModal();
  });
  return asking;
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
      await askForKeys();
      continue;
    }
    if (answer.ok) return answer.json();
    const said = await answer.json().catch(() => ({}));
    throw new Refused(answer.status, said.message ?? `The server answered ${answer.status}.`);
  }
}
