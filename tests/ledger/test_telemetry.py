"""The telemetry log gives any moment back, torn or still being written, and keeps its limits."""

import math
import shutil
import tempfile
from pathlib import Path

import msgspec
import pytest
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from hypothesis import example, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader

from ledger.ids import PathKey, PointName, RobotName
from ledger.link import Plan
from ledger.telemetry import (
    TelemetryLog,
    plans_at,
    read_plans,
    read_telemetry,
    reports_at,
)
from ledger.telemetry_format import LOOK_BACK_MS, SILENT_MS_MAX, WHOLE_EVERY_MS, files
from ledger.telemetry_read import last_plans, last_reports
from tests.ledger.driving import OTHER, SCENE, T0, drive, plan, report


def test_a_moment_has_the_newest_report_of_each_robot(tmp_path: Path) -> None:
    log = TelemetryLog(tmp_path)
    drive(log, seconds=35)
    log.flush()
    for at_ms in range(T0 + 300, T0 + 34_000, 1_700):
        found = reports_at(tmp_path, SCENE, at_ms)
        assert sorted(found) == ["R0", "R1", "R2"]
        for newest in found.values():
            assert at_ms - 200 <= newest.at_ms <= at_ms
    log.close()


def test_a_scene_sees_only_its_own_robots(tmp_path: Path) -> None:
    log = TelemetryLog(tmp_path)
    log.write([report("R", T0, 1.0), report("R", T0, 2.0, OTHER)])
    log.close()
    assert reports_at(tmp_path, SCENE, T0)[RobotName("R")].x_m == 1.0
    assert reports_at(tmp_path, OTHER, T0)[RobotName("R")].x_m == 2.0


def test_before_the_first_report_nothing_is_known(tmp_path: Path) -> None:
    assert reports_at(tmp_path / "never", SCENE, T0) == {}
    log = TelemetryLog(tmp_path)
    drive(log, seconds=2)
    log.close()
    assert reports_at(tmp_path, SCENE, T0 - 1) == {}


def test_a_robot_that_stands_still_is_written_with_every_whole_batch_only(tmp_path: Path) -> None:
    log = TelemetryLog(tmp_path)
    for tick in range(300):
        log.write([report("R", T0 + tick * 100, 7.0)])
    log.close()
    written = list(read_telemetry(tmp_path, SCENE, T0, T0 + 60_000))
    assert [r.at_ms - T0 for r in written] == [0, WHOLE_EVERY_MS, 2 * WHOLE_EVERY_MS]


def test_the_last_move_before_a_halt_is_not_lost_to_the_sampling(tmp_path: Path) -> None:
    log = TelemetryLog(tmp_path)
    for tick, x_m in enumerate([0.0, 1.0, 2.0, 2.0, 2.0, 2.0]):
        log.write([report("R", T0 + tick * 100, x_m)])
    log.close()
    assert reports_at(tmp_path, SCENE, T0 + 600)[RobotName("R")].x_m == 2.0


def test_a_crash_leaves_a_readable_file_that_lacks_a_second_at_most(tmp_path: Path) -> None:
    log = TelemetryLog(tmp_path / "live")
    drive(log, seconds=20)
    shutil.copytree(tmp_path / "live", tmp_path / "dead")  # what kill -9 would leave
    log.close()
    newest = reports_at(tmp_path / "dead", SCENE, T0 + 20_000)
    assert {r.at_ms >= T0 + 18_800 for r in newest.values()} == {True}


def test_reading_follows_the_file_that_is_being_written(tmp_path: Path) -> None:
    log = TelemetryLog(tmp_path)
    for second in range(5):
        drive(log, seconds=1, start_ms=T0 + second * 1000)
        log.flush()
        now_ms = T0 + second * 1000 + 900
        assert reports_at(tmp_path, SCENE, now_ms)[RobotName("R0")].at_ms >= now_ms - 200
    log.close()


histories = st.lists(
    st.tuples(st.integers(0, 15_000), st.sampled_from("AB"), st.integers(0, 3)), max_size=25
)


@given(history=histories, back_ms=st.integers(0, 30_000))
@example(history=[(0, "A", 0), (7_001, "A", 0), (15_000, "A", 0)], back_ms=1)  # long nothing, then
@settings(max_examples=80, deadline=None)
def test_without_sampling_every_moment_is_exact(
    history: list[tuple[int, str, int]], back_ms: int
) -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        log = TelemetryLog(folder, sample_ms=0, file_ms_max=40_000)
        at_ms, said = T0, []
        for step_ms, robot, x in history:
            at_ms += step_ms
            said.append(report(robot, at_ms, float(x)))
            log.write(said[-1:])
        log.close()
        then_ms = at_ms - back_ms
        newest: dict[RobotName, float] = {}
        for item in said:
            if item.at_ms <= then_ms:
                newest[item.robot] = item.x_m
        found = reports_at(folder, SCENE, then_ms)
        assert {robot: r.x_m for robot, r in found.items()} == newest


@pytest.mark.parametrize("away_ms", [60_000, LOOK_BACK_MS + 120_000, SILENT_MS_MAX - 120_000])
def test_a_robot_silent_since_before_a_restart_is_still_known(tmp_path: Path, away_ms: int) -> None:
    first = TelemetryLog(tmp_path)
    first.write([report("SILENT", T0, 1.0), report("R", T0, 2.0)])
    first.write_plans([plan("SILENT", T0, 1.0)])
    first.close()
    assert last_reports(tmp_path, SCENE).keys() == {"SILENT", "R"}
    assert last_plans(tmp_path, SCENE).keys() == {"SILENT"}
    second = TelemetryLog(tmp_path)
    for tick in range(5):
        second.write([report("R", T0 + away_ms + tick * WHOLE_EVERY_MS, float(tick))])
    second.close()
    assert last_reports(tmp_path, SCENE).keys() == {"SILENT", "R"}
    assert reports_at(tmp_path, SCENE, T0 + away_ms + 40_000).keys() == {"SILENT", "R"}


def test_a_robot_silent_for_too_long_is_forgotten(tmp_path: Path) -> None:
    first = TelemetryLog(tmp_path)
    first.write([report("SILENT", T0, 1.0), report("R", T0, 2.0)])
    first.close()
    second = TelemetryLog(tmp_path)
    for tick in range(2):
        second.write([report("R", T0 + SILENT_MS_MAX + 1 + tick * WHOLE_EVERY_MS, 0.0)])
    second.close()
    assert last_reports(tmp_path, SCENE).keys() == {"R"}


def test_of_no_log_nothing_is_known(tmp_path: Path) -> None:
    assert last_reports(tmp_path, SCENE) == {}
    assert last_plans(tmp_path, SCENE) == {}


def test_two_logs_of_the_same_second_do_not_overwrite_each_other(tmp_path: Path) -> None:
    for x_m in (1.0, 2.0):
        log = TelemetryLog(tmp_path)
        log.write([report("R", T0 + int(x_m), x_m)])
        log.close()
    assert [path.name for _, path in files(tmp_path)] == [
        "20261118T110640Z.mcap",
        "20261118T110640Z-1.mcap",
    ]
    assert reports_at(tmp_path, SCENE, T0 + 10)[RobotName("R")].x_m == 2.0


def test_files_roll_by_time_and_old_ones_go(tmp_path: Path) -> None:
    log = TelemetryLog(tmp_path, file_ms_max=5_000, keep_ms=12_000)
    drive(log, seconds=40)
    log.close()
    starts = [(start_ms - T0) // 1000 for start_ms, _ in files(tmp_path)]
    assert starts == [20, 25, 30, 35]
    assert reports_at(tmp_path, SCENE, T0 + 26_000)[RobotName("R1")].at_ms == T0 + 26_000


def test_the_oldest_files_go_when_there_is_too_much(tmp_path: Path) -> None:
    kept_bytes = 70_000  # a few files: each begins with some 20 kB of schemas
    log = TelemetryLog(tmp_path, file_ms_max=2_000, keep_bytes_max=kept_bytes)
    drive(log, seconds=30)
    log.close()
    *old, newest = [path for _, path in files(tmp_path)]
    assert 0 < len(old) < 14
    assert sum(path.stat().st_size for path in old) <= kept_bytes
    assert newest.exists()


def test_plans_are_kept_like_reports(tmp_path: Path) -> None:
    log = TelemetryLog(tmp_path)
    for tick in range(4):
        left = tuple(PathKey(f"P{n}->P{n + 1}") for n in range(tick, 4))
        plan = Plan(
            scene=SCENE,
            robot=RobotName("R"),
            at_ms=T0 + tick * 1000,
            ready=True,
            untravelled=left,
        )
        log.write_plans([plan])
    log.close()
    assert len(plans_at(tmp_path, SCENE, T0 + 1_500)[RobotName("R")].untravelled) == 3
    assert len(list(read_plans(tmp_path, SCENE, T0, T0 + 9_000))) == 4


def test_a_folder_that_cannot_be_written_does_not_stop_the_caller(tmp_path: Path) -> None:
    blocked = tmp_path / "telemetry"
    blocked.write_text("a file where a folder should be")
    log = TelemetryLog(blocked)
    log.write([report("R", T0, 1.0)])
    log.write([report("R", T0 + 1_000, 2.0)])
    log.close()


def messages(path: Path) -> list[tuple[str, bytes]]:
    """Read a file with the stock reader, every checksum checked."""
    with path.open("rb") as stream:
        assert list(StreamReader(stream, validate_crcs=True).records)
    with path.open("rb") as stream:
        found = make_reader(stream, validate_crcs=True).iter_messages()
        return [(channel.topic, message.data) for _, channel, message in found]


def test_stock_tools_read_the_file_and_draw_robots_and_grants(tmp_path: Path) -> None:
    log = TelemetryLog(tmp_path)
    drive(log, seconds=1)
    log.write_plans([plan("R1", T0 + 1_000, 2.0)])
    drive(log, seconds=5, start_ms=T0 + 1_000)
    log.close()
    [(_, path)] = files(tmp_path)
    found = messages(path)
    drawn = [
        transform
        for topic, data in found
        if topic == f"/scenes/{SCENE}/robots"
        for transform in FrameTransforms.FromString(data).transforms
        if transform.child_frame_id == f"{SCENE}/R1"
    ]
    assert 10 <= len(drawn) <= 13  # twice a second
    assert drawn[-1].parent_frame_id == f"{SCENE}/0"
    assert drawn[-1].timestamp.ToMilliseconds() > T0 + 5_000
    assert drawn[-1].translation.y == 1.5
    assert math.isclose(2 * math.asin(drawn[-1].rotation.z), 0.25, abs_tol=1e-3)
    [grants] = [data for topic, data in found if topic == f"/scenes/{SCENE}/grants"]
    [entity] = SceneUpdate.FromString(grants).entities
    assert (entity.id, entity.frame_id) == ("R1", f"{SCENE}/0")
    [line] = entity.lines
    assert [(p.x, p.y) for p in line.points][1:] == [(2.5, 0.5)]  # the middle of what it holds
    assert line.color.a == line.pose.orientation.w == 1.0


spans = st.sampled_from([0.0, 1e-4, 0.01, 1.0, 1e5, 1e14, 1e300, -1e300, 1.7e308])


@given(
    history=st.lists(
        st.tuples(spans.filter(lambda x: abs(x) <= 1e6), spans, st.sampled_from([None, "P"])),
        max_size=12,
    )
)
@settings(max_examples=60, deadline=None)
def test_any_number_of_a_robot_is_read_back_as_near_as_is_promised(
    history: list[tuple[float, float, PointName | None]],
) -> None:
    with tempfile.TemporaryDirectory() as name:
        log = TelemetryLog(Path(name), sample_ms=0)
        newest = None
        for tick, (x_m, odometer_m, point) in enumerate(history):
            said = report("R", T0 + tick * 100, x_m)
            said = msgspec.structs.replace(said, odometer_m=odometer_m, point=point)
            if newest is None or msgspec.structs.replace(said, at_ms=0, number=0) != (
                msgspec.structs.replace(newest, at_ms=0, number=0)
            ):
                newest = said
            log.write([said])
        log.close()
        found = reports_at(Path(name), SCENE, T0 + 10_000)
        assert (newest is None) == (found == {})
        if newest is None:
            return
        read = found[RobotName("R")]
        assert read.point == newest.point
        assert math.isclose(read.x_m, newest.x_m, abs_tol=0.0005001)
        assert math.isclose(read.odometer_m, newest.odometer_m, rel_tol=1e-15, abs_tol=0.005001)
        assert read.heading_rad == newest.heading_rad


def test_a_robot_under_way_costs_little(tmp_path: Path) -> None:
    log = TelemetryLog(tmp_path)
    drive(log, seconds=60, robots=100)
    log.close()
    [(_, path)] = files(tmp_path)
    said = [data for topic, data in messages(path) if topic == "/fleet/reports"]
    assert len(b"".join(said)) / (60 * 5 * 100) < 90  # bytes a report, not packed: it was 700
    assert path.stat().st_size / (60 * 5 * 100) < 20  # packed, drawings and index too


@given(
    steps=st.lists(st.integers(100, 9_000), min_size=1, max_size=30),
    keep_ms=st.integers(0, 60_000),
    keep_bytes_max=st.integers(0, 60_000),
)
@settings(max_examples=40, deadline=None)
def test_there_is_never_more_than_the_limits_and_one_file(
    steps: list[int], keep_ms: int, keep_bytes_max: int
) -> None:
    with tempfile.TemporaryDirectory() as name:
        folder, at_ms = Path(name), T0
        log = TelemetryLog(
            folder,
            file_ms_max=5_000,
            file_bytes_max=8_000,
            keep_ms=keep_ms,
            keep_bytes_max=keep_bytes_max,
        )
        for step_ms in steps:
            at_ms += step_ms
            log.write([report(f"R{n}", at_ms, at_ms / 7 + n) for n in range(20)])
            log.flush()
            *old, (start_ms, newest) = files(folder)
            assert newest.exists()
            assert sum(path.stat().st_size for _, path in old) <= keep_bytes_max
            ends = [next_ms for next_ms, _ in (*old, (start_ms, newest))][1:]
            assert all(end_ms >= start_ms - keep_ms for end_ms in ends)
        log.close()


def test_a_robot_whose_clock_is_wrong_does_not_say_how_old_files_are(tmp_path: Path) -> None:
    log = TelemetryLog(tmp_path, keep_ms=10_000)
    log.write([report("R", T0, 1.0)], T0)
    log.write([report("MAD", T0 + 10**9, 1.0), report("R", T0 + 1_000, 2.0)], T0 + 1_000)
    log.close()
    assert len(files(tmp_path)) == 1
    assert reports_at(tmp_path, SCENE, T0 + 1_000)[RobotName("R")].x_m == 2.0
