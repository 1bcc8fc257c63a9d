"""What may go wrong with robots and round about them, and how often: one value, named mixes.

Design notes, traffic §8: late moves, frozen robots, jumps of at most half a metre, lost reports,
closed paths, reserved lanes, restarts. The simulator strikes its own robots and their reports with
the first part; the second part is of the surroundings, and of use to whoever runs a whole site on
virtual time (`tests/surroundings.py`).
"""

import msgspec

from ledger.scene import Value

JUMP_M_MAX = 0.5


class FaultMix(Value, frozen=True, kw_only=True):
    """How often what goes wrong. Ratios are shares; rates are a robot and hour, or a site and hour;
    what lasts, lasts an exponential time.
    """

    # of a robot
    late_ratio: float = 0.0  # of moves: it stands still at their beginning
    late_mean_s: float = 6.0
    frozen_per_h: float = 0.0  # it stands still wherever it is
    frozen_mean_s: float = 60.0
    jump_per_h: float = 0.0  # standing, it is pushed aside by up to JUMP_M_MAX, and says so
    jump_mean_s: float = 30.0  # until somebody puts it back, if it cannot help itself
    cut_per_h: float = 0.0  # its link is down, and it goes on as far as it may
    cut_mean_s: float = 30.0
    hand_per_h: float = (
        0.0  # somebody drives it off its way by hand, and puts it back on some point
    )
    hand_mean_s: float = 60.0
    # of its reports
    lost_ratio: float = 0.0
    repeated_ratio: float = 0.0  # once more, after a newer one
    reordered_ratio: float = 0.0  # only after a newer one
    # of the site
    closed_per_h: float = 0.0  # a path is closed, whoever is on it
    closed_mean_s: float = 60.0
    reserved_per_h: float = 0.0  # ground across the lanes is reserved for others
    reserved_mean_s: float = 60.0
    stranger_per_h: float = 0.0  # a vehicle that is no robot of ours crosses on reserved ground
    scheduler_restarts_per_h: float = 0.0
    core_restarts_per_h: float = 0.0

    def times(self, factor: float) -> "FaultMix":
        """All that has a rate so many times as often: hours of trouble in minutes."""
        rates = {
            name: getattr(self, name) * factor
            for name in self.__struct_fields__
            if name.endswith("_per_h")
        }
        return msgspec.structs.replace(self, **rates)

    @property
    def strikes(self) -> bool:
        """Is there anything that strikes robots at any time, beside late moves."""
        rates = self.frozen_per_h, self.jump_per_h, self.cut_per_h, self.hand_per_h
        return any(rates)

    @property
    def disturbs_reports(self) -> bool:
        """Do reports not all arrive once and in order."""
        return any((self.lost_ratio, self.repeated_ratio, self.reordered_ratio))


NONE = FaultMix()
LATE = FaultMix(late_ratio=0.1)
# A hard day: each robot is in some trouble every half an hour, each site every other minute.
STANDARD = FaultMix(
    late_ratio=0.1,
    frozen_per_h=0.5,
    jump_per_h=0.5,
    cut_per_h=0.5,
    hand_per_h=0.25,
    lost_ratio=0.05,
    repeated_ratio=0.02,
    reordered_ratio=0.02,
    closed_per_h=12.0,
    reserved_per_h=12.0,
    stranger_per_h=6.0,
    scheduler_restarts_per_h=2.0,
    core_restarts_per_h=1.0,
)
MIXES = {"none": NONE, "late": LATE, "standard": STANDARD}
