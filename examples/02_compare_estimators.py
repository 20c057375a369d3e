"""Which estimator is the better one here? The same worlds, the same drive, and intervals of the differences.

python examples/02_compare_estimators.py [runs] [steps]
"""

import sys

from slam_gym.evaluation import compare


def main(runs=20, steps=400):
    jobs = None if runs > 10 else 1  # None: a process per CPU, which pays only when there is enough to do
    names = ["ekf", "fej-ekf", "dead-reckoning"]
    results = compare("default", names, ["pursuit"], runs=runs, steps=steps, seed=1, jobs=jobs)

    columns = ["estimator", "robot_error_rmse", "target_error_rmse", "pose_nees_mean", "pose_nees_in95_run"]
    print(results.summary[columns].to_string(index=False, float_format="{:.3f}".format))

    print("\nPaired differences (the same seeds, 95 % intervals):")
    print("\n".join(results.paired["sentence"]))
    # results.runs holds one row per run, results.tracks the paths of the first; compare(..., out="results/mine")
    # keeps them on disk, and `slam-gym report results/mine` draws them.


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
