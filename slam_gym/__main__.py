"""`python -m slam_gym` is `slam-gym`."""

import sys

from slam_gym.cli import main

if __name__ == "__main__":
    sys.exit(main())
