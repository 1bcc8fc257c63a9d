// @ts-check
// From metres to pixels: pan, zoom and fit. The scene's y axis points up.

/** @typedef {import("./types.js").XY} XY */

const SCALE_MIN = 0.5; // pixels a metre
const SCALE_MAX = 400;
const MARGIN_PX = 46;
const SCALE_FIT_MAX = 60; // a tiny map is not blown up beyond this

export class View {
  constructor() {
    this.scale = 20;
    this.left = 0; // pixels of the scene's origin from the canvas' corner
    this.top = 0;
    this.width = 0;
    this.height = 0;
    this.version = 0; // grows with each change
    this.touched = false; // a person chose the view; a map that changes does not fit it anew
  }

  /** @param {number} x @param {number} y @returns {XY} */
  toScreen(x, y) {
    return [this.left + x * this.scale, this.top - y * this.scale];
  }

  /** @param {number} left @param {number} top @returns {XY} */
  toScene(left, top) {
    return [(left - this.left) / this.scale, (this.top - top) / this.scale];
  }

  /** @param {XY[]} points show all of these */
  fit(points) {
    if (!points.length || !this.width) return;
    const xs = points.map((p) => p[0]);
    const ys = points.map((p) => p[1]);
    const [x0, x1] = [Math.min(...xs), Math.max(...xs)];
    const [y0, y1] = [Math.min(...ys), Math.max(...ys)];
    const wide = (this.width - 2 * MARGIN_PX) / Math.max(x1 - x0, 1);
    const high = (this.height - 2 * MARGIN_PX) / Math.max(y1 - y0, 1);
    this.scale = Math.min(Math.max(Math.min(wide, high), SCALE_MIN), SCALE_FIT_MAX);
    this.centre((x0 + x1) / 2, (y0 + y1) / 2);
    this.touched = false;
  }

  /** @param {number} x @param {number} y */
  centre(x, y) {
    this.left = this.width / 2 - x * this.scale;
    this.top = this.height / 2 + y * this.scale;
    this.version++;
  }

  /** @param {number} factor @param {number} left @param {number} top the point that stays */
  zoom(factor, left, top) {
    const [x, y] = this.toScene(left, top);
    this.scale = Math.min(Math.max(this.scale * factor, SCALE_MIN), SCALE_MAX);
    this.left = left - x * this.scale;
    this.top = top + y * this.scale;
    this.touched = true;
    this.version++;
  }

  /** @param {number} right @param {number} down in pixels */
  pan(right, down) {
    this.left += right;
    this.top += down;
    this.touched = true;
    this.version++;
  }
}
