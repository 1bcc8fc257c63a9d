"""Laws of what is committed (design notes, traffic §8), to be asked of any traffic at any time."""

from scheduler.traffic.traffic import Traffic


def connected(traffic: Traffic) -> None:
    """(3) What is owned is the beginning of the route, the rest is promised in the route's order,
    and no two routes end at one place or at two that exclude each other.
    """
    ends: list[int] = []
    for track in traffic._tracks.values():
        slots = [slot for slot in (*track.owned, *track.promised) if not slot.standing]
        marks = [slot.end for slot in slots if slot.end is not None]
        assert marks == sorted(marks), track.name
        commits = [slot.commit for slot in track.promised]
        assert commits == sorted(commits), track.name
        if track.place is not None:
            ends.append(track.place)
    assert len(ends) == len(set(ends))
    excludes = traffic.roadmap.places.conflict
    assert not any(excludes[a] >> b & 1 for a in ends for b in ends if a != b)


def acyclic(traffic: Traffic) -> None:
    """(5) Nobody waits in a ring. Who waits for ground waits for lower commit numbers only, but for
    ground that somebody was found on. One that was not heard yet waits for nobody.
    """
    tracks, grants = traffic._tracks, traffic.grants
    waits_for: dict[str, set[str]] = {}
    for name, track in tracks.items():
        if not track.promised or not track.placed:
            continue
        wanted = track.promised[0]
        excluded = set(grants.excluded(wanted.cell))
        waits_for[name] = {
            other.name
            for other in tracks.values()
            for slot in (other.promised if other is not track else ())
            if slot.cell in excluded and slot.commit < wanted.commit
        }
        for other in tracks.values():
            for slot in other.owned if other is not track else ():
                if slot.cell in excluded:
                    lower = slot.commit < wanted.commit or slot.standing
                    assert lower, (name, wanted, other.name, slot)
                    left = slot.end is not None and slot.end <= other.authority
                    if not left or slot is other.owned[-1]:  # it drives no further
                        waits_for[name].add(other.name)
    while free := {name for name, others in waits_for.items() if not others & waits_for.keys()}:
        for name in free:
            del waits_for[name]
    assert not waits_for, waits_for
