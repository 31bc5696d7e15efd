"""Which materials meet at a node, and refusing the stress there."""

import shutil

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fembridge.errors import ResultError
from fembridge.results import frd
from fembridge.results.byte_file import ByteFile
from fembridge.results.frd_format.index import index_frd
from fembridge.results.frd_format.mesh import NODES_OF_TYPE, materials_at
from fembridge.results.read_options import ReadOptions

ELEMENTS = st.lists(
    st.tuples(st.sampled_from(sorted(NODES_OF_TYPE)), st.integers(1, 3)), min_size=1, max_size=30
)


@settings(deadline=None)
@given(kinds=ELEMENTS, mesh_flag=st.sampled_from([1, 2]), seed=st.integers(0, 99))
def test_any_mix_of_element_types_gives_what_a_plain_loop_gives(write_frd, kinds, mesh_flag, seed):
    rng, nodes = np.random.default_rng(seed), list(range(1, 41))
    elements = [
        (kind, material, rng.integers(1, 41, NODES_OF_TYPE[kind]).tolist())
        for kind, material in kinds
    ]
    path = write_frd([], nodes=nodes, elements=elements, mesh_flag=mesh_flag)
    with ByteFile(path) as file:
        index = index_frd(file)
        found = materials_at(file, index.elements, nodes)
    assert index.ended
    assert not index.damage
    assert found == {
        node: {material for _, material, corners in elements if node in corners} for node in nodes
    }


@pytest.mark.parametrize("mesh_flag", [1, 2])
def test_a_mesh_larger_than_a_chunk_is_read_whole(write_frd, mesh_flag, monkeypatch):
    monkeypatch.setattr("fembridge.results.frd_format.element.CHUNK_BYTES", 256)
    elements = [(9, 1 + (k == 77), (k, k + 1, k + 2, k + 3)) for k in range(1, 99)]
    path = write_frd([], elements=elements, mesh_flag=mesh_flag)
    with ByteFile(path) as file:
        found = materials_at(file, index_frd(file).elements, [5, 77, 98, 99])
    assert found == {5: {1}, 77: {1, 2}, 98: {1}, 99: {1}}


def test_a_node_between_two_layers_is_refused_by_name(samples):
    """Node 18 of the two-layer block: uniform stretch gives 0.01126 MPa there,
    which is neither the 0.00055 of one layer nor the 0.022 of the other."""
    words = r"node 18 lies between EPI and DER.*--across-materials"
    for name in ("cpe4_ascii", "cpe4_bin_f32", "cpe4_2step_mixed"):
        with pytest.raises(ResultError, match=words):
            frd.read_stress_tensor(samples / f"{name}.frd", [11, 18])


def test_the_boundary_is_let_through_when_asked_for(samples):
    options = ReadOptions(across_materials=True)
    _, tensor_pa = frd.read_stress_tensor(samples / "cpe4_ascii.frd", [18], options)
    assert tensor_pa.shape == (4, 1, 6)


def test_displacement_on_a_boundary_is_as_good_as_elsewhere(samples):
    _, displacement_mm = frd.read_displacement(samples / "cpe4_ascii.frd", [18])
    assert displacement_mm.shape == (4, 1, 3)


def test_a_word_in_place_of_the_material_number_is_no_material(samples, tmp_path):
    """As in old files, which write ``0EL`` there."""
    path = tmp_path / "old.frd"
    shutil.copy(samples / "cpe4_ascii.frd", path)
    content = path.read_bytes()
    start, end = content.index(b"    3C"), content.index(b"    1PSTEP")
    mesh = content[start:end]
    for number in (b"1", b"2", b"3"):
        mesh = mesh.replace(b"    9    0    " + number, b"    9    0   EL")
    path.write_bytes(content[:start] + mesh + content[end:])
    assert frd.read_stress_tensor(path, [18])[1].shape == (4, 1, 6)


@pytest.mark.parametrize("mesh_flag", [1, 2])
def test_an_element_block_of_wrong_count_is_told(write_frd, block, mesh_flag):
    path = write_frd([block("STRESS", 1, 1e-3, [(1, [1] * 6)])], mesh_flag=mesh_flag)
    content = path.read_bytes()
    at = content.index(b"    3C") + 24
    path.write_bytes(content[:at] + b"%12d" % 2 + content[at + 12 :])
    with pytest.raises(ResultError, match="element block"):
        frd.read_stress_tensor(path, [1])
