"""Which parameter of a finger moves the answers how much, read off a sweep's table.

`read_swept` takes the table; `single_effects` tells what each parameter does alone,
`rank_regressions` what each does among all.
"""

from fembridge.sensitivity.ranks import RankRegression, rank_regressions
from fembridge.sensitivity.single import Effect, is_one_at_a_time, single_effects
from fembridge.sensitivity.swept import Output, SweptFingers
from fembridge.sensitivity.swept_table import read_swept, swept_text

__all__ = [
    "Effect",
    "Output",
    "RankRegression",
    "SweptFingers",
    "is_one_at_a_time",
    "rank_regressions",
    "read_swept",
    "single_effects",
    "swept_text",
]
