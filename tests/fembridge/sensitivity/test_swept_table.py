"""Tables of sweeps read as fingers."""

import numpy as np
import pytest

from fembridge.errors import TableError, UsageError
from fembridge.sensitivity import Output, read_swept, swept_text
from fembridge.sensitivity.swept_table import group_of

HEADER = (
    "finger,skin.dermis_mm,contact.friction,probe_x_mm,method,"
    "stimulus,afferent,rate_ips,spikes,peak_stress_pa,status,cause,run\n"
)


@pytest.fixture
def results(tmp_path):
    def write(*rows, header=HEADER):
        path = tmp_path / "results.csv"
        path.write_text(header + "".join(f"{row}\n" for row in rows))
        return path

    return write


def row(dermis, stimulus, rate, stress, afferent="SA", status="done,", friction=0.4):
    begin = f"quick,{dermis},{friction},0.0,map,{stimulus},{afferent}"
    return f"{begin},{rate},3,{stress},{status},runs/x"


def test_a_finger_is_what_stands_before_the_stimulus_and_constants_are_left_out(results):
    swept = read_swept(
        results(
            row(1.0, "sine_20_250", 10, 5000),
            row(1.0, "sine_20_125", 4, 3000),
            row(1.0, "noise_25_250_10", 1, 1000),
            row(1.2, "sine_20_250", 20, 6000),
            row(1.2, "sine_20_125", 6, 4000),
            row(1.2, "noise_25_250_10", 4, 2000),
        )
    )

    assert swept.names == ("skin.dermis_mm",)
    np.testing.assert_array_equal(swept.value, [[1.0], [1.2]])
    assert swept.afferents == ("SA",)
    assert swept.groups == ("all", "sine_20", "noise")
    rates = [swept.column(Output("SA", "rate_ips", g)) for g in swept.groups]
    np.testing.assert_array_equal(rates, [[5, 10], [7, 13], [1, 4]])
    stress = swept.column(Output("SA", "peak_stress_pa", "sine_20"))
    np.testing.assert_array_equal(stress, [4000, 5000])


def test_the_summary_reads_back_as_what_it_was_made_of(results, tmp_path):
    rows = [
        row(dermis, stimulus, rate + k, 1000.0 * (rate + k), afferent, friction=0.1 * k)
        for k, dermis in enumerate((1.0, 1.1, 1.2), start=1)
        for rate, stimulus in ((1, "sine_300_50"), (2, "diharm_10_50_125"))
        for afferent in ("SA", "PC")
    ]
    swept = read_swept(results(*rows))
    (tmp_path / "fingers.csv").write_text(swept_text(swept))

    again = read_swept(tmp_path / "fingers.csv")

    assert (again.names, again.outputs) == (swept.names, swept.outputs)
    np.testing.assert_allclose(again.value, swept.value, rtol=1e-6)
    np.testing.assert_allclose(again.answer, swept.answer, rtol=1e-6)
    assert swept_text(again) == swept_text(swept)


def test_a_finger_of_which_anything_failed_is_left_out_and_its_cause_told(results):
    swept = read_swept(
        results(
            row(1.0, "sine_20_250", 10, 5000),
            row(1.0, "sine_50_250", 10, 5000),
            row(1.1, "sine_20_250", 11, 5000),
            row(1.1, "sine_50_250", "", "", status="failed,it diverged"),
            row(1.2, "sine_20_250", 12, 5000),
            row(1.2, "sine_50_250", 12, 5000),
        )
    )

    np.testing.assert_array_equal(swept.value[:, 0], [1.0, 1.2])
    assert swept.causes == ("it diverged",)


@pytest.mark.parametrize(
    ("rows", "problem"),
    [
        ([row(1.0, "sine_20_250", 1, 1)], "fingers: 1, expected two or more"),
        (
            [row(1.0, "sine_20_250", 1, 1), row(1.1, "sine_20_250", "", "", status="failed,bad")],
            "fingers: 1, 1 failed, expected two",
        ),
        ([], "fingers: 0"),
    ],
)
def test_nothing_to_compare_is_told(results, rows, problem):
    with pytest.raises(UsageError, match=problem):
        read_swept(results(*rows))


@pytest.mark.parametrize(
    ("rows", "problem"),
    [
        (
            [row(1.0, "sine_20_250", 1, 1), row(1.0, "sine_20_250", 2, 1)],
            "csv:3: duplicate: sine_20_250, SA",
        ),
        (
            [row(1.0, "sine_20_250", 1, 1), row(1.1, "sine_50_250", 2, 1)],
            "is not there for all fingers",
        ),
        (
            [row("thin", "sine_20_250", 1, 1), row("thick", "sine_20_250", 2, 1)],
            "skin.dermis_mm is 'thin', 'thick': expected one for all, or different",
        ),
        (
            [row(1.0, "sine_20_250", 1, 1), row("", "sine_20_250", 2, 1)],
            "skin.dermis_mm is '1.0', '': expected",
        ),
        ([row(1.0, "sine_20_250", "nan", 1), row(1.1, "sine_20_250", 2, 1)], "rate_ips is nan"),
        ([row(1.0, "sine_20_250", 1, 1, status="odd,")], "status is 'odd'"),
    ],
)
def test_a_table_that_is_not_one_is_refused_in_words(results, rows, problem):
    with pytest.raises(TableError, match=problem):
        read_swept(results(*rows))


def test_another_table_is_refused_and_both_kinds_are_named(results):
    path = results("1.0,2.0", header="time_ms,node\n")
    with pytest.raises(TableError, match=r"neither results\.csv .* nor a summary"):
        read_swept(path)


def test_a_stimulus_belongs_to_its_frequency_or_its_family():
    stimuli = ("sine_20_250", "sine_300_50", "diharm_10_50_125", "noise_25_250_0.25")
    assert [group_of(each) for each in stimuli] == ["sine_20", "sine_300", "diharm", "noise"]
    assert group_of("my_own") == "my_own"
