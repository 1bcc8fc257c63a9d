"""Who may be where: stops, moves, cells, grants, planners."""
