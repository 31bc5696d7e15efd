"""Observed rates: a table comes back as it was, or is refused with the line and what it has."""

import pickle
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import fembridge
from decks.stimuli import CATALOGUE
from fembridge.errors import TableError, UsageError
from fembridge.observed import read_observed
from fembridge.tables import AFFERENTS, Rate, read_rates, write_rates

HEADER = "stimulus,afferent,rate_ips\n"
OBSERVED_SINES = Path(fembridge.__file__).parents[2] / "shared" / "data" / "observed_sine_rates.csv"

IDS = [entry.id for entry in CATALOGUE]
OWN_IDS = ["sine_600_10", "sine_40_100", "diharm_10_50_20_20", "noise_30_200_7"]


@pytest.fixture
def table(tmp_path):
    """Write a text or bytes as a table and give its path."""

    def write(content):
        path = tmp_path / "observed.csv"
        if isinstance(content, str):
            content = content.encode("utf-8")
        path.write_bytes(content)
        return path

    return write


def refusal(path, **options):
    """Line and words of the refusal, which can be pickled."""
    with pytest.raises(TableError) as caught:
        read_observed(path, **options)
    assert pickle.loads(pickle.dumps(caught.value)).args == caught.value.args
    return caught.value.line, caught.value.problem


@st.composite
def rate_arrays(draw):
    """Rates of some classes under some stimuli, in units that cannot be mistaken."""
    stimuli = draw(st.lists(st.sampled_from(IDS + OWN_IDS), min_size=1, unique=True))
    afferents = draw(st.sets(st.sampled_from(AFFERENTS), min_size=1))
    ips = st.just(0.0) | st.floats(0.51, 2000)
    column = st.lists(ips, min_size=len(stimuli), max_size=len(stimuli))
    columns = [draw(column) for _ in afferents]
    names = tuple(name for name in AFFERENTS if name in afferents)
    return tuple(stimuli), names, np.array(columns).T


def as_rates(stimuli, afferents, rate_ips):
    return [
        Rate(stimulus, afferent, rate_ips[row, column])
        for row, stimulus in enumerate(stimuli)
        for column, afferent in enumerate(afferents)
    ]


@given(written=rate_arrays(), mix=st.randoms(use_true_random=False))
def test_rates_come_back_bit_for_bit_however_the_classes_are_mixed(tmp_path_factory, written, mix):
    path = tmp_path_factory.mktemp("observed") / "rates.csv"
    stimuli, afferents, rate_ips = written
    rates = as_rates(*written)
    mix.shuffle(rates)
    write_rates(path, rates)

    back = read_observed(path)

    assert back.stimuli == tuple(dict.fromkeys(rate.stimulus for rate in rates))
    assert back.afferents == afferents
    order = [stimuli.index(each) for each in back.stimuli]
    np.testing.assert_array_equal(back.rate_ips, rate_ips[order])
    assert sorted(back.rates(), key=repr) == sorted(read_rates(path), key=repr)


def test_ids_come_back_as_the_catalogue_spells_them(table):
    path = table(HEADER + "SINE_20_250.00,SA,3\ndiharm_10_50_125_125,SA,4\nsine_600_10,SA,5\n")

    observed = read_observed(path)

    assert observed.stimuli == ("sine_20_250", "diharm_10_50_125", "sine_600_10")


@pytest.mark.parametrize(
    "content",
    [
        b"\xef\xbb\xbfstimulus,afferent,rate_ips\nsine_20_250,SA,3\n",
        b"stimulus,afferent,rate_ips\r\nsine_20_250,SA,3\r\n",
        b"stimulus,afferent,rate_ips\rsine_20_250,SA,3\r",
        b"rate_ips, afferent ,stimulus\n3.0, SA,sine_20_250\n\n,,\n",
        b'"stimulus","afferent","rate_ips"\n"sine_20_250","SA","3"',
    ],
    ids=["byte order mark", "CRLF", "CR", "order and blanks", "quotes"],
)
def test_what_programs_write_around_the_same_table_does_not_matter(table, content):
    observed = read_observed(table(content))

    assert observed.rates() == [Rate("sine_20_250", "SA", 3.0)]


def test_classes_come_in_the_order_asked_for_and_others_are_left_out(table):
    path = table(HEADER + "sine_20_250,PC,1\nsine_20_250,RA,2\nsine_20_250,SA,3\nsine_50_250,PC,4")

    one = read_observed(path, afferents="RA")
    two = read_observed(path, afferents=["SA", "RA", "SA"])
    all_three = read_observed(path, complete=False)

    assert (one.stimuli, one.rate_ips.tolist()) == (("sine_20_250",), [[2.0]])
    assert (two.afferents, two.rate_ips.tolist()) == (("SA", "RA"), [[3.0, 2.0]])
    assert all_three.afferents == ("SA", "RA", "PC")


def test_a_family_has_its_own_stimuli_and_no_others(table):
    path = table(
        HEADER + "noise_5_25_1,SA,1\nsine_20_250,SA,2\nnoise_5_25_5,SA,3\n"
        "noise_5_25_1,RA,4\nsine_20_250,RA,5\n"
    )

    observed = read_observed(path, complete=False)
    noise = observed.family("noise")

    assert observed.families == ("sine", "noise")
    assert noise.stimuli == ("noise_5_25_1", "noise_5_25_5")
    np.testing.assert_array_equal(noise.rate_ips, [[1, 4], [3, np.nan]])
    stimuli, rate_ips = noise.of("RA")
    assert (stimuli, rate_ips.tolist()) == (("noise_5_25_1",), [4.0])
    assert (noise.path, noise.sha256) == (observed.path, observed.sha256)


def test_a_class_or_family_that_is_not_there_is_named(table):
    path = table(HEADER + "noise_5_25_1,SA,1\nsine_20_250,SA,2\n")
    observed = read_observed(path)

    with pytest.raises(UsageError, match="'PC'"):
        observed.of("PC")
    with pytest.raises(UsageError, match="'diharm'"):
        observed.family("diharm")
    assert refusal(path, afferents=["SA", "PC"])[1].startswith("no rates of PC")


@pytest.mark.parametrize("afferents", [["SA1"], "sa", []])
def test_a_class_that_nobody_models_cannot_be_asked_for(tmp_path, afferents):
    with pytest.raises(UsageError):
        read_observed(tmp_path / "never_opened.csv", afferents=afferents)


def test_a_duplicate_names_both_lines_however_its_id_is_spelled(table):
    path = table(HEADER + "sine_20_25,SA,3\nsine_20_25,RA,3\nsine_20_25.0,SA,3\n")

    assert refusal(path) == (4, "duplicate of line 2: sine_20_25, SA")


def test_a_class_that_lacks_a_stimulus_is_named_beside_one_that_has_it(table):
    lacking = "sine_20_25,SA,3\nsine_20_25,RA,3\nsine_50_250,SA,4\nsine_100_10,RA,5\n"
    line, problem = refusal(table(HEADER + lacking))
    assert line == 4
    assert problem.startswith("sine_50_250 has a rate of SA and none of RA")

    path = table(HEADER + lacking + "sine_50_250,RA,3\n")
    line, problem = refusal(path)
    assert line == 5
    assert problem.startswith("sine_100_10 has a rate of RA and none of SA")
    observed = read_observed(path, complete=False)
    np.testing.assert_array_equal(observed.rate_ips, [[3, 3], [4, 3], [np.nan, 5]])


@pytest.mark.parametrize(
    ("header", "found"),
    [
        *(
            (f"stimulus,afferent,{name}", f"column {name}, expected rate_ips")
            for name in ("rate_hz", "spikes_per_s", "Rate_ips", "Firing frequency [Hz]", "rate_%")
        ),
        ("Stimulus,afferent,rate_ips", "column Stimulus, expected stimulus"),
        ("stimulus,class,rate_ips", "no column afferent in 'stimulus,class,rate_ips'"),
        ("a,b,c", "no column stimulus, afferent, rate_ips in 'a,b,c'"),
        ("sine_20_25,SA,1.5", "no column stimulus, afferent, rate_ips in 'sine_20_25,SA,1.5'"),
        ("stimulus,afferent,rate_ips,animal", "column animal in "),
        ("stimulus,afferent,rate_ips,", "column without a name in "),
        ("stimulus,afferent,rate_ips,rate_ips", "duplicate column in "),
        ("stimulus;afferent;rate_ips", "'stimulus;afferent;rate_ips' is separated by semicolons"),
        ("stimulus\tafferent\trate_ips", "'stimulus\\tafferent\\trate_ips' is separated by tabs"),
        ("stimulus,SA1,RA1,PC", "one column a class (SA1, RA1, PC)"),
    ],
)
def test_another_header_is_named(table, header, found):
    line, problem = refusal(table(header + "\nsine_20_250,SA,3\n"))

    assert line == 1
    assert problem.startswith(found)


@pytest.mark.parametrize(
    ("row", "found"),
    [
        (",SA,3", "stimulus is empty"),
        ("sine 20 250,SA,3", "'sine 20 250'"),
        ("sine_20_250um,SA,3", "'sine_20_250um'; did you mean sine_20_250"),
        ("sine_2000_5,SA,3", "sine_2000_5: frequency_hz"),
        ("sine_20,SA,3", "'sine_20' names 12 stimuli"),
        ("sine_20_25,3", "afferent is '3'"),
        ('"sine_20_25,sine_20_18",SA,3', "names 2 stimuli"),
    ],
)
def test_a_stimulus_that_is_not_exactly_one_is_named(table, row, found):
    line, problem = refusal(table(HEADER + row + "\n"))

    assert line == 2
    assert found in problem


@pytest.mark.parametrize(
    ("word", "hint"),
    [
        *((word, f"; {word} is SA here") for word in ("SA1", "SA-I", "sa", "SA 1")),
        *((word, f"; {word} is RA here") for word in ("FA1", "RAI", "QA")),
        *((word, f"; {word} is PC here") for word in ("FA2", "RAII", "Pacinian")),
        ("SA2", "; there is no model of SA2, SA is SA1"),
        ("SA-II", "; there is no model of SA2, SA is SA1"),
        ("C", ""),
        ("", ""),
    ],
)
def test_an_afferent_by_another_name_is_told_its_name_here(table, word, hint):
    path = table(HEADER + f"sine_20_25,PC,3\nsine_20_25,{word},3\n")

    line, problem = refusal(path)

    assert line == 3
    assert problem.startswith(f"afferent is {word!r}")
    assert problem.endswith(f"SA, RA, PC{hint}")


@pytest.mark.parametrize(
    ("cell", "found"),
    [
        ("", "rate_ips is ''"),
        ("NaN", "rate_ips is 'NaN'"),
        ("n/a", "rate_ips is 'n/a'"),
        ("-nan", "rate_ips is nan"),
        ("1e999", "rate_ips is inf"),
        ("-3", "rate_ips is -3"),
        ("12%", "rate_ips is '12%'"),
        ("12 ips", "rate_ips is '12 ips'"),
        ("1_000", "rate_ips is '1_000'"),
        ('"12,5"', "rate_ips is '12,5'"),
        ("12,5", "4 cells, expected 3 as in the header; '12,5' looks like a decimal comma"),
        ("12,loud", "4 cells, expected 3 as in the header"),
        ("2000.5", "rate_ips is 2000.5"),
    ],
)
def test_a_rate_that_is_none_is_named(table, cell, found):
    line, problem = refusal(table(HEADER + f"sine_20_25,SA,3\nsine_20_25,RA,{cell}\n"))

    assert line == 3
    assert problem.startswith(found)


def test_a_class_in_impulses_a_millisecond_is_named_and_can_be_left_out(table):
    path = table(
        HEADER + "sine_20_25,SA,20\nsine_20_25,PC,0\n"
        "sine_20_250,SA,40\nsine_20_250,PC,0.25\nsine_50_250,SA,0\nsine_50_250,PC,0.1\n"
    )

    line, problem = refusal(path)

    assert line == 5
    assert problem.startswith("the highest rate of PC is 0.25")
    assert read_observed(path, afferents=["SA"]).rate_ips.tolist() == [[20], [40], [0]]
