"""How fast simulated robots are: stepping alone, and with their reports at ten a second.

Everybody always has somewhere to go, through each other; nobody plans, nothing is sent.
"""

import random
import time
from math import atan2
from pathlib import Path as FilePath
from tempfile import TemporaryDirectory

import msgspec

from ledger.ids import PathKey, PointName, RobotName, SceneId
from ledger.link import Drive, Mark, Piece
from ledger.scene import Area, Path, RobotConfig, Scene
from sim.curves import track
from sim.robot import SimRobot
from sim.warehouses import for_robots
from sim.world import World

STEP_S = 0.1
AHEAD = 4  # paths that a robot is told at a time


class Wanderers:
    """Robots of a world that are told random ways, each before it arrives."""

    def __init__(self, robots: int, seed: int) -> None:
        made = for_robots(robots, seed)
        self.scene = Scene(
            id=SceneId("bench"), name=made.name, digest="", areas=made.areas, groups=made.groups
        )
        self.area: Area = made.areas[0]
        self.rng = random.Random(seed)
        self.world = World(random.Random(seed))
        self.points = {p.name: (p.x_m, p.y_m) for p in self.area.points}
        self.leaving: dict[PointName, list[Path]] = {}
        for path in self.area.paths:
            self.leaving.setdefault(path.start, []).append(path)
        self.at: dict[RobotName, tuple[PointName, int, str]] = {}
        for config in made.robots:
            self.join(config)
        for report in self.world.reports(0):
            assert report.point is not None
            self.at[report.robot] = (report.point, 0, report.session)

    def join(self, config: RobotConfig) -> None:
        """Add one robot."""
        assert self.world.add(self.scene, config, at_ms=0)

    def send(self, robot: RobotName) -> None:
        """Tell a robot the next few paths; sharp corners it turns round by itself."""
        point, number, session = self.at[robot]
        pieces = []
        for _ in range(AHEAD):
            path = self.rng.choice(self.leaving[point])
            curve = (self.points[path.start], *path.controls, self.points[path.end])
            number += 1
            point = path.end
            pieces.append(
                Piece(
                    number=number,
                    commit=number,
                    move=0,
                    plan="",
                    path=PathKey(path.key),
                    area=0,
                    heading_rad=atan2(curve[-1][1] - curve[-2][1], curve[-1][0] - curve[-2][0]),
                    curve=curve,
                    length_m=track(curve).length_m,
                )
            )
        end = Mark(piece=number, along_m=pieces[-1].length_m)
        self.at[robot] = (point, number, session)
        self.world.tell(
            self.scene.id,
            Drive(robot=robot, session=session, authority=end, pieces=tuple(pieces)),
        )

    def send_idle(self) -> None:
        """Tell everybody who is about to run out of way."""
        for robot in self.robots():
            if len(robot.legs) < 2:
                self.send(robot.body.name)

    def robots(self) -> list[SimRobot]:
        """All robots of the world."""
        return list(self.world.robots())


def stepping(robots: int, seconds: int, *, reporting: bool) -> dict[str, float | str]:
    """Measure CPU time per robot and step, without that of telling ways."""
    fleet = Wanderers(robots, seed=1)
    encoder = msgspec.json.Encoder()
    spent_s = 0.0
    steps = round(seconds / STEP_S)
    for number in range(steps):
        fleet.send_idle()
        began_s = time.process_time()
        fleet.world.step(STEP_S)
        if reporting:
            for report in fleet.world.reports(number * 100, changed_only=True):
                encoder.encode(report)
        spent_s += time.process_time() - began_s
    what = "stepped and reported" if reporting else "stepped"
    return {
        "what": f"{robots} robots {what}",
        "robot_steps_per_s": steps * robots / spent_s,
        "us_per_robot_step": spent_s / (steps * robots) * 1e6,
        "cpu_s_per_simulated_hour": spent_s / seconds * 3600,
    }


def saving(robots: int) -> dict[str, float | str]:
    """Measure the memory that is written before each round of reports."""
    fleet = Wanderers(robots, seed=1)
    fleet.send_idle()
    fleet.world.step(1.0)
    rounds = 200
    with TemporaryDirectory() as folder:
        path = FilePath(folder) / "robots"
        began_s = time.process_time()
        for _ in range(rounds):
            new = path.with_suffix(".new")
            new.write_bytes(fleet.world.save())
            new.replace(path)
        spent_s = time.process_time() - began_s
    return {
        "what": f"memory of {robots} robots saved",
        "ms_per_save": spent_s / rounds * 1e3,
        "bytes": float(len(fleet.world.save())),
    }


def main() -> list[dict[str, float | str]]:
    """Run all, print a table, and give the rows."""
    rows = [
        stepping(50, 120, reporting=False),
        stepping(50, 120, reporting=True),
        stepping(100, 60, reporting=True),
        saving(50),
    ]
    for row in rows:
        figures = ", ".join(
            f"{key} {value:,.2f}" for key, value in row.items() if isinstance(value, float)
        )
        print(f"{row['what']:<36} {figures}")
    return rows


if __name__ == "__main__":
    main()
