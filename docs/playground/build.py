"""Compile ``playground.wasm`` from ``playground.c`` and the header of ``fembridge export-c``.

Needs clang with the target wasm32, and wasm-ld (Debian: ``clang`` and ``lld``). Run it after a
change of the fitted parameters, of ``neural/c_header.py`` or of ``playground.c``: a test compares
their digest with that in ``playground.toml``.
"""

import hashlib
import re
import subprocess
import sys
import tempfile
from pathlib import Path

import tomli_w

from neural.c_header import export_c

FOLDER = Path(__file__).parent
SOURCE, WASM, RECORD = "playground.c", "playground.wasm", "playground.toml"
PARAMETERS, SENSOR_MS = "fitted", 0.1
FLAGS = (
    "--target=wasm32",
    "-std=c99",
    "-O2",
    "-fno-builtin",
    "-fno-math-errno",
    "-ffp-contract=off",
    "-nostdlib",
    "-Wall",
    "-Wextra",
    "-Werror",
    "-Wl,--no-entry",
    "-Wl,--strip-all",
)


def header() -> str:
    """The encoder with the parameters of the playground."""
    return export_c(PARAMETERS, sensor_ms=SENSOR_MS)


def sources_sha256() -> str:
    """Digest of all that the compiler reads: the header without its comments."""
    code = re.sub(r"/\*.*?\*/", "", header(), flags=re.DOTALL)
    texts = (code, (FOLDER / SOURCE).read_text(encoding="utf-8"), " ".join(FLAGS))
    return hashlib.sha256("\0".join(texts).encode()).hexdigest()


def compiler_version() -> str:
    """Version of clang, as ``14.0.6``."""
    command = ["clang", "--version"]
    text = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    match = re.search(r"\d+\.\d+\.\d+", text)
    return match[0] if match else "unknown"


def compiled() -> bytes:
    """The module."""
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "afferents.h").write_text(header(), encoding="utf-8")
        output = Path(folder) / WASM
        command = ["clang", *FLAGS, "-I", folder, "-o", output, FOLDER / SOURCE]
        subprocess.run(command, check=True)
        return output.read_bytes()


def main() -> int:
    """Write the module and its record."""
    module = compiled()
    (FOLDER / WASM).write_bytes(module)
    record = {
        "parameters": PARAMETERS,
        "clang": compiler_version(),
        "sources_sha256": sources_sha256(),
        "wasm_sha256": hashlib.sha256(module).hexdigest(),
    }
    (FOLDER / RECORD).write_text(tomli_w.dumps(record), encoding="utf-8")
    print(f"{WASM}: {len(module)} bytes")
    return 0


if __name__ == "__main__":
    sys.exit(main())
