"""What is already under way: when each robot's committed moves end, and how long they hold ground.

Planners that look ahead start from there. Estimates only: nothing is granted by them.
"""

from collections.abc import Iterable

import msgspec

from ledger.scene import Kinematics
from scheduler.traffic.track import Track

GATHER_S = 1.0  # until a robot that stands is as far as one that passed at full speed


class Ahead(msgspec.Struct, frozen=True, kw_only=True):
    """One robot until its committed moves end."""

    footprint: int
    limits: Kinematics
    near: bool  # its next move can be committed now
    free_s: float  # until it stands where its committed moves end
    held: tuple[tuple[int, float], ...] = ()  # cells, and how long from now on


def ahead(tracks: Iterable[Track]) -> dict[str, Ahead]:
    """Look at all robots that have a place."""
    return {track.name: _ahead(track) for track in tracks if track.place is not None}


def _ahead(track: Track) -> Ahead:
    limits = track.limits
    held: list[tuple[int, float]] = []
    slots = [slot for slot in (*track.owned, *track.promised) if slot.end and not slot.resting]
    at, seconds = 0, 0.0 if not track.standing or track.driven else GATHER_S
    for piece, _ in track.pieces:
        if piece.number < track.progress.piece:
            continue
        done = track.progress.along_m if piece.number == track.progress.piece else 0.0
        top = limits.turn_radps_max if piece.path is None else limits.speed_mps_max
        if piece.path is not None and piece.speed_mps_max is not None:
            top = min(top, piece.speed_mps_max)
        while at < len(slots) and (end := slots[at].end) and end.piece <= piece.number:
            left = end.along_m - done if end.piece == piece.number else 0.0
            held.append((slots[at].cell, seconds + max(left, 0.0) / top))
            at += 1
        seconds += max(piece.length_m - done, 0.0) / top
    return Ahead(
        footprint=track.footprint,
        limits=limits,
        near=track.near,
        free_s=0.0 if track.driven else seconds,
        held=tuple(held),
    )
