// @ts-check
// What of the map does not move: walls, paths, points and bins, drawn once for each view.

/** @typedef {import("./types.js").XY} XY */
/** @typedef {import("./types.js").Area} Area */
/** @typedef {import("./types.js").Path} Path */
/** @typedef {import("./types.js").Point} Point */
/** @typedef {import("./view.js").View} View */

const CURVE_PARTS = 16; // of a curve that canvas has no command for
const NAMES_FROM = 26; // pixels a metre from which points and bins are named
const ARROWS_FROM = 9;
const REDRAW_AFTER_MS = 90; // while a person drags, the old picture is moved along

const COLOURS = { wall: "#8b97a7", path: "#c6cfda", point: "#9aa7b6", bin: "#a16207", binFill: "#fdf3d7", name: "#566375", charge: "#15803d", park: "#475d7c" };

/** @param {Map<string, Point>} points @param {Path} path @returns {XY[]} control points, ends included */
export function curve(points, path) {
  const start = points.get(path.start);
  const end = points.get(path.end);
  if (!start || !end) return [];
  return [[start.x_m, start.y_m], ...path.controls, [end.x_m, end.y_m]];
}

/** @param {XY[]} control @param {number} t @returns {XY} a point of the Bezier curve (de Casteljau) */
export function along(control, t) {
  let points = control;
  while (points.length > 1) {
    points = points.slice(1).map((p, i) => [points[i][0] + (p[0] - points[i][0]) * t, points[i][1] + (p[1] - points[i][1]) * t]);
  }
  return points[0];
}

/** @param {CanvasRenderingContext2D} pen @param {View} view @param {XY[]} control */
export function trace(pen, view, control) {
  if (control.length < 2) return;
  const on = control.map(([x, y]) => view.toScreen(x, y));
  pen.moveTo(...on[0]);
  if (on.length === 2) pen.lineTo(...on[1]);
  else if (on.length === 3) pen.quadraticCurveTo(...on[1], ...on[2]);
  else if (on.length === 4) pen.bezierCurveTo(...on[1], ...on[2], ...on[3]);
  else for (let i = 1; i <= CURVE_PARTS; i++) pen.lineTo(...view.toScreen(...along(control, i / CURVE_PARTS)));
}

export class Ground {
  constructor() {
    this.canvas = document.createElement("canvas");
    /** @type {Area | null} */
    this.area = null;
    /** @type {Map<string, Point>} */
    this.points = new Map();
    /** @type {Map<string, XY[]>} */
    this.curves = new Map();
    this.drawnVersion = -1;
    this.drawn = { scale: 1, left: 0, top: 0 };
    this.seenVersion = -1; // of a view that is still moving
    this.changedAt = 0;
  }

  /** @param {Area} area */
  show(area) {
    this.area = area;
    this.points = new Map(area.points.map((p) => [p.name, p]));
    this.curves = new Map(area.paths.map((p) => [`${p.start}->${p.end}`, curve(this.points, p)]));
    this.drawnVersion = -1;
  }

  /** @returns {XY[]} everything that a fitting view has to show */
  extent() {
    if (!this.area) return [];
    const walls = this.area.walls.flat();
    return [...this.area.points.map((p) => /** @type {XY} */ ([p.x_m, p.y_m])), ...walls];
  }

  /**
   * Put the picture on the page's canvas, drawn anew if the view has come to rest elsewhere.
   * @param {CanvasRenderingContext2D} pen @param {View} view @param {number} now
   */
  put(pen, view, now) {
    const ratio = devicePixelRatio;
    if (this.drawnVersion !== view.version) {
      const first = this.drawnVersion < 0;
      if (this.seenVersion !== view.version) [this.seenVersion, this.changedAt] = [view.version, now];
      if (first || now - this.changedAt > REDRAW_AFTER_MS) this.draw(view, ratio);
    }
    const grown = view.scale / this.drawn.scale;
    const left = view.left - this.drawn.left * grown;
    const top = view.top - this.drawn.top * grown;
    pen.drawImage(this.canvas, left, top, (this.canvas.width / ratio) * grown, (this.canvas.height / ratio) * grown);
  }

  /** @param {View} view @param {number} ratio */
  draw(view, ratio) {
    this.canvas.width = Math.round(view.width * ratio);
    this.canvas.height = Math.round(view.height * ratio);
    const pen = /** @type {CanvasRenderingContext2D} */ (this.canvas.getContext("2d"));
    pen.scale(ratio, ratio);
    this.drawnVersion = view.version;
    this.drawn = { scale: view.scale, left: view.left, top: view.top };
    if (!this.area) return;
    this.drawWalls(pen, view);
    this.drawPaths(pen, view);
    this.drawBins(pen, view);
    this.drawPoints(pen, view);
    if (view.scale >= NAMES_FROM) this.drawNames(pen, view);
  }

  /** @param {CanvasRenderingContext2D} pen @param {View} view */
  drawWalls(pen, view) {
    pen.beginPath();
    for (const [a, b] of this.area?.walls ?? []) {
      pen.moveTo(...view.toScreen(...a));
      pen.lineTo(...view.toScreen(...b));
    }
    pen.strokeStyle = COLOURS.wall;
    pen.lineWidth = 1.5;
    pen.stroke();
  }

  /** @param {CanvasRenderingContext2D} pen @param {View} view */
  drawPaths(pen, view) {
    pen.beginPath();
    for (const control of this.curves.values()) trace(pen, view, control);
    pen.strokeStyle = COLOURS.path;
    pen.lineWidth = Math.min(Math.max(view.scale * 0.07, 1), 4);
    pen.lineCap = "round";
    pen.stroke();
    if (view.scale < ARROWS_FROM) return;
    pen.beginPath();
    for (const [key, control] of this.curves) {
      const [start, end] = key.split("->");
      if (control.length < 2 || this.curves.has(`${end}->${start}`)) continue; // only one-way paths
      const [x0, y0] = view.toScreen(...along(control, 0.48));
      const [x1, y1] = view.toScreen(...along(control, 0.54));
      const turned = Math.atan2(y1 - y0, x1 - x0);
      for (const side of [-2.6, 2.6]) {
        pen.moveTo(x1, y1);
        pen.lineTo(x1 + 6 * Math.cos(turned + side), y1 + 6 * Math.sin(turned + side));
      }
    }
    pen.strokeStyle = COLOURS.point;
    pen.lineWidth = 1.5;
    pen.stroke();
  }

  /** @param {CanvasRenderingContext2D} pen @param {View} view */
  drawBins(pen, view) {
    const half = Math.min(Math.max(view.scale * 0.34, 2.5), 22);
    pen.beginPath();
    for (const name of new Set(this.area?.bins.map((bin) => bin.point))) {
      const point = this.points.get(name);
      if (!point) continue;
      const [left, top] = view.toScreen(point.x_m, point.y_m);
      pen.roundRect(left - half, top - half, 2 * half, 2 * half, half * 0.3);
    }
    pen.fillStyle = COLOURS.binFill;
    pen.strokeStyle = COLOURS.bin;
    pen.lineWidth = 1.2;
    pen.fill();
    pen.stroke();
  }

  /** @param {CanvasRenderingContext2D} pen @param {View} view */
  drawPoints(pen, view) {
    const size = Math.min(Math.max(view.scale * 0.1, 1.4), 5);
    const badge = Math.min(Math.max(view.scale * 0.3, 5), 11);
    pen.textAlign = "center";
    pen.textBaseline = "middle";
    pen.font = `700 ${badge * 1.25}px system-ui, sans-serif`;
    for (const point of this.points.values()) {
      const [left, top] = view.toScreen(point.x_m, point.y_m);
      const charging = point.kind === "Charging";
      const special = charging || point.kind === "Parking";
      pen.beginPath();
      pen.arc(left, top, special ? badge : size, 0, 2 * Math.PI);
      pen.fillStyle = charging ? "#e2f5e8" : special ? "#e6ecf4" : COLOURS.point;
      pen.fill();
      if (!special) continue;
      pen.strokeStyle = pen.fillStyle = charging ? COLOURS.charge : COLOURS.park;
      pen.lineWidth = 1.2;
      pen.stroke();
      if (view.scale >= ARROWS_FROM) pen.fillText(charging ? "⚡" : "P", left, top + 0.5);
    }
  }

  /** @param {CanvasRenderingContext2D} pen @param {View} view */
  drawNames(pen, view) {
    pen.font = "11px system-ui, sans-serif";
    pen.textAlign = "center";
    pen.textBaseline = "alphabetic";
    pen.fillStyle = COLOURS.name;
    pen.strokeStyle = "#fafbfc";
    pen.lineWidth = 4;
    pen.lineJoin = "round";
    /** @type {Map<string, string[]>} */
    const bins = new Map();
    for (const bin of this.area?.bins ?? []) bins.set(bin.point, [...(bins.get(bin.point) ?? []), bin.name]);
    for (const point of this.points.values()) {
      const [left, top] = view.toScreen(point.x_m, point.y_m);
      if (left < -50 || top < -50 || left > view.width + 50 || top > view.height + 50) continue;
      const named = bins.get(point.name);
      const more = named && named.length > 2 ? ` +${named.length - 2}` : "";
      const name = named ? named.slice(0, 2).join(", ") + more : point.name;
      const below = top + Math.min(view.scale * 0.34, 22) + 14;
      pen.strokeText(name, left, below);
      pen.fillText(name, left, below);
    }
  }
}
