"""Which models a report judges."""

import pytest

from fembridge.errors import ParameterError, UsageError
from fembridge.validation.judged_model import judged_models
from neural import PUBLISHED


def test_the_published_model_needs_no_other_beside_it():
    [published] = judged_models("published")
    assert published.name == "published"
    assert published.parameters == PUBLISHED
    assert published.preindent_um == 0
    assert "Table 2" in published.source


def test_a_file_is_judged_under_its_name_and_the_published_model_comes_after(own_file):
    own, published = judged_models(str(own_file))
    assert (own.name, published.name) == ("own", "published")
    assert own.parameters["SA"].alpha_mv_per_ms == 1.2
    assert own.word == str(own_file)
    assert own.source.startswith("file own.toml, SHA-256 ")


@pytest.mark.parametrize("name", ["observed", "TouchSim", "published"])
def test_a_file_cannot_take_the_name_of_another_source(tmp_path, name):
    path = tmp_path / f"{name}.toml"
    path.write_text("[SA]\ntau_ms = 30.0\n", encoding="utf-8")
    with pytest.raises(UsageError, match="give it another"):
        judged_models(str(path))


def test_a_model_that_is_not_there_is_named():
    with pytest.raises(ParameterError, match="nobody"):
        judged_models("nobody")
