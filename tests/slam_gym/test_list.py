"""`slam-gym list NAME`: the page of whatever has that name."""

import pytest

from slam_gym.commands.list import entries, pages


@pytest.mark.parametrize("section", ["scenarios", "estimators", "policies", "environments"])
def test_everything_listed_has_a_page(section):
    for name, line in entries(section):
        assert line
        assert all(name in page for page in pages(name))


def test_both_environments_name_their_arguments():
    assert "Arguments of gym.make." in pages("SlamTarget-v0")[0]
    vector = pages("slamtargetvectorenv")[0]
    assert "autoreset_mode = 'SameStep'" in vector
    assert "Arguments of gym.make_vec." in vector


def test_a_scenario_file_is_printed_with_what_it_leaves_out(tmp_path):
    file = tmp_path / "my.toml"
    file.write_text("[sensor]\nmax_range = 4.0\n")
    (page,) = pages(str(file))
    assert "sensor.max_range = 4.0" in page
    assert "sensor.range_std = 0.05" in page


def test_an_unknown_name_is_told_what_there_is():
    with pytest.raises(ValueError, match="Did you mean 'ri-ekf'"):
        pages("riekf")
