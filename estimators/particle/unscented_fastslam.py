"""FastSLAM with the unscented transform in every place where FastSLAM 2 has a Jacobian."""

from typing import Any, ClassVar

import numpy as np

from estimators.interface import Floats, Ints
from estimators.kernels.jit import jit
from estimators.particle.fastslam import LookingFilter
from estimators.particle.looks import LOOK, UNSCENTED
from estimators.particle.unscented import predict_poses_unscented

WORK_ROWS = 12


@jit
def carry_lanes_unscented(lanes, control, dt, models, state, pose, pose_cov, work):
    """Every particle's Gaussian through one step, nothing drawn. control [L, 2], dt [L]."""
    for lane in lanes:
        if dt[lane] > 0.0:
            state[lane].step += 1
            predict_poses_unscented(
                pose[lane], pose_cov[lane], models[lane], control[lane, 0], control[lane, 1], dt[lane], work
            )


class UnscentedFastSLAM(LookingFilter):
    """Unscented FastSLAM with the moving target: `fastslam2` by sigma points.

    Kim, Sakthivel and Chung, "Unscented FastSLAM: a robust and efficient solution to the SLAM problem", IEEE
    Transactions on Robotics 24(4), 2008. The steps are FastSLAM 2's (see `fastslam2`); what is linearised there goes
    through the unscented transform here, with D1 and D2 of `particle.unscented`:

    1. predict: pose and control noise, five variables, through the motion model;
    2. proposal and weight: pose and point, five variables, through range and bearing, one return after the other;
       cov -= Cov(x, z) S^-1 Cov(x, z)', S with the point's covariance in it;
    3. landmarks given the drawn pose: a first sighting through the inverse of h, its two variables the return's noise;
       an update through h, its two variables the landmark's position;
    4. systematic resampling as in `slamto`.

    The target's own filter is that of `fastslam2`; in the proposal its position is one more point. The sigma points
    are those of `ukf` by default (alpha = 1, beta = 0, kappa = 0): every covariance is positive semidefinite.

    What to expect: nothing where `fastslam2` linearises well, much where it does not. `fastslam2` and the paired
    difference to it in `slamto`, 100 particles each, 100 runs, 95 % intervals; inside: the share of the pose's NEES
    inside its 95 % bounds:

    | noise                                              | robot's error [m]      | inside         |
    |----------------------------------------------------|------------------------|----------------|
    | as it is: bearings 0.008 rad                       | 0.035, +0.000 +- 0.001 | 82 %, +1 +- 2  |
    | bearings 0.15 rad                                  | 0.084, -0.008 +- 0.004 | 80 %, +5 +- 3  |
    | bearings 0.3 rad, odometry 1 m/s and 1 rad/s       | 0.344, -0.115 +- 0.027 | 30 %, +31 +- 5 |
    | a fifth of the sweeps, 0.1 rad, odometry 1.5 rad/s | 0.309, -0.028 +- 0.016 | 79 %, +7 +- 4  |

    Known weakness: that of all particle filters here, see `slamto`.

    Args:
        particles, resample_threshold, islands, association, match_gate, new_gate, remove_below, map_storage: see
            `SLAMTO`. `gate` must be infinite: labelled returns are not gated.
    """

    name: ClassVar[str] = "unscented-fastslam"
    summary: ClassVar[str] = "FastSLAM 2 by sigma points instead of Jacobians (Kim et al. 2008), and the target"

    def __init__(self, *models: Any, **options: Any) -> None:
        if options.get("gate", np.inf) < np.inf:
            raise ValueError("unscented-fastslam does not gate labelled returns; use 'fastslam2' for that")
        super().__init__(*models, **options)
        self._how = UNSCENTED, np.zeros((0, LOOK)), np.zeros((0, 4)), np.zeros((WORK_ROWS, 3)), np.zeros(3)

    def _move(self, chosen: Ints, control: Floats) -> None:
        """The Gaussians move."""
        carry_lanes_unscented(
            chosen, control, self._dt, self.models, self._state, self._pose, self._pose_cov, self._how[3]
        )
