"""Table 2 as it is printed, and what a table of parameters may hold."""

import math
import pickle
from dataclasses import FrozenInstanceError, replace

import pytest
import tomli_w

from fembridge.errors import ParameterError
from neural.parameter_file import parameters_from_table, parameters_to_table, read_parameters
from neural.parameters import PUBLISHED, PcParameters


def test_published_is_table_2_and_section_2_2():
    sa, ra, pc = PUBLISHED["SA"], PUBLISHED["RA"], PUBLISHED["PC"]

    assert (sa.tau_ms, ra.tau_ms, pc.tau_ms) == (32.14, 456.70, 639.85)
    assert (sa.a1_pa, sa.a2_pa_per_ms) == (1926.32, 9850.98)
    assert (ra.a3_pa_per_ms, pc.a4_pa_per_ms2) == (17191.87, 16.34)
    assert [p.alpha_mv_per_ms for p in (sa, ra, pc)] == [1.79, 10.23, 4.14]
    assert [p.gap_mv for p in (sa, ra, pc)] == [15.0, 10.0, 10.0]
    assert [p.refractory_ms for p in (sa, ra, pc)] == [1.0, 0.5, 0.5]
    assert {p.rest_mv for p in (sa, ra, pc)} == {-65.0}
    assert {p.dt_ms for p in (sa, ra, pc)} == {0.5}


def test_published_cannot_be_changed():
    with pytest.raises(TypeError):
        PUBLISHED["SA"] = PUBLISHED["RA"]
    with pytest.raises(FrozenInstanceError):
        PUBLISHED["SA"].tau_ms = 1.0


def test_each_set_is_filed_under_its_own_class():
    assert [(name, p.afferent) for name, p in PUBLISHED.items()] == [
        ("SA", "SA"),
        ("RA", "RA"),
        ("PC", "PC"),
    ]
    assert pickle.loads(pickle.dumps(PUBLISHED["PC"])) == PUBLISHED["PC"]


def test_a_table_survives_toml(tmp_path):
    path = tmp_path / "fitted.toml"
    own = {**PUBLISHED, "RA": replace(PUBLISHED["RA"], tau_ms=0.1 + 0.2 + 20)}

    path.write_text(tomli_w.dumps(parameters_to_table(own)), encoding="utf-8")

    assert dict(read_parameters(path)) == own


def test_what_a_table_leaves_out_is_published():
    own = parameters_from_table({"PC": {"tau_ms": 100}})

    assert own["PC"] == replace(PUBLISHED["PC"], tau_ms=100.0)
    assert own["SA"] is PUBLISHED["SA"]
    assert isinstance(own["PC"].tau_ms, float)
    assert dict(parameters_from_table({})) == dict(PUBLISHED)


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"SA": {"tau": 3}}, "SA: unknown key 'tau', .*did you mean 'tau_ms'"),
        ({"SA": {"a3_pa_per_ms": 3}}, "SA: unknown key 'a3_pa_per_ms'"),
        ({"sa": {}}, "unknown section 'sa', expected SA, RA, PC; did you mean 'SA'"),
        ({"zebra": {}}, "unknown section 'zebra', expected SA, RA, PC$"),
        ({"SA": 3}, "SA: expected a section, got 3"),
        ({"SA": {"tau_ms": "32"}}, "SA: tau_ms must be a number, got '32'"),
        ({"SA": {"tau_ms": True}}, "SA: tau_ms must be a number, got True"),
        ({"SA": {"tau_ms": math.inf}}, "SA: tau_ms is inf"),
        ({"RA": {"a3_pa_per_ms": 0}}, "RA: a3_pa_per_ms must be > 0, got 0"),
        ({"RA": {"alpha_mv_per_ms": -1.0}}, "alpha_mv_per_ms must be > 0, got -1"),
        ({"RA": {"refractory_ms": -1}}, "refractory_ms must be >= 0, got -1"),
        ({"PC": {"threshold_mv": -65}}, "threshold_mv -65 is not above rest_mv -65"),
        ({"PC": {"tau_ms": 0.4}}, "tau_ms 0.4 is below dt_ms 0.5"),
    ],
)
def test_a_key_or_value_without_meaning_is_refused_by_name(table, words):
    with pytest.raises(ParameterError, match=words):
        parameters_from_table(table)


def test_no_refractory_period_is_a_period():
    assert replace(PUBLISHED["PC"], refractory_ms=0).refractory_ms == 0.0


def test_a_class_asks_for_its_own_half_saturation():
    with pytest.raises(TypeError, match="a4_pa_per_ms2"):
        PcParameters(tau_ms=1.0, alpha_mv_per_ms=1.0)


def test_a_file_that_cannot_be_read_is_named(tmp_path):
    broken, wrong = tmp_path / "broken.toml", tmp_path / "wrong.toml"
    binary = tmp_path / "binary.toml"
    broken.write_text("[SA\n", encoding="utf-8")
    wrong.write_text("[SA]\ntaums = 3\n", encoding="utf-8")
    binary.write_bytes(b"\xff\xfe\x00")

    with pytest.raises(ParameterError, match=r"absent\.toml: cannot read: No such"):
        read_parameters(tmp_path / "absent.toml")
    with pytest.raises(ParameterError, match=r"broken\.toml: not TOML"):
        read_parameters(broken)
    with pytest.raises(ParameterError, match=r"binary\.toml: not TOML"):
        read_parameters(binary)
    with pytest.raises(ParameterError, match=r"wrong\.toml: SA: unknown key 'taums'"):
        read_parameters(wrong)
