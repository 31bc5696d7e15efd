"""Pieces of the playground in the browser: its data, script, style, and page in one file.

The module ``playground.wasm`` is part of the repository (``build.py`` makes it); the response map
is written into the script here.
"""

import base64
import json
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import PchipInterpolator

import fembridge as fb
from fembridge.response.response_map import FOLDER as MAPS
from fembridge.response.response_map import IN_PLANE, read_map
from neural import parameter_set
from neural.parameters import finest_step_ms

SOURCES = Path(__file__).parent
SCRIPT, STYLE, PAGE = "playground.js", "playground.css", "playground.html"
FINGER, PARAMETERS = "quick", "fitted"


def data() -> dict[str, Any]:
    """What the script needs: the module, the response map, classes, depth at rest and step."""
    parameters, response = parameter_set(PARAMETERS), read_map(MAPS / f"{FINGER}.toml")
    places = [site.afferent for site in response.places]
    columns = [places.index(name) for name in parameters.parameters]
    tensor_pa = response.tensor_pa[:, columns, :IN_PLANE]
    # SciPy has the term of the highest power first: (term, interval, afferent, component).
    terms = PchipInterpolator(response.depth_um, tensor_pa, axis=0).c[::-1]
    coefficients = np.ascontiguousarray(np.moveaxis(terms, 0, -1), dtype="<f8")
    return {
        "version": fb.__version__,
        "parameters": parameters.name,
        "finger": FINGER,
        "preindent_um": parameters.preindent_um,
        "step_ms": finest_step_ms(parameters.parameters),
        "deepest_um": response.deepest_um,
        "afferents": [
            {"name": name, "cells": values.cells} for name, values in parameters.parameters.items()
        ],
        "knot_um": response.depth_um.tolist(),
        "coefficients": base64.b64encode(coefficients.tobytes()).decode(),
        "wasm": base64.b64encode((SOURCES / "playground.wasm").read_bytes()).decode(),
    }


def script() -> str:
    """The script with its data."""
    text = (SOURCES / SCRIPT).read_text(encoding="utf-8")
    return text.replace("/*DATA*/ null", json.dumps(data(), separators=(",", ":")))


def style() -> str:
    """The style of the playground."""
    return (SOURCES / STYLE).read_text(encoding="utf-8")


def page() -> str:
    """The page of its own: style, script, module and response map in one file."""
    about = (
        f"fembridge {fb.__version__}: the stored response of its reference finger (plane strain, "
        f"CalculiX) under a cylinder of 1 mm, and the parameters `{PARAMETERS}`. The spikes are "
        "those of <code>fembridge simulate</code> for the same waveform. "
        '<a href="index.html">Documentation</a>'
    )
    text = (SOURCES / PAGE).read_text(encoding="utf-8")
    parts = {"STYLE": style(), "ABOUT": about.replace("`", ""), "SCRIPT": script()}
    for name, part in parts.items():
        text = text.replace(f"@@{name}@@", part)
    return text
