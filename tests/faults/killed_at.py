"""Does something again and again, each time killed one file operation later.

``kill -9`` is sent by an audit hook, which Python calls before it opens, makes,
renames or removes a file. After each kill the scene is checked, the work is done
once more without a kill, and the scene is checked again. Prints the number of kills.
"""

import os
import shutil
import signal
import sys
from pathlib import Path

MOVES = {"os.rename", "os.remove", "os.rmdir", "os.mkdir", "os.truncate"}
OLD, NEW = "** old\n", "** new\n"


SOLVER_AT_WORK = []
"""Not empty while what is written is written by the solver, which lives on."""


def is_change(event, args):
    if SOLVER_AT_WORK:
        return False
    if event == "open":
        return bool(args[2] & (os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC))
    return event in MOVES


def do_until(count, act):
    """Run `act` in a child that dies at its change number `count`; whether it did."""
    child = os.fork()
    if child == 0:
        left = [count]

        def hook(event, args):
            if is_change(event, args):
                left[0] -= 1
                if left[0] == 0:
                    os.kill(os.getpid(), signal.SIGKILL)

        sys.addaudithook(hook)
        try:
            act()
        except BaseException:
            import traceback

            traceback.print_exc()
            os._exit(1)
        os._exit(0)
    _, status = os.waitpid(child, 0)
    if os.WIFSIGNALED(status):
        assert os.WTERMSIG(status) == signal.SIGKILL
        return True
    assert os.waitstatus_to_exitcode(status) == 0
    return False


class Outputs:
    """Three files that belong together, replaced by `filling`."""

    def __init__(self, folder):
        self.folder = folder

    def prepare(self):
        self.write("old")

    def act(self):
        self.write("new")

    def write(self, text):
        from fembridge.host.store import filling, write_text

        with filling(self.folder, last="record.toml") as draft:
            for name in ("a.csv", "b.csv", "record.toml"):
                write_text(draft / name, text)

    def check(self):
        texts = {path.name: path.read_text() for path in self.folder.glob("[a-z]*")}
        assert set(texts.values()) <= {"old", "new"}, texts
        if "record.toml" in texts:
            assert len(texts) == 3, texts
            assert len(set(texts.values())) == 1, texts

    def check_done(self):
        self.check()
        assert (self.folder / "record.toml").read_text() == "new"
        assert len(list(self.folder.iterdir())) == 3  # no draft of the killed one


class Ended:
    """A process that is over as soon as it is waited for."""

    returncode = None

    def wait(self, timeout=None):
        self.returncode = 0


class Results:
    """The results of another deck, put in place of those of an earlier one."""

    def __init__(self, folder):
        self.folder = folder

    def prepare(self):
        self.build(OLD)
        self.act()
        self.build(NEW)

    def build(self, deck):
        from fembridge.host.store import sha256_of
        from fembridge.io.run_folder import RunFolder

        self.folder.mkdir(exist_ok=True)
        path = self.folder / "job.inp"
        path.write_text(deck)
        RunFolder(self.folder, "calculix", 1, 0.5, 0.0, (), sha256_of(path)).write()

    def act(self):
        from fembridge.io.run_folder import read_run_folder
        from fembridge.solver import ccx

        ccx.start = self.solve
        outcome = ccx.run_ccx(read_run_folder(self.folder))
        assert outcome.accepted, outcome

    def solve(self, program, words, folder, log, threads):
        """Stand for the solver: quick, and its files name the deck they are of."""
        SOLVER_AT_WORK.append(program)
        deck = (log.parent / "job.inp").read_text()
        for name, text in FILES.items():
            (log.parent / name).write_text(text.replace("DECK", deck[3:6]))
        log.write_text("CalculiX Version 2.20, Copyright\n Job finished\n")
        SOLVER_AT_WORK.clear()
        return Ended()

    def check(self):
        from fembridge.io.run_folder import read_run_folder
        from fembridge.solver.ccx import finished_outcome

        run = read_run_folder(self.folder)
        frd = self.folder / "job.frd"
        whole = {FILES["job.frd"].replace("DECK", word) for word in ("old", "new")}
        assert not frd.exists() or frd.read_text() in whole
        if finished_outcome(run) is not None:
            assert "new" in frd.read_text()

    def check_done(self):
        self.check()
        assert "new" in (self.folder / "job.frd").read_text()
        names = {path.name for path in self.folder.iterdir()}
        kept = {"job.inp", "run.toml", "solver.log", "solver.toml", *FILES}
        assert names == kept, names


FILES = {
    "job.sta": "SUMMARY\n STEP\n"
    "     1          1     1     2  0.500000E-03  0.500000E-03  0.500000E-03\n",
    "job.cvg": "SUMMARY\n\n\n\n",
    "job.frd": """    1C
    1UDECK
    1PSTEP                         1           1           1
  100CL  101 5.00000E-04           1                     0    1           1
 -4  STRESS      1    1
 -5  SXX         1    4    1    1
 -1         1 2.86526E-03
 -3
 9999
""",
}


def main(scene):
    count = 0
    scene.prepare()
    before = scene.folder.rename(scene.folder.with_suffix(".before"))
    while True:
        shutil.rmtree(scene.folder, ignore_errors=True)
        shutil.copytree(before, scene.folder)
        if not do_until(count + 1, scene.act):
            scene.check_done()
            break
        count += 1
        scene.check()
        scene.act()
        scene.check_done()
    print(count)


if __name__ == "__main__":
    main({"outputs": Outputs, "results": Results}[sys.argv[1]](Path(sys.argv[2])))
