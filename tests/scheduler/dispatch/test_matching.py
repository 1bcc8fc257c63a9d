"""Matching rows to columns."""

from itertools import permutations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from scheduler.dispatch.matching import FORBIDDEN, Table, match_greedy, match_km


@st.composite
def tables(draw: st.DrawFn) -> Table:
    rows, columns = draw(st.integers(1, 4)), draw(st.integers(1, 4))
    cost = st.one_of(st.just(FORBIDDEN), st.floats(0, 1000))
    return np.array(
        draw(
            st.lists(
                st.lists(cost, min_size=columns, max_size=columns), min_size=rows, max_size=rows
            )
        )
    )


def by_hand(costs: Table) -> tuple[int, float]:
    """Try everything: most pairs first, then the cheapest."""
    rows, columns = costs.shape
    best = (0, 0.0)
    slots = [*range(columns), *([None] * rows)]
    for choice in set(permutations(slots, rows)):
        pairs = [(r, c) for r, c in enumerate(choice) if c is not None]
        if all(costs[r, c] < FORBIDDEN for r, c in pairs):
            total = (len(pairs), -float(sum(costs[r, c] for r, c in pairs)))
            best = max(best, total)
    return best[0], -best[1]


@given(tables())
def test_km_makes_the_most_pairs_at_the_least_cost(costs: Table) -> None:
    pairs = match_km(costs)
    count, total = by_hand(costs)
    assert len(pairs) == count
    assert abs(sum(costs[r, c] for r, c in pairs) - total) < 1e-3


@given(tables())
def test_no_row_and_no_column_is_matched_twice_nor_against_the_rules(costs: Table) -> None:
    for pairs in (match_km(costs), match_greedy(costs)):
        assert len({r for r, _ in pairs}) == len({c for _, c in pairs}) == len(pairs)
        assert all(costs[r, c] < FORBIDDEN for r, c in pairs)


@given(tables())
def test_greed_gives_each_row_the_cheapest_that_the_rows_before_have_left(costs: Table) -> None:
    taken: set[int] = set()
    for row, column in match_greedy(costs):
        others = (c for c in range(costs.shape[1]) if c not in taken)
        assert costs[row, column] == min(costs[row, c] for c in others)
        taken.add(column)


def test_nothing_matches_nothing() -> None:
    assert match_km(np.empty((0, 3))) == match_greedy(np.empty((3, 0))) == []
