// @ts-check
// The list of orders, newest first; rows are kept from one frame to the next, so nothing jumps.

import { element, span, time } from "./words.js";

/** @typedef {import("./types.js").OrderFrame} OrderFrame */

const PLACES_MAX = 4; // of a route in one line

/** @param {string[]} route @returns {string} */
export function routeWords(route) {
  if (route.length <= PLACES_MAX) return route.join(" → ") || "no steps yet";
  return `${route.slice(0, PLACES_MAX - 1).join(" → ")} → … ${route[route.length - 1]}`;
}

/** @param {OrderFrame} order @returns {HTMLElement} */
export function chip(order) {
  return element("span", { class: `chip ${order.faulted ? "faulted" : order.status}` }, order.statusWords);
}

/** @param {OrderFrame} order @param {number} atMs @returns {string} */
function age(order, atMs) {
  return order.doneMs === null ? `for ${span(atMs - order.createdMs)}` : time(order.doneMs);
}

export class OrderList {
  /** @param {HTMLElement} list @param {(order: string) => void} picked */
  constructor(list, picked) {
    this.list = list;
    this.picked = picked;
    /** @type {Map<string, {row: HTMLElement, said: string, when: HTMLElement}>} */
    this.rows = new Map();
  }

  /** @param {OrderFrame[]} orders @param {number} atMs */
  show(orders, atMs) {
    const known = this.rows;
    this.rows = new Map();
    let place = this.list.firstElementChild;
    for (const order of orders) {
      const said = JSON.stringify(order);
      const kept = known.get(order.id);
      const made = kept && kept.said === said ? kept : { ...this.row(order), said };
      if (kept && made !== kept) {
        if (place === kept.row) place = made.row;
        kept.row.replaceWith(made.row);
      }
      made.when.textContent = age(order, atMs);
      known.delete(order.id);
      this.rows.set(order.id, made);
      if (place === made.row) place = place.nextElementSibling;
      else this.list.insertBefore(made.row, place);
    }
    for (const { row } of known.values()) row.remove();
  }

  /** @param {OrderFrame} order */
  row(order) {
    const when = element("span", { class: "when" });
    const kind = order.kind === "Business" ? "" : element("span", { class: "kind" }, order.kind);
    const button = element(
      "button",
      { class: "order", click: () => this.picked(order.id) },
      element("span", { class: "id" }, order.id, kind),
      chip(order),
      element("span", { class: "route", title: order.route.join(" → ") }, routeWords(order.route)),
      element("span", { class: "who" }, order.robot ?? ""),
    );
    const why = element("span", { class: "why" }, order.reason);
    const below = element("span", { class: "quiet" }, `${order.stepsDone} of ${order.route.length} steps`);
    below.style.fontSize = "12.5px";
    button.append(below, when);
    if (order.reason) button.append(why);
    const row = element("li", {}, button);
    row.dataset.order = order.id;
    return { row, when };
  }
}
