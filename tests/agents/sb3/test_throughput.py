import pytest

throughput = pytest.importorskip("agents.sb3.throughput")


def test_every_environment_is_trained_on_and_the_stub_is_the_measure():
    rows = throughput.training_rows(rounds=1, usual=False)
    assert [row["name"].split(",")[0] for row in rows] == ["a stub of 256 lanes that costs nothing"] + 2 * ["make_vec"]
    assert rows[0]["of_stub"] == 1.0
    assert all(row["per_second"] > 0.0 for row in rows)


def test_the_stub_has_no_methods_and_many_attributes():
    env = throughput.DummyVecEnv([lambda: throughput.gym.make("CartPole-v1")] * 3)
    stub = throughput.Stub(env)
    assert stub.get_attr("num_envs") == [3, 3, 3]
    with pytest.raises(AttributeError, match="fly"):
        stub.env_method("fly")
    env.close()
