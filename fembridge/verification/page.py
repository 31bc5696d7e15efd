"""The page: every study with its question, numbers, picture, words and command."""

import math
from collections.abc import Mapping, Sequence

from fembridge.verification.bench import THREADS
from fembridge.verification.finding import AT_MOST, Cell, Check, Finding, NumberTable

IMAGES_FOLDER = "images"
TABLES_FOLDER = "tables"
_PREFIX = "verification_"
_UNKNOWN = "–"
# The longer first: a column ends in one of them.
_UNITS = {
    "_n_per_mm": "N/mm",
    "_percent": "%",
    "_kpa": "kPa",
    "_mpa": "MPa",
    "_mm": "mm",
    "_um": "µm",
    "_ms": "ms",
    "_s": "s",
}


def image_name(name: str) -> str:
    """Name of the picture of a chart."""
    return f"{_PREFIX}{name}.png"


def table_name(name: str) -> str:
    """Name of the CSV of a table."""
    return f"{_PREFIX}{name}.csv"


def command_of(name: str, *, quick: bool) -> str:
    """Give the command that makes one study."""
    return f"fembridge verify {'--quick ' if quick else ''}--only {name}"


def page_text(findings: Sequence[Finding], versions: Mapping[str, str], *, quick: bool) -> str:
    """Give the page as Markdown; the same findings give the same text."""
    lines = [
        "# Verification of the finite-element model",
        "",
        *_lead(findings, versions, quick),
        "",
        *_summary(findings),
    ]
    for number, finding in enumerate(findings, start=1):
        lines += ["", *_section(number, finding, quick)]
    return "\n".join(lines) + "\n"


def _lead(findings: Sequence[Finding], versions: Mapping[str, str], quick: bool) -> list[str]:
    told = ", ".join(f"{name} {version}" for name, version in versions.items())
    checks = [check for finding in findings for check in finding.checks]
    kept = sum(check.passed for check in checks)
    cpu_s = sum(finding.cost.cpu_s for finding in findings)
    lines = [
        f"Made by `fembridge verify{' --quick' if quick else ''} -o DIR`, which exits "
        f"with 1 when a check fails. {told}; the solver on {THREADS} thread, "
        f"{cpu_s / 60:.0f} min of processor time in all. `DIR/tables` has every "
        "table as CSV with all digits, `DIR/verification.json` the checks.",
        "",
        f"**{kept} of {len(checks)} checks keep their bound.**",
    ]
    if quick:
        lines += [
            "",
            "This is a quick run: what each study left out is said there, and the "
            "numbers of a whole one are finer.",
        ]
    return lines


def _summary(findings: Sequence[Finding]) -> list[str]:
    lines = ["| study | check | found | bound | |", "|---|---|---|---|---|"]
    for number, finding in enumerate(findings, start=1):
        link = f"[{number}. {finding.title}](#{_anchor(number, finding)})"
        if finding.skipped:
            lines.append(f"| {link} | {finding.skipped} | | | skipped |")
        for check in finding.checks:
            found, bound = _found_and_bound(check)
            verdict = "ok" if check.passed else "**fails**"
            lines.append(f"| {link} | {check.what} | {found} | {bound} | {verdict} |")
    return lines


def _section(number: int, finding: Finding, quick: bool) -> list[str]:
    lines = [f"## {number}. {finding.title}", "", finding.question]
    if finding.skipped:
        return [*lines, "", f"Skipped: {finding.skipped}."]
    for words in finding.words:
        lines += ["", f"- {words}"] if lines[-1][:2] != "- " else [f"- {words}"]
    for chart in finding.charts:
        path = f"{IMAGES_FOLDER}/{image_name(chart.name)}"
        lines += ["", f"![{chart.caption}]({path})", "", f"*{chart.caption}*"]
    for table in finding.tables:
        lines += ["", f"{table.caption} (`{table_name(table.name)}`):", ""]
        lines += _table(table)
    if finding.reduced:
        lines += ["", f"Quick run: {finding.reduced}."]
    cost = finding.cost
    lines += [
        "",
        "```sh",
        command_of(finding.name, quick=quick),
        "```",
        "",
        f"{cost.increments} increments, {cost.iterations} iterations, "
        f"{cost.cpu_s:.0f} s of processor time.",
    ]
    return lines


def _table(table: NumberTable) -> list[str]:
    heads = [_head(column) for column in table.columns]
    lines = [f"| {' | '.join(heads)} |", "|" + "---|" * len(heads)]
    for row in table.rows:
        cells = [_cell(cell, spec) for cell, spec in zip(row, table.formats, strict=True)]
        lines.append(f"| {' | '.join(cells)} |")
    return lines


def _head(column: str) -> str:
    """Give a column's name with its unit in parentheses."""
    for ending, unit in _UNITS.items():
        if column.endswith(ending):
            return f"{column.removesuffix(ending).replace('_', ' ')} ({unit})"
    return column.replace("_", " ")


def _cell(cell: Cell, spec: str) -> str:
    if isinstance(cell, str):
        return cell
    if isinstance(cell, float) and math.isnan(cell):
        return _UNKNOWN
    return format(cell, spec).replace("-", "\N{MINUS SIGN}", _is_negative(cell))


def _is_negative(cell: float) -> int:
    """How many of the leading hyphens are a sign: one or none."""
    return int(cell < 0)


def _found_and_bound(check: Check) -> tuple[str, str]:
    unit = f" {check.unit}" if check.unit else ""
    side = "≤" if check.side == AT_MOST else "≥"
    found = _UNKNOWN if math.isnan(check.found) else f"{check.found:.3g}{unit}"
    return found, f"{side} {check.bound:g}{unit}"


def _anchor(number: int, finding: Finding) -> str:
    kept = "".join(c for c in finding.title.lower() if c.isalnum() or c in " -")
    return f"{number}-{kept.replace(' ', '-')}"
