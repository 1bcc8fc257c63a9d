// @ts-check
// The canvas: pan, zoom, click, and one picture for each refresh of the screen.

import { Ground } from "./ground.js";
import { Robots } from "./robots.js";
import { View } from "./view.js";
import { Waits } from "./waits.js";

/** @typedef {import("./types.js").MapFrame} MapFrame */

const CLICK_PX = 4; // a press that moves less is a click
const ZOOM_STEP = 1.35;

export class Stage {
  /** @param {HTMLCanvasElement} canvas @param {(robot: string | null) => void} picked */
  constructor(canvas, picked) {
    this.canvas = canvas;
    this.picked = picked;
    this.pen = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
    this.view = new View();
    this.ground = new Ground();
    this.robots = new Robots();
    this.waits = new Waits();
    /** @type {number} */
    this.area = 0;
    /** @type {string | null} */
    this.selected = null;
    new ResizeObserver(() => this.resize()).observe(canvas);
    this.listen();
    const draw = (/** @type {number} */ now) => {
      this.draw(now);
      requestAnimationFrame(draw);
    };
    requestAnimationFrame(draw);
  }

  /** @param {MapFrame} map @param {number} area */
  show(map, area) {
    this.area = area;
    this.robots.footprints = new Map(map.groups.map((g) => [g.id, g.footprint]));
    const shown = map.areas.find((a) => a.id === area);
    if (shown) this.ground.show(shown);
    if (!this.view.touched) this.fit();
  }

  fit() {
    this.view.fit(this.ground.extent());
  }

  /** @param {string} robot bring it into the middle */
  centre(robot) {
    const to = this.robots.shown.get(robot)?.to;
    if (!to) return;
    this.view.centre(to.x, to.y);
    this.view.touched = true;
  }

  /** @param {number} factor */
  zoom(factor) {
    this.view.zoom(factor, this.view.width / 2, this.view.height / 2);
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    this.canvas.width = Math.round(width * devicePixelRatio);
    this.canvas.height = Math.round(height * devicePixelRatio);
    [this.view.width, this.view.height] = [width, height];
    this.view.version++;
    this.ground.drawnVersion = -1;
    if (!this.view.touched) this.fit();
  }

  /** @param {number} now */
  draw(now) {
    this.pen.setTransform(devicePixelRatio, 0, 0, devicePixelRatio, 0, 0);
    this.pen.fillStyle = "#fafbfc";
    this.pen.fillRect(0, 0, this.view.width, this.view.height);
    if (!this.ground.area || !this.view.width) return;
    this.ground.put(this.pen, this.view, now);
    this.robots.draw(this.pen, this.view, this.ground, this.area, this.selected, now);
    this.waits.draw(this.pen, this.view, this.robots, this.area, now);
  }

  listen() {
    /** @type {{left: number, top: number, far: number} | null} */
    let press = null;
    this.canvas.addEventListener("pointerdown", (event) => {
      press = { left: event.offsetX, top: event.offsetY, far: 0 };
      this.canvas.setPointerCapture(event.pointerId);
    });
    this.canvas.addEventListener("pointermove", (event) => {
      if (!press) return;
      const [right, down] = [event.offsetX - press.left, event.offsetY - press.top];
      const far = press.far + Math.hypot(right, down);
      press = { left: event.offsetX, top: event.offsetY, far };
      if (far < CLICK_PX) return;
      this.canvas.classList.add("dragging");
      this.view.pan(right, down);
    });
    const release = (/** @type {PointerEvent} */ event) => {
      if (press && press.far < CLICK_PX && event.type === "pointerup") {
        const { offsetX: left, offsetY: top } = event;
        this.picked(this.robots.at(this.view, this.area, left, top, performance.now()));
      }
      press = null;
      this.canvas.classList.remove("dragging");
    };
    this.canvas.addEventListener("pointerup", release);
    this.canvas.addEventListener("pointercancel", release);
    this.canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.view.zoom(Math.exp(-event.deltaY * 0.0015), event.offsetX, event.offsetY);
    }, { passive: false });
    this.canvas.addEventListener("keydown", (event) => {
      const step = /** @type {Record<string, [number, number]>} */ ({ ArrowLeft: [60, 0], ArrowRight: [-60, 0], ArrowUp: [0, 60], ArrowDown: [0, -60] })[event.key];
      if (step) this.view.pan(...step);
      else if (event.key === "+") this.zoom(ZOOM_STEP);
      else if (event.key === "-") this.zoom(1 / ZOOM_STEP);
      else if (event.key === "0") this.fit();
    });
  }
}
