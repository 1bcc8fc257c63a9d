// @ts-check
// Robots on the map: poses flow from one frame to the next, colours say what they do.

import { trace } from "./ground.js";

/** @typedef {import("./types.js").RobotFrame} RobotFrame */
/** @typedef {import("./types.js").XY} XY */
/** @typedef {import("./view.js").View} View */
/** @typedef {import("./ground.js").Ground} Ground */
/** @typedef {{x: number, y: number, heading: number}} Pose */

/** @type {Record<string, string>} the same as in style.css */
export const COLOURS = { idle: "#64748b", moving: "#1d4ed8", waiting: "#b45309", working: "#7c3aed", charging: "#15803d", blocked: "#c81e1e", offline: "#7b8794" };
export const STATES = ["moving", "working", "charging", "waiting", "idle", "blocked", "offline"];

/** A pose farther from the last is jumped to: a slider was dragged, or a robot carried. */
const JUMP_M = 25;
const NAMES_FROM = 14; // pixels a metre from which names are larger
/** @type {XY[]} */
const FOOTPRINT = [[0.5, 0.35], [-0.5, 0.35], [-0.5, -0.35], [0.5, -0.35]];
const LENGTH_PX_MIN = 9; // a robot is never drawn smaller, or a large map would seem empty

/** @param {Pose} from @param {Pose} to @param {number} part @returns {Pose} */
export function between(from, to, part) {
  const turn = Math.atan2(Math.sin(to.heading - from.heading), Math.cos(to.heading - from.heading));
  return { x: from.x + (to.x - from.x) * part, y: from.y + (to.y - from.y) * part, heading: from.heading + turn * part };
}

/** One robot: where it was drawn, where it is going to be, and what is known of it. */
class Shown {
  /** @param {RobotFrame} frame */
  constructor(frame) {
    this.frame = frame;
    /** @type {Pose | null} */
    this.from = null;
    /** @type {Pose | null} */
    this.to = null;
  }
}

export class Robots {
  constructor() {
    /** @type {Map<string, Shown>} */
    this.shown = new Map();
    this.cameAt = 0;
    this.lastsMs = 200;
    /** @type {Map<number, XY[]>} */
    this.footprints = new Map();
  }

  /** @param {RobotFrame[]} frames @param {number} now @param {boolean} jump the moment was picked, not reached */
  take(frames, now, jump) {
    const before = this.shown;
    const waited = now - this.cameAt;
    this.lastsMs = Math.min(Math.max(this.lastsMs * 0.7 + waited * 0.3, 80), 600);
    this.shown = new Map();
    for (const frame of frames) {
      const robot = new Shown(frame);
      const pose = frame.x === null || frame.y === null ? null : { x: frame.x, y: frame.y, heading: frame.heading ?? 0 };
      const last = before.get(frame.name);
      const here = last ? this.pose(last, now) : null;
      const far = !here || !pose || Math.hypot(here.x - pose.x, here.y - pose.y) > JUMP_M;
      robot.to = pose;
      robot.from = jump || far || last?.frame.area !== frame.area ? pose : here;
      this.shown.set(frame.name, robot);
    }
    this.cameAt = now;
  }

  /** @param {Shown} robot @param {number} now @returns {Pose | null} */
  pose(robot, now) {
    if (!robot.from || !robot.to) return robot.to;
    return between(robot.from, robot.to, Math.min((now - this.cameAt) / this.lastsMs, 1));
  }

  /** @param {number} area @returns {Shown[]} those with a pose there, in order of their names */
  on(area) {
    return [...this.shown.values()].filter((r) => r.to && r.frame.area === area);
  }

  /**
   * @param {View} view @param {number} area @param {number} left @param {number} top @param {number} now
   * @returns {string | null} name of the robot under a pixel
   */
  at(view, area, left, top, now) {
    let nearest = null;
    let best = Math.max(0.7 * view.scale, 14);
    for (const robot of this.on(area)) {
      const pose = /** @type {Pose} */ (this.pose(robot, now));
      const [x, y] = view.toScreen(pose.x, pose.y);
      const away = Math.hypot(x - left, y - top);
      if (away < best) [nearest, best] = [robot.frame.name, away];
    }
    return nearest;
  }

  /**
   * @param {CanvasRenderingContext2D} pen @param {View} view @param {Ground} ground
   * @param {number} area @param {string | null} selected @param {number} now
   */
  draw(pen, view, ground, area, selected, now) {
    const robots = this.on(area);
    for (const robot of robots) this.drawSpaces(pen, view, robot);
    for (const robot of robots) this.drawLeft(pen, view, ground, robot, robot.frame.name === selected);
    for (const robot of robots) this.drawBody(pen, view, robot, robot.frame.name === selected, now);
    this.drawNames(pen, view, robots, selected, now);
  }

  /**
   * Name robots, the selected one first; a name that would cover another is left out.
   * @param {CanvasRenderingContext2D} pen @param {View} view @param {Shown[]} robots
   * @param {string | null} selected @param {number} now
   */
  drawNames(pen, view, robots, selected, now) {
    const size = view.scale >= NAMES_FROM ? 11.5 : 10;
    pen.font = `600 ${size}px system-ui, sans-serif`;
    /** @type {[number, number, number, number][]} */
    const taken = [];
    const inOrder = [...robots].sort((a, b) => Number(b.frame.name === selected) - Number(a.frame.name === selected));
    for (const robot of inOrder) {
      const pose = /** @type {Pose} */ (this.pose(robot, now));
      const [left, top] = view.toScreen(pose.x, pose.y);
      const half = pen.measureText(robot.frame.name).width / 2 + 2;
      const below = top - Math.max(view.scale * 0.55, 7) - 3;
      const box = /** @type {[number, number, number, number]} */ ([left - half, below - size, left + half, below + 2]);
      if (taken.some((t) => t[0] < box[2] && box[0] < t[2] && t[1] < box[3] && box[1] < t[3])) continue;
      taken.push(box);
      this.drawName(pen, robot, left, below);
    }
  }

  /** @param {CanvasRenderingContext2D} pen @param {View} view @param {Shown} robot ground that it holds */
  drawSpaces(pen, view, robot) {
    pen.beginPath();
    for (const space of robot.frame.spaces) {
      space.forEach(([x, y], i) => (i ? pen.lineTo(...view.toScreen(x, y)) : pen.moveTo(...view.toScreen(x, y))));
      pen.closePath();
    }
    pen.fillStyle = COLOURS[robot.frame.state] + "1f";
    pen.fill();
  }

  /** @param {CanvasRenderingContext2D} pen @param {View} view @param {Ground} ground @param {Shown} robot @param {boolean} selected */
  drawLeft(pen, view, ground, robot, selected) {
    if (!robot.frame.left.length) return;
    pen.beginPath();
    for (const key of robot.frame.left) trace(pen, view, ground.curves.get(key) ?? []);
    pen.strokeStyle = COLOURS[robot.frame.state] + (selected ? "d0" : "70");
    pen.lineWidth = Math.min(Math.max(view.scale * 0.14, 2), 7) * (selected ? 1.4 : 1);
    pen.lineCap = pen.lineJoin = "round";
    pen.stroke();
    const last = ground.curves.get(robot.frame.left[robot.frame.left.length - 1])?.at(-1);
    if (!last) return;
    pen.beginPath();
    pen.arc(...view.toScreen(...last), Math.min(Math.max(view.scale * 0.18, 3), 9), 0, 2 * Math.PI);
    pen.fillStyle = "#ffffff";
    pen.fill();
    pen.lineWidth = 2;
    pen.stroke();
  }

  /** @param {CanvasRenderingContext2D} pen @param {View} view @param {Shown} robot @param {boolean} selected @param {number} now */
  drawBody(pen, view, robot, selected, now) {
    const pose = /** @type {Pose} */ (this.pose(robot, now));
    const footprint = this.footprints.get(robot.frame.group) ?? FOOTPRINT;
    const xs = footprint.map((p) => p[0]);
    const long = Math.max(...xs) - Math.min(...xs);
    const grown = Math.max(1, LENGTH_PX_MIN / (long * view.scale)) * view.scale;
    const colour = COLOURS[robot.frame.state];
    pen.save();
    pen.translate(...view.toScreen(pose.x, pose.y));
    if (selected) {
      pen.beginPath();
      pen.arc(0, 0, long * grown * 0.72 + 4, 0, 2 * Math.PI);
      pen.fillStyle = "#1d4ed81a";
      pen.strokeStyle = "#1d4ed8";
      pen.lineWidth = 2;
      pen.fill();
      pen.stroke();
    }
    pen.rotate(-pose.heading);
    pen.beginPath();
    footprint.forEach(([x, y], i) => (i ? pen.lineTo(x * grown, -y * grown) : pen.moveTo(x * grown, -y * grown)));
    pen.closePath();
    const offline = robot.frame.state === "offline";
    pen.fillStyle = offline ? "#ffffff" : colour;
    pen.strokeStyle = offline ? colour : "#ffffff";
    pen.setLineDash(offline ? [3, 3] : []);
    pen.lineWidth = 1.6;
    pen.lineJoin = "round";
    pen.fill();
    pen.stroke();
    pen.setLineDash([]);
    const front = Math.max(...xs) * grown;
    const half = Math.max(...footprint.map((p) => Math.abs(p[1]))) * grown;
    pen.beginPath(); // a wedge that points forwards
    pen.moveTo(front * 0.82, 0);
    pen.lineTo(front * 0.3, -half * 0.55);
    pen.lineTo(front * 0.3, half * 0.55);
    pen.closePath();
    pen.fillStyle = offline ? colour : "#ffffffe0";
    pen.fill();
    if (robot.frame.loads.length) this.drawLoad(pen, front, half);
    pen.restore();
  }

  /** @param {CanvasRenderingContext2D} pen @param {number} front @param {number} half */
  drawLoad(pen, front, half) {
    const size = Math.max(Math.min(front, half) * 1.1, 5);
    pen.beginPath();
    pen.roundRect(-front * 0.35 - size / 2, -size / 2, size, size, size * 0.15);
    pen.fillStyle = "#fbbf24";
    pen.strokeStyle = "#78350f";
    pen.lineWidth = 1.2;
    pen.fill();
    pen.stroke();
  }

  /** @param {CanvasRenderingContext2D} pen @param {Shown} robot @param {number} left @param {number} below */
  drawName(pen, robot, left, below) {
    pen.textAlign = "center";
    pen.textBaseline = "alphabetic";
    pen.lineWidth = 3.5;
    pen.lineJoin = "round";
    pen.strokeStyle = "#ffffffe6";
    pen.strokeText(robot.frame.name, left, below);
    pen.fillStyle = robot.frame.state === "blocked" ? COLOURS.blocked : "#17202e";
    pen.fillText(robot.frame.name, left, below);
  }
}
