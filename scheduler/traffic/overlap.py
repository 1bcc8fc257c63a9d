"""Second opinion on overlaps by FCL, on prisms one metre thick.

Only yes or no is asked of FCL: penetration depth and signed distance are known to fail on touching
and thin shapes, and its broad phase cannot name the pair it found (measured: python-fcl 0.7).
"""

import fcl
import numpy as np

from scheduler.traffic.geometry import Floats

THICK_M = 1.0


def prism(corners: Floats) -> fcl.CollisionObject:
    """An upright prism over a convex polygon given counter-clockwise; (n, 2), metres."""
    count = len(corners)
    low = np.column_stack((corners, np.zeros(count)))
    high = np.column_stack((corners, np.full(count, THICK_M)))
    faces = [count, *range(count - 1, -1, -1), count, *range(count, 2 * count)]
    for k in range(count):
        after = (k + 1) % count
        faces += [4, k, after, after + count, k + count]
    shape = fcl.Convex(np.vstack((low, high)), count + 2, np.asarray(faces))
    return fcl.CollisionObject(shape)


def overlaps(a: fcl.CollisionObject, b: fcl.CollisionObject) -> bool:
    """FCL's verdict on two prisms."""
    return bool(fcl.collide(a, b, fcl.CollisionRequest(), fcl.CollisionResult()))
