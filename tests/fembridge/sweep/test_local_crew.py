"""In what order a crew on this machine does its tasks."""

from fembridge.sweep import run_sweep, sweep
from fembridge.sweep.crew import Begun
from fembridge.sweep.local_crew import LocalCrew
from fembridge.sweep.task import Item, Response


def test_an_answer_does_not_wait_until_all_fingers_are_solved(
    recorded_ccx, dermis_study, tmp_path, monkeypatch
):
    begun = []

    class Watched(LocalCrew):
        def next_event(self):
            event = super().next_event()
            if isinstance(event, Begun):
                begun.append(type(event.task))
            return event

    monkeypatch.setattr(sweep, "LocalCrew", Watched)
    done = run_sweep(dermis_study(4), tmp_path / "out")

    assert not done.failed
    assert (begun.count(Response), begun.count(Item)) == (4, 4)
    last_solve = len(begun) - 1 - begun[::-1].index(Response)
    assert begun.index(Item) < last_solve
