"""Tables and observed rates: they come back as they were written, or are refused with the line."""

import pickle
from functools import partial

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from decks.stimuli import CATALOGUE
from fembridge.errors import (
    FembridgeWarning,
    StimulusError,
    TableError,
    TraceError,
    UsageError,
)
from fembridge.io import text_table
from fembridge.io.observed_rates import read_observed
from fembridge.io.spike_table import (
    AFFERENTS,
    Rate,
    SpikeTrain,
    read_rates,
    read_spikes,
    write_rates,
    write_spikes,
)
from fembridge.io.text_table import read_table
from fembridge.io.trace_table import read_traces
from fembridge.io.waveform_file import read_stimulus
from fembridge.trace import StressTrace, Traces

HEADER = "time_ms,afferent,node,von_mises_pa\n"


def refusal(read, path):
    """Line and words of the refusal, which can be pickled."""
    with pytest.raises(TableError) as caught:
        read(path)
    assert caught.value.path == path
    assert pickle.loads(pickle.dumps(caught.value)).args == caught.value.args
    return caught.value.line, str(caught.value).partition(": ")[2]


@settings(deadline=None)
@given(
    stress_pa=st.lists(st.floats(0, 1e9), min_size=2, max_size=20),
    start_ms=st.sampled_from([0.0, 0.5, -12.5]),
    afferent=st.sampled_from(["SA", "RA", "PC", None]),
)
def test_a_trace_comes_back_bit_for_bit(tmp_path_factory, stress_pa, start_ms, afferent):
    path = tmp_path_factory.mktemp("tables") / "traces.csv"
    trace = StressTrace(np.array(stress_pa), 0.5, 17, afferent, start_ms)
    Traces([trace]).to_frame().to_csv(path, index=False)
    [back] = read_traces(path)
    np.testing.assert_array_equal(back.stress_pa, trace.stress_pa)
    np.testing.assert_array_equal(back.times_ms, trace.times_ms)
    assert (back.node, back.afferent, back.dt_ms) == (17, afferent, 0.5)


@pytest.fixture
def table(file):
    """Write a text or bytes as a table and give its path."""
    return partial(file, "table.csv")


def test_rows_of_several_nodes_may_be_mixed_and_columns_in_any_order(table):
    path = table(
        "\ufeffvon_mises_pa, node ,note,time_ms,afferent\r\n"
        "1,5,a,0,SA\r\n10,6,b,0,\r\n2,5,c,0.5,SA\r\n\r\n20,6,d,0.5,\r\n"
    )
    first, second = read_traces(path)
    assert (first.afferent, first.stress_pa.tolist()) == ("SA", [1.0, 2.0])
    assert (second.afferent, second.stress_pa.tolist()) == (None, [10.0, 20.0])


@pytest.mark.parametrize(
    ("rows", "line", "column", "found"),
    [
        ("0,SA,4,1\n0.5,SA,4,soft\n", 3, "von_mises_pa", "soft"),
        ("0,SA,4,nan\n", 2, "von_mises_pa", "nan"),
        ("0,SA,4,1_000\n", 2, "von_mises_pa", "1_000"),
        ("0,SA,4.5,1\n", 2, "node", "4.5"),
        ("0,SA,-1,1\n", 2, "node", -1),
        ("\n , ,,\n0,SA1,4,1\n", 4, "afferent", "SA1"),
        ('"0",SA,4,"1\n"\n0.5,SA,4,soft\n', 4, "von_mises_pa", "soft"),
    ],
)
def test_a_cell_that_is_no_value_is_an_error_with_line_and_column(table, rows, line, column, found):
    path = table(HEADER + rows)
    with pytest.raises(TableError) as caught:
        read_traces(path)
    error = caught.value
    assert (error.path, error.line, error.key, error.found) == (path, line, column, found)


@pytest.mark.parametrize(
    ("rows", "line", "begin", "found"),
    [
        ("0,SA,4,1\n", 2, "SA node 4", "one sample"),
        ("0,SA,4,1\n0.5,SA,4,1\n1,SA,4,1\n2,SA,4,1\n", 5, "SA node 4", "from 1 to 2 ms"),
        ("0,,4,1\n0.5,,4,1\n0.5,,4,1\n1,,4,1\n", 4, "node 4", "from 0.5 to 0.5 ms"),
        ("0,SA,4,1\n0,5,SA,4,1\n", 3, "5 cells", "expected 4"),
        ("0,SA,4,1,5\n", 2, "5 cells", "'1,5' looks like a decimal comma"),
        ('0,SA,4,1\n0.5,SA,4,"1\n', 3, "not CSV", ""),
        ("", None, "a header and no rows", ""),
    ],
)
def test_a_row_that_is_no_sample_is_named(table, rows, line, begin, found):
    named, problem = refusal(read_traces, table(HEADER + rows))
    assert named == line
    assert problem.startswith(begin)
    assert found in problem


@pytest.mark.filterwarnings("ignore:.*no line end:fembridge.errors.FembridgeWarning")
@pytest.mark.parametrize("read", [read_traces, read_spikes, read_rates])
@pytest.mark.parametrize(
    ("content", "line"),
    [
        (b"", None),
        (b"a,b,c\n1,2,3\n", 1),
        (b"a;b;c\n1;2,5;3\n", 1),
        (b"\x93NUMPY\x01\0v\0", None),
        ("stimulus".encode("utf-16"), None),
        (b"stimulus,afferent\nsine_\xb5m,SA\n", 2),
        (b'"stimulus', 1),
    ],
)
def test_a_file_that_is_no_table_is_refused(table, read, content, line):
    assert refusal(read, table(content))[0] == line


def test_a_column_that_is_missing_or_duplicate_is_named(table):
    line, problem = refusal(read_traces, table("time,afferent,node,von_mises_pa\n0,SA,1,1\n"))
    assert line == 1
    assert "time_ms in 'time,afferent,node,von_mises_pa'" in problem
    _, problem = refusal(read_traces, table("# t v\n0 1\n0.5 2\n"))  # one column and a comment
    assert "time_ms in '0 1'" in problem
    path = table("stimulus,afferent,rate_ips,rate_ips\nsine_20_250,SA,1,2\n")
    line, problem = refusal(read_rates, path)
    assert line == 1
    assert "duplicate column rate_ips" in problem


def test_a_file_that_is_not_there_is_named(tmp_path):
    assert refusal(read_traces, tmp_path / "absent.csv")[0] is None
    assert refusal(read_traces, tmp_path)[0] is None


def test_spikes_in_any_order_come_back_rising_but_not_doubled(table):
    header = "stimulus,afferent,cell,spike_time_ms\n"
    [train] = read_spikes(table(header + "s,SA,0,9\ns,SA,0,3\n"))
    assert train.times_ms.tolist() == [3.0, 9.0]
    doubled = table(header + "s,SA,0,9\ns,SA,0,3\ns,SA,0,9.0\n")
    line, problem = refusal(read_spikes, doubled)
    assert line == 4
    assert "line 2" in problem
    assert refusal(read_spikes, table(header + "s,SA,-1,9\n"))[0] == 2


@pytest.mark.parametrize(
    ("keys", "columns"),
    [
        ([{}], "cell"),
        ([{"cell": 1}, {"cell": 2}], "cell"),
        ([{"trial": 1}, {"trial": 2}], "trial"),
        ([{"unit": "SA1", "trial": 1}, {"unit": "SA2", "trial": 1}], "unit,trial"),
        ([{"unit": "u", "cell": 1, "trial": 2}], "unit,cell,trial"),
    ],
)
def test_trains_come_back_by_unit_cell_and_trial(tmp_path, keys, columns):
    trains = [SpikeTrain("s", "SA", np.array([0.1, 1 / 3]), **key) for key in keys]
    path = tmp_path / "spikes.csv"
    write_spikes(path, trains)
    assert path.read_text().splitlines()[0] == f"stimulus,afferent,{columns},spike_time_ms"
    for train, copy in zip(trains, read_spikes(path), strict=True):
        assert (copy.unit, copy.cell, copy.trial) == (train.unit, train.cell, train.trial)
        assert copy.times_ms.tolist() == train.times_ms.tolist()


def test_unit_cell_and_trial_may_be_absent(table):
    [train] = read_spikes(table("stimulus,afferent,spike_time_ms\ns,SA,1\ns,SA,2\n"))
    assert (train.unit, train.cell, train.trial) == ("", 0, 0)
    trains = read_spikes(table("stimulus,afferent,spike_time_ms,trial\ns,SA,1,1\ns,SA,1,2\n"))
    assert [train.trial for train in trains] == [1, 2]


@pytest.mark.parametrize("times_ms", [[2.0, 1.0], [1.0, 1.0], [np.nan], [[1.0]]])
def test_a_train_that_cannot_be_is_refused(times_ms):
    with pytest.raises(TraceError):
        SpikeTrain("s", "SA", np.array(times_ms))


def test_a_plain_table_is_the_same_number_by_number_as_cell_by_cell(tmp_path):
    """A quoted cell has the table read the other way."""
    rng = np.random.default_rng(3)
    made = [
        StressTrace(rng.normal(size=50) * 10.0 ** rng.integers(-300, 300), 0.1, node, name, 0.3)
        for node, name in ((4, "SA"), (9, None), (9, "PC"))
    ]
    path, quoted = tmp_path / "plain.csv", tmp_path / "quoted.csv"
    Traces(made).to_frame().to_csv(path, index=False)
    quoted.write_text(path.read_text().replace("SA", '"SA"', 1))
    for one, plain, other in zip(made, read_traces(path), read_traces(quoted), strict=True):
        for found in (plain, other):
            assert found.stress_pa.tolist() == one.stress_pa.tolist()
            assert (found.node, found.afferent) == (one.node, one.afferent)
    path.write_text(path.read_text().replace("\n0.5,", "\n0.55,"))
    with pytest.raises(TableError) as refused:
        read_traces(path)
    assert refused.value.line is not None


TABLES = {
    read_traces: "time_ms,afferent,node,von_mises_pa\n0,SA,1,100\n0.5,SA,1,12345\n",
    read_spikes: "stimulus,afferent,cell,spike_time_ms\ns,SA,0,3\ns,SA,0,9.125\n",
    read_rates: "stimulus,afferent,rate_ips\ns,SA,3\ns,RA,97.125\n",
    read_observed: "stimulus,afferent,rate_ips\nsine_20_250,SA,3\nsine_20_250,RA,97.125\n",
    read_stimulus: "time_ms,displacement_um\n0,0\n0.5,12.25\n",
    partial(
        read_traces, columns={"time": "t_s", "value": "p_pa"}
    ): "t_s;p_pa\n0;1,5\n0,0005;1,25\n",
}


@pytest.mark.parametrize(("read", "text"), TABLES.items())
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_a_table_that_is_cut_in_its_last_number_says_so(table, read, text, end):
    text = text.replace("\n", end)
    read(table(text))  # a warning would be an error
    with pytest.warns(FembridgeWarning, match="table.csv: .* may be cut") as caught:
        read(table(text[: -len(end) - 1]))
    assert len(caught) == 1


WIDE = "," * 300_000


@pytest.mark.parametrize(
    ("content", "line", "problem"),
    [
        (f"time_ms,von_mises_pa{WIDE}\n0,1\n", None, "300002 columns, expected at most 16384"),
        (f"{HEADER}0,SA,1,1{WIDE}\n", 2, "300004 cells, expected 4"),
        (f"{HEADER}0,SA,1,1\n0,SA,1,1{WIDE}\n", 3, "300004 cells, expected 4"),
        (f"time_ms,von_mises_pa{',x' * 999}\n" + "1\n" * 2000, None, "most cells are absent"),
        (HEADER + "\n" * 300_000, None, "most cells are absent"),
        (HEADER + "#\n" * 300_000, None, "most cells are absent"),
        (HEADER + '0,SA,1,"' + "\n" * 300_000 + '"\n', None, "most cells are absent"),
        ("#\n" * 20_000, None, "no header in the first 10000 lines"),
        ("x" * 2_000_000, None, "not CSV: field larger than"),
        (HEADER + "0,SA,1," + "9" * 1_000_000 + "\n", 2, "von_mises_pa is"),
    ],
)
@pytest.mark.filterwarnings("ignore:.*no line end:fembridge.errors.FembridgeWarning")
def test_a_small_file_of_a_large_table_is_refused_before_it_is_parsed(
    table, content, line, problem
):
    found_line, found = refusal(read_traces, table(content))
    assert (found_line, problem in found) == (line, True)
    assert len(found) < 300


@pytest.mark.parametrize(
    "content",
    [f"t;v{';x' * 300_000}\n1;2\n", f"# t v{' x' * 300_000}\n1 2\n", "%\n" * 20_000,
     f"t;v\n1;2{';1' * 1_000_000}\n", f"t;v\n1;2\n1;2{';1' * 300_000}\n",
     "t v\n" + "\n" * 2_000_000 + "1 2\n", 't;"' + "v" * 200_000 + '"\n1;2\n', "t;v\rx\n1;2\n"],
)  # fmt: skip
def test_a_small_table_of_another_program_is_refused_as_well(table, content):
    _, problem = refusal(partial(read_traces, columns={"time": "t", "value": "v"}, gain_pa=1.0),
                         table(content))  # fmt: skip
    assert len(problem) < 300


def test_cells_that_need_more_memory_than_the_limit_are_refused(table, monkeypatch):
    monkeypatch.setenv("FEMBRIDGE_MEMORY", "100K")
    rows = "".join(f"{k / 2},SA,4,{k}\n" for k in range(2000))
    for content in (HEADER + rows, HEADER + rows.replace("SA", '"SA"')):
        _, problem = refusal(read_traces, table(content))
        assert "FEMBRIDGE_MEMORY" in problem


@pytest.mark.parametrize(
    ("read", "known", "misspelt", "hint"),
    [
        (read_traces, "time_ms,von_mises_pa", "units", "unit"),
        (read_traces, "time_ms,von_mises_pa", "Afferent", "afferent"),
        (read_spikes, "stimulus,afferent,cell,spike_time_ms", "unt", "unit"),
        (read_rates, "stimulus,afferent,rate_ips", "Unit", "unit"),
        (read_observed, "stimulus,afferent,rate_ips", "rate", "rate_ips"),
        (read_stimulus, "time_ms,displacement_um", "aside_mm", "aside_um"),
        (partial(read_table, columns=("a",), optional=("deviate",)), "a", "deviates", "deviate"),
    ],
)
def test_a_misspelt_column_is_refused_with_the_near_name(table, read, known, misspelt, hint):
    line, problem = refusal(read, table(f"# a comment\n{known},{misspelt}\n"))
    assert line == 2
    assert f"{misspelt!r}; did you mean {hint}?" in problem


def test_a_column_of_another_thing_is_named_or_refused(table, logged):
    rows = "time_ms,von_mises_pa,force_n,note\n0,1,2,a\n0.5,2,2,b\n"
    read_traces(table(rows))
    assert logged == [f"{table(rows)}: columns not used: force_n, note"]
    rows = "stimulus,afferent,cell,spike_time_ms,note\ns,SA,0,3,1\n"
    with pytest.warns(FembridgeWarning, match="columns not used: note"):
        read_spikes(table(rows))
    with pytest.raises(TableError, match="unknown column 'sd'"):
        read_observed(table("stimulus,afferent,rate_ips,sd\nsine_20_250,SA,3,1\n"))
    with pytest.raises(TableError, match="duplicate column unit"):
        read_spikes(table("stimulus,afferent,cell,spike_time_ms,unit,unit\n"))
    with pytest.raises(TableError, match="duplicate column afferent"):
        read_traces(table("time_ms,von_mises_pa,afferent,afferent\n0,1,SA,RA\n"))


def test_row_numbers_of_pandas_and_empty_columns_of_a_spreadsheet_are_no_columns(table):
    frame = pd.DataFrame({"a": [1.0, 2.0], "b": [3.0, 4.0]}, index=[4, 7])
    for content in (frame.to_csv(), "a,b,,\n1,3,,\n2,4,,\n"):
        read = read_table(table(content), ("a", "b"), ())
        assert read.numbers("b").tolist() == [3.0, 4.0]
    with pytest.raises(TableError, match="column 3 has no name"):
        read_table(table("a,b,\n1,3,5\n2,4,6\n"), ("a", "b"), ())


@pytest.mark.parametrize("cell", ["1_000", "\u0663", "\uff11\uff12", "1e999", "nan", "0x10"])
@pytest.mark.parametrize("read", TABLES)
def test_a_cell_that_is_no_number_of_ours_is_refused_in_every_table(table, read, cell):
    *above, last = TABLES[read].splitlines(keepends=True)
    separator = ";" if ";" in last else ","
    *cells, _ = last.rstrip().split(separator)
    path = table("".join(above) + separator.join([*cells, cell]) + "\n")
    with pytest.raises((TableError, StimulusError)):
        read(path)


@pytest.mark.parametrize(
    ("header", "row", "options"),
    [
        ("t_s,v_pa", "1e306,1", {}),
        ("t_us,v_mpa", "1,1e303", {}),
        ("t_us,v", "1,1e300", {"gain_pa": 1e9}),
    ],
)
def test_a_number_that_is_infinite_in_our_unit_is_refused(table, header, row, options):
    time, value = header.split(",")
    path = table(f"{header}\n0,1\n{row}\n")
    line, problem = refusal(
        partial(read_traces, columns={"time": time, "value": value}, **options), path
    )
    assert line == 3
    assert "too large" in problem


def test_rows_that_lack_cells_or_are_commented_out_are_named(table):
    path = table("stimulus,afferent,cell,spike_time_ms,unit\ns,SA,0,3,a\ns,SA,0,9\n")
    with pytest.warns(FembridgeWarning, match=r"table.csv:3: 4 of the 5 cells"):
        assert [train.unit for train in read_spikes(path)] == ["a", ""]
    path = table("stimulus,afferent,rate_ips\na,SA,3\n#b,SA,9\n# of a day\nc,SA,4\n")
    with pytest.warns(FembridgeWarning, match=r"table.csv:3: a row begins with #: not read"):
        assert [rate.stimulus for rate in read_rates(path)] == ["a", "c"]


def test_a_table_whose_traces_end_at_other_times_may_be_cut(table):
    rows = "time_ms,node,von_mises_pa\n" + "".join(
        f"{k / 2},{n},1\n" for n in (4, 5) for k in range(9)
    )
    read_traces(table(rows))
    with pytest.warns(FembridgeWarning, match="node 5 ends at 2 ms, others at 4 ms"):
        read_traces(table(rows.rpartition("2.5,5")[0]))


def test_more_trains_than_there_are_afferents_are_refused(table, monkeypatch):
    monkeypatch.setattr(text_table, "MAX_GROUPS", 3)
    rows = "".join(f"s{k},SA,0,1\n" for k in range(4))
    _, problem = refusal(read_spikes, table(f"stimulus,afferent,cell,spike_time_ms\n{rows}"))
    assert "4 different" in problem


RATES = "stimulus,afferent,rate_ips\n"
IDS = [entry.id for entry in CATALOGUE]
OWN_IDS = ["sine_600_10", "sine_40_100", "diharm_10_50_20_20", "noise_30_200_7"]


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


@settings(settings.get_profile("costly"))
@given(written=rate_arrays(), mix=st.randoms(use_true_random=False))
def test_rates_come_back_bit_for_bit_however_the_classes_are_mixed(tmp_path_factory, written, mix):
    path = tmp_path_factory.mktemp("observed") / "rates.csv"
    stimuli, afferents, rate_ips = written
    rates = [
        Rate(stimulus, afferent, rate_ips[row, column])
        for row, stimulus in enumerate(stimuli)
        for column, afferent in enumerate(afferents)
    ]
    mix.shuffle(rates)
    write_rates(path, rates)

    frame = pd.DataFrame(rates).drop(columns="unit")
    of_file, of_frame = read_observed(path), read_observed(frame)

    for back in (of_file, of_frame):
        assert back.stimuli == tuple(dict.fromkeys(rate.stimulus for rate in rates))
        assert back.afferents == afferents
        order = [stimuli.index(each) for each in back.stimuli]
        np.testing.assert_array_equal(back.rate_ips, rate_ips[order])
        assert sorted(back.rates(), key=repr) == sorted(read_rates(path), key=repr)


def test_ids_come_back_as_the_catalogue_spells_them(table):
    path = table(RATES + "SINE_20_250.00,SA,3\ndiharm_10_50_125_125,SA,4\nsine_600_10,SA,5\n")
    observed = read_observed(path)
    assert observed.stimuli == ("sine_20_250", "diharm_10_50_125", "sine_600_10")


def test_a_class_has_its_own_stimuli_and_one_that_was_not_observed_is_named(table):
    observed = read_observed(table(RATES + "sine_50_250,PC,4\nsine_20_250,SA,3\n"), complete=False)
    stimuli, rate_ips = observed.rates_of("PC")
    assert (stimuli, rate_ips.tolist()) == (("sine_50_250",), [4.0])
    with pytest.raises(UsageError, match="'RA'"):
        observed.rates_of("RA")


LACKING = "sine_20_25,SA,3\nsine_20_25,RA,3\nsine_50_250,SA,4\nsine_100_10,RA,5\n"


@pytest.mark.filterwarnings("ignore:.*2 of the 3 cells:fembridge.errors.FembridgeWarning")
@pytest.mark.parametrize(
    ("rows", "line", "found"),
    [
        ("", None, "no rates"),
        ("sine_20_25,SA,3\nsine_20_25,RA,3\nsine_20_25.0,SA,3\n", 4, "line 2: sine_20_25, SA"),
        (LACKING, 4, "sine_50_250 has no rate of RA"),
        (LACKING + "sine_50_250,RA,3\n", 5, "sine_100_10 has no rate of SA"),
        ("sine_20_25,PC,3\nsine_20_25,SA1,3\n", 3, "'SA1'"),
        ("sine_20_25,SA,3\nsine_20_250,SA,2000.5\n", 3, "2000.5"),
        (
            "sine_20_25,PC,0\nsine_20_250,PC,0.25\nsine_50_250,PC,0.1\n",
            3,
            "0.25, the highest of PC",
        ),
        (",SA,3\n", 2, "stimulus is empty"),
        ("sine_20_250um,SA,3\n", 2, "did you mean sine_20_250"),
        ("sine_2000_5,SA,3\n", 2, "sine_2000_5: frequency_hz"),
        ("sine_20,SA,3\n", 2, "'sine_20' names 12 stimuli"),
        ("sine_20_25,3\n", 2, "'3'"),
        *(
            (f"sine_20_25,SA,3\nsine_20_25,RA,{cell}\n", 3, found)
            for cell, found in (("", "''"), ("NaN", "'NaN'"), ("-3", "-3"), ('"12,5"', "'12,5'"))
        ),
    ],
)
def test_a_row_that_is_no_rate_is_named(table, rows, line, found):
    with pytest.raises(TableError) as caught:
        read_observed(table(RATES + rows))
    assert caught.value.line == line
    assert found in str(caught.value)


def test_a_frame_names_its_row():
    frame = pd.DataFrame({"stimulus": ["sine_20_250"] * 2, "afferent": ["SA", "RA"]})
    with pytest.raises(TableError) as caught:
        read_observed(frame.assign(rate_ips=[3.0, np.nan]))
    assert (caught.value.line, caught.value.key) == (2, "rate_ips")
