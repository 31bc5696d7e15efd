"""What ``fembridge ingest --list`` says of a post file, in the keys of a ``.frd``'s."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from fembridge.results.marc_format.content import PostIncrement
from fembridge.results.marc_format.post_file import PostFile
from fembridge.results.marc_nodes.quantity import element_quantities, nodal_components
from fembridge.trace import MS_PER_S
from fembridge.typing import Table


def describe_post(post: PostFile, path: Path) -> Table:
    """Tell what an open post file holds: header, mesh, sets, quantities, problems."""
    mesh = post.meshes[0] if post.meshes else None
    nodes = 0 if mesh is None else mesh.node_ids.size
    types, counts = np.unique([] if mesh is None else mesh.element_types, return_counts=True)
    held: Table = {
        "format": f"marc-{post.kind}",
        "bytes": path.stat().st_size,
        "mesh_nodes": int(nodes),
        "elements": int(counts.sum()),
        "materials": {},
        "header": {
            "title": post.title,
            "post revision": post.revision,
            "byte order": post.byte_order,
            "precision": post.precision,
            "points stored an element": post.points,
        },
        "element_types": {
            str(int(number)): int(count) for number, count in zip(types, counts, strict=True)
        },
        "codes": [code.code for code in post.codes],
        "sets": [
            {"name": one.name, "kind": one.kind, "members": int(one.members.size)}
            for one in (() if mesh is None else mesh.sets)
        ],
        "increments": len(post.increments),
        "meshes": len(post.meshes),
        "quantities": _quantities(post, nodes),
        "remarks": list(post.remarks),
        "problem": post.problem,
    }
    if post.kind == "t19":
        del held["header"]["byte order"]
    return held


def _quantities(post: PostFile, nodes: int) -> list[Table]:
    found: dict[str, tuple[tuple[str, ...], str, list[PostIncrement]]] = {}
    for one in post.increments:
        for quantity in one.nodal:
            parts = nodal_components(quantity)
            found.setdefault(quantity.name, (parts, "nodes", []))[2].append(one)
        if one.has_element_values:
            for held in element_quantities(post.codes):
                entry = found.setdefault(held.name, (held.components, "integration points", []))
                entry[2].append(one)
    return [
        _told(name, parts, where, some, nodes, post) for name, (parts, where, some) in found.items()
    ]


def _told(
    name: str,
    components: tuple[str, ...],
    where: str,
    increments: Sequence[PostIncrement],
    nodes: int,
    post: PostFile,
) -> Table:
    timed = [one for one in increments if not one.harmonic]
    others = [one for one in increments if one.harmonic]
    ids = post.meshes[0].node_ids if post.meshes else np.empty(0, dtype=np.int64)
    return {
        "name": name,
        "components": list(components),
        "increments": len(timed),
        "first_ms": timed[0].time_s * MS_PER_S if timed else None,
        "last_ms": timed[-1].time_s * MS_PER_S if timed else None,
        "modes": len(others),
        "axis": "frequency in cycles per time" if others else "total time",
        "first_value": others[0].frequency if others else None,
        "last_value": others[-1].frequency if others else None,
        "steps": sorted({one.sub_increment for one in increments}),
        "at": where,
        "nodes": int(nodes),
        "lowest_node": int(ids.min()) if ids.size else None,
        "highest_node": int(ids.max()) if ids.size else None,
        "storage": "text" if post.kind == "t19" else post.precision,
    }
