"""The picture ``sensitivity``: a sweep read, its kind told, drawn and written down."""

import argparse
import sys
from typing import Any

_TABLES = (".csv", ".md")


def draw_sensitivity(args: argparse.Namespace) -> dict[str, Any]:
    """Draw; the summary holds every number of the tables."""
    from fembridge.errors import UsageError
    from fembridge.plots.sensitivity import draw_effects, draw_regressions
    from fembridge.sensitivity import (
        csv_text,
        effect_rows,
        effects_markdown,
        is_one_at_a_time,
        rank_regressions,
        read_swept,
        regression_rows,
        regressions_markdown,
        single_effects,
        swept_text,
    )
    from fembridge.store import write_text

    if args.effects is not None and args.effects.suffix.lower() not in _TABLES:
        raise UsageError(f"{args.effects}: expected {' or '.join(_TABLES)}")
    swept = read_swept(args.table)
    for cause in swept.causes:
        print(f"{args.table}: a finger is left out: {cause}", file=sys.stderr)
    single = is_one_at_a_time(swept)
    if single:
        effects = single_effects(swept)
        rows, people = effect_rows(effects), effects_markdown(swept, effects)
        draw_effects(swept, effects, args.output)
    else:
        regressions = rank_regressions(swept)
        rows = regression_rows(swept, regressions)
        people = regressions_markdown(swept, regressions)
        draw_regressions(swept, regressions, args.output)
    if args.effects is not None:
        is_csv = args.effects.suffix.lower() == ".csv"
        write_text(args.effects, csv_text(rows) if is_csv else people)
    if args.fingers is not None:
        write_text(args.fingers, swept_text(swept))
    return {
        "kind": "one-at-a-time" if single else "rank regression",
        "fingers": len(swept.value),
        "left_out": len(swept.causes),
        "parameters": list(swept.names),
        "effects": rows,
    }
