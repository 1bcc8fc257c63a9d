import pytest

from commands.rejected import Reason
from commands.robots import CreateRobots, CreateRobotSeries, RemoveRobots
from ledger.events import (
    RobotAdded,
    RobotRemoved,
)
from ledger.ids import RobotName
from ledger.scene import ConnectionType, RobotConfig
from ledger.state import BinStatus
from tests.commands.site import (
    ORDER,
    R1,
    R2,
    SCENE,
    assigned,
    created,
    opened,
    task,
)
from tests.scenario import ask, given

R9 = RobotName("R9")


def config(name: str = "AMB-01", **fields: object) -> RobotConfig:
    return RobotConfig(name=RobotName(name), **fields)


def create(*robots: RobotConfig) -> object:
    return ask(CreateRobots, scene=SCENE, robots=robots)


def test_robots_join_their_scene_with_empty_bins() -> None:
    both = (config(bin_count=3), config("AMB-02", group=1))
    events = tuple(RobotAdded(scene=SCENE, config=c) for c in both)
    fleet = given(*opened()).when(create(*both)).then(*events)
    assert [b.status for b in fleet.robots[f"{SCENE}/AMB-01"].bins] == [BinStatus.EMPTY] * 3


@pytest.mark.parametrize(("bins", "plus_one", "places"), [(3, True, 4), (3, None, 3), (1, True, 1)])
def test_the_fork_is_one_place_more_beside_several(
    bins: int, plus_one: bool | None, places: int
) -> None:
    asked = create(config(bin_count=bins, plus_one=plus_one))
    outcome = given(*opened()).when(asked)
    fleet = outcome.then(*outcome.decision.events)
    assert len(fleet.robots[f"{SCENE}/AMB-01"].bins) == places


@pytest.mark.parametrize(
    ("robots", "reason", "word"),
    [
        ((config(""),), Reason.ROBOT_NAME_INVALID, "robotName"),
        ((config(" A"),), Reason.ROBOT_NAME_INVALID, "robotName"),
        ((config("a/b"),), Reason.ROBOT_NAME_INVALID, "robotName"),
        ((config("a\n"),), Reason.ROBOT_NAME_INVALID, "robotName"),
        ((config("a" * 101),), Reason.ROBOT_NAME_INVALID, "100"),
        ((config("R1"),), Reason.ROBOT_NAME_TAKEN, "R1"),
        ((config(), config()), Reason.ROBOT_NAME_TAKEN, "AMB-01"),
        ((config(group=7),), Reason.GROUP_UNKNOWN, "groupId"),
        ((config(bin_count=0),), Reason.ROBOT_CONFIG_INVALID, "selfBinNum"),
        ((config(bin_count=51),), Reason.ROBOT_CONFIG_INVALID, "selfBinNum"),
        ((config(port_first=0),), Reason.ROBOT_CONFIG_INVALID, "robotPortStart"),
        (
            (config(connection=ConnectionType.FLEET_TO_ROBOT, simulated=True),),
            Reason.ROBOT_CONFIG_INVALID,
            "robotIp",
        ),
        ((config(connection=ConnectionType.GATEWAY),), Reason.ROBOT_CONFIG_INVALID, "gwAuthId"),
        (
            (config(connection=ConnectionType.GATEWAY, gateway_user="u"),),
            Reason.ROBOT_CONFIG_INVALID,
            "gwAuthSecret",
        ),
    ],
)
def test_one_bad_robot_keeps_all_out(
    robots: tuple[RobotConfig, ...], reason: Reason, word: str
) -> None:
    asked = create(config("good"), *robots)
    given(*opened(R1)).when(asked).rejected(reason, word)


def series(count: int, **fields: object) -> object:
    pattern = config("", **fields)
    return ask(CreateRobotSeries, scene=SCENE, prefix="AMB", count=count, pattern=pattern)


def test_a_series_has_numbered_names_and_consecutive_addresses() -> None:
    asked = series(2, host="192.168.10.255", port_first=19204)
    given(*opened()).when(asked).then(
        RobotAdded(scene=SCENE, config=config("AMB-01", host="192.168.10.255", port_first=19204)),
        RobotAdded(scene=SCENE, config=config("AMB-02", host="192.168.11.0", port_first=19204)),
    )


def test_numbers_are_as_wide_as_the_count() -> None:
    outcome = given(*opened()).when(series(100))
    names = [event.config.name for event in outcome.decision.events]
    assert (names[0], names[-1]) == ("AMB-001", "AMB-100")


def test_a_series_that_cannot_be_made_whole_is_not_made() -> None:
    story = given(*opened(RobotName("AMB-02")))
    story.when(series(3)).rejected(Reason.ROBOT_NAME_TAKEN, "AMB-02")
    story.when(series(0)).rejected(Reason.TOO_MANY, "count")
    story.when(series(1001)).rejected(Reason.TOO_MANY, "count")
    last = series(2, host="255.255.255.255")
    given(*opened()).when(last).rejected(Reason.ROBOT_CONFIG_INVALID, "robotIpStart")
    blank = ask(CreateRobotSeries, scene=SCENE, prefix=" ", count=1, pattern=config(""))
    given(*opened()).when(blank).rejected(Reason.ROBOT_NAME_INVALID, "robotNamePrefix")
    unreachable = series(1, connection=ConnectionType.FLEET_TO_ROBOT)
    given(*opened()).when(unreachable).rejected(Reason.ROBOT_CONFIG_INVALID, "robotIpStart")
    named = series(1, host="robot.local")
    given(*opened()).when(named).rejected(Reason.ROBOT_CONFIG_INVALID, "robotIpStart")


def test_robots_without_orders_can_be_removed() -> None:
    asked = ask(RemoveRobots, scene=SCENE, robots=(R1, R2, R1))
    fleet = (
        given(*opened(R1, R2))
        .when(asked)
        .then(RobotRemoved(scene=SCENE, robot=R1), RobotRemoved(scene=SCENE, robot=R2))
    )
    assert not fleet.robots


def test_robots_with_orders_stay_and_so_do_the_others() -> None:
    past = (*opened(R1, R2), created(ORDER, task()), assigned())
    asked = ask(RemoveRobots, scene=SCENE, robots=(R2, R1))
    given(*past).when(asked).rejected(Reason.ROBOT_HAS_ORDERS, R1, ORDER)
    asked = ask(RemoveRobots, scene=SCENE, robots=(R2, R9))
    given(*past).when(asked).rejected(Reason.ROBOT_UNKNOWN, R9)


def test_a_scene_must_exist_for_robots() -> None:
    asked = ask(RemoveRobots, scene="S", robots=())
    given(*opened()).when(asked).rejected(Reason.SCENE_UNKNOWN)
