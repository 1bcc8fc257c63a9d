"""Scenes with simulated robots, and drives for them along the scene's paths."""

import random
from math import atan2, hypot

import msgspec

from ledger.ids import PathKey, RobotName, SceneId
from ledger.link import Drive, Mark, Piece, Report
from ledger.scene import Area, Path, RobotConfig, Scene, SceneFile
from sim.curves import track

SCENE = SceneId("0123456789abcdef01234567")


def scene_of(made: SceneFile) -> Scene:
    return Scene(id=SCENE, name=made.name, digest="", areas=made.areas, groups=made.groups)


def leaving(area: Area, report: Report) -> list[Path]:
    return [path for path in area.paths if path.start == report.point]


def drive_on(area: Area, report: Report, path: Path, number: int, part: float = 1.0) -> Drive:
    """Tell the robot to drive one path from where it rests; it turns by itself."""
    ends = {p.name: (p.x_m, p.y_m) for p in area.points}
    curve = (ends[path.start], *path.controls, ends[path.end])
    table = track(curve)
    piece = Piece(
        number=number,
        commit=number,
        move=0,
        plan=area.map_digest,
        path=PathKey(path.key),
        area=area.id,
        heading_rad=atan2(curve[-1][1] - curve[-2][1], curve[-1][0] - curve[-2][0]),
        curve=curve,
        length_m=table.length_m,
    )
    return Drive(
        robot=report.robot,
        session=report.session,
        authority=Mark(piece=number, along_m=table.length_m * part),
        pieces=(piece,),
    )


def random_drives(area: Area, reports: list[Report], rng: random.Random) -> list[Drive]:
    """Send every resting robot somewhere near; robots pass through each other."""
    drives = []
    for report in reports:
        ways = leaving(area, report)
        if ways and report.progress == report.authority:
            number = report.progress.piece + 1
            drives.append(drive_on(area, report, rng.choice(ways), number))
    return drives


def configs(count: int) -> list[RobotConfig]:
    return [RobotConfig(name=RobotName(f"AMB-{n:02}"), simulated=True) for n in range(1, count + 1)]


def least_gap_m(reports: list[Report]) -> float:
    return min(
        (hypot(a.x_m - b.x_m, a.y_m - b.y_m) for i, a in enumerate(reports) for b in reports[:i]),
        default=float("inf"),
    )


def encoded(reports: list[Report]) -> bytes:
    return msgspec.json.encode(reports)
