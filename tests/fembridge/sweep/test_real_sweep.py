"""A sweep with CalculiX: against what is stored, and a transient against the map."""

import numpy as np
import pytest

from decks.presets import PRESETS
from decks.stimuli import resolve
from fembridge.stimulus import Stimulus
from fembridge.sweep import Study, Variant, run_sweep
from fembridge.sweep import task as task_module
from fembridge.sweep.answers import read_answers
from fembridge.sweep.plan import plan_of
from fembridge.sweep.solver_version import solver_version
from fembridge.sweep.work import STUDY_FILE, work
from neural import parameter_set

pytestmark = pytest.mark.solver


def short(entry, preindent_um=0.0, seed=None):
    """A quarter of a slow wave: few increments."""
    wave_um = 60.0 * np.sin(np.linspace(0, np.pi / 2, 9))
    return Stimulus(entry.id, wave_um, 0.5, (0.0, 4.0), origin={"family": "short"})


def test_calculix_gives_what_is_stored_and_a_transient_what_the_map_gives(tmp_path, monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    variants = (Variant("quick", PRESETS["quick"]),)
    study = Study(resolve("noise_25_250_20,sine_20_250"), variants)
    stored = Study(study.stimuli, variants, stored=True)

    solved = run_sweep(study, tmp_path / "out")
    known = run_sweep(stored, tmp_path / "out")

    assert not solved.causes
    [one], [other] = solved.plan.items.values(), known.plan.items.values()
    answers = read_answers(tmp_path / "out" / one.place)
    expected = read_answers(tmp_path / "out" / other.place)
    assert answers.keys() == expected.keys()
    for key, answer in answers.items():
        assert answer.rate_ips == expected[key].rate_ips
        np.testing.assert_allclose(answer.peak_stress_pa, expected[key].peak_stress_pa, rtol=1e-3)

    monkeypatch.setattr(task_module, "make_stimulus", short)
    both = Study(
        resolve("sine_20_250"),
        variants,
        methods=("map", "transient"),
        parameters=parameter_set("published"),
    )
    plan = plan_of(both, solver_version())
    assert {item.response.key for item in plan.items.values()} == {one.response.key}
    assert (tmp_path / "out" / STUDY_FILE).exists()
    peaks = []
    for item in plan.items.values():
        finding = work(item, tmp_path / "out", threads=1)
        assert finding.cause == ""
        assert work(item, tmp_path / "out").again
        found = read_answers(tmp_path / "out" / item.place)
        peaks.append([answer.peak_stress_pa for answer in found.values()])
    np.testing.assert_allclose(peaks[1], peaks[0], rtol=5e-3)
