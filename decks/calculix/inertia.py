"""Inertia for CalculiX: what a ``*DYNAMIC`` step with contact takes to go through.

ccx 2.20 holds increments of implicit dynamics with contact against a balance of
energy, also fixed ones, and ends a run whose balance jumps by 0.25 % of the largest
energy so far. The work of a prescribed displacement is not in its balance, so a
probe that is moved always breaks it. The rule has no switch. But a massless spring
that is joined to nothing may store, in the first increment, many times the energy of
the skin: what the skin does is a jump of nothing then.

That spring moves, so ccx's measure of displacement is void; the residual force alone
decides, against an average force that is given.

A static step cannot precede: it leaves its speed behind, and a pressed contact a
kick. So the probe is ramped in, smoothly, in the same step.
"""

from collections.abc import Iterator

from decks.analysis import Analysis
from decks.calculix.drive import first_free_element
from decks.inp.lines import fixed
from decks.inp.steps import Moved

CARD = "*DYNAMIC, DIRECT, ALPHA=-0.3"
# 1e-3 N on 1e-9 N/mm store 500 N mm; skin pressed in by 0.5 mm, about 0.01.
_STIFFNESS_N_PER_MM = 1.0e-9
_FORCE_N = 1.0e-3
# Of the residual, 0.5 % of this is allowed in a node.
_AVERAGE_FORCE_N = 5.0e-5
_HEIGHT_MM = 100.0


def store(model: Analysis) -> Iterator[str]:
    """Give the spring, its two nodes, and when it is wound."""
    motion = model.motion
    first_s, last_s = motion.phases[0].dt_s, float(motion.time_s[-1])
    held, free = _nodes(model)
    yield "**"
    yield "** ---- A store of energy, joined to nothing: beside it no increment of the"
    yield "** skin breaks the balance by which ccx judges contact in dynamics"
    yield "*NODE, NSET=STORE"
    yield f"{held}, 0.0, {_HEIGHT_MM}, 0.0"
    yield f"{free}, 1.0, {_HEIGHT_MM}, 0.0"
    yield "*ELEMENT, TYPE=SPRING1, ELSET=STORE_SPRING"
    yield f"{first_free_element(model)}, {free}"
    yield "*SPRING, ELSET=STORE_SPRING"
    yield "1"
    yield f"{_STIFFNESS_N_PER_MM:.6e}"
    yield "*AMPLITUDE, NAME=STORED, TIME=TOTAL TIME"
    yield f"0.0, 0.0, {fixed(first_s, 7)}, 1.0, {fixed(2 * last_s, 7)}, 1.0"


def moved(model: Analysis) -> Moved:
    """Tell the step that the waveform moves the probe, and what is said beside it."""
    held, free = _nodes(model)
    return Moved(
        controls=(
            "** more iterations before an increment is given up",
            "*CONTROLS, PARAMETERS=TIME INCREMENTATION",
            "30, 40, 9, 200, 60, 4",
            "** the fourth number is the average force, in N, for the residual",
            "*CONTROLS, PARAMETERS=FIELD",
            f"0.005, 0.01, 0.0, {_AVERAGE_FORCE_N:.1E}",
        ),
        held=("STORE, 2, 3", f"{held}, 1, 1"),
        loads=("*CLOAD, AMPLITUDE=STORED", f"{free}, 1, {_FORCE_N:.1E}"),
    )


def energies(every: int) -> Iterator[str]:
    """Ask for energies, which ccx has to keep from the first increment on."""
    yield "** energies, which that balance is made of"
    yield f"*EL PRINT, ELSET=PROBE_BODY, TOTALS=ONLY, FREQUENCY={every}"
    yield "ELSE"


def _nodes(model: Analysis) -> tuple[int, int]:
    """Give the numbers of the store's held and of its free node."""
    first = model.first_probe_node + len(model.probe_node_mm)
    return first, first + 1
