// @ts-check
// The page: asks for frames of the moment shown, and hands them to map, list and details.

import { Refused, get, showWho } from "./api.js";
import { robotOf, storyOf } from "./detail.js";
import { Moment } from "./moment.js";
import { OrderList } from "./orders.js";
import { COLOURS, STATES } from "./robots.js";
import { Stage } from "./stage.js";
import { showChains } from "./waits.js";
import { dayAndTime, element, fieldTime, time } from "./words.js";

/** @typedef {import("./types.js").Frame} Frame */
/** @typedef {import("./types.js").MapFrame} MapFrame */

const FRAME_MS = 200;
const ORDERS_EVERY = 3; // frames, while live; a past moment always comes with its orders
const ORDERS_MAX = 100;
const STORY_MS = 1_000;
const PAST_MS = 60_000; // a past moment at rest does not change
const RETRY_MS = 1_500;
const JUMP_MS = 4_000; // robots do not drive from moments farther apart at rest; they are just there
const ZOOM_STEP = 1.35;

/** @param {string} id @returns {any} */
const byId = (id) => document.getElementById(id);

const moment = new Moment(() => wake());
const stage = new Stage(byId("map"), (robot) => (robot ? pickRobot(robot) : pickNothing()));
const orders = new OrderList(byId("orders"), (id) => pickOrder(id));
showWho();

/** What the page knows and shows; `window.fleetledger` for those who look under the bonnet. */
const page = {
  /** @type {Frame | null} */ frame: null,
  /** @type {MapFrame | null} */ map: null,
  /** @type {string | null} */ scene: null,
  /** @type {string | null} */ order: null,
  /** @type {string | null} */ robot: null,
  /** @type {string | null} */ carrier: null, // robot of the order whose story is open
  frames: 0,
  moment,
  stage,
};
Object.assign(window, { fleetledger: page });

let asked = 0; // grows with each frame asked for
let woken = false; // something changed that the frame under way does not show yet
let waking = () => {};
let storyAt = -Infinity;
let storySaid = "";

/** Ask for the next frame now instead of after a pause. */
function wake() {
  showMoment();
  woken = true;
  waking();
}

/** @param {number} ms @returns {Promise<void>} ends early when something has changed */
function pause(ms) {
  if (woken) return Promise.resolve();
  return new Promise((resolve) => {
    const timer = setTimeout(resolve, ms);
    waking = () => {
      clearTimeout(timer);
      resolve();
    };
  });
}

async function run() {
  for (;;) {
    const began = performance.now();
    woken = false;
    moment.tick();
    const asOf = moment.asOfMs === null ? null : Math.round(moment.asOfMs);
    try {
      await show(asOf);
      notice("");
      await pause(Math.max(0, FRAME_MS - (performance.now() - began)));
      if (asOf !== null && !moment.playing && asOf === roundedMoment()) await pause(PAST_MS);
    } catch (trouble) {
      console.info(String(trouble));
      notice(trouble instanceof Refused ? trouble.message : "The server does not answer. Trying again …");
      if (trouble instanceof Refused && trouble.status === 404) page.scene = null;
      await pause(RETRY_MS);
    }
  }
}

/** @returns {number | null} */
function roundedMoment() {
  return moment.asOfMs === null ? null : Math.round(moment.asOfMs);
}

/** @param {number | null} asOf */
async function show(asOf) {
  const withOrders = asOf !== null || asked % ORDERS_EVERY === 0 || page.frame?.live === false;
  asked++;
  /** @type {Frame} */
  const frame = await get("/api/replay/frame", {
    sceneId: page.scene,
    asOf,
    orders: withOrders ? ORDERS_MAX : 0,
    find: byId("find").value.trim() || null,
    business: !byId("all-kinds").checked,
  });
  const before = page.frame;
  if (!withOrders && before) frame.orders = before.orders;
  if (frame.mapDigest && (frame.mapDigest !== page.map?.digest || frame.scene !== page.map?.scene)) await showMap(frame, asOf);
  const apart = before ? Math.abs(frame.atMs - before.atMs) : Infinity;
  page.frame = frame;
  page.frames++;
  stage.robots.take(frame.robots, performance.now(), apart > JUMP_MS && !moment.playing);
  [moment.firstMs, moment.nowMs] = [frame.firstMs ?? frame.nowMs, frame.nowMs];
  showFrame(frame);
  if (withOrders) showOrders(frame);
  showWaits(frame);
  await showDetail(frame, asOf);
  document.body.dataset.state = "ready";
}

/** @param {Frame} frame @param {number | null} asOf */
async function showMap(frame, asOf) {
  const other = frame.scene !== page.map?.scene;
  page.map = /** @type {MapFrame} */ (await get("/api/replay/map", { sceneId: frame.scene, asOf }));
  const known = page.map.areas.some((area) => area.id === stage.area);
  if (other) stage.view.touched = false;
  stage.show(page.map, known && !other ? stage.area : page.map.areas[0]?.id ?? 0);
  const choice = byId("area");
  choice.replaceChildren(...page.map.areas.map((area) => new Option(area.name, String(area.id))));
  choice.value = String(stage.area);
  byId("area-choice").hidden = page.map.areas.length < 2;
}

/** @param {Frame} frame */
function showFrame(frame) {
  byId("position").value = frame.position.toLocaleString();
  byId("open").value = `${frame.ordersOpen.toLocaleString()} open`;
  const scenes = byId("scene");
  const names = JSON.stringify(frame.scenes);
  if (scenes.dataset.names !== names && frame.scenes.length) {
    scenes.dataset.names = names;
    scenes.replaceChildren(...frame.scenes.map((scene) => new Option(scene.name, scene.id)));
  }
  if (frame.scene) scenes.value = page.scene = frame.scene;
  /** @type {Record<string, number>} */
  const count = {};
  for (const robot of frame.robots) count[robot.state] = (count[robot.state] ?? 0) + 1;
  const tally = STATES.filter((state) => count[state]).map((state) => {
    const dot = element("span", { class: "dot" });
    dot.style.color = COLOURS[state];
    return element("li", { title: `${count[state]} ${state}` }, dot, element("b", {}, String(count[state])), element("span", { class: "word" }, state));
  });
  byId("tally").replaceChildren(...tally);
  showMoment();
}

/** Bring clock, slider and buttons in step with the moment. */
function showMoment() {
  const { live, firstMs, nowMs } = moment;
  const shownMs = moment.asOfMs ?? nowMs;
  document.body.dataset.mode = live ? "live" : "past";
  byId("mode").textContent = live ? "Live" : moment.playing ? `Replay ${moment.speed}×` : "Past moment";
  byId("clock").textContent = dayAndTime(shownMs);
  byId("clock").dateTime = new Date(shownMs).toISOString();
  const slider = byId("slider");
  [slider.min, slider.max] = [String(firstMs), String(Math.max(nowMs, firstMs + 1))];
  if (!sliding) slider.value = String(shownMs);
  slider.setAttribute("aria-valuetext", dayAndTime(shownMs));
  const sameDay = new Date(firstMs).toDateString() === new Date(nowMs).toDateString();
  byId("first").textContent = sameDay ? time(firstMs) : dayAndTime(firstMs);
  byId("last").textContent = time(nowMs);
  const field = byId("moment");
  if (document.activeElement !== field) field.value = fieldTime(shownMs);
  byId("live").setAttribute("aria-pressed", String(live));
  const play = byId("play");
  play.textContent = moment.playing ? "❚❚" : "▶";
  play.setAttribute("aria-label", moment.playing ? "Pause" : "Play");
  play.title = moment.playing ? "Pause" : live ? "Play the last minute" : "Play from here";
}

/** @param {Frame} frame */
function showOrders(frame) {
  orders.show(frame.orders, frame.atMs);
  byId("no-orders").hidden = frame.orders.length > 0;
  byId("no-orders").textContent = byId("find").value.trim() ? "No order holds this text." : "No orders at this moment.";
}

/** @param {Frame} frame */
function showWaits(frame) {
  stage.waits.take(frame.waits, frame.chains);
  byId("waits").hidden = frame.chains.length === 0;
  byId("waiting").value = String(frame.waits.length);
  showChains(byId("chains"), frame.waits, frame.chains, frame.atMs, pickRobot);
}

/** @param {Frame} frame @param {number | null} asOf */
async function showDetail(frame, asOf) {
  const links = { order: pickOrder, robot: pickRobot, moment: (/** @type {number} */ ms) => moment.go(ms) };
  const picked = page.order ?? page.robot;
  byId("detail").hidden = !picked;
  byId("list").hidden = Boolean(picked);
  stage.selected = page.robot ?? page.carrier;
  if (page.robot) {
    const robot = frame.robots.find((r) => r.name === page.robot);
    const said = JSON.stringify([robot, Math.round(frame.atMs / 1000)]);
    if (said === storySaid) return;
    storySaid = said;
    byId("detail-title").textContent = page.robot;
    const nothing = [element("p", { class: "quiet" }, "Not in this scene at this moment.")];
    byId("detail-body").replaceChildren(...(robot ? robotOf(robot, frame.atMs, links) : nothing));
  } else if (page.order && performance.now() - storyAt > (asOf === null ? STORY_MS : 0)) {
    storyAt = performance.now();
    await showStory(page.order, asOf, links);
  }
}

/** @param {string} order @param {number | null} asOf @param {import("./detail.js").Links} links */
async function showStory(order, asOf, links) {
  let shown;
  let said = `${order} none`;
  try {
    const story = await get("/api/replay/order-story", { orderId: order, asOf });
    said = JSON.stringify(story);
    if (page.order !== order) return; // something else was picked meanwhile
    page.carrier = story.order.doneMs === null ? story.order.robot : null;
    stage.selected = page.carrier;
    shown = () => storyOf(story, links);
  } catch (trouble) {
    if (!(trouble instanceof Refused)) throw trouble;
    shown = () => [element("p", { class: "quiet" }, "This order did not exist yet at this moment.")];
  }
  if (said === storySaid || page.order !== order) return;
  storySaid = said;
  byId("detail-title").textContent = order;
  byId("detail-body").replaceChildren(...shown());
}

/** @param {string} text empty = nothing to say */
function notice(text) {
  byId("notice").textContent = text;
  byId("notice").hidden = !text;
}

/** @param {string | null} order @param {string | null} robot */
function pick(order, robot) {
  [page.order, page.robot, page.carrier] = [order, robot, null];
  [storyAt, storySaid] = [-Infinity, ""];
  wake();
}

/** @param {string} id */
const pickOrder = (id) => pick(id, null);
/** @param {string} name */
const pickRobot = (name) => pick(null, name);
const pickNothing = () => pick(null, null);

let sliding = false;

function listen() {
  byId("slider").addEventListener("input", (/** @type {Event} */ event) => {
    sliding = true;
    moment.playing = false;
    moment.go(Number(/** @type {HTMLInputElement} */ (event.target).value));
  });
  byId("slider").addEventListener("change", () => (sliding = false));
  byId("moment").addEventListener("change", () => {
    const ms = new Date(byId("moment").value).getTime();
    if (Number.isFinite(ms)) moment.go(ms);
  });
  byId("live").addEventListener("click", () => moment.goLive());
  byId("play").addEventListener("click", () => moment.play());
  for (const button of document.querySelectorAll(".speeds button")) {
    button.addEventListener("click", () => {
      moment.speed = Number(/** @type {HTMLElement} */ (button).dataset.speed);
      for (const other of document.querySelectorAll(".speeds button")) other.setAttribute("aria-pressed", String(other === button));
      wake();
    });
  }
  byId("scene").addEventListener("change", () => {
    page.scene = byId("scene").value;
    pickNothing();
  });
  byId("area").addEventListener("change", () => {
    stage.view.touched = false;
    if (page.map) stage.show(page.map, Number(byId("area").value));
  });
  byId("find").addEventListener("input", () => [(asked = 0), wake()]);
  byId("all-kinds").addEventListener("change", () => [(asked = 0), wake()]);
  byId("back").addEventListener("click", pickNothing);
  byId("fit").addEventListener("click", () => stage.fit());
  byId("zoom-in").addEventListener("click", () => stage.zoom(ZOOM_STEP));
  byId("zoom-out").addEventListener("click", () => stage.zoom(1 / ZOOM_STEP));
  document.addEventListener("keydown", (event) => {
    if (event.key === "Escape" && (page.order || page.robot)) pickNothing();
  });
}

listen();
run();
