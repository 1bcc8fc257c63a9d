// @ts-check
// Times and small things in words, and building elements without markup from data.

const TIME = new Intl.DateTimeFormat(undefined, { hour: "2-digit", minute: "2-digit", second: "2-digit", hour12: false });
const DAY = new Intl.DateTimeFormat(undefined, { year: "numeric", month: "short", day: "2-digit" });

/** @param {number} ms @returns {string} */
export const time = (ms) => TIME.format(ms);

/** @param {number} ms @returns {string} */
export const dayAndTime = (ms) => `${DAY.format(ms)}, ${TIME.format(ms)}`;

/** @param {number} ms @returns {string} a stretch of time, in its two largest units */
export function span(ms) {
  const s = Math.max(0, Math.round(ms / 1000));
  if (s < 60) return `${s} s`;
  if (s < 3600) return `${Math.floor(s / 60)} min ${s % 60} s`;
  if (s < 86400) return `${Math.floor(s / 3600)} h ${Math.floor((s % 3600) / 60)} min`;
  return `${Math.floor(s / 86400)} d ${Math.floor((s % 86400) / 3600)} h`;
}

/** @param {number} ms @returns {string} as a datetime-local field wants it, in local time */
export function fieldTime(ms) {
  const local = new Date(ms - new Date(ms).getTimezoneOffset() * 60_000);
  return local.toISOString().slice(0, 19);
}

/**
 * Build an element. Text from the server only ever becomes text, never markup.
 * @param {string} tag
 * @param {{class?: string, title?: string, click?: () => void}} [of]
 * @param {(Node | string)[]} content
 * @returns {HTMLElement}
 */
export function element(tag, of = {}, ...content) {
  const made = document.createElement(tag);
  if (of.class) made.className = of.class;
  if (of.title) made.title = of.title;
  if (of.click) made.addEventListener("click", of.click);
  made.append(...content);
  return made;
}
