"""Check of a base deck before anything is solved: `fb.check`, and warnings of `rebase_deck`.

Three sources speak: the deck itself (`decks.own_model.inspection`), a trial of the waveform in it
(the changes and refusals of `rebase_deck`), and CalculiX, which reads the deck without analysis.
"""

from __future__ import annotations

import os
from dataclasses import asdict
from html import escape
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from decks.own_model import Rebased, Request
from decks.own_model.inspection import WAVEFORM, Finding, Inspection
from fembridge.errors import DeckError, UsageError
from fembridge.solver.build import BaseDeck, read_base_deck, rebased_deck
from fembridge.typing import Table

if TYPE_CHECKING:
    from pandas import DataFrame

    from fembridge.io.waveform import Stimuli
    from fembridge.solver.afferents import Afferents
    from fembridge.stimulus import Stimulus

LONGEST_REPR = 5
DEFAULT_STIMULUS = "sine_20_250"
SOLVER_NAMES = {"calculix": "CalculiX", "abaqus": "Abaqus", "marc": "Marc"}
TABLES = (
    *("parts", "materials", "sets", "steps", "motions", "loads", "contacts", "afferents"),
    "cards",
)
"""Names of the tables of a `DeckCheck`."""

# Cost of an iteration on one core, in s: of plane models 6 400 and 78 000 equations took 0.17 and
# 4.3, of solids 91 000 took 24 to factor (CalculiX 2.20, SPOOLES).
_OVERHEAD_S = 0.002
_ASSEMBLY_S, _ASSEMBLY_POWER = 1.9e-6, 1.3
_SOLID_FACTOR_S = 2.9e-9
# Iterations of an increment: two are the fewest, and contact takes more where it opens or closes.
_ITERATIONS, _CONTACT_ITERATIONS = (2, 3), (2, 5)
_MANY_HOURS_S = 4 * 3600.0


class DeckCheck:
    """Result of `check`: contents of a deck, with problems and warnings.

    Each name of `TABLES` is a DataFrame: ``parts``, ``materials``, ``sets``, ``steps``,
    ``motions``, ``loads``, ``contacts``, ``afferents``, ``cards``.

    Parameters
    ----------
    path
        The deck.
    inspection
        Its contents, problems and warnings.
    changes
        Changes that a waveform makes, each with its line.
    cost
        Increments, iterations and seconds of a run; empty for a deck that takes no waveform.

    Examples
    --------
    >>> import fembridge as fb
    >>> check = fb.check(fb.sample("deck"))
    >>> check.problems, check.materials["material"].tolist()[1:3]
    ((), ['EPIDERMIS', 'DERMIS'])
    """

    def __init__(
        self, path: Path, inspection: Inspection, changes: tuple[str, ...], cost: Table
    ) -> None:
        self.path, self.changes, self.cost = path, changes, cost
        self._inspection = inspection

    @property
    def problems(self) -> tuple[Finding, ...]:
        """Reasons why the deck takes no waveform, or would not be solved."""
        return tuple(self._inspection.problems)

    @property
    def warnings(self) -> tuple[Finding, ...]:
        """Doubtful parts of the deck."""
        return tuple(self._inspection.warnings)

    @property
    def passed(self) -> bool:
        """Whether there is no problem."""
        return not self.problems

    @property
    def units(self) -> Table:
        """Units of length and stress, where they come from, and the size of the model in mm."""
        inspection = self._inspection
        return {
            "length": inspection.units.length_unit,
            "stress": inspection.units.stress_unit,
            "source": inspection.stated,
            "size_mm": list(inspection.size_mm),
        }

    def table(self, name: str) -> DataFrame:
        """A table of the deck, a row per item.

        Parameters
        ----------
        name
            One of ``parts``, ``materials``, ``sets``, ``steps``, ``motions``, ``loads``,
            ``contacts``, ``afferents``, ``cards``.

        Raises
        ------
        UsageError
            Another name.
        """
        if name not in TABLES:
            raise UsageError(argument="name", found=name, expected=f"one of {', '.join(TABLES)}")
        from pandas import DataFrame

        return DataFrame(getattr(self._inspection, name))

    def __getattr__(self, name: str) -> DataFrame:
        if name in TABLES:
            return self.table(name)
        raise AttributeError(f"'DeckCheck' object has no attribute {name!r}")

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *TABLES]

    def to_dict(self) -> Table:
        """All of it as plain values, as ``fembridge check --json`` prints it."""
        inspection = self._inspection
        return {
            "deck": str(self.path),
            "solver": inspection.solver,
            "units": self.units,
            "nodes": inspection.nodes,
            "elements": inspection.elements,
            **{name: [dict(row) for row in getattr(inspection, name)] for name in TABLES},
            "changes": list(self.changes),
            "cost": dict(self.cost),
            "findings": [
                {"severity": severity, **asdict(finding)}
                for severity, findings in (("problem", self.problems), ("warning", self.warnings))
                for finding in findings
            ],
            "passed": self.passed,
        }

    def headline(self) -> str:
        """The deck, its solver, and how many problems and warnings there are."""
        counts = (
            f"{len(findings)} {kind}{'s' * (len(findings) != 1)}"
            for findings, kind in ((self.problems, "problem"), (self.warnings, "warning"))
        )
        return f"{self.path} ({SOLVER_NAMES[self._inspection.solver]}): {', '.join(counts)}"

    def model_line(self) -> str:
        """Nodes, elements by type, size and units, in a line."""
        inspection = self._inspection
        kinds: dict[str, int] = {}
        for part in inspection.parts:
            kinds[part["element"]] = kinds.get(part["element"], 0) + part["elements"]
        listed = ", ".join(
            f"{count} {f'of type {kind}' if kind.isdigit() else kind}"
            for kind, count in kinds.items()
        )
        listed = listed or "no elements"
        size = " x ".join(f"{side:.4g}" for side in inspection.size_mm)
        units = inspection.units
        return (
            f"{inspection.nodes} nodes, {listed}; {size or 'unknown'} mm; lengths in "
            f"{units.length_unit}, stress in {units.stress_unit} ({inspection.stated})"
        )

    def motion_line(self) -> str:
        """The displacement or load that the waveform replaces."""
        driven = [row for row in self._inspection.motions if row["role"] in (WAVEFORM, "motion")]
        loads = [row for row in self._inspection.loads if row["course"] == WAVEFORM]
        if loads:
            first = loads[0]
            more = f" and {len(loads) - 1} more" if len(loads) > 1 else ""
            target = f"{first['card']}, {first['target']},{first['label']}"
            return f"waveform: {target} in step {first['step']}{more}"
        if not driven and not self._inspection.steps and self.passed:
            return "waveform: none, the deck has no step; fembridge pad takes such a model"
        if not driven:
            return "waveform: no displacement that it could replace is chosen"
        first = driven[0]
        degree = "" if first["degree"] is None else f",{first['degree']}"
        along = f" along {first['direction']}" if first["direction"] else ""
        step = "" if first["step"] is None else f" in step {first['step']}"
        more = f" and {len(driven) - 1} more" if len(driven) > 1 else ""
        return f"waveform: {first['target']}{degree}{along}{step}{more}"

    def cost_line(self) -> str:
        """The forecast of a run's cost."""
        if not self.cost:
            return "cost: no forecast, the deck takes no waveform"
        low, high = self.cost["iterations"]
        text = f"cost of {self.cost['stimulus']}: {self.cost['increments']} increments"
        if "seconds" not in self.cost:
            return text
        least_s, most_s = self.cost["seconds"]
        return (
            f"{text}, {low} to {high} iterations, about {duration_text(least_s)} to "
            f"{duration_text(most_s)} on one core"
        )

    def __repr__(self) -> str:
        lines = [f"DeckCheck of {self.headline()}", f"  {self.model_line()}"]
        lines += [f"  {self.motion_line()}"]
        lines += [f"  problem: {finding}" for finding in self.problems]
        lines += [f"  warning: {finding}" for finding in self.warnings]
        return "\n".join(lines[:LONGEST_REPR])

    def _repr_html_(self) -> str:
        findings = [
            *(
                f"<li><b>{escape(finding.topic)}</b>: {escape(str(finding))}</li>"
                for finding in self.problems
            ),
            *(
                f"<li>{escape(finding.topic)}: {escape(str(finding))}</li>"
                for finding in self.warnings
            ),
        ]
        lines = (self.headline(), self.model_line(), self.motion_line(), self.cost_line())
        return f"<pre>{escape(chr(10).join(lines))}</pre><ul>{''.join(findings)}</ul>"


def duration_text(seconds: float) -> str:
    """A duration with one or two digits: 40 s, 12 min, 3 h."""
    for size_s, unit in ((3600.0, "h"), (60.0, "min")):
        if seconds >= 1.5 * size_s:
            return f"{seconds / size_s:.2g} {unit}"
    return f"{max(seconds, 1.0):.0f} s"


def check(
    path: str | os.PathLike[str],
    stimulus: Stimuli | None = None,
    *,
    afferents: Afferents | None = None,
    amplitude: str | None = None,
    move: str | None = None,
    step: str | None = None,
    target: str | None = None,
    length_unit: str | None = None,
    increments: str = "fixed",
    shell_face: str | None = None,
    newton_per_um: float | None = None,
    mpa_per_um: float | None = None,
    preindent_um: float = 0.0,
) -> DeckCheck:
    """Contents, problems and warnings of a base deck; nothing is solved or written.

    The options are those of `rebase_deck`. A deck that leaves its motion open has a problem that
    names the choices. If CalculiX is installed it reads the deck without analysis. A .inp without
    a step is a model for a pad: that it takes no waveform is a problem only with a `stimulus`.

    Parameters
    ----------
    path
        A .inp of CalculiX or Abaqus, or a .dat of Marc.
    stimulus
        Waveform of the trial and of the forecast; of several the first. Default: None,
        ``"sine_20_250"``, 250 ms, for a deck with a step.
    afferents
        Nodes of each afferent class, as in `rebase_deck`. Default: None, no node is checked.
    amplitude, move, step
        Motion and step of the waveform, as in `rebase_deck`. Default: None, the only ones.
    target
        ``"calculix"`` or ``"abaqus"`` for a .inp without an unambiguous card. Default: None,
        as the deck shows.
    length_unit
        ``"mm"``, ``"m"`` or ``"in"``: stress is in MPa, Pa or psi. Default: None, as the
        heading states, else mm.
    increments
        ``"fixed"`` or ``"automatic"``. Default: ``"fixed"``.
    shell_face
        Layer of afferents in shells: ``"bottom"``, ``"middle"`` or ``"top"``. Default: None.
    newton_per_um, mpa_per_um
        Force in N or pressure in MPa of each um of the stimulus, for a deck that is driven by
        ``*CLOAD``, by ``*DLOAD`` or ``*DSLOAD``, or by Marc's point or distributed loads. `move`
        then names the load, as ``"TIP,2"`` or ``"SKIN,P"``. Default: None, a displacement, unless
        the waveform is a load.
    preindent_um
        Depth of the probe in um before time 0. Default: 0.

    Returns
    -------
    DeckCheck
        ``problems``, ``warnings``, tables as DataFrames, ``changes``, ``cost``, ``to_dict()``.

    Raises
    ------
    DeckError
        The file is missing, is no deck, or has no readable structure.
    UsageError, StimulusError
        An unknown stimulus, or an argument out of range.

    Examples
    --------
    >>> import fembridge as fb
    >>> fb.check("mine.inp", move="PROBE,2").problems  # doctest: +SKIP
    ()
    """
    from fembridge.io.waveform import resolve_stimuli
    from fembridge.solver.afferents import afferent_nodes
    from fembridge.solver.loads import in_scale, load_scale

    requested = DEFAULT_STIMULUS if stimulus is None else stimulus
    [first, *_] = resolve_stimuli(requested, preindent_um, loads=True)
    load = load_scale(newton_per_um, mpa_per_um, [first])
    first = in_scale(first, load)
    base = read_base_deck(Path(path), target)
    request = Request(
        amplitude,
        step,
        afferent_nodes(afferents, base),
        length_unit,
        None,
        move,
        increments,
        shell_face=shell_face,
        load=load,
    )
    inspection = inspect(base, request)
    rebased: Rebased | None = None
    try:
        rebased = rebased_deck(base, first, request)
    except DeckError as error:
        if stimulus is not None or not _has_no_step(base):
            inspection.problems.append(Finding("waveform", f"the deck takes no waveform: {error}"))
    else:
        inspection.warnings += [Finding("waveform", doubt) for doubt in rebased.doubts]
    if base.solver == "calculix":
        _add_solver_messages(inspection, base)
    cost = {} if rebased is None else forecast(inspection, first)
    if cost.get("seconds", (0, 0))[0] > _MANY_HOURS_S:
        inspection.warn("cost", f"a run may take {duration_text(cost['seconds'][1])}")
    changes = () if rebased is None else rebased.remarks
    return DeckCheck(base.path, inspection, changes, cost)


def inspect(base: BaseDeck, request: Request) -> Inspection:
    """Contents of a base deck, with their problems and warnings.

    Raises
    ------
    DeckError
        The deck has no readable structure.
    """
    from decks.inp import folder_resolver
    from decks.own_model.inp_inspection import inspect_inp
    from decks.own_model.marc_inspection import inspect_marc

    try:
        if base.solver == "marc":
            return inspect_marc(base.data, request)
        resolver = folder_resolver(base.path)
        return inspect_inp(base.data, request, dialect=base.solver, resolver=resolver)
    except DeckError as error:
        raise DeckError.from_error(error, base.path) from error


def _has_no_step(base: BaseDeck) -> bool:
    """Whether a .inp, read with all its files, is a model without a step."""
    from decks.inp import folder_resolver, read_inp

    if base.solver == "marc":
        return False
    deck = read_inp(base.data, resolver=folder_resolver(base.path))
    return not deck.unread and not any(b.keyword in ("STEP", "ENDSTEP") for b in deck.blocks)


def _add_solver_messages(inspection: Inspection, base: BaseDeck) -> None:
    """Errors and warnings of CalculiX, which reads the deck without analysis."""
    from decks.inp import folder_resolver, read_inp
    from fembridge.solver.ccx import read_without_analysis, unread_text
    from fembridge.solver.verdict import find_card

    deck, folder = read_inp(base.data, resolver=folder_resolver(base.path)), base.path.parent
    names = {inclusion.name for inclusion in deck.inclusions}
    names |= {
        option.value or ""
        for block in deck.blocks
        for option in block.options
        if option.name == "FILE"
    }
    if any(Path(name).name != name for name in names):
        return  # in another folder, which build-deck refuses
    needed = [folder / name for name in names if name and (folder / name).is_file()]
    with TemporaryDirectory(prefix="fembridge-check-") as work:
        log = read_without_analysis(base.data, needed, Path(work))
    if log is None:
        return
    for message in log.errors:
        line = message.card and find_card(base.path, message.card)
        if log.exit_code:
            problem = f"CalculiX refuses the deck: {message}"
            inspection.problems.append(Finding("solver", problem, line or None))
        else:
            inspection.warn("solver", f"CalculiX reports: {message}", line or None)
    for message in log.dropped:
        line = message.card and find_card(base.path, message.card)
        row = {"card": message.card or "", "effect": message.text, "line": line or None}
        inspection.cards.append(row)
        inspection.warn("cards", f"CalculiX warns: {message}", line or None)
    if log.exit_code is None:
        inspection.warn("solver", unread_text())


def forecast(inspection: Inspection, stimulus: Stimulus) -> Table:
    """Increments of a run with `stimulus`, and its iterations and seconds in CalculiX.

    The seconds are those of one core; the measured cases behind them are within a factor of 3.
    """
    from decks.motion import motion_of

    increments = motion_of(stimulus).increments
    has_contact = any(row["kind"] == "contact pair" for row in inspection.contacts)
    low, high = _CONTACT_ITERATIONS if has_contact else _ITERATIONS
    cost: Table = {
        "stimulus": stimulus.id,
        "increments": increments,
        "iterations": [low * increments, high * increments],
    }
    if inspection.solver != "calculix":
        return cost
    equations = inspection.nodes * inspection.dimensions
    iteration_s = _OVERHEAD_S + _ASSEMBLY_S * equations**_ASSEMBLY_POWER
    if inspection.dimensions > 2:
        iteration_s += _SOLID_FACTOR_S * equations**2
    cost["equations"] = equations
    cost["seconds"] = [iteration_s * count for count in cost["iterations"]]
    return cost


def text_of(result: DeckCheck, longest: int = 12) -> list[str]:
    """Lines of the page that ``fembridge check`` prints; tables are cut at `longest` rows."""
    lines = [result.headline(), result.model_line(), result.motion_line(), result.cost_line()]
    for name in TABLES:
        frame = result.table(name)
        if frame.empty or (name == "cards"):
            continue
        shown = frame.head(longest).astype(object).where(frame.head(longest).notna(), "")
        shown = shown.loc[:, [column for column in shown if (shown[column] != "").any()]]
        lines += ["", f"{name}:", *shown.to_string(index=False).splitlines()]
        if len(frame) > longest:
            lines.append(f"... and {len(frame) - longest} more (--json lists all)")
    for title, findings in (("problems", result.problems), ("warnings", result.warnings)):
        if findings:
            lines += ["", f"{title}:", *(f"- {finding.topic}: {finding}" for finding in findings)]
    return lines
