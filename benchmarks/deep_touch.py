"""Deep touches against whole contact runs of CalculiX with large strain.

``python -m benchmarks.deep_touch OUT [plate] [ball] [--spacing-mm 0.5] [--alpha 6.82]`` presses a
plate and a ball of 5 mm into a quarter of the prism: finite strain, neo-Hookean skin, a first-order
Ogden law in the subcutaneous tissue with the moduli of the finger, contact node to surface without
friction. It prints force and von Mises stress at the depths of SA, RA and PC beside those of
`fembridge.touching.large_strain` on a pad of the same elements. With 0.5 mm a run takes 3 to 5
minutes of one core.
"""

import argparse
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import fembridge as fb
from benchmarks.prism_contact import PROBE_SET, first_layer
from decks.finger import Finger
from decks.keyword_deck import real
from decks.unit_loads import PadMesh, Prism, prism_of, prism_text
from fembridge.host.store import make_folder
from fembridge.io.run_folder import RunFolder
from fembridge.results.printed import read_node_print
from fembridge.solver.ccx import run_ccx
from fembridge.touching.green import stress_row
from fembridge.touching.large_strain import press_deep
from fembridge.touching.prism_pad import PrismPad
from fembridge.touching.shape import Shape

DEPTHS_MM = {"plate": (0.5, 1, 1.5, 2, 2.5, 3), "ball": (0.5, 1, 1.5, 2, 2.5, 3, 3.5, 3.75, 4)}
SHAPES = {"plate": Shape.plate(), "ball": Shape.sphere(5.0)}
REACH_MM = 7.0
_TIP_RADIUS_MM = 20.0  # `PrismPad.tip_radius_mm` of the finger quick
# Class, layer, row of elements above its depth, depth.
SITES = (
    ("SA", "epidermis", 1, 0.5875),
    ("RA", "epidermis", 1, 0.52),
    ("PC", "subcutaneous_tissue", 0, 2.0),
)
_ACROSS_MM = (0, 1, 2, 3, 4)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("output", type=Path)
    parser.add_argument("shapes", nargs="*", default=["plate", "ball"])
    parser.add_argument("--spacing-mm", type=float, default=0.5)
    parser.add_argument("--alpha", type=float, default=6.82)
    options = parser.parse_args()
    folder = make_folder(options.output)
    stored = folder / "pad.npz"
    if not stored.is_file():
        fb.make_pad(spacing_mm=options.spacing_mm, reach_mm=REACH_MM).write(stored)
    pad = fb.Pad.read(stored)
    assert isinstance(pad, PrismPad)
    prism = prism_of(pad.finger, PadMesh(spacing_mm=options.spacing_mm))
    for name in options.shapes:
        forces_n, stress_pa = whole_run(folder / name, prism, name, options.alpha)
        report(name, pad, prism, forces_n, stress_pa)


# ---- The whole contact run


def whole_run(folder: Path, prism: Prism, name: str, alpha: float):
    """Forces in N, and Cauchy stress in Pa by element ``(step, 6)``."""
    run = RunFolder(make_folder(folder), "calculix", 0, 1.0, 0.0, (), "")
    text = "\n".join(_lines(prism, name, alpha)) + "\n"
    if not (run.results.is_file() and run.deck.read_text() == text):
        run.deck.write_text(text)
        outcome = run_ccx(run)
        if not outcome.accepted:
            raise outcome.to_error()
    _, _, forces_n = read_node_print(folder / "job.dat", "total force", PROBE_SET)
    return -4 * forces_n[:, 0, 1], _printed_stress(folder / "job.dat")


def _printed_stress(path: Path) -> dict[int, np.ndarray]:
    steps: dict[int, list[np.ndarray]] = {}
    for block in re.split(r"\n stresses", path.read_text())[1:]:
        points: dict[int, list[list[float]]] = {}
        for line in block.split("\n")[1:]:
            words = line.split()
            if len(words) == 8:
                points.setdefault(int(words[0]), []).append([float(word) for word in words[2:]])
        for element, values in points.items():
            xx, yy, zz, xy, xz, yz = np.mean(values, axis=0) * 1e6
            steps.setdefault(element, []).append(np.array([xx, yy, zz, xy, yz, xz]))
    return {element: np.stack(values) for element, values in steps.items()}


def _lines(prism: Prism, name: str, alpha: float) -> Iterator[str]:
    yield "*HEADING"
    yield "fembridge: a deep touch of a prismatic finger, a quarter of both"
    body = prism_text(prism, even_x=True, even_z=True).rstrip("\n")
    watched = "\n".join(str(number) for *_, numbers in _watched(prism) for number in numbers)
    body = re.sub(
        r"\*MATERIAL, NAME=(\w+)\n\*ELASTIC\n[^\n]*\n",
        lambda match: _material(prism.finger, match.group(1), alpha) or match.group(0),
        body,
    )
    yield body.replace("*BOUNDARY\nHELD", f"*ELSET, ELSET=WATCHED\n{watched}\n*BOUNDARY\nHELD", 1)
    node = prism.section_nodes * len(prism.z_mm) + 1
    yield from _probe(name, node, prism.elements + 1)
    yield "*SURFACE, NAME=SKIN_SURFACE, TYPE=ELEMENT"
    reach_mm = 10.0 if name == "plate" else 3.2
    across = int((prism.point_mm[0, : prism.nail_column - 1, 0] < reach_mm).sum())
    if name == "plate":
        across = int(np.argmax(prism.point_mm[0, :, 1] < -5.0))
    for k in range(int((prism.z_mm[:-1] < reach_mm).sum())):
        for column in range(across):
            yield f"{1 + k * first_layer(prism) + column}, S5"
    yield "*SURFACE INTERACTION, NAME=TOUCH"
    yield "*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR"
    yield "5.0, 0.001"
    yield "*CONTACT PAIR, INTERACTION=TOUCH, TYPE=NODE TO SURFACE"
    yield "SKIN_SURFACE, PROBE_SURFACE"
    for depth_mm in DEPTHS_MM[name]:
        yield "*STEP, INC=1000, NLGEOM"
        yield "*STATIC"
        yield "0.2, 1.0, 1e-4, 0.8"
        yield "*BOUNDARY"
        yield f"{PROBE_SET}, 1, 1"
        yield f"{PROBE_SET}, 3, 3"
        yield f"{PROBE_SET}, 2, 2, {real(-float(depth_mm))}"
        yield "*NODE OUTPUT, NSET=OUTPUT_NODES, DOUBLE, FREQUENCY=1000"
        yield "U"
        yield f"*NODE PRINT, NSET={PROBE_SET}, TOTALS=ONLY, FREQUENCY=1000"
        yield "RF"
        yield "*EL PRINT, ELSET=WATCHED, FREQUENCY=1000"
        yield "S"
        yield "*END STEP"


def _material(finger: Finger, name: str, alpha: float) -> str | None:
    key = name.lower()
    if key in ("bone", "nail"):
        return None
    material = finger.materials[key]
    shear, volume = material.shear_mpa, 2 / material.bulk_mpa
    if key == "subcutaneous_tissue":
        law = f"*HYPERELASTIC, OGDEN, N=1\n{shear:.9g}, {alpha:g}, {volume:.9g}"
    else:
        law = f"*HYPERELASTIC, NEO HOOKE\n{shear / 2:.9g}, {volume:.9g}"
    return f"*MATERIAL, NAME={name}\n{law}\n"


def _probe(name: str, node: int, element: int) -> Iterator[str]:
    """A rigid surface: x, y, z ``(i, j)``, curved as the prism is not along the finger."""
    if name == "plate":
        x, z = np.meshgrid(
            np.arange(0, 10.1, 2), np.append(np.arange(0, 9.01, 0.75), [10.5, 13.0]), indexing="ij"
        )
        y = np.zeros_like(x)
    else:
        share = np.linspace(0, 1, 11)
        a, b = np.meshgrid(share, share, indexing="ij")
        ring = np.maximum(a, b)
        turn = np.where(a >= b, b / np.maximum(a, 1e-9), 2 - a / np.maximum(b, 1e-9)) * np.pi / 4
        polar = 0.97 * np.pi / 2 * ring
        x, z = (2.5 * np.sin(polar) * part for part in (np.cos(turn), np.sin(turn)))
        y = 2.5 * (1 - np.cos(polar))
    y = y + z**2 / (2 * _TIP_RADIUS_MM) + 1e-4
    count, length = x.shape
    yield f"*NODE, NSET={PROBE_SET}"
    for top in (0, 1):
        for number, place in enumerate(zip(x.flat, (y + 0.3 * top).flat, z.flat, strict=True)):
            yield f"{node + top * x.size + number}, " + ", ".join(f"{at:.6f}" for at in place)
    yield "*ELEMENT, TYPE=C3D8, ELSET=PROBE_BODY"
    last = element
    for i in range(count - 1):
        for j in range(length - 1):
            quad = [i * length + j, i * length + j + 1, (i + 1) * length + j + 1]
            quad.append((i + 1) * length + j)
            corners = [node + top * x.size + corner for top in (0, 1) for corner in quad]
            yield f"{last}, {', '.join(map(str, corners))}"
            last += 1
    yield "*SURFACE, NAME=PROBE_SURFACE, TYPE=ELEMENT"
    yield from (f"{number}, S1" for number in range(element, last))
    yield from ("*MATERIAL, NAME=RIGID", "*ELASTIC", "2.1e5, 0.3")
    yield "*SOLID SECTION, ELSET=PROBE_BODY, MATERIAL=RIGID"


def _watched(prism: Prism) -> Iterator[tuple[str, int, tuple[int, int]]]:
    """Class, column and the two elements around its depth, in the first slice."""
    slices = len(prism.z_mm) - 1
    layers = [int((prism.row_layer == layer).sum()) for layer in range(4)]
    columns = prism.point_mm.shape[1] - 1
    first = {}
    number = 1
    for name, rows in zip(
        ("stratum_corneum", "epidermis", "dermis", "subcutaneous_tissue"), layers, strict=True
    ):
        width = prism.nail_column if name == "stratum_corneum" else columns
        first[name] = number
        number += rows * width * slices
    for name, layer, row, _ in SITES:
        for across_mm in _ACROSS_MM:
            column = round(across_mm / prism.mesh.spacing_mm)
            element = first[layer] + row * columns + column
            yield name, column, (element, element + columns)


# ---- The comparison


def report(name: str, pad: PrismPad, prism: Prism, forces_n, stress_pa) -> None:
    depths_um = 1e3 * np.array(DEPTHS_MM[name], dtype=float)
    _, forces, _, large_strain = press_deep(pad, SHAPES[name], depths_um)
    print(f"{name}, depth (mm):", *DEPTHS_MM[name])
    print("  force, CalculiX (N):", *(f"{force:.3f}" for force in forces_n))
    print("  here / CalculiX:", *(f"{r:.3f}" for r in forces.sum(axis=1) / forces_n))
    section = pad.section
    x_mm = 0.5 * (prism.point_mm[0, 1:, 0] + prism.point_mm[0, :-1, 0])
    z_mm = 0.5 * prism.z_mm[1]
    for (label, layer, row, depth_mm), watched in _by_site(prism):
        rows = prism.layer_rows(layer)
        for column, (upper, lower) in watched:
            above, below = (stress_row(prism, layer, int(rows[n])) for n in (row, row + 1))
            top, bottom = above.depth_mm[column], below.depth_mm[column]
            share = (depth_mm - top) / (bottom - top)
            theirs = _von_mises((1 - share) * stress_pa[upper].T + share * stress_pa[lower].T)
            x = float(np.interp(above.arc_mm[column], section.arc_mm, section.point_mm[:, 0]))
            place = np.array([layer]), np.array([x]), np.array([z_mm]), np.array([depth_mm])
            ours = _von_mises(large_strain.fields.stress_pa(*place)[:, 0])
            values = (f"{t / 1e3:.1f} ({o / t:.2f})" for o, t in zip(ours, theirs, strict=False))
            print(f"  {label} at x = {x_mm[column]:.2f} mm, kPa (here / CalculiX):", *values)


def _by_site(prism: Prism):
    watched = list(_watched(prism))
    for site in SITES:
        yield site, [(column, numbers) for name, column, numbers in watched if name == site[0]]


def _von_mises(tensor):
    xx, yy, zz, xy, yz, zx = tensor
    square = 0.5 * ((xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2)
    return np.sqrt(square + 3 * (xy**2 + yz**2 + zx**2))


if __name__ == "__main__":
    main()
