// @ts-check
// Which moment is shown: the newest, a past one at rest, or a past one that runs.

/** A past moment that reaches the newest by so much is live again. */
const CAUGHT_UP_MS = 400;

export class Moment {
  /** @param {() => void} changed called when a person picked another moment */
  constructor(changed) {
    this.changed = changed;
    /** @type {number | null} null = live */
    this.asOfMs = null;
    this.playing = false;
    this.speed = 1;
    this.firstMs = 0;
    this.nowMs = 0;
    this.tickedAt = performance.now();
  }

  get live() {
    return this.asOfMs === null;
  }

  /** @param {number} ms */
  go(ms) {
    this.asOfMs = Math.min(Math.max(ms, this.firstMs), this.nowMs);
    this.changed();
  }

  goLive() {
    this.asOfMs = null;
    this.playing = false;
    this.changed();
  }

  /** Play from the moment shown; from the newest there is nothing to play, so from a minute ago. */
  play() {
    if (this.asOfMs === null) this.asOfMs = Math.max(this.firstMs, this.nowMs - 60_000);
    this.playing = !this.playing;
    this.tickedAt = performance.now();
    this.changed();
  }

  /** Let the moment run on. */
  tick() {
    const at = performance.now();
    const passed = (at - this.tickedAt) * this.speed;
    this.tickedAt = at;
    if (!this.playing || this.asOfMs === null) return;
    this.asOfMs += passed;
    if (this.asOfMs >= this.nowMs - CAUGHT_UP_MS) this.goLive();
  }
}
