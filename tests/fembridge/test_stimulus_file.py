"""Waveforms that come in: what `--export` wrote, and what other people have."""

import json
import struct
import tomllib
import wave
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose
from scipy.interpolate import PchipInterpolator

import fembridge as fb
from decks.stimuli import MAX_SAMPLES, resolve
from decks.synthesis import make_stimulus
from fembridge.cli import main
from fembridge.errors import (
    FembridgeError,
    FembridgeWarning,
    StimulusError,
    TableError,
    UsageError,
)
from fembridge.io.run_folder import read_run_folder, read_waveform
from fembridge.io.waveform import resolve_stimuli
from fembridge.io.waveform_file import FORMATS, read_stimulus, write_stimulus
from fembridge.trace import resample

TIMES_MS = np.arange(201) * 0.5
TAP_UM = 200 * np.sin(np.pi * TIMES_MS / 100) ** 2


def made(word, preindent_um=0.0):
    (entry,) = resolve(word)
    return make_stimulus(entry, preindent_um)


def table(path, times, depth, header="time_ms,displacement_um"):
    rows = (f"{time!r},{value!r}\n" for time, value in np.stack([times, depth], -1).tolist())
    path.write_text(f"{header}\n{''.join(rows)}")
    return path


@pytest.fixture
def tap(tmp_path, monkeypatch):
    """A tap of 200 um, 100 ms long, as ``tap.csv`` in the folder of work."""
    monkeypatch.chdir(tmp_path)
    return table(tmp_path / "tap.csv", TIMES_MS, TAP_UM)


@pytest.mark.parametrize("format_name", list(FORMATS))
@pytest.mark.parametrize("preindent_um", [0.0, 75.0])
def test_what_export_writes_comes_back_in(tmp_path, format_name, preindent_um):
    """A WAV to half a step of its 16 bits, the others to the last digit of a sample."""
    out = made("noise_25_250_10", preindent_um)
    path = tmp_path / f"{out.id}{FORMATS[format_name][0]}"
    scale_um = write_stimulus(out, path, format_name)
    back = read_stimulus(path, preindent_um, dt_ms=0.5 if format_name == "npy" else None)
    step_um = (scale_um or 0.0) / 32767
    off_um = 0.5001 * step_um + (1e-9 if format_name == "marc-table" else 0.0)
    assert_allclose(back.displacement_um, out.displacement_um, rtol=0, atol=off_um)
    assert_allclose(back.preindent_um, preindent_um, rtol=0, atol=off_um)
    assert (back.id, back.dt_ms, back.window_ms) == (out.id, 0.5, (0.0, 250.0))


def test_all_files_of_an_export_share_the_scale_that_travels_with_them(tmp_path, capsys):
    words = ["stimuli", "--export", "wav", "sine_20_250", "sine_20_25", "-o", str(tmp_path)]
    assert main([*words, "--json"]) == 0
    shown = json.loads(capsys.readouterr().out)["files"]
    assert [one["full_scale_um"] for one in shown] == [250.0, 250.0]
    with wave.open(str(tmp_path / "sine_20_25.wav"), "rb") as file:
        pcm = np.frombuffer(file.readframes(501), dtype="<i2")
    assert abs(pcm).max() == round(32767 / 10)
    (tmp_path / "other_name.wav").write_bytes((tmp_path / "sine_20_25.wav").read_bytes())
    weak = read_stimulus(tmp_path / "other_name.wav")
    assert_allclose(weak.displacement_um, made("sine_20_25").displacement_um, atol=0.004)


@pytest.mark.parametrize(
    ("kind", "bits", "code", "peak"),
    [("<i2", 16, 1, 32767), ("<i4", 32, 1, 2**31 - 1), ("<f4", 32, 3, 1), ("u1", 8, 1, 127)],
)
def test_a_wav_of_others_takes_its_scale_by_option(tmp_path, kind, bits, code, peak):
    rate_hz, path = 2000, tmp_path / "shaker.wav"
    samples = TAP_UM / 200 * peak + (128 if kind == "u1" else 0)
    samples = samples if kind == "<f4" else np.rint(samples)
    data = samples.astype(kind).tobytes()
    size = bits // 8
    form = struct.pack("<HHIIHH", code, 1, rate_hz, rate_hz * size, size, bits)
    body = b"WAVEfmt " + struct.pack("<I", 16) + form + b"data" + struct.pack("<I", len(data))
    path.write_bytes(b"RIFF" + struct.pack("<I", len(body) + len(data)) + body + data)

    back = read_stimulus(path, full_scale_um=200.0)

    assert_allclose(back.displacement_um, TAP_UM, rtol=0, atol=100 / min(peak, 32767) + 1e-5)
    with pytest.raises(StimulusError) as refused:
        read_stimulus(path)
    assert (refused.value.argument, refused.value.path) == ("full_scale_um", path)
    path.write_bytes(path.read_bytes()[:-10])
    with pytest.raises(StimulusError, match="cut"):
        read_stimulus(path, full_scale_um=200.0)


def test_seconds_millimetres_and_uneven_times_become_samples_every_half_ms(tmp_path, logged):
    """PCHIP between the samples, said in one line; time counts from the first."""
    rng = np.random.default_rng(5)
    times_s = 3.0 + np.cumsum(rng.uniform(1e-4, 4e-4, 400))
    way = np.sin(2 * np.pi * 20 * (times_s - times_s[0]))
    header = "displacement_mm,note,time_s"
    path = tmp_path / "robot arm.csv"
    rows = (f"{0.2 * w!r},x,{t!r}\n" for w, t in zip(way.tolist(), times_s.tolist(), strict=True))
    path.write_text(f"{header}\n{''.join(rows)}")
    said = logged

    back = read_stimulus(path)

    exact_um = 200 * np.sin(2 * np.pi * 20e-3 * back.times_ms)
    assert_allclose(back.displacement_um, exact_um, rtol=0, atol=0.1)
    assert back.id == "robot_arm"
    assert back.times_ms[-1] == pytest.approx((times_s[-1] - times_s[0]) * 1e3, abs=0.5)
    unused, resampled = said
    assert unused.endswith("columns not used: note")
    assert "400 samples, uneven times, resampled" in resampled


def test_what_lies_above_half_the_rate_is_said(tmp_path, logged):
    times_ms = np.arange(2000) * 0.05
    said = logged
    for hz in (100.0, 3900.0):
        samples = 10 * np.sin(2e-3 * np.pi * hz * times_ms)
        np.save(tmp_path / f"{hz:g}.npy", samples)
    read_stimulus(tmp_path / "100.npy", dt_ms=0.05)
    assert said[0].endswith("one every 0.5 ms")
    with pytest.warns(FembridgeWarning, match="100 % of its power is above 1000 Hz"):
        read_stimulus(tmp_path / "3900.npy", dt_ms=0.05)


def test_the_first_sample_is_where_the_probe_stands_before(tmp_path, logged):
    from_rest = table(tmp_path / "rest.csv", TIMES_MS, TAP_UM)
    deep = table(tmp_path / "deep.csv", TIMES_MS, TAP_UM + 30)
    said = logged
    rest, stands = resolve_stimuli([from_rest, deep], 75.0)
    assert (rest.preindent_um, rest.displacement_um[0]) == (75.0, 75.0)
    assert (stands.preindent_um, stands.displacement_um[0]) == (30.0, 30.0)
    assert ["30 um" in line for line in said] == [True]


def samples_of(stimulus, **options):
    [resolved] = resolve_stimuli(stimulus, **options)
    return resolved


def test_an_array_a_table_and_a_file_are_the_same_waveform(tap):
    """So are a list of these, a Stimulus, and a path; the pre-indentation is added once."""
    frame = pd.DataFrame({"time_ms": TIMES_MS, "displacement_um": TAP_UM})
    array = fb.Waveform(TAP_UM, dt_ms=0.5, name="tap")
    listed = fb.Waveform(TAP_UM.tolist(), dt_ms=0.5)
    rest = fb.Stimulus("tap", TAP_UM, 0.5, (0.0, 100.0))
    for depth_um in (0.0, 75.0):
        expected = samples_of("tap.csv", preindent_um=depth_um)
        assert expected.preindent_um == depth_um
        for waveform in (tap, Path("tap.csv"), frame, array, listed, rest, [array]):
            stimulus = samples_of(waveform, preindent_um=depth_um)
            assert_allclose(stimulus.displacement_um, expected.displacement_um, atol=1e-6)
            assert stimulus.preindent_um == depth_um
            assert stimulus.window_ms == expected.window_ms
    assert samples_of(array).origin["sha256"] == samples_of(listed).origin["sha256"]
    deep = fb.Stimulus("deep", TAP_UM + 30, 0.5, (0.0, 100.0), 30.0)
    assert samples_of(deep, preindent_um=75.0) is deep


def test_a_waveform_takes_the_options_of_the_command(tap):
    [slow] = fb.Waveform("sine_20_250", slide_mm_per_s=4.0, window_ms=(20, 40)).stimuli()
    assert (slow.id, slow.window_ms, slow.aside_um[-1]) == ("sine_20_250_slide_4", (20, 40), 1000.0)
    [noise] = fb.Waveform("noise_25_250_20", seed=7, name="mine").stimuli()
    assert (noise.id, noise.origin["seed"]) == ("mine", 7)
    assert [item.id for item in fb.Waveform(["sine_20_250", "tap.csv"]).stimuli()] == [
        "tap",
        "sine_20_250",
    ]


@pytest.mark.parametrize(
    ("make", "argument"),
    [
        (lambda: resolve_stimuli(TAP_UM), "stimulus"),
        (lambda: resolve_stimuli([1.0, 2.0]), "stimulus"),
        (lambda: resolve_stimuli(5), "stimulus"),
        (lambda: resolve_stimuli([None]), "stimulus"),
        (lambda: resolve_stimuli([fb.Waveform(TAP_UM, dt_ms=0.5)] * 2), "stimulus"),
        (lambda: fb.Waveform(TAP_UM), "dt_ms"),
        (lambda: fb.Waveform(TAP_UM, dt_ms=0), "dt_ms"),
        (lambda: fb.Waveform(TAP_UM, dt_ms=0.5, seed=1), "seed"),
        (lambda: fb.Waveform(pd.DataFrame(), dt_ms=0.5), "dt_ms"),
        (lambda: fb.Waveform("noise_25_250_20", seed=-1), "seed"),
        (lambda: fb.Waveform("sine_20_250", seed=1).stimuli(), "seed"),
        (lambda: fb.Waveform("sine_20_250", dt_ms=1).stimuli(), "dt_ms"),
        (lambda: fb.Waveform("sine_20_250", full_scale_um=1).stimuli(), "full_scale_um"),
        (lambda: fb.Waveform("noise_25_250", name="n").stimuli(), "name"),
        (lambda: fb.Waveform(object(), dt_ms=1), "source"),
        (lambda: fb.Waveform(np.zeros((2, 2)), dt_ms=1), "source"),
    ],
)
def test_a_waveform_that_means_nothing_names_its_argument(make, argument):
    with pytest.raises(UsageError) as refused:
        make()
    assert refused.value.argument == argument


def test_a_waveform_goes_through_every_verb_that_takes_a_stimulus(tap, capsys):
    """`simulate` of a file is `simulate` of its samples; the deck holds them."""
    stimulus = fb.Stimulus("tap", 75 + np.round(TAP_UM, 6), 0.5, (0.0, 100.0), 75.0)
    expected = fb.simulate(stimulus, stored=True).rates
    assert fb.simulate("tap.csv", stored=True).rates.equals(expected)
    assert fb.simulate(tap, stored=True).rates.equals(expected)
    assert main(["simulate", "--waveform", "tap.csv", "--stored", "--no-plot", "-o", "out"]) == 0
    assert (
        tomllib.loads((tap.parent / "out/simulation.toml").read_text())["stimuli"]["tap"]["file"]
        == "tap.csv"
    )

    assert main(["build-deck", "--waveform", "tap.csv", "--preindent-um", "0"]) == 0
    run = read_run_folder(tap.parent / "runs/tap")
    assert run.inputs["stimulus"]["window_ms"] == [0.0, 100.0]
    assert_allclose(read_waveform(run.folder)[1], TAP_UM, rtol=0, atol=1e-6)

    assert main(["stimuli", "tap.csv", "sine_20_250", "--json"]) == 0
    assert main(["plot", "stimulus", "tap.csv", "-o", "tap.svg"]) == 0
    words = ["touch", "--waveform", "tap.csv", "--population", "one_each", "--no-plot"]
    assert main([*words, "-o", "touched"]) == 0
    (tap.parent / "pins.csv").write_text(
        "x_mm,z_mm,diameter_mm,stimulus\n0,0,1,tap.csv\n3,0,1,ramp_100_20_20_20\n"
    )
    assert fb.Trajectory.from_pins("pins.csv").window_ms == (0.0, 210.0)
    assert "not in the appendix" not in capsys.readouterr().err


@pytest.mark.parametrize(
    ("name", "content", "found"),
    [
        ("a.csv", "time,displacement_um\n0,0\n", "time_ms or time_s"),
        ("a.csv", "time_ms,depth\n0,0\n", "displacement_um or displacement_mm"),
        ("a.csv", "time_ms,displacement_um\n0,0\n1,x\n", "a.csv:3: displacement_um is 'x'"),
        ("a.csv", "time_ms,displacement_um\n0,0\n1,1\n1,2\n", "a.csv:4: time does not rise"),
        ("a.csv", "time_ms,displacement_um\n0,0\n1,0\n", "goes 0 um deep"),
        ("a.csv", "time_ms,displacement_um\n0,0\n1,20000\n", "at most 10000 um"),
        ("a.csv", "time_ms,displacement_um\n0,-3\n1,5\n", "starts at -3 um"),
        ("a.npy", "none", "not an NPY"),
        ("a.wav", "none", "not a WAV"),
        ("a.dat", "none\n", "not one whole table"),
        ("a.txt", "none", "expected a waveform in one of .csv, .wav, .npy, .dat"),
    ],
)
def test_what_is_no_waveform_is_refused_in_one_line(tmp_path, name, content, found):
    path = tmp_path / name
    path.write_text(content)
    with pytest.raises((StimulusError, TableError)) as refused:
        fb.Waveform(str(path), **{".npy": {"dt_ms": 0.5}}.get(path.suffix, {})).stimuli()
    message = str(refused.value).replace(f"{tmp_path}/", "")
    assert found in message
    assert len(message) < 300
    assert "\n" not in message


@pytest.mark.parametrize(
    "content", [np.zeros((3, 2)), np.array(["a", "b"]), np.array([1j, 2]), np.array([0, np.nan])]
)
def test_an_npy_of_something_else_is_refused(tmp_path, content):
    np.save(tmp_path / "a.npy", content)
    with pytest.raises(StimulusError, match=r"a\.npy"):
        read_stimulus(tmp_path / "a.npy", dt_ms=0.5)


def test_an_npy_needs_its_step_and_names_are_distinguished(tap, capsys):
    np.save("tap.npy", TAP_UM)
    with pytest.raises(StimulusError) as refused:
        resolve_stimuli("tap.npy")
    assert (refused.value.argument, refused.value.path) == ("dt_ms", Path("tap.npy"))
    with pytest.raises(UsageError, match="'tap'") as refused:
        resolve_stimuli(fb.Waveform("tap.npy,tap.csv", dt_ms=0.5))
    assert refused.value.argument == "stimulus"
    with pytest.raises(FembridgeError, match="absent/tap"):
        resolve_stimuli("absent/tap")
    with pytest.raises(StimulusError) as refused:
        resolve_stimuli(fb.Waveform("tap.csv", window_ms=(0.0, 200.0)))
    assert (refused.value.argument, refused.value.found) == ("window_ms", (0.0, 200.0))


@pytest.mark.parametrize("suffix", [".npy", ".wav", ".npz"])
def test_a_damaged_binary_is_refused_whatever_its_parser_makes_of_it(tmp_path, suffix):
    """Byte after byte of the header: an error of ours in one line, or samples."""
    from fembridge.simulation.encoding import read_stress

    made_of = made("sine_20_250")
    if suffix == ".npz":
        fb.simulate("sine_20_250", stored=True).write(tmp_path)
        whole = (tmp_path / "traces.npz").read_bytes()
    else:
        write_stimulus(made_of, tmp_path / f"a{suffix}", suffix[1:])
        whole = (tmp_path / f"a{suffix}").read_bytes()
    path = tmp_path / f"b{suffix}"
    for place in range(0, 128, 3):
        for byte in (0x00, 0x28, 0xFF):
            path.write_bytes(whole[:place] + bytes([byte]) + whole[place + 1 :])
            try:
                if suffix == ".npz":
                    read_stress(path)
                else:
                    read_stimulus(path, dt_ms=0.5)
            except FembridgeError as error:
                assert len(str(error).replace(str(tmp_path), "")) < 300
                assert "\n" not in str(error)


def test_a_long_waveform_is_bounded(tmp_path):
    path = tmp_path / "long.npy"
    np.save(path, np.sin(np.arange(MAX_SAMPLES) * 1e-2))
    assert read_stimulus(path, dt_ms=0.5).displacement_um.size == MAX_SAMPLES
    with pytest.raises(StimulusError) as caught:
        read_stimulus(path, dt_ms=0.6)
    assert caught.value.found == pytest.approx(120_000)
    assert caught.value.path == path


def test_a_depth_before_time_0_that_no_waveform_takes_is_refused(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("deep.csv").write_text("time_ms,displacement_um\n0,30\n10,80\n20,30\n", encoding="utf-8")
    for make in (
        lambda depth_um: fb.simulate("deep.csv", stored=True, preindent_um=depth_um),
        lambda depth_um: fb.build_deck("deep.csv", "runs", preindent_um=depth_um),
    ):
        with pytest.raises(UsageError, match="30 um") as refused:
            make(75.0)
        assert (refused.value.argument, refused.value.found) == ("preindent_um", 75.0)
        with pytest.warns(FembridgeWarning, match=r"75 um \(here: 30 um\)"):
            make(30.0)


def chunk(name, content):
    return name + struct.pack("<I", len(content)) + content + b"\0" * (len(content) % 2)


@pytest.fixture
def wav(tmp_path):
    """Content of a WAV with the chunks of one that `stimuli` exports."""
    write_stimulus(made("sine_50_250"), tmp_path / "a.wav", "wav")
    return (tmp_path / "a.wav").read_bytes()


def test_a_wav_whose_sizes_do_not_fit_is_refused_and_bytes_behind_it_are_named(tmp_path, wav):
    path = tmp_path / "b.wav"
    whole = read_stimulus(tmp_path / "a.wav").displacement_um
    size_at = wav.index(b"data") + 4
    stated = struct.unpack("<I", wav[size_at : size_at + 4])[0]
    for size in (0, stated - 100, stated - 2, stated + 2, 2**32 - 2):
        path.write_bytes(wav[:size_at] + struct.pack("<I", size) + wav[size_at + 4 :])
        with pytest.raises(StimulusError, match=r"damaged|cut"):
            read_stimulus(path)
    for size in (len(wav) + 8, 2**32 - 1, 100):
        path.write_bytes(wav[:4] + struct.pack("<I", size) + wav[8:])
        with pytest.raises(StimulusError, match=r"damaged|cut"):
            read_stimulus(path)
    path.write_bytes(wav + b"ID3 of a player")
    with pytest.warns(FembridgeWarning, match="15 bytes after the end"):
        assert_allclose(read_stimulus(path).displacement_um, whole)
    listed = wav[12:] + chunk(b"bext", b"odd")  # of others, with a byte to make it even
    path.write_bytes(b"RIFF" + struct.pack("<I", 4 + len(listed)) + b"WAVE" + listed)
    assert_allclose(read_stimulus(path).displacement_um, whole)


def npy(shape, kind, data):
    header = f"{{'descr': {kind!r}, 'fortran_order': False, 'shape': {shape}, }}"
    return b"\x93NUMPY\x01\0" + struct.pack("<H", len(header) + 1) + header.encode() + b"\n" + data


@pytest.mark.parametrize(
    ("shape", "kind", "count"),
    [
        ("(1000000000000,)", "<f8", 10),
        ("(99999999999999999999,)", "<f8", 10),
        ("(9,)", "<f8", 10),
        ("(11,)", "<f8", 10),
        ("(-10,)", "<f8", 10),
        ("(10,)", "|O", 10),
        ("(10,)", "<c16", 20),
        ("(10,)", "<f4", 10),
        ("(10,)", ">f8", 10),
        ("(2, 5)", "<f8", 10),
        ("()", "<f8", 1),
    ],
)
def test_an_npy_whose_header_is_not_of_its_bytes_is_refused(tmp_path, shape, kind, count):
    path = tmp_path / "a.npy"
    path.write_bytes(npy("(10,)", "<f8", np.arange(10.0).tobytes()))
    assert read_stimulus(path, dt_ms=0.5).displacement_um.tolist() == np.arange(10.0).tolist()
    path.write_bytes(npy(shape, kind, np.arange(float(count)).tobytes()))
    with pytest.raises(StimulusError, match=r"a\.npy"):
        read_stimulus(path, dt_ms=0.5)


def test_a_waveform_of_more_samples_than_the_memory_takes_is_refused(tmp_path, wav, monkeypatch):
    monkeypatch.setenv("FEMBRIDGE_MEMORY", "10K")
    np.save(tmp_path / "a.npy", np.arange(501.0))
    for name, dt_ms in (("a.wav", None), ("a.npy", 0.5)):
        with pytest.raises(StimulusError, match="FEMBRIDGE_MEMORY"):
            read_stimulus(tmp_path / name, dt_ms=dt_ms)


def test_a_fine_waveform_is_resampled_as_by_all_its_samples():
    """PCHIP of the samples beside each new one is that of all, to the bit."""
    rng = np.random.default_rng(2)
    for count, step_ms in ((2000, 0.01), (1999, 0.3), (50, 2.0), (3, 4.0), (2, 5.0)):
        times_ms = np.cumsum(rng.uniform(0.5, 1.5, count)) * step_ms
        values = rng.normal(size=(count, 2))
        even_ms, resampled = resample(times_ms, values, 0.5)
        exact = PchipInterpolator(times_ms, values, axis=0)(even_ms)
        np.testing.assert_array_equal(resampled, exact)


def test_a_sample_that_is_lost_is_named_also_where_nobody_reads_the_log(tmp_path):
    kept = np.arange(TIMES_MS.size) != 70
    table(tmp_path / "lost.csv", TIMES_MS[kept], TAP_UM[kept])
    with pytest.warns(FembridgeWarning, match="the first from 34.5 to 35.5 ms: samples lost"):
        read_stimulus(tmp_path / "lost.csv")
    table(tmp_path / "s.csv", TIMES_MS, TAP_UM, "time_s,displacement_um")
    with pytest.warns(FembridgeWarning, match="in which unit is the time"):
        read_stimulus(tmp_path / "s.csv")


@pytest.mark.parametrize(
    ("header", "row"),
    [
        ("time_s,displacement_um", "1e306,3"),
        ("time_ms,displacement_mm", "1,1e306"),
        ("time_ms,displacement_um", "1e308,3"),
        ("time_ms,displacement_um", "1_0,3"),
        ("time_ms,displacement_um", "1,\u0663"),
    ],
)
def test_a_number_of_a_waveform_is_finite_in_its_unit(tmp_path, header, row):
    path = tmp_path / "a.csv"
    path.write_text(f"{header}\n0,0\n{row}\n", encoding="utf-8")
    with pytest.raises((StimulusError, TableError), match=r"a\.csv"):
        read_stimulus(path)


def test_a_micro_sign_in_a_name_is_answered_with_the_right_one(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("time_ms,displacement_\N{MICRO SIGN}m\n0,0\n1,2\n", encoding="utf-8")
    with pytest.raises(StimulusError, match="did you mean"):
        read_stimulus(path)


def test_a_marc_table_cut_in_its_last_number_is_refused(tmp_path):
    path = tmp_path / "a.marc.dat"
    write_stimulus(made("sine_50_250"), path, "marc-table")
    whole = path.read_bytes()
    path.write_bytes(whole[:-1])
    with pytest.warns(FembridgeWarning, match="may be cut"):
        read_stimulus(path)
    path.write_bytes(whole[:-3])
    with pytest.warns(FembridgeWarning), pytest.raises(StimulusError, match="not one whole table"):
        read_stimulus(path)
