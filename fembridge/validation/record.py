"""``validation.toml``: what a report was made of, and what its files should hold."""

import hashlib
import importlib.metadata
import platform
from pathlib import Path

from fembridge import __version__
from fembridge.touchsim import TABLE
from fembridge.typing import Table
from fembridge.validation.study import Study
from neural import parameters_to_table

_LIBRARIES = ("numpy", "scipy", "matplotlib")


def record_of(study: Study, command: str, folder: Path) -> Table:
    """Give the record of `study`, whose files stand in `folder`; no date, no place."""
    table: Table = {
        "fembridge": __version__,
        "command": command,
        "judged": study.judged.name,
        "reference": study.reference,
        "versions": {
            "python": platform.python_version(),
            **{name: importlib.metadata.version(name) for name in _LIBRARIES},
        },
        "touchsim": {"sha256": digest_of(TABLE)},
        "response": {
            "finger": study.finger,
            "closure_percent": study.response.closure_percent,
            **study.response.origin,
        },
        "models": {
            model.name: {
                "source": model.source,
                **({"origin": dict(model.origin)} if model.origin else {}),
                "preindent_um": model.preindent_um,
                "parameters": parameters_to_table(model.parameters),
            }
            for model in study.models
        },
        "deflection": {
            mesh.name: {"elements": mesh.elements, **_mesh_origin(mesh.origin)}
            for mesh in study.deflections
        },
        "files": {
            path.name: digest_of(path)
            for path in sorted(folder.iterdir(), key=lambda path: path.name)
        },
    }
    if study.observed is not None:
        table["observed"] = {
            "file": study.observed.path.name,
            "sha256": study.observed.sha256,
            "stimuli": len(study.observed.stimuli),
            "left_out": list(study.left_out),
        }
    return table


def digest_of(path: Path) -> str:
    """SHA-256 of the bytes of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _mesh_origin(origin: object) -> Table:
    wanted = ("mesh_sha256", "version", "law")
    known = origin if isinstance(origin, dict) else {}
    return {name: known[name] for name in wanted if name in known}
