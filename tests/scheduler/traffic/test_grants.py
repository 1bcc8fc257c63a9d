from hypothesis import given
from hypothesis import strategies as st

from scheduler.traffic.grants import Grants

CELLS = 6
pairs = st.frozensets(
    st.tuples(st.integers(0, CELLS - 1), st.integers(0, CELLS - 1)).filter(lambda p: p[0] < p[1])
)


def table(conflicts):
    rows = [{c} for c in range(CELLS)]
    for a, b in conflicts:
        rows[a].add(b)
        rows[b].add(a)
    return rows, Grants(lambda c: (c, *sorted(rows[c] - {c})), CELLS)


@given(pairs, st.lists(st.tuples(st.integers(0, CELLS - 1), st.sampled_from("ABC")), max_size=40))
def test_no_two_owners_ever_hold_cells_that_exclude_each_other(conflicts, asked):
    rows, grants = table(conflicts)
    held = {}
    for commit, (cell, owner) in enumerate(asked):
        if grants.free(cell, owner, commit):
            grants.take(cell, owner)
            held.setdefault(owner, []).append(cell)
        elif held.get(owner):
            grants.release(held[owner].pop(), owner)
        for a in held:
            for b in held:
                if a != b:
                    assert not any(y in rows[x] for x in held[a] for y in held[b])


@given(
    pairs,
    st.lists(st.lists(st.integers(0, CELLS - 1), min_size=1, max_size=4), min_size=1, max_size=6),
    st.randoms(use_true_random=False),
)
def test_whatever_is_committed_can_be_driven_to_its_end(conflicts, routes, chance):
    """Any order of acquiring and releasing drains: whoever waits, waits for a lower number."""
    _, grants = table(conflicts)
    promised = {f"R{n}": list(route) for n, route in enumerate(routes)}
    commits = {owner: n for n, owner in enumerate(promised)}
    owned = {owner: [] for owner in promised}
    for owner, route in promised.items():
        for cell in route:
            grants.promise(cell, owner, commits[owner])
    while any(promised.values()):
        able = [o for o, r in promised.items() if r and grants.free(r[0], o, commits[o])]
        leaving = [o for o in owned if len(owned[o]) > bool(promised[o])]
        assert able or leaving
        if able and (not leaving or chance.random() < 0.5):
            owner = chance.choice(able)
            cell = promised[owner].pop(0)
            grants.fulfil(cell, owner, commits[owner])
            owned[owner].append(cell)
        else:
            owner = chance.choice(leaving)
            grants.release(owned[owner].pop(0), owner)


def test_a_lower_commit_goes_first_even_if_it_comes_later():
    _, grants = table([(0, 1)])
    grants.promise(0, "late", 1)
    grants.promise(1, "early", 2)
    assert not grants.free(1, "early", 2)
    assert grants.blockers(1, "early", 2) == ["late"]
    assert grants.free(0, "late", 1)
    grants.withdraw(0, "late", 1)
    assert grants.free(1, "early", 2)


def test_a_foreign_shape_excludes_cells_until_its_owner_leaves_it():
    _, grants = table([])
    shape = grants.add_shape(((0, 0), (1, 0), (0, 1)), (2, 3))
    grants.take(shape, "forklift")
    assert not grants.free(2, "A", 1)
    assert grants.free(4, "A", 1)
    assert grants.blockers(3, "A", 1) == ["forklift"]
    grants.release(shape, "forklift")
    assert grants.free(2, "A", 1)
    assert not grants.shapes()


def test_a_cell_owned_twice_is_released_twice():
    _, grants = table([])
    grants.take(0, "A")
    grants.take(0, "A")
    grants.release(0, "A")
    assert not grants.free(0, "B", 1)
    grants.release(0, "A")
    assert grants.free(0, "B", 1)
