"""Observed rates: a table comes back as it was, or lacks what is named."""

import hashlib
import pickle
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import fembridge
from decks.stimuli import CATALOGUE
from fembridge.errors import TableError, UsageError
from fembridge.observed import ObservedRates, read_observed
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
    with pytest.raises(TableError) as caught:
        read_observed(path, **options)
    assert pickle.loads(pickle.dumps(caught.value)).args == caught.value.args
    return str(caught.value).removeprefix(str(path))


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


@given(written=rate_arrays(), chance=st.randoms(use_true_random=False))
def test_rows_that_are_left_out_are_the_ones_that_are_nan(tmp_path_factory, written, chance):
    path = tmp_path_factory.mktemp("observed") / "rates.csv"
    rates = as_rates(*written)
    kept = [rate for rate in rates if chance.random() < 0.5] or rates[:1]
    kept.append(Rate("sine_20_77", kept[0].afferent, 30.0))  # no class in doubt
    kept += [
        Rate("sine_20_78", name, 30.0)
        for name in {rate.afferent for rate in kept} - {kept[0].afferent}
    ]
    write_rates(path, kept)

    back = read_observed(path, complete=False)

    there = {(rate.stimulus, rate.afferent): rate.rate_ips for rate in kept}
    for row, stimulus in enumerate(back.stimuli):
        for column, afferent in enumerate(back.afferents):
            expected = there.get((stimulus, afferent), np.nan)
            np.testing.assert_equal(back.rate_ips[row, column], expected)
    assert sorted(back.rates(), key=repr) == sorted(kept, key=repr)
    for afferent in back.afferents:
        stimuli, rate_ips = back.of(afferent)
        assert dict(zip(stimuli, rate_ips.tolist(), strict=True)) == {
            rate.stimulus: rate.rate_ips for rate in kept if rate.afferent == afferent
        }


def test_ids_come_back_as_the_catalogue_spells_them(table):
    path = table(HEADER + "SINE_20_250.00,SA,3\ndiharm_10_50_125_125,SA,4\nsine_600_10,SA,5\n")

    observed = read_observed(path)

    assert observed.stimuli == ("sine_20_250", "diharm_10_50_125", "sine_600_10")


def test_the_sum_of_the_file_is_kept_with_its_path(table):
    content = (HEADER + "sine_20_250,SA,3\n").encode()
    path = table(content)

    observed = read_observed(path)

    assert observed.path == path
    assert observed.sha256 == hashlib.sha256(content).hexdigest()


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


def test_a_class_or_family_that_is_not_there_is_told(table):
    path = table(HEADER + "noise_5_25_1,SA,1\nsine_20_250,SA,2\n")
    observed = read_observed(path)

    with pytest.raises(UsageError, match="no observed rates of 'PC', only of SA: "):
        observed.of("PC")
    with pytest.raises(UsageError, match="of family 'diharm', only of sine, noise: "):
        observed.family("diharm")
    assert refusal(path, afferents=["SA", "PC"]) == ": no rates of PC, only of SA"


@pytest.mark.parametrize(
    ("afferents", "words"),
    [
        (["SA1"], "afferent 'SA1', expected one of SA, RA, PC"),
        ("sa", "afferent 'sa', expected one of SA, RA, PC"),
        ([], "no afferent, expected some of SA, RA, PC"),
    ],
)
def test_a_class_that_nobody_models_cannot_be_asked_for(tmp_path, afferents, words):
    with pytest.raises(UsageError) as caught:
        read_observed(tmp_path / "never_opened.csv", afferents=afferents)

    assert str(caught.value) == words


def test_a_second_rate_names_both_lines_however_its_id_is_spelled(table):
    path = table(HEADER + "sine_20_25,SA,3\nsine_20_25,RA,3\nsine_20_25.0,SA,3\n")

    assert refusal(path) == (":4: a second rate of sine_20_25, SA; the first is on line 2")


def test_a_class_that_lacks_a_stimulus_is_named_beside_one_that_has_it(table):
    lacking = "sine_20_25,SA,3\nsine_20_25,RA,3\nsine_50_250,SA,4\nsine_100_10,RA,5\n"
    path = table(HEADER + lacking)

    assert refusal(path) == (
        ":4: sine_50_250 has a rate of SA here and none of RA anywhere, "
        "expected one of SA, RA each (2 rows are missing)"
    )
    path = table(HEADER + lacking + "sine_50_250,RA,3\n")
    assert refusal(path) == (
        ":5: sine_100_10 has a rate of RA here and none of SA anywhere, expected one of SA, RA each"
    )
    observed = read_observed(path, complete=False)
    np.testing.assert_array_equal(observed.rate_ips, [[3, 3], [4, 3], [np.nan, 5]])


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"rate_ips": [1.0, 2.0]}, r"shape \(2,\), expected one for each of 2 stimuli"),
        ({"rate_ips": [[1.0], [-2.0]]}, "negative or infinite"),
        ({"rate_ips": [[1.0], [np.inf]]}, "negative or infinite"),
        ({"rate_ips": [[1.0], [np.nan]]}, "no rate of sine_50_250"),
        ({"stimuli": ("sine_20_25",) * 2}, "sine_20_25 stands there twice"),
        ({"afferents": ("SA1",)}, "afferent 'SA1', expected one of SA, RA, PC"),
        ({"stimuli": (), "rate_ips": np.zeros((0, 1))}, "0 stimuli and 1 classes"),
    ],
)
def test_rates_that_cannot_be_are_refused(changes, words):
    sound = {
        "stimuli": ("sine_20_25", "sine_50_250"),
        "afferents": ("SA",),
        "rate_ips": [[1.0], [2.0]],
        "path": Path("observed.csv"),
        "sha256": "",
    }
    assert ObservedRates(**sound).of("SA")[1].tolist() == [1.0, 2.0]

    with pytest.raises(TableError, match=words):
        ObservedRates(**sound | changes)


def test_rates_are_read_only_and_keep_their_own_copy():
    rate_ips = np.array([[1.0]])
    observed = ObservedRates(("sine_20_25",), ("SA",), rate_ips, Path("o.csv"), "")
    rate_ips[0, 0] = 9.0

    assert observed.rate_ips.tolist() == [[1.0]]
    with pytest.raises(ValueError, match="read-only"):
        observed.rate_ips[0, 0] = 5.0


@pytest.mark.skipif(
    not OBSERVED_SINES.is_file(), reason="the observed rates are not on this machine"
)
def test_the_observed_sinusoids_are_the_37_of_the_appendix_for_each_class():
    observed = read_observed(OBSERVED_SINES)

    assert set(observed.stimuli) == {id_ for id_ in IDS if id_.startswith("sine_")}
    assert observed.afferents == AFFERENTS
    assert not np.isnan(observed.rate_ips).any()
