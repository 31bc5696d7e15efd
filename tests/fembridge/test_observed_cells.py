"""Tables of observed rates as they go wrong: each is told what stands where."""

import pickle

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from fembridge.errors import TableError
from fembridge.observed import read_observed
from fembridge.tables import Rate, write_rates

HEADER = "stimulus,afferent,rate_ips\n"


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


@pytest.mark.parametrize(
    ("header", "words"),
    [
        *(
            (f"stimulus,afferent,{name}", f"column {name}, expected rate_ips, impulses")
            for name in (
                "rate_hz",
                "rate",
                "rate_per_ms",
                "spikes_per_s",
                "Rate_ips",
                "Firing frequency [Hz]",
                "rate_%",
            )
        ),
        ("Stimulus,afferent,rate_ips", "column Stimulus, expected stimulus"),
        (
            "stimulus,class,rate_ips",
            "no column afferent in 'stimulus,class,rate_ips', expected stimulus,afferent,rate_ips",
        ),
        ("stimulus,afferent", "no column rate_ips in 'stimulus,afferent', expected"),
        ("a,b,c", "no column stimulus, afferent, rate_ips in 'a,b,c', expected"),
        (
            "stimulus,afferent,rate_ips,animal",
            "column animal in 'stimulus,afferent,rate_ips,animal', "
            "expected stimulus,afferent,rate_ips and no other",
        ),
        ("stimulus,afferent,rate_ips,", "column without a name in "),
        ("stimulus,afferent,rate_ips,rate_ips", "column rate_ips stands there twice"),
        (
            "stimulus;afferent;rate_ips",
            "'stimulus;afferent;rate_ips' is parted by semicolons, expected commas: "
            "stimulus,afferent,rate_ips",
        ),
        ("stimulus\tafferent\trate_ips", r"'stimulus\tafferent\trate_ips' is parted"),
        (
            "stimulus,SA1,RA1,PC",
            "one column a class (SA1, RA1, PC), expected one row a rate: stimulus,",
        ),
        (
            "sine_20_25,SA,1.5",
            "'sine_20_25,SA,1.5' is no header, expected stimulus,afferent,rate_ips on",
        ),
    ],
)
def test_a_header_that_is_another_is_told_what_it_should_be(table, header, words):
    path = table(header + "\nsine_20_250,SA,3\n")

    assert refusal(path).startswith(":1: " + words)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", ": empty, expected a header with stimulus,afferent,rate_ips"),
        (b"\xef\xbb\xbf", ": empty, expected a header with stimulus,afferent,rate_ips"),
        (HEADER.encode(), ": a header and no rows, expected rates"),
        (HEADER.encode("utf-16"), ": the text is UTF-16, expected UTF-8"),
        (b"\xfe\xff\0s\0t", ": the text is UTF-16, expected UTF-8"),
        (b"PK\x03\x04\x14\0", ": a spreadsheet or another ZIP archive, expected a CSV table"),
        (b"\x93NUMPY\x01\0v\0", ": a binary file, expected a CSV table"),
        (HEADER.encode() + b"sine_20_25\xb5,SA,3\n", ":2: byte 0xb5 is not UTF-8"),
        (HEADER.encode() + b'"sine_20_25,SA,3\n', ":2: not CSV: unexpected end of data"),
        (b'"stimulus', ":1: not CSV: unexpected end of data"),
    ],
)
def test_a_file_that_is_no_table_is_refused(table, content, words):
    assert refusal(table(content)) == words


def test_a_file_that_is_not_there_is_named(tmp_path):
    words = refusal(tmp_path / "absent.csv")

    assert words == ": cannot read: No such file or directory"


@pytest.mark.parametrize(
    ("row", "words"),
    [
        (",SA,3", "stimulus is empty"),
        ("sine 20 250,SA,3", "stimulus 'sine 20 250' has a blank in it, expected as sine_20_250"),
        ("sine_40 _100,SA,3", "stimulus 'sine_40 _100' has a blank in it, expected as sine_40_100"),
        ("20 Hz 250 um,SA,3", "stimulus '20 Hz 250 um' has a blank in it, expected as sine_20_250"),
        ("sin_20_250,SA,3", "no stimulus 'sin_20_250'; did you mean sine_20_250,"),
        ("sine_20_250um,SA,3", "no stimulus 'sine_20_250um'; did you mean sine_20_250"),
        ("sine_21,SA,3", "no stimulus 'sine_21' in the catalogue, which has sine_20,"),
        ("sine_2000_5,SA,3", "sine_2000_5: frequency_hz of a sine must be below 1000"),
        (
            "sine_20,SA,3",
            "stimulus 'sine_20' names 12 stimuli, expected one row a level: "
            "sine_20_6.71, sine_20_9.32, sine_20_12.5, ...",
        ),
        ("all,SA,3", "stimulus 'all' names 82 stimuli, expected one row a level: "),
        (
            '"sine_20_25,sine_20_18",SA,3',
            "stimulus 'sine_20_25,sine_20_18' names 2 stimuli, expected one row a "
            "level: sine_20_25, sine_20_18",
        ),
    ],
)
def test_a_stimulus_that_is_not_exactly_one_is_told(table, row, words):
    assert refusal(table(HEADER + row + "\n")).startswith(":2: " + words)


@pytest.mark.parametrize(
    ("word", "hint"),
    [
        *((word, f"; {word} is SA here") for word in ("SA1", "SAI", "SA-I", "sa", "SA 1")),
        *((word, f"; {word} is RA here") for word in ("FA1", "RA1", "FAI", "RA-I", "QA")),
        *((word, f"; {word} is PC here") for word in ("FA2", "RAII", "Pacinian", "Pc")),
        ("SA2", "; there is no model of SA2, SA is SA1"),
        ("SA-II", "; there is no model of SA2, SA is SA1"),
        ("C", ""),
        ("", ""),
    ],
)
def test_an_afferent_by_another_name_is_told_its_name_here(table, word, hint):
    path = table(HEADER + f"sine_20_25,PC,3\nsine_20_25,{word},3\n")

    assert refusal(path) == (f":3: afferent is {word!r}, expected one of SA, RA, PC{hint}")


@pytest.mark.parametrize(
    ("cell", "words"),
    [
        ("", "rate_ips is empty, expected a number; a rate that was not measured has no row"),
        ("NaN", "rate_ips is 'NaN', expected a number; a rate that was not measured"),
        ("n/a", "rate_ips is 'n/a', expected a number; a rate that was not measured"),
        ("-nan", "rate_ips is nan, expected a finite number"),
        ("inf", "rate_ips is inf, expected a finite number"),
        ("1e999", "rate_ips is inf, expected a finite number"),
        ("-3", "rate_ips is -3, expected >= 0"),
        ("12%", "rate_ips is '12%', a share; expected impulses a second"),
        ("12 ips", "rate_ips is '12 ips', expected a number"),
        ("1_000", "rate_ips is '1_000', expected a number"),
        ('"12,5"', "rate_ips is '12,5', expected a number with a decimal point"),
        (
            "12,5",
            "4 cells, expected 3 as in the header; "
            "'12,5' looks like a decimal comma, expected a point",
        ),
        ("12,loud", "4 cells, expected 3 as in the header"),
        (
            "2000.5",
            "rate_ips is 2000.5, expected impulses a second: "
            "an afferent that rests 0.5 ms after each has at most 2000",
        ),
    ],
)
def test_a_rate_that_is_none_is_told(table, cell, words):
    path = table(HEADER + f"sine_20_25,SA,3\nsine_20_25,RA,{cell}\n")

    assert refusal(path).startswith(":3: " + words)


def test_a_row_cut_short_is_told_without_a_word_of_commas(table):
    path = table(HEADER + "sine_20_25,3\n")

    assert refusal(path) == ":2: 2 cells, expected 3 as in the header"


def test_a_class_in_impulses_a_millisecond_is_told_and_can_be_left_out(table):
    path = table(
        HEADER + "sine_20_25,SA,20\nsine_20_25,PC,0\n"
        "sine_20_250,SA,40\nsine_20_250,PC,0.25\nsine_50_250,SA,0\nsine_50_250,PC,0.1\n"
    )

    assert refusal(path) == (
        ":5: the highest rate of PC is 0.25, as if in impulses a ms; "
        "expected impulses a second (if it is right, leave PC out)"
    )
    assert read_observed(path, afferents=["SA"]).rate_ips.tolist() == [[20], [40], [0]]


@given(top_ips=st.floats(0, 2000))
@example(top_ips=0.5)
def test_a_class_is_in_doubt_when_it_fires_and_never_above_half_an_impulse(
    tmp_path_factory, top_ips
):
    path = tmp_path_factory.mktemp("observed") / "rates.csv"
    write_rates(path, [Rate("sine_20_25", "SA", 0.0), Rate("sine_20_250", "SA", top_ips)])

    if 0 < top_ips <= 0.5:
        assert "as if in impulses a ms" in refusal(path)
    else:
        assert read_observed(path).rate_ips[1, 0] == top_ips
