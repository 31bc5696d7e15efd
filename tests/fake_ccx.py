"""Plays CalculiX: the deck's first line, ``** play NAME``, says which part.

Run as a program, so that it is a process like the solver; needs no package.
"""

import os
import signal
import sys
import time
from pathlib import Path

JOB = Path(sys.argv[2])
DT_S, INCREMENTS = 0.0005, 4
STA_HEAD = """SUMMARY OF JOB INFORMATION
  STEP      INC     ATT  ITRS     TOT TIME     STEP TIME      INC TIME
"""
CVG_HEAD = "SUMMARY OF C0NVERGENCE INFORMATION\n\n\n\n"
BLOCK = """    1PSTEP{place:26d}{place:12d}           1
  100CL{name:5d}{time:12.5E}           1{blank:20}{kind:2d}{place:5d}           1
 -4  DISP        4    1
 -5  D1          1    2    1    0
 -5  D2          1    2    2    0
 -5  D3          1    2    3    0
 -5  ALL         1    2    0    0    1ALL
 -1         1 0.00000E+00-1.00000E-02 0.00000E+00
 -3
"""


def say(text):
    print(text, flush=True)


def append(suffix, text):
    with Path(f"{JOB}{suffix}").open("a") as file:
        file.write(text)


def iteration(increment, number):
    place = f"{1:6d}{increment:6d}{1:6d}{number:6d}{0:9d}"
    append(".cvg", place + "  0.0000E+00" * 4 + "\n")


def attempt(increment, failed=False):
    end_s = DT_S * (increment - 1 if failed else increment)
    times = f"{end_s:14.6E}{end_s:14.6E}{DT_S:14.6E}"
    mark = "U" if failed else " "
    append(".sta", f"{1:6d}{increment:11d}{1:6d}{mark}{2:5d}{times}\n")


def begin():
    say("CalculiX Version 2.20, Copyright(C) 1998-2022 Guido Dhondt")
    append(".sta", STA_HEAD)
    append(".cvg", CVG_HEAD)
    append(".frd", "    1C\n")


def increments(count=INCREMENTS, output=True):
    for increment in range(1, count + 1):
        iteration(increment, 1)
        iteration(increment, 2)
        attempt(increment)
        if output:
            values = {"place": increment, "name": 100 + increment, "kind": 0}
            append(".frd", BLOCK.format(**values, time=increment * DT_S, blank=""))


def finish():
    append(".frd", " 9999\n")
    Path("spooles.out").touch()
    say(" Job finished")


def normal():
    begin()
    increments()
    finish()


def loud():
    say(" iteration of a solver that talks\n" * 100_000)
    normal()


def diverged():
    begin()
    increments(1)
    for number in range(1, 8):
        iteration(2, number)
    attempt(2, failed=True)
    say(" *ERROR: solution seems to diverge; please try \n automatic incrementation\n")
    return 201


def silent_divergence():
    begin()
    increments(3)
    attempt(4, failed=True)
    finish()


def cut():
    begin()
    increments()
    with Path(f"{JOB}.frd").open("r+") as file:
        file.truncate(900)
    say(" Job finished")


def nothing():
    say("nothing to do")


def harmless():
    normal()
    say(" *WARNING reading *STATIC:\n          the minimum increment is small\n")


def no_output():
    begin()
    increments(output=False)
    finish()


def no_frd():
    normal()
    Path(f"{JOB}.frd").unlink()


def odd_exit():
    normal()
    return 7


def aborted():
    begin()
    say("realloc(): invalid old size")
    signal.signal(signal.SIGABRT, signal.SIG_DFL)
    os.kill(os.getpid(), signal.SIGABRT)


def too_large():
    begin()
    signal.signal(signal.SIGXFSZ, signal.SIG_DFL)  # Python ignores it
    os.kill(os.getpid(), signal.SIGXFSZ)


def hang():
    begin()
    increments(1)
    Path(f"{JOB}.pid").write_text(str(os.getpid()))
    time.sleep(600)


def stubborn():
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    hang()


def with_child():
    if os.fork() == 0:
        hang()
    time.sleep(600)


def endless():
    begin()
    increments(1)
    for number in range(1, 100_000):
        iteration(2, number)
        time.sleep(0.001)


def environment():
    normal()
    say(f"threads {os.environ.get('OMP_NUM_THREADS')}")
    say(f"override {os.environ.get('NUMBER_OF_CPUS')}")


SAID = {
    "bad_deck": (
        0,
        " *ERROR reading *BOUNDARY: node set NOPE\n        has not yet been defined.\n"
        " *ERROR reading *BOUNDARY. Card image:\n        NOPE,1,1\n\n"
        " *ERROR in calinput: at least one fatal\n         error message\n",
        201,
    ),
    "odd_error": (2, " *ERROR in somewhere: the moon is full\n", 201),
    "inverted": (
        0,
        200 * " *ERROR in e_c3d: nonpositive jacobian\n        determinant in element 7\n\n",
        201,
    ),
    "starved": (0, " *ERROR in u_calloc: error allocating memory\n", 16),
    "no_room": (2, "Fortran runtime error: No space left on device\n" + 9 * "#0  0x7f in ???\n", 2),
}
"""Increments that are made, last words and exit code."""


def main():
    play = Path(f"{JOB}.inp").read_text().split()[2]
    if play in SAID:
        count, words, code = SAID[play]
        begin()
        increments(count)
        say(words)
        sys.exit(code)
    sys.exit(globals()[play]() or 0)


if __name__ == "__main__":
    main()
