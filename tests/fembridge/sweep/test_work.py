"""Work of a study: what is shared, what makes an address another one, one task at a time."""

import errno
from dataclasses import fields, replace

import pytest

from decks.contact_analysis import Contact
from decks.finger import PronyTerm
from decks.presets import PRESETS, finger_from
from decks.probe import Probe
from decks.stimuli import resolve
from fembridge.host.store import folder_lock
from fembridge.response.indentation import LADDER
from fembridge.sweeps import Study, Variant
from fembridge.sweeps import sweep as module
from fembridge.sweeps.study_file import contact_ladder
from fembridge.sweeps.sweep import STUDY_FILE, Item, Response, make_plan, run_task
from neural import parameter_set

QUICK = Variant("quick", PRESETS["quick"])
CCX = "calculix 2.20"


def study(words="sine_20_250", **changes):
    return Study(resolve(words), changes.pop("variants", (QUICK,)), **changes)


def response(**changes):
    made = {
        "finger": PRESETS["quick"],
        "probe": Probe(),
        "contact": {},
        "element": "CPE4",
        "depth_um": 400.0,
        "solver": CCX,
    }
    return Response(**made | changes)


def item(**changes):
    made = {
        "response": response(),
        "method": "map",
        "entries": resolve("noise_25_250"),
        "preindent_um": 75.0,
        "seed": None,
        "parameters": parameter_set("fitted").parameters,
    }
    return Item(**made | changes)


def test_all_stimuli_share_the_map_and_each_has_its_transient():
    plan = make_plan(study("sine_20,noise_25_250", methods=("map", "transient")), CCX)
    count = len(resolve("sine_20,noise_25_250"))
    methods = [each.method for each in plan.items.values()]
    assert methods.count("map") == 1
    assert methods.count("transient") == count
    assert len(plan.rows) == 2 * count * 3
    assert len({each.response.key for each in plan.items.values()}) == 1
    assert len({each.solve_folder for each in plan.items.values()}) == count + 1


def test_what_is_asked_of_the_contact_is_put_into_every_rung():
    ladder = contact_ladder({"friction": 0.2})
    assert {contact.friction for contact in ladder} == {0.2}
    assert ladder[0] == Contact(friction=0.2)
    assert len(ladder) == len(LADDER) - 1  # the one without friction is the first
    assert contact_ladder({}) == LADDER
    whole = Contact("surface-to-surface", 500.0, 0.1, 0.05)
    asked = {name.name: getattr(whole, name.name) for name in fields(Contact)}
    assert contact_ladder(asked) == (whole,)


def soft():
    """A finger whose dermis relaxes, of another density."""
    finger = PRESETS["quick"]
    dermis = replace(
        finger.materials["dermis"], prony=(PronyTerm(0.4, 0.02),), density_kg_m3=1000.0
    )
    return replace(finger, materials={**finger.materials, "dermis": dermis})


@pytest.mark.parametrize("finger", [*PRESETS.values(), soft()], ids=["quick", "paper", "soft"])
def test_a_key_is_made_of_the_whole_finger(finger):
    """What comes back from it is the same: another number makes another key."""
    assert finger_from(response(finger=finger).inputs()["finger"], "any") == finger


@pytest.mark.parametrize(
    "changes",
    [
        {"finger": PRESETS["paper"]},
        {"probe": Probe(diameter_mm=0.5)},
        {"probe": Probe(x_mm=0.1)},
        {"probe": Probe("flat")},
        {"contact": {"friction": 0.4}},
        {"element": "CPE8R"},
        {"depth_um": 500.0},
        {"solver": "calculix 2.21"},
    ],
)
def test_all_that_goes_into_a_response_changes_its_address(changes):
    assert response(**changes).key != response().key
    assert item(response=response(**changes)).key != item().key


@pytest.mark.parametrize(
    "changes",
    [
        {"method": "transient"},
        {"entries": resolve("noise_25_250")[:-1]},
        {"preindent_um": 76.0},
        {"seed": 1},
        {"seed": 2**64 + 1},
        {"parameters": parameter_set("published").parameters},
    ],
)
def test_all_that_goes_into_an_item_changes_its_address(changes):
    assert item(**changes).key != item().key
    assert item(**changes).response.key == item().response.key


def test_of_a_finger_that_relaxes_each_waveform_is_solved():
    variants = (QUICK, Variant("soft", soft()))
    plan = make_plan(study("sine_20", variants=variants), CCX)
    method_of = {item.response.finger.relaxing_s > 0: item.method for item in plan.items.values()}
    assert method_of == {False: "map", True: "transient"}
    assert len(plan.items) == 1 + len(resolve("sine_20"))
    assert set(plan.rows["method"]) == {"map", "transient"}


@pytest.fixture
def folder(tmp_path):
    (tmp_path / STUDY_FILE).touch()
    return tmp_path


def test_who_is_not_to_wait_says_that_it_is_busy(folder):
    [item] = make_plan(study(stored=True), "stored").items.values()
    (folder / item.run_folder).mkdir(parents=True)
    with folder_lock(folder / item.run_folder, ".lock"):
        ended = run_task(item, folder, wait=False)
    assert ended.busy
    assert not run_task(item, folder, wait=False).cause
    assert run_task(item, folder).before


def test_another_solver_than_the_planned_one_is_refused(folder, recorded_ccx, ledger):
    [item] = make_plan(study(stored=True), "calculix 9.9").items.values()
    finding = run_task(item.response, folder)
    assert "calculix 2.20" in finding.cause and "calculix 9.9" in finding.cause
    assert ledger() == []


def test_a_folder_that_this_machine_does_not_see_is_said(tmp_path):
    [item] = make_plan(study(stored=True), "stored").items.values()
    assert str(tmp_path) in run_task(item, tmp_path).cause


def test_a_full_disk_in_an_item_is_no_bug_of_ours(tmp_path, monkeypatch):
    def full(*words):
        raise OSError(errno.ENOSPC, "No space left on device", "runs/a/spikes.csv")

    (tmp_path / STUDY_FILE).write_text("")
    monkeypatch.setattr(module, "_run_item", full)

    done = run_task(item(), tmp_path)

    assert done.cause == "runs/a/spikes.csv: No space left on device"
    assert not list(tmp_path.rglob("failed.txt"))
