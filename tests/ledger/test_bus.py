"""The bus within one process."""

from ledger.bus import MemoryBus


def test_nothing_more_is_delivered_to_who_is_gone():
    bus, heard = MemoryBus(), list[str]()
    bus.subscribe("a/*", lambda key, _: heard.append(f"stays {key}"))
    stay = bus.listeners()
    bus.subscribe("a/*", lambda key, _: heard.append(f"goes {key}"))
    bus.watch("a/*", lambda key, _: heard.append(f"watches {key}"))
    bus.publish("a/1", b"")
    let_go = bus.live("a/2")
    assert heard == ["stays a/1", "goes a/1", "watches a/2"]
    bus.end(entry for entry in bus.listeners() if entry not in stay)
    bus.publish("a/1", b"")
    let_go()
    assert heard[3:] == ["stays a/1"]
