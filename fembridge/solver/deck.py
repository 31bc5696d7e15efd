"""The decks of stimuli: `build_deck` for our finger, `rebase_deck` for a user's own model.

A command reads these signatures for its options: a function imports what it needs when it is
called, so that ``--help`` costs nothing.
"""

from __future__ import annotations

import logging
import os
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING

from fembridge.errors import DeckError, UsageError, check_type, warn
from fembridge.solver.analysis import DEFAULT_ANALYSIS, Analysis, load_finger

if TYPE_CHECKING:
    from decks.contact_analysis import Contact
    from decks.finger import Finger
    from decks.own_model import Rebased, Request
    from decks.probe import Probe
    from fembridge.io.run_folder import RunFolder
    from fembridge.io.waveform import Stimuli
    from fembridge.solver.afferents import Afferents
    from fembridge.solver.build import BaseDeck
    from neural.parameter_sets import ParameterSet

_BYTES_A_NODE = 90  # of U and S in float64, with the error estimate of CalculiX
_MANY_GIGABYTES = 1.0
_LOGGER = logging.getLogger(__name__)


def build_deck(
    stimulus: Stimuli,
    output: str | os.PathLike[str] = "runs",
    *,
    target: str = "calculix",
    finger: str | Finger = "quick",
    probe: Probe | None = None,
    parameters: str | ParameterSet = "fitted",
    preindent_um: float | None = None,
    analysis: Analysis = DEFAULT_ANALYSIS,
    contact: Contact | None = None,
    results: str | None = None,
    frames: int = 0,
    probe_body: str | None = None,
) -> list[RunFolder]:
    """Run folders below `output`, one a stimulus: deck, waveform and ``run.toml``.

    Parameters
    ----------
    stimulus
        Waveform of the probe: an id or a set of the catalogue, a `Stimulus`, a `Waveform`,
        the path of a file, a DataFrame ``time_ms,displacement_um``, or a list of these.
    output
        Folder of the run folders. Default: ``"runs"``.
    target
        Solver of the decks: ``"calculix"``, ``"marc"`` or ``"abaqus"``.
        Default: ``"calculix"``.
    finger
        ``"quick"``, ``"paper"``, the path of a TOML file, or a `Finger`.
        Default: ``"quick"``.
    probe
        Shape and position of the probe. Default: None, a cylinder of 1 mm.
    parameters
        Parameter set with which `encode` encodes the stress of the run: ``"fitted"``,
        ``"published"``, the path of a TOML file, or a `ParameterSet`. ``run.toml`` names it.
        Default: ``"fitted"``.
    preindent_um
        Depth of the probe in um before time 0. Default: None, the depth at which `parameters`
        were fitted; a waveform that begins deeper than 0 keeps its own depth.
    analysis
        Element, inertia, section and material law. Default: ``Analysis()``.
    contact
        Contact of probe and skin. Default: None, that of the paper. Marc has its own
        formulation and stiffness.
    results
        Format of the results: ``"binary"``, ``"text"`` or ``"both"``. Default: None, binary,
        in Marc both.
    frames
        Number of samples between two results at all nodes. Default: 0, results at the
        afferents only.
    probe_body
        Probe in Marc: ``"rigid"``, a curve, or ``"meshed"``. Default: None, rigid; other
        solvers have a meshed probe.

    Returns
    -------
    list of RunFolder
        ``folder``, ``increments``, ``dt_ms`` and afferent nodes of each run.

    Raises
    ------
    UsageError, StimulusError
        An unknown id, or an option that the solver does not have.
    DeckError, FingerError, OutputError
        The model cannot be expressed in a deck, or a folder cannot be written.

    Examples
    --------
    >>> import fembridge as fb
    >>> [run] = fb.build_deck("sine_20_250", "runs", target="marc")
    >>> run.folder.name, run.increments
    ('sine_20_250', 520)
    """
    from decks.contact_analysis import Contact
    from decks.dialects import DIALECTS, DeckOptions, dialect_named
    from decks.presets import finger_table
    from decks.probe import Probe
    from fembridge.io.waveform import check_preindentation, resolve_stimuli
    from fembridge.solver.build import build_run_folder
    from fembridge.solver.mechanics import report_mechanics
    from fembridge.trace import finger_id
    from neural.parameter_sets import parameter_set

    for argument, value, kind in (
        ("probe", probe or Probe(), Probe),
        ("contact", contact or Contact(), Contact),
        ("analysis", analysis, Analysis),
    ):
        check_type(argument, value, kind)
    if target not in DIALECTS:
        raise UsageError(argument="target", found=target, expected=" or ".join(DIALECTS))
    dialect = dialect_named(target)
    loaded_set = parameter_set(parameters)
    depth_um = loaded_set.preindent_um if preindent_um is None else preindent_um
    stimuli = resolve_stimuli(stimulus, depth_um)
    check_preindentation(stimuli, preindent_um)
    for field in fields(contact) if contact else ():
        if field.name not in dialect.contact and getattr(contact, field.name) != field.default:
            raise UsageError(
                f"has {field.name}, a deck for {target} has none",
                argument="contact",
                found=field.name,
                expected=", ".join(dialect.contact) or "None",
            )
    try:
        element = dialect.element_named(analysis.element or dialect.element)
    except DeckError as error:
        raise UsageError.from_error(error) from error
    model = analysis.model(load_finger(finger), probe, contact, element)
    runs = [
        build_run_folder(
            Path(output) / item.id,
            model,
            item,
            solver=target,
            options=DeckOptions(results, probe_body, frames),
            parameters=loaded_set.to_table(),
        )
        for item in stimuli
    ]
    depths_um = {stimulus.preindent_um for stimulus in stimuli}
    report_mechanics(loaded_set, finger_id(finger_table(model.finger)), depths_um)
    return runs


def rebase_deck(
    base_deck: str | os.PathLike[str],
    stimulus: Stimuli,
    output: str | os.PathLike[str] = "runs",
    *,
    afferents: Afferents | None = None,
    amplitude: str | None = None,
    move: str | None = None,
    step: str | None = None,
    target: str | None = None,
    length_unit: str | None = None,
    increments: str = "fixed",
    results: str | None = None,
    all_nodes: bool = False,
    own_output: bool = True,
    shell_face: str | None = None,
    newton_per_um: float | None = None,
    mpa_per_um: float | None = None,
    parameters: str | ParameterSet = "fitted",
    preindent_um: float = 0.0,
) -> list[RunFolder]:
    """Run folders of a deck of yours with the waveform in it, one per stimulus.

    The deck is kept to the byte except for the waveform, the increments and the output. Each
    change is logged and listed in the ``inputs`` of the run.

    Parameters
    ----------
    base_deck
        Path of a .inp of CalculiX or Abaqus, or of a .dat of Marc.
    stimulus
        Waveform of the probe, as in `build_deck`.
    output
        Folder of the run folders. Default: ``"runs"``.
    afferents
        Nodes of each afferent class: ``{"SA": 461}``, ``{"SA": [12, 15, 19]}`` or, of a node set,
        ``{"SA": "MERKEL"}``; a table ``afferent, node`` and optionally ``unit``, or its path; or
        the name of a set that has the class in it, as ``"AFFERENT_SA"``. Several nodes of a class
        are units, named after their nodes. Default: None, results at all nodes.
    amplitude
        Name of the ``*AMPLITUDE``, or of Marc's table, that becomes the waveform.
        Default: None, the only one that moves a node.
    move
        Displacement that becomes the waveform, as ``"PROBE,2"``, or ``"PROBE,-2"`` for skin on
        the negative side. Default: None, the only displacement.
    step
        Number of the step, or name of Marc's load case, of the waveform. Default: None, the
        only one that uses it.
    target
        ``"calculix"`` or ``"abaqus"`` for a .inp without an unambiguous card. Default: None,
        as the deck shows.
    length_unit
        ``"mm"``, ``"m"`` or ``"in"``: stress is in MPa, Pa or psi. Default: None, as the
        heading states, else mm.
    increments
        ``"fixed"``, one a sample, or ``"automatic"``: the solver may make them smaller.
        Default: ``"fixed"``.
    results
        Format of the results: ``"binary"`` or ``"text"``. Default: None, binary.
    all_nodes
        Whether results are written at all nodes at every sample. Default: False.
    own_output
        Whether your own requests of results stay in the deck. CalculiX writes them as often as
        those of the afferents, and U and S at the nodes of your request too. Default: True.
    shell_face
        Layer of a shell whose stress an afferent reads: ``"bottom"``, ``"middle"`` or ``"top"``,
        where the normal of the shell points. Default: None, refused for afferents in shells.
    newton_per_um, mpa_per_um
        Force in N or pressure in MPa of each um of the stimulus, for a deck that is driven by
        ``*CLOAD``, by ``*DLOAD`` or ``*DSLOAD``, or by Marc's point or distributed loads. `move`
        then names the load, as ``"TIP,2"`` or ``"SKIN,P"``. Default: None, a displacement, unless
        the waveform is a load.
    parameters
        Parameter set with which `encode` encodes the stress of the run. Default: ``"fitted"``.
    preindent_um
        Depth of the probe in um before time 0, beyond where the deck's own steps leave it.
        Default: 0.

    Returns
    -------
    list of RunFolder
        ``folder``, ``increments``, ``dt_ms`` and afferent nodes of each run.

    Raises
    ------
    UsageError, StimulusError
        An unknown id, or an option that the solver does not have.
    DeckError, OutputError
        The deck lacks a part or leaves it open, with its line; a folder cannot be written.

    Examples
    --------
    >>> import fembridge as fb
    >>> [run] = fb.rebase_deck("mine.inp", "sine_20_250", afferents={"SA": 461})  # doctest: +SKIP
    """
    from decks.own_model import Request
    from fembridge.io.waveform import check_preindentation, resolve_stimuli
    from fembridge.solver.afferents import afferent_nodes
    from fembridge.solver.build import build_own_folder, read_base_deck
    from fembridge.solver.loads import in_scale, load_scale
    from neural.parameter_sets import parameter_set

    loaded_set = parameter_set(parameters)
    stimuli = resolve_stimuli(stimulus, preindent_um, loads=True)
    check_preindentation(stimuli, preindent_um or None)
    load = load_scale(newton_per_um, mpa_per_um, stimuli)
    stimuli = [in_scale(item, load) for item in stimuli]
    base = read_base_deck(Path(base_deck), target)
    request = Request(
        amplitude,
        step,
        afferent_nodes(afferents, base),
        length_unit,
        results,
        move,
        increments,
        all_nodes=all_nodes,
        shell_face=shell_face,
        keeps_output=own_output,
        load=load,
    )
    rebased = [
        build_own_folder(Path(output) / item.id, base, item, request, loaded_set.to_table())
        for item in stimuli
    ]
    report_rebased(base, request, *rebased[-1])
    return [run for run, _ in rebased]


def report_rebased(base: BaseDeck, request: Request, run: RunFolder, rebased: Rebased) -> None:
    """Log what was changed in the deck `base` for `run`, and warn of what is doubtful in it."""
    from fembridge.solver.ccx import deck_warnings
    from fembridge.solver.check import inspect

    warnings = deck_warnings(run, base.path) if base.solver == "calculix" else []
    for remark in (*rebased.remarks, *warnings):
        _LOGGER.info(f"{base.path}: {remark}")
    inspection = inspect(base, request)
    gigabytes = inspection.nodes * run.increments_in_all * _BYTES_A_NODE / 1e9
    if rebased.is_whole_field and not request.all_nodes and gigabytes > _MANY_GIGABYTES:
        warn(
            f"your requests of U or S make results of about {gigabytes:.0f} GB, all nodes at every "
            "increment; take them out of the deck (--no-own-output)",
            base.path,
        )
    # Cards are those of the original: the new deck may have something else for them.
    doubts = [finding for finding in inspection.warnings if finding.topic != "cards"]
    for finding in (*inspection.problems, *doubts, *rebased.doubts):
        warn(str(finding), base.path)
