"""One task in one process: who may publish, and what is refused."""

import json
import pickle

import pytest

from decks.presets import PRESETS
from decks.stimuli import resolve
from fembridge.sweep import Study, Variant, lease, run_sweep
from fembridge.sweep import work as module
from fembridge.sweep.answers import is_finished
from fembridge.sweep.plan import plan_of
from fembridge.sweep.work import STUDY_FILE, work


def plan(solver="stored"):
    variants = (Variant("quick", PRESETS["quick"]),)
    return plan_of(Study(resolve("sine_20_250"), variants, stored=True), solver)


@pytest.fixture
def folder(tmp_path):
    (tmp_path / STUDY_FILE).touch()
    return tmp_path


def test_who_lost_the_folder_meanwhile_publishes_nothing_and_looks_again(folder, monkeypatch):
    [item] = plan().items.values()
    place, real, calls = folder / item.place, module.simulate, []

    def slow(*words, **options):
        calls.append(is_finished(place, item))
        if len(calls) == 1:  # somebody took over, and died
            gone = {"machine": lease._machine(), "pid": 2**22 + 1, "start": "1"}
            text = json.dumps({**gone, "token": "t"})
            (place / f"{lease.PREFIX}2").write_text(text)
        return real(*words, **options)

    monkeypatch.setattr(module, "simulate", slow)
    finding = work(item, folder)

    assert (finding.finished, finding.again) == (True, False)
    assert calls == [False, False]
    assert is_finished(place, item)
    assert work(item, folder).again
    assert len(calls) == 2


def test_who_lost_the_folder_to_one_who_finished_takes_what_he_did(folder, monkeypatch):
    [item] = plan().items.values()
    real = module.simulate

    def slow(*words, **options):
        monkeypatch.setattr(module, "simulate", real)
        (folder / item.place / f"{lease.PREFIX}1").unlink()
        assert work(item, folder).finished
        return real(*words, **options)

    monkeypatch.setattr(module, "simulate", slow)
    assert work(item, folder).again


def test_who_is_not_to_wait_says_that_it_is_busy(folder):
    [item] = plan().items.values()
    with lease.leased(folder / item.place):
        finding = work(item, folder, patient=False)
    assert finding.busy
    assert not finding.finished
    assert work(item, folder, patient=False).finished


def test_another_solver_than_the_planned_one_is_refused(folder, recorded_ccx, ledger):
    module._version_here.cache_clear()
    [item] = plan("calculix 9.9").items.values()
    finding = work(item.response, folder)
    module._version_here.cache_clear()

    told = "calculix 2.20 is here, the sweep was laid out for calculix 9.9"
    assert finding.cause == told
    assert ledger() == []


def test_a_folder_that_this_machine_does_not_see_is_told(tmp_path):
    [item] = plan().items.values()
    assert "all need to share it" in work(item, tmp_path).cause


def test_what_a_sweep_gives_can_be_sent_to_another_process(tmp_path):
    variants = (Variant("quick", PRESETS["quick"]),)
    study = Study(resolve("sine_20_250"), variants, stored=True)
    sweep = run_sweep(study, tmp_path)
    again = pickle.loads(pickle.dumps(sweep))
    assert again.results == sweep.results
    assert list(again.plan.items) == list(sweep.plan.items)
