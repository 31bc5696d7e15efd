"""Models for the tests of pads of meshes: a half-space in closed form, and small decks."""

import numpy as np

from fembridge.touching.mesh_pad import MeshPad, MeshSite

YOUNG_MPA, SPACING_MM = 0.2, 0.1


def love_compliance(x, z, half_mm, modulus_mpa):
    """Depth at (x, z) from the middle of a square of unit force; Love 1929."""

    def corner(a, b):
        return a * np.arcsinh(b / np.abs(a)) + b * np.arcsinh(a / np.abs(b))

    a, b, c, d = x + half_mm, z + half_mm, x - half_mm, z - half_mm
    area = corner(a, b) - corner(a, d) - corner(c, b) + corner(c, d)
    return area / (np.pi * modulus_mpa * (2 * half_mm) ** 2)


def half_space(nodes=21, depths_mm=(0.45, 0.5, 0.55), turn_deg=0.0):
    """Incompressible half-space; turned about z by an angle, as a part of a curved skin."""
    axis = (np.arange(nodes) - nodes // 2) * SPACING_MM
    x, z = (each.ravel() for each in np.meshgrid(axis, axis, indexing="ij"))
    flat_mm = np.stack([x, 0 * x, z], -1)
    modulus = YOUNG_MPA / (1 - 0.5**2)
    into = love_compliance(x[:, None] - x, z[:, None] - z, SPACING_MM / 2, modulus)
    point_mm = np.concatenate([flat_mm - [0, depth, 0] for depth in depths_mm])
    away = point_mm[:, None] - flat_mm  # of an incompressible half-space stress is radial
    distance = np.linalg.norm(away, axis=2)
    radial = -3 * -away[..., 1] / (2 * np.pi * distance**5)
    pairs = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0))
    turn = np.radians(turn_deg)
    rotation = np.array(
        [[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]]
    )
    away = away @ rotation.T
    stress_pa = np.zeros((3, 6, len(point_mm), x.size))
    stress_pa[1] = [1e6 * radial * away[..., a] * away[..., b] for a, b in pairs]
    scale_pa = np.maximum(np.abs(stress_pa).max(axis=(1, 3), keepdims=True), 1e-9)
    corner = np.arange(nodes**2).reshape(nodes, nodes)
    lower, right, ahead, both = corner[:-1, :-1], corner[1:, :-1], corner[:-1, 1:], corner[1:, 1:]
    triangles = np.concatenate(
        [np.stack([lower, ahead, right], -1), np.stack([right, ahead, both], -1)]
    ).reshape(-1, 3)
    down_mm = np.zeros((3, x.size, x.size), dtype=np.float32)
    down_mm[1] = into
    return MeshPad(
        name="half-space",
        spacing_mm=SPACING_MM,
        node=np.arange(1, x.size + 1),
        position_mm=flat_mm @ rotation.T,
        normal=np.tile(rotation[:, 1], (x.size, 1)),
        area_mm2=np.full(x.size, SPACING_MM**2),
        triangles=triangles,
        is_end=(np.maximum(np.abs(x), np.abs(z)) > axis[-1] - 1e-9),
        down_mm=down_mm,
        point_mm=point_mm @ rotation.T,
        point_layer=np.zeros(len(point_mm), dtype=np.int64),
        point_depth_mm=np.repeat(depths_mm, x.size).astype(float),
        stress=(stress_pa / scale_pa).astype(np.float16),
        stress_scale_pa=scale_pa,
        layers=("RUBBER",),
        sites={name: MeshSite("RUBBER", 0.5) for name in ("SA", "RA", "PC")},
    )


def block_deck(
    across=6, down=4, size_mm=0.5, kind="C3D8", material="*ELASTIC\n0.2, 0.45\n", more=""
):
    """A block of bricks that is held below; sets TOP, BOTTOM, INNER and the elements RUBBER."""
    number = np.arange(1, (across + 1) ** 2 * (down + 1) + 1).reshape(down + 1, across + 1, -1)
    lines = ["*HEADING", "block", "*NODE, NSET=ALL"]
    for (k, j, i), node in np.ndenumerate(number):
        at = (i - across / 2) * size_mm, (j - across / 2) * size_mm, (k - down) * size_mm
        lines.append(f"{node}, " + ", ".join(f"{value:.6f}" for value in at))
    lines.append(f"*ELEMENT, TYPE={kind}, ELSET=RUBBER")
    ring = ((0, 0), (0, 1), (1, 1), (1, 0))
    element = 0
    for k in range(down):
        for j in range(across):
            for i in range(across):
                element += 1
                corners = [number[k + up, j + y, i + x] for up in (0, 1) for y, x in ring]
                lines.append(f"{element}, " + ", ".join(map(str, corners)))
    for name, nodes in (
        ("TOP", number[-1]), ("BOTTOM", number[0]), ("INNER", number[-2, 2:-2, 2:-2]),
        ("CORNERS", number[-1][[0, 0, -1, -1], [0, -1, 0, -1]]),
    ):  # fmt: skip
        lines += [f"*NSET, NSET={name}", *(f"{node}," for node in nodes.ravel())]
    lines += ["*MATERIAL, NAME=SOFT", material.rstrip()]
    lines += ["*SOLID SECTION, ELSET=RUBBER, MATERIAL=SOFT", "*BOUNDARY", "BOTTOM, 1, 3"]
    return "\n".join(lines) + "\n" + more


# Corners of a brick that tetrahedra and wedges of its volume have.
_PARTS = {
    "hex": ((0, 1, 2, 3, 4, 5, 6, 7),),
    "wedge": ((0, 1, 2, 4, 5, 6), (0, 2, 3, 4, 6, 7)),
    "tet": (
        (0, 1, 2, 6), (0, 2, 3, 6), (0, 3, 7, 6), (0, 7, 4, 6), (0, 4, 5, 6), (0, 5, 1, 6),
    ),
}  # fmt: skip


def block_of(kind, across=6, down=4, size_mm=0.5):
    """The deck of `block_deck` with elements of another kind; surface SKIN is its upper side."""
    from decks.inp import read_inp
    from decks.shape_functions import CORNERS, EDGES
    from decks.solid_model import KINDS, read_solid_model

    model = read_solid_model(read_inp(block_deck(across, down, size_mm).encode()))
    nodes = int("".join(letter for letter in kind[3:] if letter.isdigit()))
    family = KINDS[nodes].rstrip("0123456789")
    (bricks,) = model.elements
    rows = np.concatenate([bricks.rows[:, list(part)] for part in _PARTS[family]])
    position = model.position
    if nodes > CORNERS[family]:
        ends = np.sort(rows[:, EDGES[family]].reshape(-1, 2), axis=1)
        unique, number = np.unique(ends, axis=0, return_inverse=True)
        rows = np.concatenate([rows, len(position) + number.reshape(len(rows), -1)], axis=1)
        position = np.concatenate([position, position[unique].mean(axis=1)])
    lines = ["*NODE", *(f"{n}, {x}, {y}, {z}" for n, (x, y, z) in enumerate(position.tolist(), 1))]
    lines.append(f"*ELEMENT, TYPE={kind}, ELSET=RUBBER")
    for n, row in enumerate((rows + 1).tolist(), 1):
        first, rest = row[:10], row[10:]
        lines.append(", ".join(map(str, [n, *first])) + ("," if rest else ""))
        lines += [", ".join(map(str, rest))] if rest else []
    z = position[:, 2]
    for name, selected in (("BOTTOM", z == z.min()), ("TOP", np.abs(z) < 1e-9)):
        lines += [f"*NSET, NSET={name}", *(f"{n}," for n in np.flatnonzero(selected) + 1)]
    lines += ["*SURFACE, NAME=SKIN, TYPE=NODE", "TOP"]
    lines += ["*MATERIAL, NAME=SOFT", "*ELASTIC", "0.2, 0.45"]
    lines += ["*SOLID SECTION, ELSET=RUBBER, MATERIAL=SOFT", "*BOUNDARY", "BOTTOM, 1, 3"]
    return "\n".join(lines) + "\n"
