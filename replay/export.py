"""Any stretch of the past as a Rerun recording, for engineers to look into."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

import rerun as rr
import rerun.blueprint as rrb

from ledger.errors import Refused
from ledger.ids import SceneId
from ledger.moment import At, time_text
from ledger.scan import read_folder
from ledger.scene import Scene
from ledger.snapshot import Read
from ledger.state import Fleet
from ledger.telemetry_read import plans_at, read_plans, read_telemetry, reports_at
from replay.layers import TIMELINE, Layers
from replay.moment import Moments
from replay.pictures import Picture, film

APPLICATION = "fleetledger"
STEP_MS = 500  # between two pictures
STRETCH_MS_MAX = 24 * 3_600_000  # a longer recording no viewer is happy with

Progress = Callable[[int, int], None]  # done, of all: milliseconds of the past


def export_rrd(
    data: Path,
    file: Path,
    *,
    scene: str | None = None,
    from_ms: int | None = None,
    to_ms: int | None = None,
    progress: Progress | None = None,
) -> Scene:
    """Write a scene's past, the whole of it by default; raises Refused in words.

    The map is drawn as it was at the end. The file appears when it is whole.
    """
    read = partial(read_folder, data / "ledger")
    moments = Moments(data, read=read)
    from_ms, to_ms = _stretch(moments, read, data, from_ms, to_ms)
    chosen = _scene(moments.fleet(At(at_ms=to_ms)), scene)
    folder = data / "telemetry"
    before = moments.fleet(At(at_ms=from_ms)).copy()
    film_of = film(
        Picture(
            before, reports_at(folder, chosen.id, from_ms), plans_at(folder, chosen.id, from_ms)
        ),
        read(before.position),
        read_telemetry(folder, chosen.id, from_ms, to_ms),
        read_plans(folder, chosen.id, from_ms, to_ms),
        from_ms,
        to_ms,
        STEP_MS,
    )
    part = file.with_name(file.name + ".part")
    file.parent.mkdir(parents=True, exist_ok=True)
    name = f"{chosen.name} {time_text(from_ms)}"
    recording = rr.RecordingStream(APPLICATION, recording_id=f"{chosen.id}-{from_ms}")
    try:
        recording.save(part, default_blueprint=blueprint(chosen))
        recording.send_recording_name(name)
        layers = Layers(recording, chosen)
        layers.map(chosen)
        for picture in film_of:
            layers.add(picture)
            if progress is not None:
                progress(picture.at_ms - from_ms, to_ms - from_ms)
        layers.finish()
        recording.flush()
        recording.disconnect()
        part.replace(file)
        return chosen
    finally:
        recording.disconnect()
        part.unlink(missing_ok=True)


def _stretch(
    moments: Moments, read: Read, data: Path, from_ms: int | None, to_ms: int | None
) -> tuple[int, int]:
    """Fill in the ends that were not named: the first event, and the newest event or report."""
    first = next(read(0, 1), None)
    if first is None:
        raise Refused("errLedgerEmpty", f"There is nothing in {data} yet.")
    from_ms = first.at_ms if from_ms is None else max(from_ms, first.at_ms)
    to_ms = moments.fleet(At()).at_ms if to_ms is None else to_ms
    if to_ms < from_ms:
        words = f"{time_text(to_ms)} lies before {time_text(from_ms)}."
        raise Refused("errFieldInvalid", f"Field 'to' is wrong: {words}", "to")
    if to_ms - from_ms > STRETCH_MS_MAX:
        hours = STRETCH_MS_MAX // 3_600_000
        words = f"name a stretch of {hours} hours at most with --from and --to."
        raise Refused("errFieldInvalid", f"Field 'from' is wrong: {words}", "from")
    return from_ms, to_ms


def _scene(fleet: Fleet, scene: str | None) -> Scene:
    if scene is None:
        chosen = next((s for s in fleet.scenes.values() if not s.removed), None)
    else:
        chosen = fleet.scenes.get(SceneId(scene))
    if chosen is None:
        known = ", ".join(f"{s.id} ({s.name})" for s in fleet.scenes.values()) or "none"
        words = f"Field 'scene' is wrong: no scene '{scene or ''}' then; there were: {known}."
        raise Refused("errSceneUnknown", words, scene)
    return chosen


def blueprint(scene: Scene) -> rrb.Blueprint:
    """Lay out the views: the site from above, what happened beside it."""
    points = [point for area in scene.areas for point in area.points]
    xs, ys = [p.x_m for p in points] or [0.0], [p.y_m for p in points] or [0.0]
    x_m, y_m = (min(xs) + max(xs)) / 2, (min(ys) + max(ys)) / 2
    height_m = max(5.0, max(xs) - min(xs), 1.6 * (max(ys) - min(ys)))
    target = (x_m, y_m, 0.0)
    eye = (x_m, y_m - height_m / 20, height_m)  # not straight down, or there is no north
    above = rrb.EyeControls3D(kind=rrb.Eye3DKind.Orbital, position=eye, look_target=target)
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Spatial3DView(
                origin="/",
                name="Site",
                contents=["+ /**", "- /orders", "- /figures/**"],
                eye_controls=above,
            ),
            rrb.Vertical(
                rrb.TextLogView(origin="/orders", name="Orders"),
                rrb.TimeSeriesView(origin="/figures", name="Open orders"),
            ),
            column_shares=[3, 1],
        ),
        rrb.TimePanel(timeline=TIMELINE, state="expanded"),
        rrb.SelectionPanel(state="collapsed"),
        collapse_panels=False,
    )
