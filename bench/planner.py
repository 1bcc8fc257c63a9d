"""Planner figures: a step of traffic for 100 robots, and compiling a map of 10 000 paths.

Run as `python -m bench.planner`. The fleet drives for one simulated minute on a lattice under
perfect robots; every call of `Traffic.step` is timed, and calls without news apart.
"""

import json
import math
import random
import statistics
import tempfile
import time
from pathlib import Path as FilePath

from rich.console import Console
from rich.table import Table

from ledger.ids import PointName, RobotName, SceneId
from ledger.link import Drive, Mark, Piece, Report, TellRoute
from ledger.scene import Area, Group, Path, Point
from scheduler.goal import Goal
from scheduler.traffic.compile import compile_area
from scheduler.traffic.traffic import Traffic

SCENE = SceneId("bench0bench0bench0bench0")
RESULTS = FilePath(__file__).parent / "results" / "planner.json"
TICK_S = 0.1
SPEED_MPS = 1.0


def lattice(side: int, pitch_m: float = 2.0) -> Area:
    """Two-way lanes between the points of a square grid."""
    points, paths = [], []
    for i in range(side):
        for j in range(side):
            points.append(Point(name=PointName(f"P{i}-{j}"), x_m=i * pitch_m, y_m=j * pitch_m))
            for a, b in ((i + 1, j), (i, j + 1)):
                if a < side and b < side:
                    ends = PointName(f"P{i}-{j}"), PointName(f"P{a}-{b}")
                    paths += [Path(start=ends[0], end=ends[1]), Path(start=ends[1], end=ends[0])]
    return Area(
        id=0,
        name="lattice",
        map_name="lattice",
        map_digest="",
        points=tuple(points),
        paths=tuple(paths),
    )


class Runner:
    """A robot that follows its route at a constant speed: enough to keep the planner busy."""

    def __init__(self, name: RobotName, point: Point) -> None:
        """Start on a point."""
        self.name, self.x_m, self.y_m, self.heading_rad = name, point.x_m, point.y_m, 0.0
        self.session, self.number = "", 0
        self.pieces: dict[int, Piece] = {}
        self.progress, self.authority = Mark(), Mark()
        self.moving = False

    def tell(self, message: Drive) -> None:
        """Take over new pieces and the authority."""
        self.session, self.authority = message.session, message.authority
        self.pieces.update({piece.number: piece for piece in message.pieces})

    def step(self) -> None:
        """Drive on for one tick."""
        piece = self.pieces.get(self.progress.piece)
        if piece is None or self.progress.along_m >= piece.length_m - 1e-9:
            piece = self.pieces.get(self.progress.piece + 1)
            if piece is None or self.authority.piece < piece.number:
                self.moving = False
                return
            self.progress = Mark(piece=piece.number)
        reach = piece.length_m
        if self.authority.piece == piece.number:
            reach = min(reach, self.authority.along_m)
        along = min(self.progress.along_m + SPEED_MPS * TICK_S, reach)
        self.moving = along > self.progress.along_m
        self.progress = Mark(piece=piece.number, along_m=along)
        share = along / piece.length_m
        (x0, y0), (x1, y1) = piece.curve[0], piece.curve[-1]
        self.x_m, self.y_m = x0 + (x1 - x0) * share, y0 + (y1 - y0) * share
        self.heading_rad = piece.heading_rad

    def report(self, at_ms: int) -> Report:
        """Say where it is."""
        self.number += 1
        return Report(
            scene=SCENE,
            robot=self.name,
            number=self.number,
            at_ms=at_ms,
            area=0,
            x_m=self.x_m,
            y_m=self.y_m,
            heading_rad=self.heading_rad,
            speed_mps=SPEED_MPS if self.moving else 0.0,
            session=self.session,
            progress=self.progress,
            authority=self.authority,
        )


def reserve(traffic: Traffic, chance: random.Random, claims: int) -> float:
    """Reserve ground in the middle of lanes; gives milliseconds per claim."""
    start = time.perf_counter()
    at = {point.name: point for point in traffic.area.points}
    for k, lane in enumerate(chance.sample(traffic.area.paths, claims)):
        a, b = at[lane.start], at[lane.end]
        x, y, r = (a.x_m + b.x_m) / 2, (a.y_m + b.y_m) / 2, 0.05
        ring = ((x - r, y - r), (x + r, y - r), (x + r, y + r), (x - r, y + r))
        traffic.claim(f"claim {k}", "somebody", (ring,))
    return (time.perf_counter() - start) * 1000 / max(claims, 1)


def steps(robots: int, side: int, seconds: int, seed: int, claims: int = 0) -> dict[str, float]:
    """Milliseconds per call of `step`, and orders done, with random goals for everybody."""
    area = lattice(side)
    chance = random.Random(seed)
    traffic = Traffic(SCENE, area, (Group(id=0, name="g"),))
    runners = {
        RobotName(f"R{k:03}"): Runner(RobotName(f"R{k:03}"), point)
        for k, point in enumerate(chance.sample(area.points, robots))
    }
    for name in runners:
        traffic.add(name, 0)
    goals: dict[RobotName, Goal] = {}
    taken: list[float] = []
    reports_s, done, now_ms = 0.0, 0, 0
    claim_ms = reserve(traffic, chance, claims)
    for _ in range(round(seconds / TICK_S)):
        now_ms += round(TICK_S * 1000)
        held = {goal.point for goal in goals.values()}
        for name, runner in runners.items():
            runner.step()
            report = runner.report(now_ms)
            start = time.perf_counter()
            traffic.observe(report)
            reports_s += time.perf_counter() - start
            goal = goals.get(name)
            if goal is not None and traffic.stands_at(name, goal.point):
                done += 1
                goal = None
            if goal is None:
                point = chance.choice(area.points).name
                while point in held:
                    point = chance.choice(area.points).name
                held.add(point)
                goals[name] = Goal(point=point, rank=(0, now_ms, name))
        start = time.perf_counter()
        messages: list[Drive | TellRoute] = traffic.step(now_ms, goals, frozenset())
        taken.append((time.perf_counter() - start) * 1000)
        for message in messages:
            if isinstance(message, Drive):
                runners[message.robot].tell(message)
    settled = sorted(taken[10:])
    start = time.perf_counter()
    for _ in range(1000):
        traffic.step(now_ms, goals, frozenset())
    quiet_us = (time.perf_counter() - start) * 1000
    return {
        "robots": robots,
        "stops": traffic.roadmap.places.stops,
        "step_ms_mean": statistics.fmean(settled),
        "step_ms_p50": settled[len(settled) // 2],
        "step_ms_p99": settled[math.ceil(len(settled) * 0.99) - 1],
        "quiet_step_us": quiet_us,
        "claims": claims,
        "claim_ms": claim_ms,
        "report_us": reports_s * 1e6 / (len(taken) * robots),
        "orders_per_h": done * 3600 / seconds,
    }


def compiling(side: int) -> dict[str, float]:
    """CPU seconds for a map, cold and from the cache."""
    area, groups = lattice(side), (Group(id=0, name="g"),)
    with tempfile.TemporaryDirectory() as folder:
        start = time.process_time()
        roadmap = compile_area(area, groups, FilePath(folder))
        cold = time.process_time() - start
        start = time.process_time()
        compile_area(area, groups, FilePath(folder))
        kept = time.process_time() - start
    return {
        "paths": len(area.paths),
        "cells": roadmap.cells.count,
        "conflicts": len(roadmap.cells.indices) // 2,
        "fcl_pairs": roadmap.cells.checked,
        "fcl_disagreed": roadmap.cells.disagreed,
        "moves": roadmap.moves.count,
        "cold_s": cold,
        "cached_s": kept,
    }


def main() -> None:
    """Measure, print, and keep."""
    results = {
        "step": [
            steps(50, 20, 60, 1),
            steps(100, 26, 60, 1),
            steps(100, 26, 60, 1, claims=20),
            steps(100, 15, 60, 1),
        ],
        "compile": [compiling(16), compiling(51)],
    }
    console = Console(width=160)
    for name, rows in results.items():
        table = Table(title=f"traffic: {name}")
        for column in rows[0]:
            table.add_column(column, justify="right")
        for row in rows:
            table.add_row(*(f"{value:.4g}" for value in row.values()))
        console.print(table)
    RESULTS.parent.mkdir(exist_ok=True)
    RESULTS.write_text(json.dumps(results, indent=2) + "\n")


if __name__ == "__main__":
    main()
