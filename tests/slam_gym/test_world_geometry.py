"""Lines of sight that end on a pillar's rim, where a target slides along."""

import numpy as np

from slam_gym.world_draws import NOBODY
from slam_gym.world_geometry import hidden, pushed_out


def test_a_pillar_hides_what_slides_along_its_far_side_and_nothing_on_its_near_side():
    """The rounding of `pushed_out` leaves a point on either side of the rim."""
    rng = np.random.default_rng(0)
    for _ in range(300):
        x = np.array([*rng.uniform(-8.0, 8.0, 2), rng.uniform(0.3, 1.0)])
        centre, radius = x[:2], x[2]
        way = rng.uniform(-np.pi, np.pi)
        rim = pushed_out(*(centre + 0.9 * radius * np.array([np.cos(way), np.sin(way)])), 0.0, x, 0, 2, 1)
        for side in (1.0, -1.0):
            eye = centre + side * 4.0 * (np.array(rim) - centre) / radius
            assert hidden(*eye, *rim, NOBODY, x, 0, 2, 1) == (side < 0.0)
