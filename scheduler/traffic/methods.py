"""Which planner a scene has (`trafficMethod`)."""

from ledger.scene_config import SceneConfig, TrafficMethod
from scheduler.traffic.planner import Distributed, Planner
from scheduler.traffic.venus import Settings, Think, Venus


def planner_of(config: SceneConfig, think: Think, present: Planner) -> Planner:
    """The planner that these settings ask for: the present one, plans and all, where that is it.

    What is committed is the execution layer's, so that another planner goes on from there.
    """
    if config.traffic_method is TrafficMethod.DISTRIBUTED:
        return present if isinstance(present, Distributed) else Distributed()
    settings = Settings(
        high_w=config.cbs_high_w,
        low_w=config.cbs_low_w,
        interval_ms=config.traffic_plan_interval_ms,
    )
    if isinstance(present, Venus) and present.settings == settings:
        return present
    return Venus(settings, think)
