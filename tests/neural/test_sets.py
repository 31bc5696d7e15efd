"""The shipped parameters by name, and others by the path of their file."""

import pytest
import tomli_w

from fembridge.errors import ParameterError
from neural import (
    DEFAULT_SET,
    PUBLISHED,
    SET_NAMES,
    parameter_set,
    parameter_set_or_file,
    parameter_sets,
    parameters_to_table,
    read_parameter_set,
)
from neural.drive_table import DEFAULT_DRIVES, drive_of
from neural.parameters import AFFERENTS
from neural.sets import FITTED_FILE


def test_published_is_table_2_without_a_preindentation():
    own = parameter_set("published")

    assert own.parameters is PUBLISHED
    assert (own.name, own.preindent_um) == ("published", 0.0)
    assert own.origin["fit"] == {"source": "Ishizuka et al., Table 2"}


def test_fitted_is_its_file_and_has_the_default_models():
    own = parameter_set("fitted")
    read = read_parameter_set(FITTED_FILE)

    assert own.name == "fitted" == DEFAULT_SET
    assert dict(own.parameters) == dict(read.parameters)
    assert own.preindent_um == read.preindent_um >= 0.0
    assert tuple(own.parameters) == AFFERENTS
    for afferent, parameters in own.parameters.items():
        drive = drive_of(parameters)
        assert (drive.afferent, drive.name) == (afferent, DEFAULT_DRIVES[afferent])
        assert (parameters.cells, parameters.dt_ms) == (drive.cells, 0.5)


def test_what_is_fitted_lies_inside_what_is_searched():
    for parameters in parameter_set("fitted").parameters.values():
        for one in drive_of(parameters).free(parameters.cells):
            assert one.low <= getattr(parameters, one.field) <= one.high


def test_every_name_gives_its_set():
    assert SET_NAMES == ("published", "fitted")
    assert {name: one.name for name, one in parameter_sets().items()} == {
        "published": "published",
        "fitted": "fitted",
    }
    for name in SET_NAMES:
        assert parameter_set_or_file(name) is parameter_set(name)


@pytest.mark.parametrize("word", ["Published", "fitted ", "table2", "folder/absent"])
def test_a_word_that_names_nothing_is_refused(tmp_path, monkeypatch, word):
    monkeypatch.chdir(tmp_path)

    for give in (parameter_set, parameter_set_or_file):
        with pytest.raises(
            ParameterError, match=f"no parameter set '{word}', expected published or"
        ):
            give(word)


@pytest.mark.parametrize("name", ["own.toml", "own", "own.txt"])
def test_a_file_is_read_by_its_path_whatever_it_is_called(tmp_path, monkeypatch, name):
    text = tomli_w.dumps({"SA": parameters_to_table(PUBLISHED)["SA"]})
    (tmp_path / name).write_text(text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)

    for word in (name, f"./{name}", str(tmp_path / name)):
        own = parameter_set_or_file(word)
        assert own.name == "own"
        assert dict(own.parameters) == dict(PUBLISHED)


def test_a_shipped_name_wins_over_a_file_of_that_name(tmp_path, monkeypatch):
    (tmp_path / "published").write_text("[SA]\ntau_ms = 1.0\n", encoding="utf-8")
    monkeypatch.chdir(tmp_path)

    assert parameter_set_or_file("published").parameters is PUBLISHED
    own = parameter_set_or_file("./published")
    assert own.parameters["SA"].tau_ms == 1.0


def test_a_folder_or_a_file_that_is_not_there_is_named(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "sets").mkdir()

    with pytest.raises(ParameterError, match=r"^absent\.toml: cannot read: No such"):
        parameter_set_or_file("absent.toml")
    with pytest.raises(ParameterError, match=r"^sets: cannot read: Is a directory"):
        parameter_set_or_file("sets")
    with pytest.raises(ParameterError, match=r"^sets/absent\.toml: cannot read"):
        parameter_set_or_file("sets/absent.toml")


def test_a_file_of_something_else_is_named(tmp_path):
    path = tmp_path / "rates.csv"
    path.write_text("stimulus,afferent,rate_ips\n", encoding="utf-8")

    with pytest.raises(ParameterError, match=r"rates\.csv: not TOML"):
        parameter_set_or_file(str(path))
