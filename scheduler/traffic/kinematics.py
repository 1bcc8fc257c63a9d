"""How long driving and turning take."""

import math

from ledger.scene import Kinematics, Path


def turn_s(angle_rad: float, limits: Kinematics) -> float:
    """A turn in place from rest to rest."""
    rate, gain = limits.turn_radps_max, limits.turn_radps2_max
    if angle_rad <= rate * rate / gain:
        return 2 * math.sqrt(angle_rad / gain)
    return angle_rad / rate + rate / gain


def drive_s(length_m: float, path: Path, limits: Kinematics) -> float:
    """A path at its speed limit, without speeding up and braking: robots roll through stops."""
    speed = limits.speed_mps_max
    if path.speed_mps_max is not None:
        speed = min(speed, path.speed_mps_max)
    return length_m / speed


def halt_s(limits: Kinematics) -> float:
    """What a halt on the way costs: braking to rest and speeding up again."""
    return limits.speed_mps_max / limits.acceleration_mps2_max


def braking_m(limits: Kinematics, speed_mps: float) -> float:
    """Way to a halt."""
    return speed_mps**2 / (2 * limits.acceleration_mps2_max)
