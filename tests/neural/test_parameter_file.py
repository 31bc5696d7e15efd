"""Parameters as TOML: models by name, what a section must have, what is kept."""

import math
from dataclasses import fields, replace

import pytest
import tomli_w

from fembridge.errors import ParameterError
from neural import (
    PUBLISHED,
    RateRaParameters,
    RisingRaParameters,
    SharpPcParameters,
    parameters_from_table,
    parameters_to_table,
    read_parameter_set,
    read_parameters,
)
from neural.drive_table import DRIVES
from neural.parameters import AFFERENTS

ROWS = [row for models in DRIVES.values() for row in models.values()]
ALL = pytest.mark.parametrize("row", ROWS, ids=[f"{row.name}-{row.afferent}" for row in ROWS])
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


@pytest.fixture
def file_of(tmp_path):
    def write(text, name="own.toml"):
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        return path

    return write


@ALL
def test_a_model_survives_a_table_and_a_file_to_the_last_digit(row, file_of):
    own = {**PUBLISHED, row.afferent: odd_parameters(row)}
    table = parameters_to_table(own)

    again = parameters_from_table(table)
    read = read_parameters(file_of(tomli_w.dumps(table)))

    assert dict(again) == dict(read) == own
    assert type(read[row.afferent]) is row.parameters
    assert set(table[row.afferent]) == {one.name for one in fields(row.parameters)}


@ALL
def test_a_section_says_by_its_drive_which_parameters_it_holds(row):
    needed = {one.field: math.sqrt(one.low * one.high) for one in row.free(1)}
    section = {"drive": row.name, **needed}

    own = parameters_from_table({row.afferent: section})[row.afferent]

    assert type(own) is row.parameters
    assert own.drive == row.name
    assert {name: getattr(own, name) for name in needed} == needed


def test_without_a_drive_a_section_is_published():
    own = parameters_from_table({"RA": {"tau_ms": 99.0}})

    assert own["RA"] == replace(PUBLISHED["RA"], tau_ms=99.0)
    assert own["RA"].drive == "published"


@pytest.mark.parametrize("name", ["published", "energy", "adaptive", "one_sided"])
def test_models_of_the_published_parameters_keep_what_a_section_leaves_out(name):
    own = parameters_from_table({"RA": {"drive": name, "tau_ms": 99.0}})

    assert own["RA"] == replace(PUBLISHED["RA"], drive=name, tau_ms=99.0)


def test_other_models_keep_the_defaults_of_their_class():
    own = parameters_from_table({"RA": RISING_RA, "SA": {}})

    assert own["RA"] == RisingRaParameters(tau_ms=300.0, step_pa=7000.0)
    assert own["RA"].threshold_mv == -55.0
    assert own["SA"] == PUBLISHED["SA"]


@pytest.mark.parametrize(
    ("section", "words"),
    [
        ({"drive": "rising"}, "RA: drive 'rising' also needs tau_ms, step_pa$"),
        ({"drive": "rising", "tau_ms": 3.0}, "RA: drive 'rising' also needs step_pa$"),
        (
            {"drive": "rate", "tau_ms": 3.0, "alpha_mv_per_ms": 1.0},
            "also needs a3_pa_per_ms, a5_pa_per_ms$",
        ),
        (
            {**RISING_RA, "a3_pa_per_ms": 3.0},
            "RA: unknown key 'a3_pa_per_ms', expected tau_ms, .*step_pa",
        ),
        ({**RISING_RA, "Step_Pa": 3.0}, "unknown key 'Step_Pa'.*mean 'step_pa'"),
        ({"step_pa": 3.0}, "RA: unknown key 'step_pa', expected tau_ms"),
        ({"drive": "sharp"}, "no drive 'sharp' for RA, expected one of published"),
        ({"drive": "risin"}, "drive 'risin', expected one of published, .*rising"),
        ({"drive": ""}, "drive '', expected one of published"),
        ({"drive": 3}, "drive '3', expected one of"),
        ({"drive": ["rising"]}, "expected one of published"),
        ({**RISING_RA, "step_pa": 0}, "RA: step_pa must be > 0, got 0"),
        ({**RISING_RA, "step_pa": math.nan}, "RA: step_pa is nan"),
        ({**RISING_RA, "step_pa": "7000"}, "step_pa must be a number, got '7000'"),
        ({**RISING_RA, "step_pa": [7000]}, r"step_pa must be a number, got \[7000\]"),
        ({**RISING_RA, "cells": 5.0}, r"cells must be a whole number .* got 5\.0"),
        ({**RISING_RA, "cells": True}, "cells must be a whole number .* got True"),
        ({**RISING_RA, "spread": -1}, "spread must be >= 0, got -1"),
        ({**RISING_RA, "jump_mv": -1}, "jump_mv must be >= 0, got -1"),
        ({**RISING_RA, "recovery_ms": 0.1}, r"recovery_ms 0\.1 is below dt_ms 0\.5"),
        ({**RISING_RA, "dt_ms": 0}, "dt_ms must be > 0, got 0"),
        ({**RISING_RA, "rest_mv": -50}, "threshold_mv -55 is not above rest_mv -50"),
    ],
)
def test_a_section_that_makes_no_parameters_is_refused_by_name(section, words):
    with pytest.raises(ParameterError, match=words):
        parameters_from_table({"RA": section})


def test_parameters_of_another_model_are_refused_by_their_class():
    with pytest.raises(ParameterError, match=r"RA: drive 'sharp' has no such .* rising"):
        RisingRaParameters(tau_ms=1.0, step_pa=1.0, drive="sharp")
    assert SharpPcParameters(tau_ms=1.0, beta_mv_per_ms=1.0).drive == "sharp"
    with pytest.raises(TypeError, match="a5_pa_per_ms"):
        RateRaParameters(tau_ms=1.0, a3_pa_per_ms=1.0, alpha_mv_per_ms=1.0)


def test_a_set_has_its_name_its_depth_and_where_it_comes_from(file_of):
    path = file_of(
        'name = "mine"\npreindent_um = 75\n'
        "[RA]\ndrive = 'rising'\ntau_ms = 300\nstep_pa = 7000\n"
        "[fit]\nseed = 3\nsources = ['a.csv', 'b.csv']\n[study.RA]\nrank = 1\n"
    )

    own = read_parameter_set(path)

    assert (own.name, own.preindent_um) == ("mine", 75.0)
    assert isinstance(own.preindent_um, float)
    assert dict(own.origin) == {
        "name": "mine",
        "fit": {"seed": 3, "sources": ["a.csv", "b.csv"]},
        "study": {"RA": {"rank": 1}},
    }
    assert dict(own.parameters) == dict(parameters_from_table({"RA": RISING_RA}))
    assert dict(read_parameters(path)) == dict(own.parameters)


def test_a_set_without_a_name_has_that_of_its_file(file_of):
    own = read_parameter_set(file_of("", "keen cells.toml"))

    assert (own.name, own.preindent_um, dict(own.origin)) == ("keen cells", 0.0, {})
    assert dict(own.parameters) == dict(PUBLISHED)
    assert tuple(own.parameters) == AFFERENTS


@pytest.mark.parametrize("value", ["-1", "nan", "inf", "true", '"75"', "[75]"])
def test_a_depth_that_is_none_is_refused_with_the_file(file_of, value):
    path = file_of(f"preindent_um = {value}\n")

    with pytest.raises(ParameterError, match=r"own\.toml: preindent_um must be a number >= 0, got"):
        read_parameter_set(path)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[RA]\ndrive = 'rapid'\n", r"own\.toml: drive 'rapid', expected one of"),
        ("[RA]\ndrive = 'rising'\n", r"own\.toml: RA: drive 'rising' also needs"),
        ("RA = 3\n", r"own\.toml: RA: expected a section, got 3"),
        ("[[RA]]\ntau_ms = 3\n", r"own\.toml: RA: expected a section, got \["),
        ("preindent = 3\n", r"own\.toml: unknown section 'preindent'"),
        ("[RA]\ntau_ms = 3\ntau_ms = 4\n", r"own\.toml: not TOML"),
        ("[RA]\ntau_ms = 1e999\n", r"own\.toml: RA: tau_ms is inf"),
    ],
)
def test_a_file_that_makes_no_parameters_is_named(file_of, text, words):
    with pytest.raises(ParameterError, match=words):
        read_parameter_set(file_of(text))


def test_parameters_that_were_read_cannot_be_changed(file_of):
    own = read_parameter_set(file_of(""))

    with pytest.raises(TypeError):
        own.parameters["RA"] = PUBLISHED["RA"]
