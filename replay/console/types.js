// @ts-check
// What the server sends (replay/frame.py, replay/story.py) and what the page holds, as types only.

/** @typedef {[number, number]} XY metres in the scene's frame */

/**
 * @typedef {object} RobotFrame
 * @property {string} name
 * @property {number} group
 * @property {string} state idle, moving, waiting, working, charging, blocked or offline
 * @property {string} words
 * @property {boolean} online
 * @property {boolean} offDuty
 * @property {boolean} disabled
 * @property {string[]} orders
 * @property {{status: string, order: string | null, container: string | null}[]} bins
 * @property {number | null} reportedMs
 * @property {number | null} area
 * @property {number | null} x
 * @property {number | null} y
 * @property {number | null} heading
 * @property {number} speed
 * @property {number | null} battery
 * @property {string | null} point
 * @property {string[]} loads
 * @property {string | null} target
 * @property {string[]} left
 * @property {XY[][]} spaces
 * @property {string[]} blockedBy
 */

/**
 * @typedef {object} OrderFrame
 * @property {string} id
 * @property {string} kind
 * @property {string} status
 * @property {string} statusWords
 * @property {string} reason
 * @property {boolean} faulted
 * @property {string | null} robot
 * @property {number} priority
 * @property {string[]} route
 * @property {number} stepsDone
 * @property {number} createdMs
 * @property {number | null} doneMs
 * @property {string | null} externalId
 * @property {string | null} container
 */

/**
 * @typedef {object} Frame
 * @property {number} atMs
 * @property {boolean} live
 * @property {number} position
 * @property {number | null} firstMs
 * @property {number} nowMs
 * @property {{id: string, name: string}[]} scenes
 * @property {string | null} scene
 * @property {string} mapDigest
 * @property {RobotFrame[]} robots
 * @property {OrderFrame[]} orders
 * @property {number} ordersOpen
 * @property {WaitFrame[]} waits
 * @property {ChainFrame[]} chains
 */

/**
 * @typedef {object} WaitFrame
 * @property {string} robot
 * @property {number} sinceMs
 * @property {string} reason
 * @property {string} words
 * @property {string[]} blockers
 * @property {string | null} place
 */

/**
 * @typedef {object} ChainFrame
 * @property {string[]} robots
 * @property {number} sinceMs
 * @property {string | null} root
 * @property {string} rootWords
 * @property {boolean} closed
 * @property {string} words
 */

/** @typedef {{name: string, x_m: number, y_m: number, kind: string}} Point */
/** @typedef {{start: string, end: string, controls: XY[], backward: boolean}} Path */

/**
 * @typedef {object} Area
 * @property {number} id
 * @property {string} name
 * @property {Point[]} points
 * @property {Path[]} paths
 * @property {{name: string, point: string}[]} bins
 * @property {[XY, XY][]} walls
 */

/**
 * @typedef {object} MapFrame
 * @property {string} scene
 * @property {string} name
 * @property {string} digest
 * @property {Area[]} areas
 * @property {{id: number, name: string, footprint: XY[]}[]} groups
 */

/**
 * @typedef {object} Story
 * @property {OrderFrame} order
 * @property {{id: string, words: string, location: string, arguments: string | null, status: string,
 *   startedMs: number | null, endedMs: number | null}[]} steps
 * @property {{position: number, atMs: number, type: string, by: string, command: string,
 *   words: string}[]} events
 */

export {};
