"""The first use of an estimator: another process compiles it, and nothing hangs on that process."""

import os
import subprocess
import sys

import pytest

from estimators import registry
from slam_gym import first_use
from slam_gym.first_use import FirstUse
from slam_gym.scenario import Scenario
from slam_gym.specs import Spec

HERE = """
import gymnasium as gym
from numba.core import event
import slam_gym

compiled = set()

class Listener(event.Listener):
    def on_start(self, started):
        compiled.add(started.data["dispatcher"].py_func.__module__)

    def on_end(self, ended):
        pass

event.register("numba:compile", Listener())
env = gym.make("SlamTarget-v0", estimator="dead-reckoning")
env.reset(seed=0)
for _ in range(3):
    env.step(env.action_space.sample())
print(*sorted(compiled))
"""


OPEN, EKF = Scenario.load("open"), Spec.parse("ekf")


@pytest.fixture(autouse=True)
def cold(monkeypatch, tmp_path):
    """A cache in which nothing has been compiled."""
    monkeypatch.setenv("SLAM_GYM_CACHE_DIR", str(tmp_path))


@pytest.fixture
def started(monkeypatch):
    """What would have been compiled elsewhere."""
    found = []
    monkeypatch.setattr(first_use, "_processors", lambda: 2)
    monkeypatch.setattr(first_use, "_start", lambda scenario, spec: found.append(spec.name))
    return found


def use(spec=EKF):
    with FirstUse(OPEN, spec) as company:
        company.wait()


def test_the_first_use_has_company_and_later_ones_need_none(started):
    use()
    use()
    use(Spec.parse("ri-ekf"))
    assert started == ["ekf", "ri-ekf"]


def test_a_use_that_failed_was_none(started):
    for _ in range(2):
        with pytest.raises(ZeroDivisionError), FirstUse(OPEN, EKF):
            raise ZeroDivisionError
    assert started == ["ekf", "ekf"]


@pytest.mark.parametrize("module", ["__main__", "builtins"])
def test_a_class_without_a_source_file_is_used_all_the_same(started, monkeypatch, module):
    """One that was typed into a notebook or at the prompt."""
    typed = type("Typed", (registry.get("dead-reckoning"),), {"__module__": module})
    monkeypatch.delattr(sys.modules["__main__"], "__file__", raising=False)
    monkeypatch.setitem(registry._registered, "typed", typed)
    use(Spec.parse("typed"))
    assert started == []


def test_where_nothing_can_be_kept_nobody_is_asked(started, monkeypatch):
    monkeypatch.setattr(first_use, "is_writable", lambda folder: False)
    use()
    assert started == []


def test_one_processor_or_a_class_known_to_this_process_alone_gets_no_company(started, monkeypatch):
    monkeypatch.setitem(registry._registered, "mine", registry.get("ekf"))
    use(Spec.parse("mine"))
    monkeypatch.setattr(first_use, "_processors", lambda: 1)
    use()
    assert started == []


def test_a_second_process_that_fails_or_cannot_be_started_does_no_harm(monkeypatch):
    monkeypatch.setattr(first_use, "_processors", lambda: 2)
    use(Spec("ekf", "ekf", {"no_such_option": 1}))
    monkeypatch.setattr(sys, "executable", "/usr/bin/blender")
    use(Spec.parse("ri-ekf"))


def test_nobody_is_left_running_where_the_environment_cannot_be_made(monkeypatch):
    monkeypatch.setattr(first_use, "_processors", lambda: 2)
    with pytest.raises(ZeroDivisionError), FirstUse(OPEN, EKF) as company:
        process = company._process
        raise ZeroDivisionError
    assert process is not None and process.returncode is not None


@pytest.mark.parametrize("is_terminal", [True, False])
def test_a_person_is_told_why_it_takes_so_long(started, monkeypatch, capsys, is_terminal):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: is_terminal)
    use()
    assert ("compiling 'ekf'" in capsys.readouterr().err) is is_terminal


@pytest.mark.slow
@pytest.mark.skipif(first_use._processors() < 2, reason="one processor")
def test_the_world_is_compiled_here_and_the_estimator_elsewhere(tmp_path):
    settings = {**os.environ, "SLAM_GYM_CACHE_DIR": str(tmp_path)}
    done = subprocess.run([sys.executable, "-c", HERE], env=settings, capture_output=True, text=True, check=True)
    here = done.stdout.split()
    assert "slam_gym.world_step" in here
    assert "estimators.dead_reckoning" not in here
    assert list(tmp_path.glob("dead_reckoning-*/*.nbi"))
