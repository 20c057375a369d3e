"""A policy of one's own, known by name, compared with pursuit in the same worlds.

python examples/03_own_policy.py [runs] [steps]
"""

import sys

import numpy as np

from slam_gym import policies
from slam_gym.evaluation import compare


@policies.register("orbit")
class Orbit(policies.Policy):
    """Circles the believed target, so that it is seen, and its surroundings, from every side.

    Args:
        radius: [m] of the circle.
    """

    summary = "circles the believed target"

    def __init__(self, context, num_lanes=1, *, radius=2.5):
        super().__init__(context, num_lanes)
        self.radius = radius

    def reset(self, lanes, seeds):
        """Nothing to forget."""

    def act(self, observation, belief):
        """All lanes at once: arrays have the lane first."""
        x, y = belief.target_rel.T  # [L] metres, in the robot's frame: forward, left
        distance, bearing = np.hypot(x, y), np.arctan2(y, x)
        # Far away drive towards the target; on the circle keep it at 50 degrees to the left, still in view.
        aim = np.clip(1.0 - (distance - self.radius) / self.radius, 0.0, 1.0) * np.radians(50)
        turn = 2.5 * (bearing - aim)
        speed = self.context.speed_max * np.clip(np.cos(bearing), 0.2, 1.0)
        # Look around where the target was never seen, or where its position is known to a metre at best.
        sure = belief.target_known & (np.trace(belief.target_rel_cov, axis1=1, axis2=2) < 1.0)  # [L]
        command = np.column_stack([np.where(sure, speed, 0.0), np.where(sure, turn, 0.9)])
        return self.to_action(command)


def main(runs=20, steps=400):
    results = compare("default", ["ekf"], ["pursuit", "orbit", "orbit:radius=1.5"], runs=runs, steps=steps, jobs=1)
    columns = ["policy", "target_error_mean", "target_error_rel_mean", "lost_share", "robot_error_mean"]
    print(results.summary[columns].to_string(index=False, float_format="{:.3f}".format))


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
