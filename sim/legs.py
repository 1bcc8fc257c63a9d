"""What a simulated robot is, and one leg of its way: a piece of the route as it drives it."""

from math import pi

import msgspec

from ledger.ids import PointName, RobotName, SceneId
from ledger.link import Piece
from ledger.scene import Kinematics
from sim.curves import Track, track, wrapped

ALIGN_RAD = 0.1  # a kink up to this is driven through; a sharper one is a stop and a turn in place
CURVE_SPEED_MPS_MIN = 0.1  # also in a bend that is too sharp for the limit of rotation


class Body(msgspec.Struct, frozen=True, kw_only=True):
    """What a robot is, as far as it does not change while it drives."""

    scene: SceneId
    name: RobotName
    area: int
    map_name: str
    map_digest: str
    kinematics: Kinematics
    radius_m: float  # of the circle round the reference point that holds the footprint
    chargers: frozenset[PointName]


class Leg:
    """A piece of the route being driven, with the speeds that the road ahead allows."""

    __slots__ = (
        "acceleration",
        "exit",
        "joined",
        "length",
        "piece",
        "speed_max",
        "stop",
        "track",
        "whole",
    )

    def __init__(self, piece: Piece, kinematics: Kinematics) -> None:
        self.piece = piece
        self.length = piece.length_m
        self.stop = 0.0  # how far the authority reaches in it
        self.whole = False  # it reaches to the end
        self.exit = 0.0  # speed allowed at `stop`
        self.joined = False  # entered without a stop
        self.track: Track | None = None
        if piece.path is None:
            self.speed_max = kinematics.turn_radps_max
            self.acceleration = kinematics.turn_radps2_max
            return
        self.track = track(piece.curve)
        speed = min(kinematics.speed_mps_max, piece.speed_mps_max or kinematics.speed_mps_max)
        if self.track.curvature_max > 0.0:
            bend = kinematics.turn_radps_max / self.track.curvature_max
            speed = min(speed, max(bend, CURVE_SPEED_MPS_MIN))
        own = kinematics.acceleration_mps2_max
        self.speed_max = speed
        self.acceleration = min(own, piece.acceleration_mps2_max or own)

    def heading_at_start(self) -> float:
        """Heading of the robot that drives this path, at its start."""
        assert self.track is not None
        return self.track.headings_rad[0] + (pi if self.piece.backward else 0.0)


def joined(before: Leg, leg: Leg) -> bool:
    """Tell whether a leg is entered without a stop."""
    if before.track is None or leg.track is None or before.piece.backward != leg.piece.backward:
        return False
    kink = wrapped(leg.track.headings_rad[0] - before.track.headings_rad[-1])
    return abs(kink) <= ALIGN_RAD
