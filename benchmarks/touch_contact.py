"""Superposed unit forces against CalculiX' own contact in three dimensions.

``python -m benchmarks.touch_contact OUT [punch] [sphere] [--large-strain]`` presses a flat
1 mm pin and a 4 mm ball by 0.1 and 0.2 mm into the prism of the reference pad, without
friction, and prints force and von Mises stress of both ways (ten minutes each).
"""

import sys
from pathlib import Path

import numpy as np

from benchmarks.prism_contact import PROBE_SET, contact_deck
from decks.contact_analysis import ContactSolver as PenaltyContact
from decks.unit_loads import PadMesh, Prism, prism_of
from fembridge.host.store import make_folder
from fembridge.io.run_folder import RunFolder
from fembridge.results import read_fields
from fembridge.results.printed import read_node_print
from fembridge.solver.ccx import run_ccx
from fembridge.touching.contact import ContactSolver
from fembridge.touching.green import displacements, stress_mpa, stress_row
from fembridge.touching.pad import COMPONENTS, Pad
from fembridge.touching.pad_file import resolve_pad
from fembridge.touching.shape import Shape
from fembridge.touching.stress import von_mises_pa

DEPTHS_MM = (0.1, 0.2)
STEP_MM = 0.0625


def main() -> None:
    words = [word for word in sys.argv[2:] if not word.startswith("--")]
    for name in words or ("punch", "sphere"):
        compare(name, Path(sys.argv[1]), large_strain="--large-strain" in sys.argv)


def compare(name: str, out: Path, *, large_strain: bool) -> None:
    pad = resolve_pad("reference")
    prism = prism_of(pad.finger, PadMesh(**pad.origin["mesh"]))
    if name == "punch":
        shape = Shape.punch(1.0)
        radius = np.append(np.arange(0, 0.5 + STEP_MM / 2, STEP_MM), [0.55, 0.8])
    else:
        shape = Shape.sphere(4.0)
        radius = np.arange(0, 1.5, STEP_MM)
    height = shape.height_mm(radius, np.zeros_like(radius))
    folder = make_folder(out / (name + "_large" * large_strain))
    run = RunFolder(folder, "calculix", 0, 1.0, 0.0, (), "")
    text = contact_deck(
        prism, radius, height, DEPTHS_MM, PenaltyContact(friction=0.0), large_strain=large_strain
    )
    if not (run.results.is_file() and run.deck.read_text() == text):
        run.deck.write_text(text)
        outcome = run_ccx(run)
        if not outcome.accepted:
            raise outcome.to_error()
    _, _, forces_n = read_node_print(folder / "job.dat", "total force", PROBE_SET)
    forces_n = -4 * forces_n[:, 0, 1]  # of four quarters, into the skin
    for depth, moved, total in zip(DEPTHS_MM, fields(run, prism), forces_n, strict=False):
        report(name, pad, prism, shape, depth, moved, total)


def fields(run: RunFolder, prism: Prism):
    for field in read_fields(run.results, "DISP"):
        yield displacements(field, prism)


def report(name, pad: Pad, prism: Prism, shape: Shape, depth, moved, total) -> None:
    nodes = pad.skin_nodes()
    gap = shape.height_mm(nodes.x_mm, nodes.z_mm) - pad.y_mm[nodes.column]
    near = gap < depth
    nodes, gap = nodes.subset(near), gap[near]
    forces = ContactSolver.on_nodes(nodes).press(depth - gap)
    print(f"{name} {depth * 1000:.0f} um: force {forces.sum():.4f} N, CalculiX {total:.4f} N")
    for layer, row_in_layer in (("epidermis", 2), ("epidermis", 1), ("subcutaneous_tissue", 0)):
        row = int(prism.layer_rows(layer)[row_in_layer])
        own = stress_mpa(prism, layer, row, moved[None, None])[0, :, 0] * 1e6  # (6, C, K)
        where = stress_row(prism, layer, row)
        section = pad.section
        for column, slice_ in ((0, 0), (2, 0), (4, 0), (0, 3)):
            x = float(np.interp(where.arc_mm[column], section.arc_mm, section.point_mm[:, 0]))
            z = float(pad.stress_z_mm[slice_])
            place = np.array([x]), np.array([z]), np.array([where.depth_mm[column]])
            ours = von_mises_pa(pad.influence_pa(nodes, np.array([layer]), *place), forces[None])[
                0, 0
            ]
            theirs = von_mises_pa(own[:, column, slice_][:, None, None], np.ones((1, 1)))[0, 0]
            print(
                f"  {layer} {place[2][0]:.2f} mm at ({x:.2f}, {z:.2f}): {ours:.0f} Pa, CalculiX "
                f"{theirs:.0f} Pa, {100 * (ours / theirs - 1):+.1f} %"
            )


assert COMPONENTS[0] == "xx"

if __name__ == "__main__":
    main()
