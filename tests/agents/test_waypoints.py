import math
from pathlib import Path

import numpy as np
import pytest

from slam_gym import policies

PUBLISHED = Path(__file__).resolve().parents[2] / "../shared/data/webmap/webmap_waypoints.csv"
SQUARE = [[4.0, 0.0], [4.0, 4.0], [0.0, 4.0], [0.0, 0.0]]


@pytest.fixture
def published_context(make_context):
    return make_context(
        "bicycle", speed=3.0, step_dt=0.025, steering_max=math.radians(30), steering_rate=math.radians(20)
    )


def reset(policy):
    policy.reset(np.arange(policy.num_lanes), np.arange(policy.num_lanes))
    return policy


@pytest.mark.skipif(not PUBLISHED.is_file(), reason="the published map is not here")
def test_published_loop_takes_8779_steps(published_context):
    policy = reset(policies.make("waypoints", published_context, file=str(PUBLISHED), follow="commands"))
    actions = []
    while not policy.finished[0] and len(actions) < 10_000:
        actions.append(policy.act(None, None)[0, 0])
    driven = np.array(actions[:-1])  # the action at which the policy is finished is not carried out
    assert (driven == 1.0).all()
    assert actions[-1] == 0.0
    assert len(driven) == 8779
    assert len(driven) // 8 == 1097


def literal_law(points, dt, speed=3.0, wheelbase=4.0, limit=math.pi / 6, rate=math.pi / 9):
    """The standard simulator's loop as it is usually written, scalar."""
    x = y = heading = steering = 0.0
    i, path = 0, []
    while True:
        if (points[i][0] - x) ** 2 + (points[i][1] - y) ** 2 < 1.0:
            i += 1
        if i < len(points):
            angle = math.atan2(points[i][1] - y, points[i][0] - x) - heading - steering
            angle = math.atan2(math.sin(angle), math.cos(angle))
            steering = max(-limit, min(limit, steering + max(-rate * dt, min(rate * dt, angle))))
        path.append((x, y, steering))
        if i == len(points):
            return np.array(path)
        x += speed * dt * math.cos(heading + steering)
        y += speed * dt * math.sin(heading + steering)
        heading += speed * dt * math.sin(steering) / wheelbase


def test_steers_as_the_standard_simulator(published_context, make_belief, move):
    points = [[20.0, 8.0], [30.0, 30.0], [-5.0, 25.0]]
    expected = literal_law(points, 0.025)
    blind = reset(policies.make("waypoints", published_context, points=points, follow="commands"))
    seeing = reset(policies.make("waypoints", published_context, points=points))
    pose = np.zeros((1, 3))
    for x, y, steering in expected:
        blind.act(None, None)
        seeing.act(None, make_belief(pose))
        np.testing.assert_allclose(pose[0, :2], [x, y], atol=1e-9)
        np.testing.assert_allclose(blind.command[0], [3.0, steering], atol=1e-9)
        np.testing.assert_allclose(seeing.command, blind.command, atol=1e-9)
        pose = move(pose, blind.command, 0.025, 4.0)
    for policy in (blind, seeing):
        assert not policy.finished[0]
        policy.act(None, make_belief(pose))
        assert policy.finished[0]


def test_unicycle_visits_every_point_once_and_stops(make_context, make_belief, move):
    policy = reset(policies.make("waypoints", make_context(), points=SQUARE, radius=0.3))
    pose, nearest = np.zeros((1, 3)), np.full(4, np.inf)
    for _ in range(400):
        policy.act(None, make_belief(pose))
        pose = move(pose, policy.command, 0.1)
        nearest = np.minimum(nearest, np.hypot(*(np.array(SQUARE) - pose[0, :2]).T))
    assert policy.finished[0]
    assert (nearest < 0.3).all()
    np.testing.assert_array_equal(policy.command[0], [0.0, 0.0])


def test_belief_steers_what_commands_ignore(make_context, make_belief):
    aside = make_belief([0.0, 3.0, 0.0])
    by_belief = reset(policies.make("waypoints", make_context(), points=SQUARE))
    by_commands = reset(policies.make("waypoints", make_context(), points=SQUARE, follow="commands"))
    assert by_belief.act(None, aside)[0, 1] < 0.0
    assert by_commands.act(None, aside)[0, 1] == 0.0


def test_lanes_are_independent(published_context, make_belief):
    rng = np.random.default_rng(0)
    many = reset(policies.make("waypoints", published_context, 3, points=SQUARE))
    singles = [reset(policies.make("waypoints", published_context, points=SQUARE)) for _ in range(3)]
    for k in range(30):
        poses = rng.normal(2.0, 3.0, (3, 3))
        together = many.act(None, make_belief(poses))
        apart = np.concatenate([s.act(None, make_belief(p)) for s, p in zip(singles, poses, strict=True)])
        assert together.tobytes() == apart.tobytes()
        if k == 20:
            many.reset(np.array([1]), np.array([5]))
            singles[1].reset(np.array([0]), np.array([5]))


def test_default_route_stays_in_the_arena(make_context):
    policy = policies.make("waypoints", make_context(arena=(10.0, 30.0)))
    assert policy.points.shape == (4, 2)
    np.testing.assert_allclose(np.abs(policy.points), [[3.0, 9.0]] * 4)


def test_reads_a_file(make_context, tmp_path):
    file = tmp_path / "route.csv"
    file.write_text("x_m,y_m\n1.5,2\n-3,4e1\n")
    policy = policies.make("waypoints", make_context(), file=str(file))
    np.testing.assert_array_equal(policy.points, [[1.5, 2.0], [-3.0, 40.0]])


@pytest.mark.parametrize(("content", "message"), [
    ("", "must start with"), ("x,y\n1,2\n3,4\n", "must start with"), ("x_m,y_m\n1,two\n3,4\n", "pair of numbers"),
    ("x_m,y_m\n1,2,3\n4,5,6\n", "at least two rows"), ("x_m,y_m\n1,2\n", "at least two rows"),
    ("x_m,y_m\n1,2\n3\n", "pair of numbers"), ("x_m,y_m\n1,nan\n3,4\n", "finite"),
])  # fmt: skip
def test_foreign_files_are_explained(make_context, tmp_path, content, message):
    file = tmp_path / "route.csv"
    file.write_text(content)
    with pytest.raises(ValueError, match=message):
        policies.make("waypoints", make_context(), file=str(file))


@pytest.mark.parametrize(("options", "message"), [
    ({"file": "nowhere.csv"}, "no file"), ({"follow": "comands"}, "Did you mean 'commands'"),
    ({"points": [[1.0, 2.0]]}, "at least two"), ({"points": SQUARE, "file": "a.csv"}, "not both"),
    ({"speed": 0.0}, "speed"), ({"radius": -1.0}, "radius"),
])  # fmt: skip
def test_impossible_options_are_named(make_context, options, message):
    with pytest.raises(ValueError, match=message):
        policies.make("waypoints", make_context(), **options)
