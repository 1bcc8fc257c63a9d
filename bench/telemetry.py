"""What telemetry costs: a thousand robots at ten reports a second, `python -m bench.telemetry`.

Three measurements. The *log* alone, on virtual time: CPU seconds of `write` and `write_plans` for a
second of a plant, and bytes on disk, for robots that all drive and for a mix where every other one
stands. The *intake* as `serve` has it, on real time: another process publishes over zenoh, this one
takes in, decodes, shows and logs; what counts is the CPU time of this whole process, zenoh's
threads too, less that of the same process with nobody publishing. And *commits* beside the log:
how long acknowledged appends wait while another thread of the process writes telemetry, and not.

Robots are simulated ones that wander (`bench.sim`); plans have the size and pace of real ones,
measured in a shift of 30 robots: 1.55 a second and robot, 6.7 polygons of 6.5 points each.
"""

import argparse
import asyncio
import re
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import msgspec

from bench.append import acknowledged, percentile
from bench.sim import STEP_S, Wanderers
from fleetledger.collector import tame
from fleetledger.intake import Intake
from fleetledger.listening import free_port
from ledger.bus import plans_key, report_key
from ledger.ids import PathKey, PointName, RobotName, SceneId
from ledger.link import Plan, Report, Space
from ledger.state import Fleet
from ledger.telemetry import TelemetryLog
from ledger.zenoh_bus import ZenohBus
from projections.live import Live

ROBOTS, TOGETHER = 1_000, 100  # robots of the plant, and of each world that is simulated
SCENE = SceneId("b" * 24)
START_MS = 1_790_000_000_000
WRITE_EVERY = 2  # reports of a robot between two calls of the log, as the intake coalesces them
PLAN_EVERY = 6  # ticks between two plans of one robot
CELL_M, CELLS = 0.8, 7  # ground that a robot holds
CLIENTS, TURNS = 8, 5  # that wait for commits, with telemetry and without
TAPE_S = 10  # of reports that the publisher plays to and fro


class Plant:
    """A thousand robots under way, or every other one of them."""

    def __init__(self, *, driving: float) -> None:
        self._worlds = [Wanderers(TOGETHER, seed) for seed in range(ROBOTS // TOGETHER)]
        self._driving = driving
        self.tick = 0

    def reports(self) -> list[Report]:
        """Drive a tenth of a second; give what everybody reports."""
        said = []
        self.tick += 1
        for number, world in enumerate(self._worlds):
            for robot in world.robots()[: int(self._driving * TOGETHER)]:
                if len(robot.legs) < 2:
                    world.send(robot.body.name)
            world.world.step(STEP_S)
            for report in world.world.reports(START_MS + self.tick * 100):
                name = RobotName(f"{number}-{report.robot}")
                said.append(msgspec.structs.replace(report, scene=SCENE, robot=name))
        return said


def plan_of(report: Report) -> Plan:
    """Intend something with a robot: ground ahead of it, mostly cells that others hold too."""
    x, y = (round(v / CELL_M) for v in (report.x_m, report.y_m))
    corners = [
        tuple(
            (round((x + n + dx) * CELL_M, 3), round((y + dy) * CELL_M, 3))
            for dx, dy in ((0, 0), (2, 0), (2, 1), (0, 1))
        )
        for n in range(CELLS - 1)
    ]
    ring = tuple(
        (round(report.x_m + dx, 3), round(report.y_m + dy / 3, 3))
        for dx in range(4)
        for dy in range(5)
    )
    return Plan(
        scene=SCENE,
        robot=report.robot,
        at_ms=report.at_ms,
        ready=True,
        target=PointName(f"AP{x}"),
        untravelled=tuple(PathKey(f"LM{a}->LM{b}") for a, b in pairwise(range(x, x + 3))),
        spaces=tuple(Space(points=points) for points in (*corners, ring)),
        commit=report.at_ms % 1_000_000,
        moving=True,
    )


def plans_of(reports: list[Report], tick: int) -> list[Plan]:
    """Give the plans of this tick: of those under way, each every so often."""
    return [
        plan_of(report)
        for number, report in enumerate(reports)
        if report.speed_mps and (number + tick) % PLAN_EVERY == 0
    ]


def log_alone(folder: Path, seconds: int, *, driving: float) -> dict[str, float | str]:
    """Measure CPU time of the log for a second of the plant, and its files."""
    plant, log, spent_s = Plant(driving=driving), TelemetryLog(folder), 0.0
    tame()
    worst_s = 0.0
    for _ in range(seconds * 10 // WRITE_EVERY):
        plans: list[Plan] = []
        for _ in range(WRITE_EVERY):
            reports = plant.reports()
            plans += plans_of(reports, plant.tick)
        began_s = time.process_time()
        log.write(reports)
        log.write_plans(plans)
        took_s = time.process_time() - began_s
        spent_s, worst_s = spent_s + took_s, max(worst_s, took_s)
    log.close()
    size = sum(path.stat().st_size for path in folder.iterdir())
    return {
        "what": f"log alone, {ROBOTS} robots, {driving:.0%} driving",
        "core_percent": spent_s / seconds * 100,
        "gb_per_hour": size / seconds * 3600 / 1e9,
        "worst_call_ms": worst_s * 1e3,
    }


def _publish(endpoint: str, seconds: float) -> None:
    """Be all robots and traffic: play a tape of reports to and fro, with new times."""
    plant = Plant(driving=1.0)
    tape: list[list[tuple[str, bytes, bytes]]] = []
    intended: list[bytes] = []
    stamp = re.compile(rb'"number":\d+,"at_ms":\d+')
    for _ in range(TAPE_S * 10):
        reports = plant.reports()
        lines = []
        for report in reports:
            front, back = stamp.split(msgspec.json.encode(report), maxsplit=1)
            lines.append((report_key(SCENE, report.robot), front, back))
        tape.append(lines)
        intended.append(msgspec.json.encode(plans_of(reports, plant.tick)))
    bus = ZenohBus(None, (endpoint,))
    print("ready", flush=True)
    sys.stdin.readline()
    order = [*range(len(tape)), *reversed(range(len(tape)))]
    due, tick = time.monotonic(), 0
    end = due + seconds
    while time.monotonic() < end:
        at = order[tick % len(order)]
        now = b'"number":%d,"at_ms":%d' % (tick, START_MS + tick * 100)
        for key, front, back in tape[at]:
            bus.publish(key, front + now + back)
        bus.publish(plans_key(SCENE), re.sub(rb'"at_ms":\d+', now.split(b",")[1], intended[at]))
        tick += 1
        due += 0.1
        time.sleep(max(0.0, due - time.monotonic()))  # robots report at a pace
    print("published", tick * ROBOTS, flush=True)
    bus.close()


async def intake(folder: Path, endpoint: str, seconds: int) -> dict[str, float | str]:
    """Measure the CPU time of this process, quiet and under the flood."""
    live, log = Live(Fleet()), TelemetryLog(folder)
    bus = ZenohBus(endpoint)
    taken = 0

    def observe(report: Report) -> None:
        nonlocal taken
        taken += 1
        live.observe(report)

    task = Intake(bus, asyncio.get_running_loop(), log, observe, live.intend)
    task.start()
    tame()
    sys.setswitchinterval(0.0005)  # as `serve` does
    command = [sys.executable, "-m", "bench.telemetry", "--publish", endpoint]
    with subprocess.Popen(
        [*command, "--seconds", str(seconds + 2)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as publisher:
        assert publisher.stdin is not None
        assert publisher.stdout is not None
        await asyncio.to_thread(publisher.stdout.readline)
        quiet_s = await _cpu_s(3) / 3
        publisher.stdin.write("go\n")
        publisher.stdin.flush()
        await asyncio.sleep(1)  # under way
        before = taken
        busy_s = await _cpu_s(seconds) / seconds
        rate = (taken - before) / seconds
        await asyncio.to_thread(publisher.stdout.readline)
    task.stop()
    bus.close()
    log.close()
    size = sum(path.stat().st_size for path in folder.iterdir())
    return {
        "what": f"whole intake, {ROBOTS} robots driving",
        "core_percent": (busy_s - quiet_s) * 100,
        "gb_per_hour": size / (seconds + 2) * 3600 / 1e9,
        "reports_per_s": rate,
    }


async def _cpu_s(seconds: float) -> float:
    began_s = time.process_time()
    await asyncio.sleep(seconds)
    return time.process_time() - began_s


def commits(root: Path, seconds: int) -> dict[str, float | str]:
    """Measure what acknowledged appends wait without telemetry and with it, by turns."""
    plant = Plant(driving=1.0)
    tape = []
    for _ in range(50):
        reports = plant.reports()
        tape.append((reports, plans_of(reports, plant.tick)))
    tame()
    sys.setswitchinterval(0.0005)  # as `serve` does
    waits: dict[bool, list[float]] = {False: [], True: []}
    log, tick = TelemetryLog(root / "telemetry"), 0
    for turn in range(2 * TURNS):
        busy, stop = turn % 2 == 1, threading.Event()

        def write(stop: threading.Event = stop) -> None:
            nonlocal tick
            while not stop.wait(0.1 * WRITE_EVERY):
                tick += WRITE_EVERY
                now_ms = START_MS + tick * 100
                reports, plans = tape[tick % len(tape)]
                log.write([msgspec.structs.replace(r, at_ms=now_ms) for r in reports])
                log.write_plans([msgspec.structs.replace(p, at_ms=now_ms) for p in plans])

        writer = threading.Thread(target=write)
        if busy:
            writer.start()
        waits[busy] += acknowledged(root / f"ledger-{turn}", CLIENTS, seconds / TURNS / 2)[1]
        stop.set()
        if busy:
            writer.join()
    log.close()
    row: dict[str, float | str] = {"what": f"commits, {CLIENTS} waiting"}
    for busy, name in ((False, "without"), (True, "with")):
        for share in (50, 99):
            row[f"p{share}_ms_{name}"] = percentile(waits[busy], share / 100) * 1e3
    return row


def rows(seconds: int, endpoint: str) -> Iterator[dict[str, float | str]]:
    """Measure one after the other."""
    for driving in (1.0, 0.5):
        with tempfile.TemporaryDirectory(prefix="fleetledger-bench-") as name:
            yield log_alone(Path(name), seconds, driving=driving)
    with tempfile.TemporaryDirectory(prefix="fleetledger-bench-") as name:
        yield asyncio.run(intake(Path(name), endpoint, seconds))
    with tempfile.TemporaryDirectory(prefix="fleetledger-bench-") as name:
        yield commits(Path(name), seconds)


def main() -> list[dict[str, float | str]] | None:
    """Run all, print a table, and give the rows."""
    parser = argparse.ArgumentParser(prog="python -m bench.telemetry", description=__doc__)
    parser.add_argument("--seconds", type=int, default=30, help="length of each round")
    parser.add_argument("--publish", metavar="ENDPOINT", help="be the robots of another run")
    arguments = parser.parse_args()
    if arguments.publish is not None:
        _publish(arguments.publish, arguments.seconds)
        return None
    found = []
    for row in rows(arguments.seconds, f"tcp/127.0.0.1:{free_port()}"):
        figures = ", ".join(f"{k} {v:,.2f}" for k, v in row.items() if isinstance(v, float))
        print(f"{row['what']:<44} {figures}", flush=True)
        found.append(row)
    return found


if __name__ == "__main__":
    main()
