"""Skip where Stable-Baselines3 is not installed; environments and a short training that tests share."""

import pytest

pytest.importorskip("stable_baselines3")
