"""Which filter makes the better pilot? The same policy drives on the belief of each, in the same worlds.

python examples/08_which_filter_pilots_best.py [runs] [steps] [policy]

A filter that is wrong about the target, or too sure of itself, leads its robot astray, and a robot astray sees less:
errors of the estimate and of the driving feed each other. So each filter drives its own robot (closed loop) here, where
a comparison of filters on shared data would hide that.
"""

import sys

from slam_gym.evaluation import compare

FILTERS = ["ri-ekf", "ekf", "fej-ekf", "slamto", "dead-reckoning"]  # the first is what the others are compared with


def main(runs=40, steps=400, policy="pursuit"):
    results = compare("default", FILTERS, [policy], runs=runs, steps=steps, mode="closed-loop", jobs=1)
    columns = ["estimator", "target_error_capped", "lost_share", "robot_error_mean", "target_nees_mean"]
    print(f"{policy}, {runs} worlds; target error at most 8 m a step; an honest target NEES is 2")
    print(results.summary[columns].to_string(index=False, float_format="{:.3f}".format))

    print("\nAgainst the first, run by run:")
    told = results.paired["metric"].isin(["target_error_rmse", "lost_share"])
    print("\n".join(results.paired["sentence"][told]))


if __name__ == "__main__":
    main(*map(int, sys.argv[1:3]), *sys.argv[3:4])
