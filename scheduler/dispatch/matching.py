"""Match rows to columns by cost: the optimum (Kuhn-Munkres) or one row after another."""

from typing import Any, TypeAlias

import numpy as np
from scipy.optimize import linear_sum_assignment

Table: TypeAlias = "np.ndarray[Any, np.dtype[np.float64]]"  # (rows, columns), seconds

# Finite, for the solver fails where a row has nothing finite at all; above any sum of real costs,
# so that a matching of more pairs is always the better one.
FORBIDDEN = 1e9


def match_km(costs: Table) -> list[tuple[int, int]]:
    """Give the pairs of the cheapest matching among those with the most pairs."""
    if costs.size == 0:
        return []
    rows, columns = linear_sum_assignment(costs)
    pairs = zip(rows.tolist(), columns.tolist(), strict=True)
    return [(r, c) for r, c in pairs if costs[r, c] < FORBIDDEN]


def match_greedy(costs: Table) -> list[tuple[int, int]]:
    """Give every row, in order, the cheapest column that is left; the first of equal ones."""
    if costs.size == 0:
        return []
    left = costs.copy()
    pairs: list[tuple[int, int]] = []
    for row in range(left.shape[0]):
        column = int(np.argmin(left[row]))
        if left[row, column] < FORBIDDEN:
            pairs.append((row, column))
            left[:, column] = FORBIDDEN
    return pairs
