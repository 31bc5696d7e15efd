"""How CalculiX moves the probe: each node prescribed, or all of them on a spring.

ccx begins an increment where the last one's velocities lead to, but for what is
prescribed: a prescribed probe stands at its new place at once. Where it slows down
the skin runs ahead of it, contact is lost in the first iteration, and four to six
more, or none, bring it back. A probe whose nodes are unknowns is predicted as the
skin is. So they are tied to one node that hangs on the prescribed driver by a spring
which gives 0.01 um a N/mm: two iterations an increment, the fewest that ccx makes.

Where the probe is off the skin the solution falls to 1e-320, numbers with which
processors are seven times slower. A force that moves nothing keeps it off that.
"""

from collections.abc import Iterator

from decks.analysis import Analysis
from decks.inp.steps import Moved

_STIFFNESS_N_PER_MM = 1.0e5
_NO_FORCE_N = 1.0e-12
# Places of nodes that no element has; for a person who looks at the mesh.
_RIGID_MM, _DRIVER_MM = 1.0, 2.0


def sprung(model: Analysis) -> bool:
    """Whether the probe of `model` hangs on a spring."""
    return model.support == "spring"


def drive_blocks(model: Analysis) -> Iterator[str]:
    """Give the driver, the spring, and the probe's nodes as one body."""
    if not sprung(model):
        return
    driver = model.first_probe_node + len(model.probe_node_mm)
    rigid, element = driver + 1, first_free_element(model)
    yield "**"
    yield "** ---- The probe on a stiff spring: its nodes are tied to RIGID, which the"
    yield "** spring, in N/mm, ties to the prescribed DRIVER"
    for name, number, height_mm in (("DRIVER", driver, _DRIVER_MM), ("RIGID", rigid, _RIGID_MM)):
        yield f"*NODE, NSET={name}"
        yield f"{number}, 0.0, {height_mm}, 0.0"
    for count, axis in enumerate(_axes(model)):
        yield f"*ELEMENT, TYPE=SPRING2, ELSET=DRIVE_{axis}"
        yield f"{element + count}, {rigid}, {driver}"
        yield f"*SPRING, ELSET=DRIVE_{axis}"
        yield f"{axis}, {axis}"
        yield f"{_STIFFNESS_N_PER_MM}"
        for node in model.probe_node.tolist():
            yield "*EQUATION"
            yield "2"
            yield f"{node}, {axis}, 1.0, {rigid}, {axis}, -1.0"


def moved(model: Analysis) -> Moved:
    """Tell the steps what the waveform moves, and what else is said in each."""
    if not sprung(model):
        return Moved()
    slides = model.motion.aside_mm is not None
    return Moved(
        name="DRIVER",
        held=(
            *(("AXIS, 1, 1",) if model.is_half else ()),
            *(() if slides else ("PROBE, 1, 1", "RIGID, 1, 1")),
            "RIGID, 3, 3",
            "DRIVER, 3, 3",
        ),
        loads=(
            "** a force that moves nothing, against numbers of 1e-320",
            "*CLOAD",
            f"SKIN_APEX, 2, {_NO_FORCE_N:.1E}",
        ),
    )


def _axes(model: Analysis) -> tuple[int, ...]:
    return (2,) if model.motion.aside_mm is None else (1, 2)


def first_free_element(model: Analysis) -> int:
    """Give the first number that neither finger, probe nor Maxwell branch has."""
    branches = sum(len(layer.number) * len(layer.material.prony) for layer in model.layers)
    return int(model.probe.number.max()) + 1 + branches
