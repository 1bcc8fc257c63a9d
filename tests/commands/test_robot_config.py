import msgspec
import pytest
from hypothesis import given as drawn
from hypothesis import settings
from hypothesis import strategies as st

from commands.decide import decide
from commands.rejected import Reason, Rejected
from commands.robot_config import ReconfigureRobot, ReconfigureRobots, RobotConfigPatch
from ledger.events import OrderCancelled, RobotDisabled, RobotReconfigured
from ledger.ids import RobotName, robot_key
from ledger.scene import ConnectionType, RobotConfig, RobotVendor
from ledger.state import BinStatus, Fleet
from tests.commands.site import (
    BINS,
    ORDER,
    R1,
    R2,
    SCENE,
    assigned,
    created,
    finished,
    opened,
    started,
    task,
)
from tests.scenario import ask, given, happened

R9 = RobotName("R9")
LOADED = (*opened(R1), created(ORDER, task(BINS[0], loads=True), task()), assigned())


def config(name: str = R1, **fields: object) -> RobotConfig:
    return RobotConfig(name=RobotName(name), **{"group": 1, "simulated": True, **fields})


def whole(**fields: object) -> object:
    return ask(ReconfigureRobot, scene=SCENE, config=config(**fields))


def part(*robots: RobotName, **fields: object) -> object:
    return ask(ReconfigureRobots, scene=SCENE, robots=robots, patch=RobotConfigPatch(**fields))


def changed(**fields: object) -> RobotReconfigured:
    after = config(**fields)
    return RobotReconfigured(scene=SCENE, robot=after.name, config=after)


def test_a_set_up_is_replaced_whole() -> None:
    tagged = changed(tags=("a",), remark="r", bin_count=2)
    fleet = given(*opened(R1)).when(whole(tags=("a",), remark="r", bin_count=2)).then(tagged)
    assert len(fleet.robots[f"{SCENE}/{R1}"].bins) == 2
    given(*opened(R1), tagged).when(whole()).then(changed())


def test_the_same_set_up_is_no_news() -> None:
    given(*opened(R1)).when(whole()).nothing()
    given(*opened(R1, R2)).when(part(R1, R2, group=1, simulated=True, bin_count=1)).nothing()
    given(*opened(R1)).when(part(R1)).nothing()


@pytest.mark.parametrize(
    ("fields", "reason", "word"),
    [
        ({"name": ""}, Reason.ROBOT_NAME_INVALID, "robotName"),
        ({"name": "R9"}, Reason.ROBOT_UNKNOWN, "R9"),
        ({"group": 7}, Reason.GROUP_UNKNOWN, "groupId"),
        ({"bin_count": 0}, Reason.ROBOT_CONFIG_INVALID, "selfBinNum"),
        ({"port_first": 65_536}, Reason.ROBOT_CONFIG_INVALID, "robotPortStart"),
        (
            {"connection": ConnectionType.FLEET_TO_ROBOT},
            Reason.ROBOT_CONFIG_INVALID,
            "robotIp",
        ),
        (
            {"connection": ConnectionType.GATEWAY, "gateway_user": "u"},
            Reason.ROBOT_CONFIG_INVALID,
            "gwAuthSecret",
        ),
    ],
)
def test_what_cannot_be_is_refused(fields: dict[str, object], reason: Reason, word: str) -> None:
    given(*opened(R1)).when(whole(**fields)).rejected(reason, word)


def test_what_is_absent_or_null_stays_and_an_empty_text_takes_away() -> None:
    kept = {"host": "10.0.0.1", "vendor": RobotVendor.HAI}
    story = given(*opened(R1), changed(remark="r", tags=("a",), plus_one=True, **kept))
    asked = part(R1, remark="", tags=(), plus_one=False)
    story.when(asked).then(changed(plus_one=False, **kept))


def test_each_robot_is_set_up_on_its_own() -> None:
    asked = part(R9, R1, R2, bin_count=2)
    past = (*LOADED[:2], LOADED[2], *opened(R2)[1:], *LOADED[3:])
    outcome = given(*past).when(asked)
    outcome.refused(R9=Reason.ROBOT_UNKNOWN, R1=Reason.ROBOT_HAS_ORDERS)
    outcome.then(changed(name=R2, bin_count=2))


@pytest.mark.parametrize("fields", [{"group": 0}, {"bin_count": 2}, {"bin_count": 0}])
def test_ground_and_bins_of_a_robot_with_orders_stay(fields: dict[str, int]) -> None:
    outcome = given(*LOADED).when(part(R1, **fields))
    reason = Reason.ROBOT_CONFIG_INVALID if fields == {"bin_count": 0} else Reason.ROBOT_HAS_ORDERS
    outcome.refused(R1=reason).nothing()
    given(*LOADED).when(part(R1, remark="r")).then(changed(remark="r"))


def test_a_bin_with_a_load_in_it_is_not_cut_off() -> None:
    two = opened(R1, bins=2)
    left = (
        *two,
        created(ORDER, task(BINS[0], loads=True), task()),
        assigned(bin=1),
        started(),
        finished(),
        OrderCancelled(scene=SCENE, order=ORDER),
    )
    given(*left).when(part(R1, bin_count=1)).refused(R1=Reason.ROBOT_BIN_TAKEN).nothing()
    outcome = given(*left).when(part(R1, bin_count=3))
    fleet = outcome.then(changed(bin_count=3))
    bins = [content.status for content in fleet.robots[f"{SCENE}/{R1}"].bins]
    assert bins == [BinStatus.EMPTY, BinStatus.CANCELLED, BinStatus.EMPTY]


def test_disabled_is_a_field_like_the_others() -> None:
    fleet = given(*opened(R1)).when(part(R1, disabled=True)).then(changed(disabled=True))
    assert fleet.robots[f"{SCENE}/{R1}"].config.disabled
    off = RobotDisabled(scene=SCENE, robot=R1)
    given(*opened(R1), off).when(whole()).then(changed())
    given(*opened(R1), off).when(part(R1, remark="r")).then(changed(remark="r", disabled=True))


def test_a_kept_secret_stays_and_a_new_one_is_news() -> None:
    gateway = {"connection": ConnectionType.GATEWAY, "gateway_user": "u"}
    first = changed(**gateway, gateway_secret_kept=True)
    given(*opened(R1)).when(whole(**gateway, gateway_secret_kept=True)).then(first)
    story = given(*opened(R1), first)
    story.when(whole(**gateway)).nothing()
    story.when(part(R1, remark="r")).then(changed(**gateway, gateway_secret_kept=True, remark="r"))
    story.when(whole(**gateway, gateway_secret_kept=True)).then(first)
    story.when(part(R1, gateway_user="")).refused(R1=Reason.ROBOT_CONFIG_INVALID).nothing()


patches = st.builds(
    RobotConfigPatch,
    group=st.sampled_from((None, 0, 1, 7)),
    disabled=st.sampled_from((None, True, False)),
    simulated=st.sampled_from((None, True, False)),
    remark=st.sampled_from((None, "", "r")),
    tags=st.sampled_from((None, (), ("a",))),
    vendor=st.sampled_from((None, *RobotVendor)),
    bin_count=st.sampled_from((None, 0, 1, 3)),
    image=st.sampled_from((None, "7")),
    connection=st.sampled_from((None, *ConnectionType)),
    host=st.sampled_from((None, "", "10.0.0.1")),
    port_first=st.sampled_from((None, 0, 19204)),
    gateway_user=st.sampled_from((None, "", "u")),
    plus_one=st.sampled_from((None, True, False)),
)


@settings(max_examples=150, deadline=None)
@drawn(st.lists(patches, min_size=1, max_size=4), st.permutations((R1, R2, R9)))
def test_a_batch_does_to_each_robot_what_it_does_to_it_alone(
    chain: list[RobotConfigPatch], robots: list[RobotName]
) -> None:
    together = happened(opened(R1, R2))
    alone = happened(opened(R1, R2))
    for patch in chain:
        asked = ask(ReconfigureRobots, scene=SCENE, robots=tuple(robots), patch=patch)
        before = dict(together.robots)
        decision = decide(together, asked)
        happened(decision.events, together)
        assert decide(together, asked).events == ()  # asked again, nothing is new
        assert R9 in decision.refused
        for robot in robots:
            one = decide(alone, msgspec.structs.replace(asked, robots=(robot,)))
            assert one.refused.keys() == decision.refused.keys() & {robot}
            happened(one.events, alone)
        for robot in (R1, R2):
            _check_one(before, together, robot, patch, refused=robot in decision.refused)
    assert {k: r.config for k, r in together.robots.items()} == {
        k: r.config for k, r in alone.robots.items()
    }


def _check_one(
    before: dict[str, object], after: Fleet, name: RobotName, patch: RobotConfigPatch, refused: bool
) -> None:
    key = robot_key(SCENE, name)
    was, now = before[key], after.robots[key]
    if refused:
        assert now == was
        return
    for field in patch.__struct_fields__:
        given_value = getattr(patch, field)
        expected = getattr(was.config, field) if given_value is None else given_value
        assert getattr(now.config, field) == (None if expected == "" else expected)
    assert len(now.bins) == now.config.storage_places
    assert now.config.name == name


@settings(max_examples=60, deadline=None)
@drawn(patches)
def test_a_whole_set_up_is_what_was_asked_or_nothing(patch: RobotConfigPatch) -> None:
    fleet = happened(opened(R1))
    wanted = patch.over(config())
    asked = ask(ReconfigureRobot, scene=SCENE, config=wanted)
    try:
        happened(decide(fleet, asked).events, fleet)
    except Rejected:
        assert fleet.robots[robot_key(SCENE, R1)].config == config()
        return
    assert fleet.robots[robot_key(SCENE, R1)].config == wanted
    assert decide(fleet, asked).events == ()
