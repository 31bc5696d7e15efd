"""Tables of the pages are replaced between their marks, and nothing else of a page."""

import pytest

from benchmarks.touch_evidence import agreement_text, replaced

PAGE = "a\n\n<!-- rows -->\n\n| old |\n\n<!-- end -->\n\nb\n\n<!-- dots -->\n\n<!-- end -->\n"


def test_a_table_is_replaced_between_its_marks():
    page = replaced(PAGE, "rows", "| new |")
    assert page == PAGE.replace("old", "new")
    assert replaced(page, "dots", "| x |").endswith("<!-- dots -->\n\n| x |\n\n<!-- end -->\n")
    with pytest.raises(SystemExit):
        replaced(PAGE, "bars", "")


def test_a_negative_correlation_and_missing_values_are_shown():
    row = {"r_squared": 0.25, "correlation": -0.5, "rmse": 3.14, "bias": 1.0, "ratio": 2.0}
    row |= {"source": "own", "count": 3, "recorded": 5}
    assert agreement_text(row) == "0.25 (3.14) 2.00, r −0.50, 3 reached"
