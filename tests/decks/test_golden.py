"""Decks keep their bytes: those of 22 November 2026, when no probe was pre-indented by default.

But for one comment since: which of two opposite forces is printed.
"""

import hashlib

import pytest

from fembridge.cli import main

RELAXING = """base = "quick"
[[materials.dermis.prony]]
g = 0.3
tau_s = 0.05
"""
# Options, and the beginning of the SHA-256 of the deck.
GOLDEN = {
    "": "26c38c4d79446f67",
    "--finger paper": "f8790a030f285b0b",
    "--results text --element CPE8R --preindent-um 75": "6c118a17d325428a",
    "--probe-shape flat --probe-diameter-mm 2": "bf793b5de61a8473",
    "--whole-section --probe-x-mm 0.4": "a4648dfef5f1eb21",
    "--slide-mm-per-s 5": "9acb4b87c0c127fd",
    "--slide-mm-per-s 5 --preindent-um 75": "e44f2d7419c1015f",
    "--inertia": "4df6ee202a136ec3",
    "--inertia --finger relaxing.toml --preindent-um 50": "503128fca83b9563",
    "--contact surface-to-surface --friction 0": "4efc2c0f24f20496",
    "--finger relaxing.toml --preindent-um 50": "2016e4a7e01cac5e",
    "--solver abaqus": "1c4bc81edc542146",
    "--solver abaqus --finger relaxing.toml": "2fcf168c0eda08fe",
    "--solver abaqus --slide-mm-per-s 5 --element CPE8R --contact surface-to-surface": (
        "f9334988d3460f40"
    ),
    "--solver abaqus --inertia": "1d77603abdead8cc",
    "--solver marc": "5af3a8a8062cce66",
    "--solver marc --probe-body meshed --preindent-um 75": "f268d684a0e52f72",
    "--solver marc --friction 0": "bb8a4b7c72d48def",
    "--solver marc --results text": "cb85e21444a45e2a",
    "--solver marc --element 11": "13d3aac249b604e3",
    "--solver marc --element 27": "8609a29cb3da8278",
    "--solver marc --element 54": "56c27831da927e1c",
    "--solver marc --element 118": "dfa9183b522925f2",
}


@pytest.mark.parametrize("words", GOLDEN)
def test_a_deck_keeps_its_bytes(words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "relaxing.toml").write_text(RELAXING)
    unindented = [] if "--preindent-um" in words else ["--preindent-um", "0"]
    assert main(["build-deck", "--stimulus", "sine_50_50", *words.split(), *unindented]) == 0
    (deck,) = tmp_path.glob("runs/*/job.*[pt]")
    assert hashlib.sha256(deck.read_bytes()).hexdigest().startswith(GOLDEN[words])
