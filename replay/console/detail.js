// @ts-check
// One order's whole story, or what is known of one robot, beside the map.

import { chip, routeWords } from "./orders.js";
import { dayAndTime, element, span, time } from "./words.js";

/** @typedef {import("./types.js").Story} Story */
/** @typedef {import("./types.js").RobotFrame} RobotFrame */
/** @typedef {{order: (id: string) => void, robot: (name: string) => void, moment: (ms: number) => void}} Links */

const LOW = 0.2; // of a battery

/** @param {[string, (Node | string | null)][]} known @returns {HTMLElement} what is null is left out */
function facts(known) {
  const list = element("dl", { class: "facts" });
  for (const [name, value] of known) {
    if (value !== null && value !== "") list.append(element("dt", {}, name), element("dd", {}, value));
  }
  return list;
}

/** @param {Story} story @param {Links} links @returns {Node[]} */
export function storyOf(story, links) {
  const { order } = story;
  const robot = order.robot;
  const shown = [
    facts([
      ["State", chip(order)],
      ["Robot", robot && element("button", { class: "link", click: () => links.robot(robot) }, robot)],
      ["Route", routeWords(order.route)],
      ["Priority", String(order.priority)],
      ["Container", order.container],
      ["Your id", order.externalId],
      ["Kind", order.kind === "Business" ? null : order.kind],
      ["Created", dayAndTime(order.createdMs)],
      ["Took", order.doneMs && span(order.doneMs - order.createdMs)],
    ]),
  ];
  if (order.reason) shown.push(element("p", { class: "callout" }, order.reason));
  shown.push(element("h3", {}, "Steps"), stepsOf(story));
  const events = element("ol", { class: "events" });
  for (const event of story.events) {
    const when = element("button", { title: "Show this moment", click: () => links.moment(event.atMs) }, time(event.atMs));
    const meta = element("span", { class: "meta" }, ` · ${event.type}, position ${event.position}${event.by ? `, by ${event.by}` : ""}`);
    const line = element("li", {}, element("div", {}, event.words), when, meta);
    line.dataset.type = event.type;
    events.append(line);
  }
  shown.push(element("h3", {}, "What happened"), events);
  return shown;
}

/** @param {Story} story @returns {HTMLElement} */
function stepsOf(story) {
  const steps = element("ol", { class: "steps" });
  story.steps.forEach((step, index) => {
    const took = step.startedMs && step.endedMs ? span(step.endedMs - step.startedMs) : step.startedMs ? "under way" : "";
    steps.append(
      element(
        "li",
        { class: step.status, title: step.arguments ?? "" },
        element("span", { class: "mark" }, step.status === "Done" ? "✓" : String(index + 1)),
        element("span", {}, step.words),
        element("span", { class: "span" }, took),
      ),
    );
  });
  if (!story.steps.length) steps.append(element("li", { class: "quiet" }, "None yet"));
  return steps;
}

/** @param {number | null} ratio @returns {Node | null} */
function battery(ratio) {
  if (ratio === null) return null;
  const fill = element("i", { class: ratio < LOW ? "low" : "" });
  fill.style.width = `${ratio * 100}%`;
  return element("span", {}, element("span", { class: "bar" }, fill), `${Math.round(ratio * 100)} %`);
}

/** @param {RobotFrame} robot @param {number} atMs @param {Links} links @returns {Node[]} */
export function robotOf(robot, atMs, links) {
  const loads = robot.bins.map((bin) => bin.container ?? bin.order).filter((held) => held !== null);
  const orders = element("span");
  robot.orders.forEach((id) => orders.append(element("button", { class: "link", click: () => links.order(id) }, id), " "));
  const place = robot.x === null || robot.y === null ? null : `${robot.x.toFixed(2)} m, ${robot.y.toFixed(2)} m`;
  const shown = [
    facts([
      ["State", element("span", { class: `chip ${robot.state}` }, robot.state)],
      ["Orders", robot.orders.length ? orders : "none"],
      ["Carries", robot.loads.join(", ") || null],
      ["Reserved", robot.loads.length ? null : loads.join(", ") || null],
      ["Drives to", robot.target],
      ["Paths left", robot.left.length ? String(robot.left.length) : null],
      ["Waits for", robot.blockedBy.join(", ") || null],
      ["Battery", battery(robot.battery)],
      ["Speed", `${Math.abs(robot.speed).toFixed(2)} m/s`],
      ["Stands on", robot.point],
      ["Place", place],
      ["Duty", robot.disabled ? "disabled" : robot.offDuty ? "off duty" : "on duty"],
      ["Last report", robot.reportedMs ? `${span(atMs - robot.reportedMs)} before` : "none"],
    ]),
  ];
  if (robot.words) shown.push(element("p", { class: "callout" }, robot.words));
  return shown;
}
