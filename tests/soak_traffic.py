"""`python -m tests.soak_traffic --days 2`: whole sites at work with faults, judged at every step.

The days are made of pieces, one simulated hour each by default, each with its own seed and in a
process of its own, so that any can be repeated alone. What is done is kept in a file, and the next
call goes on behind it; one that fails does not stop the others. Core, scheduler and robots are
those of `serve`, on virtual time.
"""

import argparse
import json
import logging
import random
import subprocess
import sys
import time
from collections.abc import Iterable
from pathlib import Path
from typing import TypeAlias

import msgspec
import shapely
import structlog

from fleetledger.collector import tame
from fleetledger.shift import Shift
from ledger.ids import RobotName, robot_key
from ledger.link import Plan
from ledger.state import OrderKind, StepTask
from scheduler.traffic.judge import body, collisions, double_grants, outside
from sim.faults import MIXES, STANDARD, FaultMix
from sim.robot import SimRobot, place
from sim.troubles import HAND, JUMP
from sim.warehouses import for_robots
from tests.laws.yard import near_others
from tests.stands import STALL_MS, Stands, bound_ms
from tests.surroundings import Surroundings

Pose: TypeAlias = tuple[float, float, float]

ROOT = Path(__file__).parent.parent
# A new scheduler a minute: most of what it may take over wrongly is so only for a moment.
RESTLESS = msgspec.structs.replace(STANDARD.times(3), scheduler_restarts_per_h=60.0)
SOAKED = MIXES | {"restless": RESTLESS}
STEP_MS = 400
ORDERS_EACH = 2  # open at any time, for each robot
LOOK_MS = 5_000  # between two looks for stalls
POLL_S = 0.5


class Piece:
    """One site for a while."""

    def __init__(self, robots: int, seed: int, mix: FaultMix) -> None:
        file = for_robots(robots, seed)
        self.shift = Shift(file, seed=seed, faults=mix, step_ms=STEP_MS)
        self.around = Surroundings(self.shift, mix, random.Random(seed + 1))
        self.robots = robots
        self._chance = random.Random(seed + 2)
        self._bins = [str(b.name) for area in file.areas for b in area.bins]
        self._footprint = file.groups[0].footprint
        self._moved_ms: dict[RobotName, int] = {}
        self._poses: dict[RobotName, Pose] = {}
        self._by_people: set[RobotName] = set()  # they may leave it on reserved ground …
        self._amid: set[RobotName] = set()  # … off its own, or on what another was granted
        self._look_ms = 0
        self.stands = Stands()
        self.still_ms = 0  # longest that somebody stood for whatever cause

    def run(self, seconds: float) -> None:
        """Fails at the first overlap or stall."""
        self.shift.run(seconds, self._step)

    @property
    def done(self) -> int:
        """Orders that have ended."""
        return sum(self.shift.fleet.order_counts.values()) - len(self.shift.fleet.orders)

    def _step(self) -> None:
        self.around.step()
        orders = self.shift.fleet.orders.values()
        live = sum(order.kind is OrderKind.BUSINESS for order in orders)
        for _ in range(ORDERS_EACH * self.robots - live):
            source, target = self._chance.sample(self._bins, 2)
            self.shift.order(
                StepTask(location=source, arguments='{"binTask":"Load"}', loads=True),
                StepTask(location=target, arguments='{"binTask":"Unload"}', unloads=True),
            )
        robots = {robot.body.name: robot for robot in self.shift.world.robots()}
        poses = {name: place(robot)[:3] for name, robot in robots.items()}
        self._nobody_overlaps(robots, poses)
        for name, robot in robots.items():
            pose = poses[name]
            if pose != self._poses.get(name) or robot.actions.running:
                self._poses[name], self._moved_ms[name] = pose, self.shift.now_ms
        if self.shift.now_ms >= self._look_ms:
            self._look_ms = self.shift.now_ms + LOOK_MS
            self._nobody_stalls(robots)

    def _nobody_overlaps(
        self, robots: dict[RobotName, SimRobot], poses: dict[RobotName, Pose]
    ) -> None:
        bodies = {n: body(self._footprint, *poses[n]) for n in near_others(robots)}
        assert collisions(bodies) == [], f"overlap at {self.shift.now_ms} ms"
        in_hand = self._in_hand(robots)
        self._by_people |= in_hand
        self._amid |= in_hand
        claims = [claim.unit for claim in self.shift.fleet.claims.values() if claim.granted]
        zones = [shapely.Polygon(zone) for unit in claims for zone in unit.zones]
        zones += [shapely.Polygon(stranger.corners()) for stranger in self.around.crossing]
        if not zones:
            return
        ground = shapely.union_all(zones)
        shapely.prepare(ground)
        spots = shapely.points([pose[:2] for pose in poses.values()])
        reach_m = [robot.body.radius_m for robot in robots.values()]
        on = {
            name
            for name, is_near in zip(poses, shapely.dwithin(ground, spots, reach_m), strict=True)
            if is_near and body(self._footprint, *poses[name]).intersection(ground).area > 1e-6
        }
        assert on <= self._by_people, (on, [unit.id for unit in claims], self.shift.now_ms)
        self._by_people &= on | in_hand

    def _in_hand(self, names: Iterable[RobotName]) -> set[RobotName]:
        """Which of these people push or drive just now."""
        troubles, scene = self.shift.world.troubles, self.shift.scene
        return {name for name in names if troubles.get(robot_key(scene, name)) in (JUMP, HAND)}

    def _nobody_stalls(self, robots: dict[RobotName, SimRobot]) -> None:
        site = self.shift.role.scheduler._sites.get(self.shift.scene)
        if site is None:  # the scheduler has just been started anew
            return
        plans: dict[RobotName, Plan] = site.plans
        now_ms = self.shift.now_ms
        troubles = self.shift.world.troubles
        causes = {
            name
            for name, robot in robots.items()
            if robot_key(self.shift.scene, name) in troubles or robot.held_s > 0.0
        }
        causes |= {r.name for r in self.shift.fleet.robots.values() if not r.online}
        moved_ms = {name: self._moved_ms.get(name, now_ms) for name in robots}
        moved_ms = bound_ms(moved_ms, self.shift.fleet.orders.values())
        standing = [n for n, p in plans.items() if n in robots and (p.target or p.moving)]
        self.still_ms = max([self.still_ms, *(now_ms - moved_ms[name] for name in standing)])
        self._grants_hold(plans)
        self.stands.look(standing, moved_ms, plans, causes, now_ms)
        assert self.stands.unnamed_ms < STALL_MS, self.stands.unnamed

    def _grants_hold(self, plans: dict[RobotName, Plan]) -> None:
        """Exclusive and contained (design notes §8, 1 and 2), but where people put a robot."""
        twice = double_grants(plans.values())
        wrong = [pair for pair in twice if self._amid.isdisjoint(pair)]
        assert not wrong, f"granted twice at {self.shift.now_ms} ms: {wrong}"
        bodies = {n: body(self._footprint, *pose) for n, pose in self._poses.items()}
        off = {n for n, plan in plans.items() if plan.spaces and outside(plan, bodies[n])}
        assert off <= self._amid, f"off its ground at {self.shift.now_ms} ms: {off}"
        self._amid &= self._in_hand(plans) | off | {name for pair in twice for name in pair}


def piece(robots: int, minutes: float, seed: int, mix: str) -> dict[str, float]:
    """Run one piece, and give its figures."""
    structlog.configure(wrapper_class=structlog.make_filtering_bound_logger(logging.CRITICAL))
    began_s = time.process_time()
    made = Piece(robots, seed, SOAKED[mix])
    tame()  # as the server does: the collector takes a twentieth of the time else
    made.run(minutes * 60)
    struck = made.shift.world.struck
    return {
        "seed": seed,
        "robots": robots,
        "minutes": minutes,
        "orders_done": made.done,
        "stall_s": made.stands.unnamed_ms / 1000,
        "still_s": made.still_ms / 1000,
        "cpu_s": round(time.process_time() - began_s, 1),
        **{f"faults_{kind}": count for kind, count in (struck | made.around.happened).items()},
    }


def _kept(path: Path, robots: int, minutes: float) -> dict[int, dict[str, float]]:
    rows = [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []
    wanted = [r for r in rows if (r["robots"], r["minutes"]) == (robots, minutes)]
    return {int(row["seed"]): row for row in wanted}


def soak(robots: int, days: float, minutes: float, mix: str, processes: int, path: Path) -> int:
    """Run what is still to be run; 0 if nothing failed."""
    path.parent.mkdir(parents=True, exist_ok=True)
    seeds = range(1, round(days * 24 * 60 / minutes) + 1)
    done = _kept(path, robots, minutes)
    left = [seed for seed in seeds if seed not in done]
    began, running, failed = time.monotonic(), {}, list[int]()
    print(f"{len(seeds)} pieces of {minutes:g} min, {robots} robots; {len(done)} are done already")
    while left or running:
        while left and len(running) < processes:
            seed = left.pop(0)
            told = ["--robots", str(robots), "--piece-minutes", str(minutes), "--faults", mix]
            command = [sys.executable, "-m", "tests.soak_traffic", "--piece", str(seed), *told]
            running[seed] = subprocess.Popen(
                command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
            )
        time.sleep(POLL_S)
        for seed, process in [(s, p) for s, p in running.items() if p.poll() is not None]:
            said, trouble = process.communicate()
            del running[seed]
            if process.returncode:
                failed.append(seed)
                print(trouble[-4000:])
                again = " ".join(process.args[1:])
                print(f"piece {seed} failed. To repeat it:\n  {again}", flush=True)
                continue
            with path.open("a") as file:
                file.write(said.splitlines()[-1] + "\n")
            done[seed] = json.loads(said.splitlines()[-1])
            minutes_gone = (time.monotonic() - began) / 60
            to_go = len(left) + len(running)
            print(f"{minutes_gone:6.1f} min: piece {seed} done, {to_go} to go", flush=True)
    if failed:
        print(f"failed: {len(failed)} of {len(seeds)} pieces, of the seeds {failed}")
        return 1
    rows = [done[seed] for seed in seeds]
    orders, cpu_s = (sum(row[key] for row in rows) for key in ("orders_done", "cpu_s"))
    stall_s, still_s = (max(row[key] for row in rows) for key in ("stall_s", "still_s"))
    print(f"{days:g} days: {orders:.0f} orders, no overlap; longest stand with somewhere to go")
    print(
        f"{still_s:.0f} s, without a named cause {stall_s:.0f} s; {cpu_s / 3600:.1f} h of one core"
    )
    return 0


def main() -> int:
    """Soak, or do one piece."""
    parser = argparse.ArgumentParser(prog="python -m tests.soak_traffic", description=__doc__)
    parser.add_argument("--days", type=float, default=2.0)
    parser.add_argument("--robots", type=int, default=100)
    parser.add_argument("--piece-minutes", type=float, default=60.0)
    parser.add_argument("--faults", choices=sorted(SOAKED), default="standard")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--kept", type=Path, help="what is done already; else a file a mix")
    parser.add_argument("--piece", type=int, help="do the piece of this seed only")
    told = parser.parse_args()
    if told.piece is not None:
        figures = piece(told.robots, told.piece_minutes, told.piece, told.faults)
        print(json.dumps(figures))
        return 0
    kept = told.kept or ROOT / "data" / f"soak-{told.faults}.jsonl"
    return soak(told.robots, told.days, told.piece_minutes, told.faults, told.processes, kept)


if __name__ == "__main__":
    sys.exit(main())
