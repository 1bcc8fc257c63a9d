// @ts-check
// Who waits for whom: arrows between robots on the map, and the chains as a list beside it.

import { element, span } from "./words.js";

/** @typedef {import("./types.js").WaitFrame} WaitFrame */
/** @typedef {import("./types.js").ChainFrame} ChainFrame */
/** @typedef {import("./types.js").XY} XY */
/** @typedef {import("./view.js").View} View */
/** @typedef {import("./robots.js").Robots} Robots */

const COLOUR = "#b45309";
const CLOSED_COLOUR = "#c81e1e"; // they wait for each other
const APART_M = 0.55; // arrows begin and end so far from the middles of robots,
const APART_PART = 0.3; // but where robots are near each other most of the way is arrow
const FAR_PX_MIN = 16; // robots nearer to each other on the screen have no arrow
const HEAD_PX = 8;

export class Waits {
  constructor() {
    /** @type {WaitFrame[]} */
    this.waits = [];
    /** @type {Set<string>} robots that wait for each other */
    this.closed = new Set();
    this.arrows = 0; // drawn last
  }

  /** @param {WaitFrame[]} waits @param {ChainFrame[]} chains */
  take(waits, chains) {
    this.waits = waits;
    this.closed = new Set();
    for (const chain of chains) {
      const from = chain.closed ? chain.robots.indexOf(chain.root ?? "") : -1;
      if (from >= 0) for (const robot of chain.robots.slice(from)) this.closed.add(robot);
    }
  }

  /**
   * @param {CanvasRenderingContext2D} pen @param {View} view @param {Robots} robots
   * @param {number} area @param {number} now
   */
  draw(pen, view, robots, area, now) {
    this.arrows = 0;
    for (const wait of this.waits) {
      const from = this.place(robots, view, wait.robot, area, now);
      if (!from) continue;
      for (const blocker of wait.blockers) {
        const to = this.place(robots, view, blocker, area, now);
        if (!to) continue;
        const closed = this.closed.has(wait.robot) && this.closed.has(blocker);
        this.arrow(pen, from, to, APART_M * view.scale, closed ? CLOSED_COLOUR : COLOUR);
      }
    }
  }

  /** @param {Robots} robots @param {View} view @param {string} name @param {number} area @param {number} now @returns {XY | null} */
  place(robots, view, name, area, now) {
    const shown = robots.shown.get(name);
    const pose = shown && shown.frame.area === area ? robots.pose(shown, now) : null;
    return pose && view.toScreen(pose.x, pose.y);
  }

  /** @param {CanvasRenderingContext2D} pen @param {XY} from @param {XY} to @param {number} apart in pixels @param {string} colour */
  arrow(pen, from, to, apart, colour) {
    const [right, down] = [to[0] - from[0], to[1] - from[1]];
    const far = Math.hypot(right, down);
    if (far < FAR_PX_MIN) return;
    this.arrows++;
    const [x, y] = [right / far, down / far];
    const off = Math.min(apart, APART_PART * far);
    const [x0, y0] = [from[0] + x * off, from[1] + y * off];
    const [x1, y1] = [to[0] - x * off, to[1] - y * off];
    // bent to its left, so that two who wait for each other are two arrows
    const bend = Math.min(far * 0.12, 26);
    const [xc, yc] = [(x0 + x1) / 2 + y * bend, (y0 + y1) / 2 - x * bend];
    pen.beginPath();
    pen.moveTo(x0, y0);
    pen.quadraticCurveTo(xc, yc, x1, y1);
    pen.strokeStyle = "#ffffffd0";
    pen.lineWidth = 5;
    pen.stroke();
    pen.strokeStyle = colour;
    pen.lineWidth = 2.2;
    pen.stroke();
    const turn = Math.atan2(y1 - yc, x1 - xc);
    pen.beginPath();
    pen.moveTo(x1, y1);
    for (const side of [2.7, -2.7]) pen.lineTo(x1 + HEAD_PX * Math.cos(turn + side), y1 + HEAD_PX * Math.sin(turn + side));
    pen.closePath();
    pen.fillStyle = colour;
    pen.fill();
  }
}

/**
 * Who or what is waited for, in words; the server's own names have a prefix where it is no robot.
 * @param {string} name @returns {string}
 */
function outside(name) {
  if (name.startsWith("door:")) return `door '${name.slice(5)}'`;
  return name.startsWith("external:") ? `ground reserved for '${name.slice(9)}'` : "";
}

/**
 * One chain: a line for each robot, and at the end what all of them hang on.
 * @param {ChainFrame} chain @param {Map<string, WaitFrame>} waits @param {number} atMs
 * @param {(robot: string) => void} picked @returns {HTMLElement}
 */
function chainRow(chain, waits, atMs, picked) {
  const robot = (/** @type {string} */ name) => element("button", { class: "link", click: () => picked(name) }, name);
  const row = element("li", { class: chain.closed ? "chain closed" : "chain" });
  for (const name of chain.robots) {
    const wait = waits.get(name);
    const words = element("span", {}, ` ${wait?.words ?? ""}`);
    const since = element("span", { class: "since" }, wait ? span(atMs - wait.sinceMs) : "");
    const line = element("div", { class: "link-of-chain" }, element("span", {}, robot(name), words), since);
    if (wait?.place) line.title = `at ${wait.place}, ${wait.reason}`;
    row.append(line);
  }
  if (chain.closed) row.append(element("div", { class: "root" }, "They wait for each other."));
  else if (chain.root && !outside(chain.root)) row.append(element("div", { class: "root" }, robot(chain.root), ` ${chain.rootWords}`));
  row.dataset.chain = chain.robots.join(" ");
  row.dataset.root = chain.root ?? "";
  return row;
}

/**
 * @param {HTMLElement} list @param {WaitFrame[]} waits @param {ChainFrame[]} chains
 * @param {number} atMs @param {(robot: string) => void} picked
 */
export function showChains(list, waits, chains, atMs, picked) {
  const said = JSON.stringify([chains.map((chain) => [chain.robots, chain.root, chain.rootWords, chain.closed]), waits, Math.floor(atMs / 1000)]);
  if (list.dataset.said === said) return;
  list.dataset.said = said;
  const byRobot = new Map(waits.map((wait) => [wait.robot, wait]));
  list.replaceChildren(...chains.map((chain) => chainRow(chain, byRobot, atMs, picked)));
}
