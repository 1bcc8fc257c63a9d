"""What traffic has, and how each of it is switched off: by a setting of the scene where there is
one, else by a constant of its module, set for the time of a run.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from types import ModuleType

from ledger.scene_config import SceneConfig, TrafficMethod
from scheduler.traffic import guidance, pibt, stalls, wishes
from tests.laws import yard

NEVER_MS = 10**12
NO_LIMIT = 10**6

Constant = tuple[ModuleType, str, object]


def _granted(*_: object) -> bool:
    return True


BASE = "Distributed"
# Name; settings; constants.
VARIANTS: dict[str, tuple[SceneConfig, tuple[Constant, ...]]] = {
    BASE: (SceneConfig(), ()),
    "Venus": (SceneConfig(traffic_method=TrafficMethod.VENUS), ()),
    "no guidance": (
        SceneConfig(),
        ((guidance, "AGAINST", 0.0), (guidance, "ARRIVING", 0.0)),
    ),
    "no impatience": (SceneConfig(), ((wishes, "IMPATIENCE_PER_S", 0.0),)),
    "pushed where one is bound": (SceneConfig(), ((pibt, "AHEAD_S", 0.0),)),
    "no two moves in one": (SceneConfig(), ((pibt, "PAIRS_MAX", 0),)),
    "no rescues": (SceneConfig(), ((stalls, "STALL_MS", NEVER_MS),)),
    "no safe-state check": (SceneConfig(deadlock_prevention=False), ()),
    "no tokens of dead ends": (
        SceneConfig(),
        ((pibt, "has_token", _granted), (wishes, "has_token", _granted)),
    ),
    "no drain order": (
        SceneConfig(),
        ((wishes, "LEAVING", wishes.BOUND), (wishes, "WAITING", wishes.BOUND)),
    ),
    "no cap of orders per aisle": (SceneConfig(), ((yard, "LANE_MAX", NO_LIMIT),)),
    "no turns ahead": (SceneConfig(turn_ahead=False), ()),
    "reversing": (SceneConfig(reverse_out_of_deadlock=True), ()),
    "pushes of 4 m at most": (SceneConfig(push_distance_m_max=4.0), ()),
}


@contextmanager
def switched(name: str) -> Iterator[SceneConfig]:
    """Within it all runs are of this variant; gives the settings that scenes are to have."""
    config, constants = VARIANTS[name]
    before = [(module, key, getattr(module, key)) for module, key, _ in constants]
    try:
        for module, key, value in constants:
            setattr(module, key, value)
        yield config
    finally:
        for module, key, value in before:
            setattr(module, key, value)
