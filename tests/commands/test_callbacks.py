import pytest
from hypothesis import given as drawn
from hypothesis import settings
from hypothesis import strategies as st

from commands.callbacks import (
    REASON_CHARS_MAX,
    RETRIES_MAX,
    URL_CHARS_MAX,
    URLS_MAX,
    ConfigureCallbacks,
    GiveUpCallback,
)
from commands.rejected import Reason, Rejected
from ledger.callbacks import CallbackConfig, CallbackStatus
from ledger.events import CallbackGivenUp, CallbacksConfigured, SceneDisabled, SceneRemoved
from ledger.ids import SceneId
from tests.commands.site import ORDER, SCENE, opened
from tests.scenario import ask, given

URL = "https://wms.example:8443/fleet/orders?plant=7"
ON = CallbackConfig(enabled=True, urls=(URL,), statuses=(CallbackStatus.DONE,))


def configure(config: CallbackConfig, scene: SceneId = SCENE) -> object:
    return ask(ConfigureCallbacks, scene=scene, callbacks=config)


def given_up(reason: str, scene: SceneId = SCENE) -> object:
    return ask(
        GiveUpCallback,
        scene=scene,
        order=ORDER,
        url=URL,
        status=CallbackStatus.DONE,
        of_position=7,
        reason=reason,
    )


def test_settings_are_taken_as_they_are() -> None:
    fleet = (
        given(*opened()).when(configure(ON)).then(CallbacksConfigured(scene=SCENE, callbacks=ON))
    )
    assert fleet.scenes[SCENE].callbacks == ON


def test_the_same_settings_again_are_no_news() -> None:
    past = *opened(), CallbacksConfigured(scene=SCENE, callbacks=ON)
    given(*past).when(configure(ON)).nothing()


def test_a_disabled_scene_may_be_settled_a_removed_one_not() -> None:
    disabled = *opened(), SceneDisabled(scene=SCENE)
    given(*disabled).when(configure(ON)).then(CallbacksConfigured(scene=SCENE, callbacks=ON))
    gone = *disabled, SceneRemoved(scene=SCENE)
    given(*gone).when(configure(ON)).rejected(Reason.SCENE_UNKNOWN)
    given(*opened()).when(configure(ON, SceneId("no"))).rejected(Reason.SCENE_UNKNOWN)


@pytest.mark.parametrize(
    ("config", "field"),
    [
        (CallbackConfig(enabled=True), "callbackUrlList"),
        (CallbackConfig(urls=(URL, URL)), "callbackUrlList.1"),
        (CallbackConfig(retries_max=-1), "retryTimes"),
        (CallbackConfig(retries_max=RETRIES_MAX + 1), "retryTimes"),
        (CallbackConfig(retry_s=0.0), "retryInterval"),
        (CallbackConfig(retry_s=float("nan")), "retryInterval"),
        (CallbackConfig(retry_s=float("inf")), "retryInterval"),
        *(
            (CallbackConfig(urls=(url,)), "callbackUrlList.0")
            for url in (
                "",
                "wms.example",
                "ftp://wms.example/",
                "http://",
                "http:///path",
                "http://wms.example:0/",
                "http://wms.example:99999/",
                "http://wms.example:port/",
                "http://[::1/",
                "http://alice:secret@wms.example/",
                "http://@wms.example/",
                "http://wms.example/#part",
                "http://wms.example/a b",
                "http://wms.example/\n",
                "http://wms.example/\u00e9",
                "http://wms.example/\ud800",
                "http://wms.example/\0",
                "http://wms.example/" + "x" * URL_CHARS_MAX,
            )
        ),
    ],
)
def test_what_cannot_be_done_is_refused_by_its_field(config: CallbackConfig, field: str) -> None:
    given(*opened()).when(configure(config)).rejected(Reason.FIELD_INVALID, f"'{field}'")


def test_more_addresses_than_the_limit_are_refused() -> None:
    urls = tuple(f"http://wms.example/{n}" for n in range(URLS_MAX + 1))
    given(*opened()).when(configure(CallbackConfig(urls=urls))).rejected(Reason.TOO_MANY)
    most = CallbackConfig(enabled=True, urls=urls[:-1])
    given(*opened()).when(configure(most)).then(CallbacksConfigured(scene=SCENE, callbacks=most))


@settings(max_examples=200)
@drawn(st.text(max_size=40) | st.text(max_size=20).map("http://{}".format))
def test_no_text_is_more_than_refused(url: str) -> None:
    outcome = given(*opened()).when(configure(CallbackConfig(urls=(url,))))
    if isinstance(outcome.decision, Rejected):
        assert "callbackUrlList.0" in outcome.decision.message


def test_what_was_given_up_is_on_record() -> None:
    event = CallbackGivenUp(
        scene=SCENE,
        order=ORDER,
        url=URL,
        status=CallbackStatus.DONE,
        of_position=7,
        reason="x" * REASON_CHARS_MAX,
    )
    given(*opened()).when(given_up("x" * 1_000)).then(event)
    gone = *opened(), SceneRemoved(scene=SCENE)
    given(*gone).when(given_up("x" * REASON_CHARS_MAX)).then(event)
    given(*opened()).when(given_up("x", SceneId("no"))).nothing()
