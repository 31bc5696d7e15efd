"""Decks keep their bytes: those of the program before issue 12, of 22 November 2026."""

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
    "": "054878ddf4cbf64d",
    "--finger paper": "9651e1cc9b587f28",
    "--results text --element CPE8R --preindent-um 75": "17af9166f54522a8",
    "--probe-shape flat --probe-diameter-mm 2": "b9563b3b834cee68",
    "--whole-section --probe-x-mm 0.4": "8ee5c57420b69bfa",
    "--slide-mm-per-s 5": "8ec7f811fd77775f",
    "--inertia": "6b3933caa936fc53",
    "--inertia --finger relaxing.toml --preindent-um 50": "ceb4721d1c791daa",
    "--contact surface-to-surface --friction 0": "1e8d2348e023e62f",
    "--finger relaxing.toml --preindent-um 50": "2db7137c52b87e6b",
    "--solver abaqus": "26c57baf0600d9eb",
    "--solver abaqus --finger relaxing.toml": "4dc5b4191ab97bb9",
    "--solver abaqus --slide-mm-per-s 5 --element CPE8R --contact surface-to-surface": (
        "667d9b395ed13417"
    ),
    "--solver abaqus --inertia": "0b886600bc171108",
    "--solver marc": "5af3a8a8062cce66",
    "--solver marc --probe-body meshed --preindent-um 75": "f268d684a0e52f72",
    "--solver marc --element 11": "13d3aac249b604e3",
    "--solver marc --element 27": "8609a29cb3da8278",
    "--solver marc --element 54": "56c27831da927e1c",
    "--solver marc --element 118": "dfa9183b522925f2",
}


@pytest.mark.parametrize("words", GOLDEN)
def test_a_deck_keeps_its_bytes(words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "relaxing.toml").write_text(RELAXING)
    assert main(["build-deck", "--stimulus", "sine_50_50", *words.split()]) == 0
    (deck,) = tmp_path.glob("runs/*/job.*[pt]")
    assert hashlib.sha256(deck.read_bytes()).hexdigest().startswith(GOLDEN[words])
