"""Commands that work on files, without a server: scenes in, history out."""

import csv
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import msgspec
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from commands.imports.scene_json import read_any, read_scene, write_scene
from fleetledger.config import Format
from ledger.errors import Refused
from ledger.ids import SceneId
from ledger.moment import At, parse_time
from ledger.scan import read_folder
from ledger.scene import Group, SceneFile
from ledger.telemetry_read import reports_at
from ledger.verify import verify as verify_folder
from projections.parquet import export_parquet
from projections.sql import run_sql
from replay.export import export_rrd
from replay.moment import Moments
from replay.report import describe
from replay.viewer import show
from scheduler.traffic.check import check_scene as planner_findings
from sim.warehouses import for_robots

out = Console()
people = Console(stderr=True)


def import_scene(
    file: Path, output: Path, *, name: str | None, robots: int, robot_group: Path | None
) -> None:
    """Translate a map and write the scene file."""
    groups = None
    if robot_group is not None:
        try:
            groups = (msgspec.json.decode(robot_group.read_bytes(), type=Group),)
        except msgspec.DecodeError as trouble:
            raise Refused("errGroupInvalid", f"{robot_group}: {trouble}") from trouble
    scene = read_any(file.name, file.read_bytes(), name=name, robots=robots, groups=groups)
    _write_scene(scene, output)


def generate_scene(output: Path, *, robots: int, seed: int) -> None:
    """Write a generated warehouse."""
    _write_scene(for_robots(robots, seed), output)


def _write_scene(scene: SceneFile, output: Path) -> None:
    output.write_bytes(write_scene(scene))
    points = sum(len(area.points) for area in scene.areas)
    paths = sum(len(area.paths) for area in scene.areas)
    bins = sum(len(area.bins) for area in scene.areas)
    people.print(
        f"{output}: scene '{scene.name}' with {points} points, {paths} paths, {bins} bins, "
        f"{len(scene.robots)} robots"
    )


def check_scene(file: Path) -> bool:
    """Print what a planner would trip over; False if the scene is unusable."""
    findings = planner_findings(read_scene(file.read_bytes()))
    for finding in findings:
        out.print(
            f"[{'red' if finding.unusable else 'yellow'}]{finding.code}[/] {escape(finding.words)}"
        )
    if not findings:
        out.print("Nothing to say against it.")
    return not any(finding.unusable for finding in findings)


def verify(data: Path) -> bool:
    """Print every finding; False if anything is damaged."""
    with _bar("checking") as advance:
        verdict = verify_folder(data, advance)
    for finding in verdict.findings:
        colour = "red" if finding.damage else "yellow"
        at = "" if finding.position is None else f", position {finding.position}"
        out.print(f"[{colour}]{finding.path}[/], byte {finding.offset}{at}: {escape(finding.what)}")
        out.print(f"  {finding.advice}")
    damaged = any(finding.damage for finding in verdict.findings)
    out.print(
        f"{'DAMAGED' if damaged else 'sound'}: {verdict.events} events in {verdict.chunks} "
        f"chunks, {verdict.segments} segments ({verdict.sealed} sealed), "
        f"{verdict.snapshots} snapshots"
    )
    return not damaged


def replay(data: Path, *, at: str, scene: str | None, as_json: bool, rerun: bool) -> None:
    """Print the state at a moment, or open it in Rerun."""
    at_ms = parse_time(at, "--at")
    fleet = Moments(data).fleet(At(at_ms=at_ms))
    if scene is not None and scene not in fleet.scenes:
        raise Refused("errSceneNotFound", f"There was no scene '{scene}' at that moment.")
    if rerun:
        show(data, scene=scene, at_ms=at_ms)
        return
    if as_json:
        sys.stdout.buffer.write(fleet.canonical() + b"\n")
        return
    present = [id_ for id_, known in fleet.scenes.items() if not known.removed]
    scenes = [SceneId(scene)] if scene is not None else present
    reports = {id_: reports_at(data / "telemetry", id_, at_ms) for id_ in scenes}
    out.print(describe(fleet, reports))


def export(
    data: Path,
    *,
    rrd: Path | None,
    parquet: Path | None,
    scene: str | None,
    since: str | None,
    until: str | None,
) -> None:
    """Write a Rerun recording, or Parquet files by day, or both."""
    if rrd is None and parquet is None:
        raise Refused("errFieldMissing", "Say what to write: '--rrd FILE' or '--parquet FOLDER'.")
    from_ms = parse_time(since, "--from") if since is not None else None
    to_ms = parse_time(until, "--to") if until is not None else None
    if parquet is not None:
        read = partial(read_folder, data / "ledger")
        with _bar("writing Parquet") as advance:
            wrote = export_parquet(
                data, parquet, read, scene=scene, from_ms=from_ms, to_ms=to_ms, progress=advance
            )
        people.print(
            f"{parquet}: {wrote.orders} ended orders, {wrote.steps} steps and {wrote.events} "
            f"events of {wrote.days} days; read them with "
            f"`SELECT * FROM '{parquet}/orders/*/*.parquet'` in DuckDB"
        )
    if rrd is None:
        return
    with _bar("recording") as advance:
        export_rrd(data, rrd, scene=scene, from_ms=from_ms, to_ms=to_ms, progress=advance)
    people.print(f"{rrd}: {rrd.stat().st_size / 1e6:.1f} MB; open it with `rerun {rrd}`")


def sql(data: Path, statement: str, form: Format) -> None:
    """Print the rows of one SELECT."""
    with _bar("reading history") as advance:
        answer = run_sql(data, statement, partial(read_folder, data / "ledger"), advance)
    names = [column.name for column in answer.columns]
    if form is Format.JSON:
        rows = [dict(zip(names, row, strict=True)) for row in answer.rows]
        sys.stdout.buffer.write(msgspec.json.encode(rows, enc_hook=str) + b"\n")
    elif form is Format.CSV:
        writer = csv.writer(sys.stdout)
        writer.writerow(names)
        writer.writerows(answer.rows)
    else:
        table = Table(*names)
        for row in answer.rows:
            table.add_row(*("" if value is None else str(value) for value in row))
        out.print(table)


@contextmanager
def _bar(what: str) -> Iterator[Callable[[int, int], None]]:
    """Show progress of what may take longer than a second, on standard error."""
    columns = (TextColumn(what), BarColumn(), TimeRemainingColumn())
    with Progress(*columns, console=people, transient=True) as progress:
        bar = progress.add_task(what, total=None)

        def advance(done: int, total: int) -> None:
            progress.update(bar, completed=done, total=total)

        yield advance
