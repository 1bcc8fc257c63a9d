"""Scene files: SCENE.json in and out, what is wrong with one, and which importer reads what."""

import hashlib
from pathlib import PurePath

import msgspec

from commands.imports.checks import BAD_SCENE, check_references, checked, simulated
from commands.imports.movingai import read_movingai
from commands.imports.smap import read_smap
from ledger.canonical import canonical_json
from ledger.errors import Refused
from ledger.scene import Group, SceneFile

__all__ = ["check_references", "digest", "read_any", "read_scene", "write_scene"]

SCENE_BYTES_MAX = 256 * 1024 * 1024


class _Robot(msgspec.Struct):
    gateway_secret: str | None = None  # what files of earlier versions may hold


class _Robots(msgspec.Struct):
    robots: tuple[_Robot, ...] = ()


def _check_no_secret(raw: bytes) -> None:
    """Refuse a file with a secret in it: what is imported goes to the ledger as it is."""
    if b'"gateway_secret"' not in raw:
        return
    for i, robot in enumerate(msgspec.json.decode(raw, type=_Robots).robots):
        if robot.gateway_secret:
            words = (
                f"robots[{i}].gateway_secret: a scene file holds no secret; leave it and "
                "'connection' out, and give both by robot/update/config"
            )
            raise Refused(BAD_SCENE, words, i)


def read_scene(raw: bytes) -> SceneFile:
    """Read SCENE.json. Raises Refused, naming the JSON path of what is wrong."""
    if len(raw) > SCENE_BYTES_MAX:
        raise Refused(BAD_SCENE, f"a scene file has at most {SCENE_BYTES_MAX} bytes", len(raw))
    try:
        scene = msgspec.json.decode(raw, type=SceneFile)
        _check_no_secret(raw)
    except msgspec.ValidationError as error:
        raise Refused(BAD_SCENE, f"scene file: {error}") from error
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise Refused(BAD_SCENE, f"scene file is not JSON: {error}") from error
    return checked(scene)


def write_scene(scene: SceneFile) -> bytes:
    """Write canonical JSON: equal scenes give equal bytes."""
    return canonical_json(scene)


def digest(scene: SceneFile) -> str:
    """SHA-256 of the canonical content: by it the same file is the same scene."""
    return hashlib.sha256(write_scene(scene)).hexdigest()


def read_any(
    file_name: str,
    raw: bytes,
    *,
    name: str | None = None,
    robots: int | None = None,
    groups: tuple[Group, ...] | None = None,
) -> SceneFile:
    """Choose the reader by the file's suffix; `name`, `robots` and `groups` win over the file's.

    Raises Refused for a suffix that nobody reads, and as the reader does.
    """
    match PurePath(file_name).suffix.lower():
        case ".json":
            scene = read_scene(raw)
            if name is not None:
                scene = msgspec.structs.replace(scene, name=name)
            if groups is not None:
                scene = msgspec.structs.replace(scene, groups=groups)
            if robots is not None:
                more = simulated(robots, scene.groups)
                scene = msgspec.structs.replace(scene, robots=more)
            return checked(scene)
        case ".smap":
            return read_smap(raw, name=name, robots=robots or 0, groups=groups)
        case ".map":
            given = name if name is not None else PurePath(file_name).stem
            return read_movingai(raw, name=given, robots=robots or 0, groups=groups)
        case suffix:
            raise Refused(
                "UnknownSceneFormat",
                f"{file_name}: scene files end in .json, .smap or .map, not {suffix or 'nothing'}",
                file_name,
            )
