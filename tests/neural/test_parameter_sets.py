"""Parameters: Table 2 as it is printed, the shipped sets, and a user's own as TOML."""

import math
import tomllib
from copy import deepcopy
from dataclasses import asdict, fields, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
import tomli_w

from fembridge.errors import ParameterError, UsageError
from neural.models import DEFAULT_MODELS, model_named, model_of
from neural.parameter_sets import (
    DEFAULT_SET,
    FITTED_FILE,
    PAD_FILE,
    ParameterSet,
    parameter_set,
    parameters_to_table,
)
from neural.parameters import (
    AFFERENTS,
    PUBLISHED,
    CorpusclePcParameters,
    RisingRaParameters,
    TwoWayRaParameters,
)

RISING_RA = {"drive": "rising", "tau_ms": 300.0, "step_pa": 7000.0}


def odd_parameters(row):
    """Parameters of a row in which every number differs from its default."""
    numbers = {
        one.name: 0.1 + 0.7 * k
        for k, one in enumerate(fields(row.parameters))
        if one.name not in ("drive", "cells", "rest_mv", "threshold_mv", "dt_ms")
    }
    return row.parameters(
        **{**numbers, "tau_ms": 0.1 + 0.2, "recovery_ms": 1e-300 + 3.3},
        cells=7,
        rest_mv=-71.3,
        threshold_mv=-51.7,
        dt_ms=0.25,
        drive=row.name,
    )


def parameters_from_table(table, base="published"):
    table = {"base": base, **table} if base else table
    with TemporaryDirectory() as folder:
        path = Path(folder) / "own.toml"
        path.write_text(tomli_w.dumps(table), encoding="utf-8")
        return parameter_set(path).parameters


@pytest.fixture
def file_of(file):
    """A function that writes a set and gives its path."""
    return partial(file, "own.toml")


def test_a_model_survives_a_file_to_the_last_digit(row):
    own = {**PUBLISHED, row.afferent: odd_parameters(row)}
    table = parameters_to_table(own)
    read = parameters_from_table(table, base=None)
    assert dict(read) == own
    assert type(read[row.afferent]) is row.parameters
    assert set(table[row.afferent]) == {one.name for one in fields(row.parameters)}


def test_a_section_says_by_its_drive_which_parameters_it_holds(row):
    needed = {one.field: math.sqrt(one.low * one.high) for one in row.free(1)}
    section = {"drive": row.name, **needed}
    own = parameters_from_table({row.afferent: section})[row.afferent]
    assert type(own) is row.parameters
    assert own.drive == row.name
    assert {name: getattr(own, name) for name in needed} == needed


def test_other_models_keep_the_defaults_of_their_class():
    own = parameters_from_table({"RA": RISING_RA, "SA": {}})
    assert own["RA"] == RisingRaParameters(tau_ms=300.0, step_pa=7000.0)
    assert own["RA"].threshold_mv == -55.0
    assert own["SA"] == PUBLISHED["SA"]


def test_parameters_of_another_model_are_refused_by_their_class():
    with pytest.raises(ParameterError) as caught:
        RisingRaParameters(tau_ms=1.0, step_pa=1.0, drive="corpuscle")
    assert (caught.value.argument, caught.value.found) == ("drive", "corpuscle")
    assert CorpusclePcParameters(tau_ms=1.0, beta_mv_per_ms=1.0).drive == "corpuscle"
    with pytest.raises(TypeError, match="retraction"):
        TwoWayRaParameters(step_pa=1.0)


def test_a_set_has_its_name_its_depth_and_where_it_comes_from(file_of):
    path = file_of(
        'base = "published"\nname = "mine"\npreindent_um = 75\n'
        "[RA]\ndrive = 'rising'\ntau_ms = 300\nstep_pa = 7000\n"
        "[fit]\nseed = 3\nsources = ['a.csv', 'b.csv']\n[study.RA]\nrank = 1\n"
    )

    own = parameter_set(path)

    assert (own.name, own.preindent_um) == ("mine", 75.0)
    assert isinstance(own.preindent_um, float)
    assert dict(own.origin) == {
        "name": "mine",
        "fit": {"seed": 3, "sources": ["a.csv", "b.csv"]},
        "study": {"RA": {"rank": 1}},
    }
    assert dict(own.parameters) == dict(parameters_from_table({"RA": RISING_RA}))


def test_a_set_keeps_what_its_base_has_and_the_file_leaves_out(file_of):
    fitted = parameter_set("fitted")
    own = parameter_set(file_of("base = 'fitted'\n[SA]\ntau_ms = 50.0"))
    assert own.preindent_um == fitted.preindent_um
    assert own.parameters["SA"] == replace(fitted.parameters["SA"], tau_ms=50.0)
    assert own.parameters["RA"] == fitted.parameters["RA"]
    with pytest.raises(ParameterError) as caught:
        parameter_set(file_of("base = 'mine'"))
    assert (caught.value.key, caught.value.found) == ("base", "mine")


WHOLE = tomli_w.dumps({**parameters_to_table(PUBLISHED), "RA": RISING_RA}).splitlines(keepends=True)


def test_a_set_that_was_cut_is_never_completed_from_another(file_of):
    for lines in (k for k in range(len(WHOLE)) if WHOLE[k] != "\n"):
        path = file_of("".join(WHOLE[:lines]))
        with pytest.raises(ParameterError) as caught:
            parameter_set(path)
        assert caught.value.path == path


@pytest.mark.parametrize("path", [FITTED_FILE, PAD_FILE])
def test_a_fit_with_another_equation_is_refused(file_of, path):
    table = tomllib.loads(path.read_text(encoding="utf-8"))
    for afferent in AFFERENTS:
        changed = deepcopy(table)
        row = changed["fit"][afferent]
        assert row["equation"] == model_named(row["drive"], afferent).equation
        row["equation"] = "I' = σ"
        with pytest.raises(ParameterError) as caught:
            parameter_set(file_of(tomli_w.dumps(changed)))
        assert caught.value.key == f"fit.{afferent}.equation"
        assert caught.value.path.name == "own.toml"
        other = asdict(PUBLISHED[afferent])  # another model's numbers: not of that fit
        parameter_set(file_of(tomli_w.dumps({**changed, afferent: other})))
        del row["equation"]
        own = parameter_set(file_of(tomli_w.dumps(changed)))
        assert own.parameters == parameter_set(path).parameters


@pytest.mark.parametrize("name", ["published", "fitted", "fitted_pad"])
def test_a_shipped_set_travels_by_its_name(name):
    assert parameter_set(name).to_table() == {"name": name}
    assert ParameterSet.from_table({"name": name}, "run", "run.toml") is parameter_set(name)


def test_a_set_of_ones_own_travels_whole_with_the_finger_of_its_fit(file_of):
    own = parameter_set(file_of("base = 'fitted'\nname = 'fitted'\n[SA]\ntau_ms = 50.0"))
    table = tomllib.loads(tomli_w.dumps(own.to_table()))
    back = ParameterSet.from_table(table, "run", "run.toml")
    assert (back.name, back.preindent_um, back.mechanics["name"]) == ("fitted", 75.0, "quick")
    assert dict(back.mechanics) == dict(own.mechanics)
    assert dict(back.parameters) == dict(own.parameters)
    assert back.parameters["SA"].tau_ms == 50.0


def test_fitted_is_its_file_and_has_the_default_models():
    own = parameter_set("fitted")
    read = parameter_set(FITTED_FILE)

    assert own.name == "fitted" == DEFAULT_SET
    assert dict(own.parameters) == dict(read.parameters)
    assert own.preindent_um == read.preindent_um >= 0.0
    assert tuple(own.parameters) == AFFERENTS
    for afferent, parameters in own.parameters.items():
        drive = model_of(parameters)
        assert (drive.afferent, drive.name) == (afferent, DEFAULT_MODELS[afferent])
        assert (parameters.cells, parameters.dt_ms) == (drive.cells, drive.step_ms)


def test_what_is_fitted_lies_inside_what_is_searched():
    for parameters in parameter_set("fitted").parameters.values():
        for one in model_of(parameters).free(parameters.cells):
            assert one.low <= getattr(parameters, one.field) <= one.high


@pytest.mark.parametrize("name", ["own.toml", "own", "own.txt"])
def test_a_file_is_read_by_its_path_whatever_it_is_called(here, name):
    text = tomli_w.dumps(parameters_to_table(PUBLISHED))
    (here / name).write_text(text, encoding="utf-8")
    for word in (name, f"./{name}", str(here / name)):
        own = parameter_set(word)
        assert own.name == "own"
        assert dict(own.parameters) == dict(PUBLISHED)


def test_a_shipped_name_wins_over_a_file_of_that_name(here):
    (here / "published").write_text("base = 'fitted'\n[SA]\ntau_ms = 1.0\n", encoding="utf-8")
    assert parameter_set("published").parameters is PUBLISHED
    own = parameter_set("./published")
    assert own.parameters["SA"].tau_ms == 1.0


@pytest.mark.parametrize(
    ("text", "key", "found"),
    [
        ("[SA]\ntau = 3", "SA.tau", "tau"),
        ("preindent = 3", "preindent", "preindent"),
        ("[SA]\ntau_ms = '32'", "SA.tau_ms", "32"),
        ("[SA]\ntau_ms = inf", "SA.tau_ms", math.inf),
        ("[SA]\ntau_ms = 1" + "0" * 400, "SA.tau_ms", 10**400),
        ("[RA]\na3_pa_per_ms = 0", "RA.a3_pa_per_ms", 0.0),
        ("[RA]\nrefractory_ms = -1", "RA.refractory_ms", -1.0),
        ("[RA]\nspread = 11", "RA.spread", 11.0),
        ("[RA]\nrecovery_ms = 0.1", "RA.recovery_ms", 0.1),
        ("[RA]\ncells = 1001", "RA.cells", 1001),
        ("[PC]\nthreshold_mv = -65", "PC.threshold_mv", -65.0),
        ("[PC]\ntau_ms = 0.4", "PC.tau_ms", 0.4),
        ("[RA]\ndrive = 'rising'\ntau_ms = 3", "RA.step_pa", None),
        ("[RA]\ndrive = 'two_way'\nstep_pa = 3", "RA.retraction", None),
        ("[RA]\ndrive = 'risin'", "RA.drive", "risin"),
        ("preindent_um = -1", "preindent_um", -1.0),
        ("[SA", None, None),
        ("[RA]\ntau_ms = 3\ntau_ms = 4", None, None),
        ("stimulus,afferent,rate_ips", None, None),
    ],
)
def test_a_file_that_makes_no_parameters_is_refused_by_key(file_of, text, key, found):
    with pytest.raises(ParameterError) as caught:
        parameter_set(file_of(f"base = 'published'\n{text}"))
    assert (caught.value.key, caught.value.found) == (key, found)
    assert caught.value.path.name == "own.toml"
    assert "\n" not in str(caught.value)


def test_a_file_without_a_base_names_the_sections_that_it_lacks(file_of):
    with pytest.raises(ParameterError) as caught:
        parameter_set(file_of(tomli_w.dumps({"SA": asdict(PUBLISHED["SA"])})))
    assert caught.value.key == "RA, PC"


def test_what_is_no_set_and_no_file_is_named(here):
    (here / "sets").mkdir()
    (here / "own.toml").write_text('name = "own.toml"\n', encoding="utf-8")  # and nothing else
    for word in ("absent.toml", "sets", "sets/absent.toml", "own.toml"):
        with pytest.raises(ParameterError) as caught:
            parameter_set(word)
        assert str(caught.value.path) == word
    for word in ("Published", "fitted ", "table2", "folder/absent"):
        with pytest.raises(UsageError) as caught:
            parameter_set(word)
        assert (caught.value.argument, caught.value.found) == ("parameters", word)


@pytest.mark.parametrize(
    ("line", "name", "bound"),
    [
        ("tau_ms = 1e308", "tau_ms", "1e+12"),
        ("step_pa = 1e-320", "step_pa", "1e-12"),
        ("threshold_mv = 1e200", "threshold_mv", "1e+12"),
    ],
)
def test_a_parameter_whose_products_are_infinite_is_refused(file_of, line, name, bound):
    path = file_of(f'base = "fitted"\n[RA]\n{line}\n')
    with pytest.raises(ParameterError) as caught:
        parameter_set(path)
    assert caught.value.key == f"RA.{name}"
    assert bound in caught.value.expected


def test_a_name_and_a_depth_of_a_set_have_their_bounds(file_of):
    for head in ('name = ""', f'name = "{"x" * 300}"', "preindent_um = 1e308"):
        with pytest.raises(ParameterError) as caught:
            parameter_set(file_of(f'base = "fitted"\n{head}\n'))
        assert caught.value.key == head.split()[0]
