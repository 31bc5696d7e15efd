"""The pad of a mesh: closed forms of a half-space, directions of shapes, its file, its parts."""

import json
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial import cKDTree

import fembridge as fb
from decks.material_law import LinearElastic, Ogden, Polynomial, stress_change
from decks.shape_functions import BEST_POINTS, EDGES, shape_functions
from fembridge.errors import DeckError, FembridgeWarning, ResponseError, UsageError
from fembridge.response.response_map import write_map
from fembridge.touching.contact import press_to
from fembridge.touching.mesh_pad import MappedSkin, fit_weights
from fembridge.touching.pad_file import checksum
from fembridge.touching.shape import Shape
from fembridge.touching.stress import sa_stress_pa, von_mises_pa
from tests.fembridge.touching.mesh_models import YOUNG_MPA, block_deck, half_space

PAD = half_space()
MODULUS_MPA, RADIUS_MM = YOUNG_MPA / 0.75, 4.0


def hertz_n(depth_mm):
    return 4 / 3 * MODULUS_MPA * RADIUS_MM**0.5 * depth_mm**1.5


def axis_stress_pa(nodes, forces, depth_mm):
    place = np.array(["RUBBER"]), np.zeros(1), np.zeros(1), np.array([depth_mm])
    return nodes.pad.influence_pa(nodes, *place), forces


@pytest.mark.parametrize("depth_mm", [0.05, 0.1])
def test_a_ball_on_a_half_space_is_hertz(depth_mm):
    nodes, forces, _ = press_to(PAD, Shape.sphere(2 * RADIUS_MM), np.array([1e3 * depth_mm]))
    assert_allclose(forces.sum(), hertz_n(depth_mm), rtol=0.02)
    radius_mm = (RADIUS_MM * depth_mm) ** 0.5
    pressure = 1.5 * hertz_n(depth_mm) / (np.pi * radius_mm**2)
    assert_allclose((forces[0] / nodes.area_mm2).max(), pressure, rtol=0.03)
    # On the axis of an incompressible half-space; Johnson 1985, eq. (3.45).
    ratio = 0.5 / radius_mm
    along = -1 / (1 + ratio**2)
    beside = -1.5 * (1 - ratio * np.arctan(1 / ratio)) + 0.5 / (1 + ratio**2)
    expected_pa = 1e6 * pressure * abs(along - beside)
    influence, _ = axis_stress_pa(nodes, forces, 0.5)
    assert_allclose(von_mises_pa(influence, forces)[0, 0], expected_pa, rtol=0.03)


def test_a_shape_from_a_direction_meets_a_turned_skin_as_a_flat_one_from_above():
    turned, level = half_space(turn_deg=-25.0), np.array([60.0, 100.0])
    from_above = press_to(PAD, Shape.punch(0.7), level)
    seen = turned.seen_from((25.0, 0.0), (0.0, 0.0))
    nodes, forces, _ = press_to(seen, Shape.punch(0.7), level)
    assert_allclose(forces, from_above[1], rtol=1e-3, atol=1e-6)
    normal = seen.normal_at(np.zeros(1), np.zeros(1))
    assert_allclose(normal, [[np.sin(np.radians(25)), np.cos(np.radians(25)), 0]], atol=1e-9)
    sa = [
        sa_stress_pa(
            axis_stress_pa(*pressed[:2], 0.5)[0], pressed[1], pad.normal_at(*np.zeros((2, 1)))
        )
        for pad, pressed in ((PAD, from_above), (seen, (nodes, forces)))
    ]
    assert_allclose(sa[1], sa[0], rtol=5e-3)


def test_an_oblique_ball_is_hertz_along_the_normal():
    tilt, radius_mm, depth_mm = np.radians(30.0), 1.5, 0.1
    seen = PAD.seen_from((0.0, 30.0), (0.2, -0.6))
    nodes, forces, _ = press_to(seen, Shape.sphere(2 * radius_mm), np.array([1e3 * depth_mm]))
    expected_n = hertz_n(depth_mm * np.cos(tilt)) * (radius_mm / RADIUS_MM) ** 0.5
    assert_allclose(forces.sum(), expected_n * np.cos(tilt), rtol=0.03)
    middle = (forces @ np.stack([nodes.x_mm, nodes.z_mm], -1))[0] / forces.sum()
    # The middle of the ball aims at the point, and is a radius above the skin when it touches;
    # then it goes on along its direction.
    aside_mm = (radius_mm - depth_mm * np.cos(tilt)) * np.tan(tilt)
    assert_allclose(middle, [0.2, -0.6 + aside_mm], atol=0.06)


def test_drag_needs_the_tangents_of_the_skin():
    nodes = PAD.skin_nodes()
    assert_allclose(nodes.compliance((0.4, 0.3)).matrix, nodes.compliance().matrix)  # no tables
    tables = PAD.down_mm.copy()
    tables[0], tables[2] = 0.1 * tables[1], 0.2 * tables[1]
    dragged = replace(PAD, down_mm=tables).skin_nodes().compliance((0.4, 0.3)).matrix
    assert_allclose(dragged, (1 + 0.04 + 0.06) * nodes.compliance().matrix, rtol=1e-5)


@pytest.mark.filterwarnings("ignore::fembridge.errors.FembridgeWarning")
def test_a_touch_is_written_and_read_with_its_direction(tmp_path):
    path = tmp_path / "pad.npz"
    PAD.write(path)
    touched = fb.touch(
        "sphere:diameter_mm=8", press_um=100, pad=path, population="one_each", tilt_deg=(10, 5)
    )
    touched.write(tmp_path / "out")
    again = fb.Touch.read(tmp_path / "out")
    assert_allclose(again.stress_pa, touched.stress_pa)
    assert again.contact.nodes.pad.pose == {"tilt_deg": [10, 5], "at_mm": [0, 0]}
    assert touched.population.afferent == ("SA", "RA", "PC")
    assert touched.plot().axes and touched.stress_pa.max() > 0


def test_a_prism_is_touched_from_above_alone():
    with pytest.raises(UsageError) as error:
        fb.touch("punch", press_um=100, tilt_deg=(10, 0))
    assert error.value.argument == "tilt_deg"


@pytest.mark.filterwarnings("ignore:parameter set")
def test_contact_at_the_border_is_reported():
    with pytest.warns(FembridgeWarning, match="border"):
        fb.touch("plate", press_um=50, pad=PAD, population="one_each")


@pytest.mark.filterwarnings("ignore:parameter set")
def test_units_away_from_the_points_with_stress_are_refused():
    for table, found in (
        (fb.Population.at(["SA"], [3.0], [0.0], finger=PAD), "x = 3"),
        (fb.Population.at(["SA"], [0.0], [0.0], [2.0], finger=PAD), "2 mm deep"),
    ):
        with pytest.raises(UsageError, match=found):
            fb.touch("punch", press_um=100, pad=PAD, population=table)
    without_ra = replace(PAD, sites={name: PAD.sites[name] for name in ("SA", "PC")})
    assert fb.Population.one_each(finger=without_ra).afferent == ("SA", "PC")
    with pytest.raises(UsageError) as error:
        fb.Population.one_each(afferents=("RA",), finger=without_ra)
    assert error.value.found == "RA"
    everywhere = fb.Population.fingertip(density=20, finger=PAD)
    assert np.abs([everywhere.x_mm, everywhere.z_mm]).max() <= 1.01


@pytest.mark.filterwarnings("ignore::fembridge.errors.FembridgeWarning")
def test_a_receptive_field_of_a_mesh_is_pressed_everywhere():
    field = fb.receptive_field(
        "SA", units=1, depth_um=[300], times_threshold=[], step_mm=0.5, probe_diameter_mm=0.5,
        pad=PAD, endings_mm=0.0,
    )  # fmt: skip
    (impulses,) = field.impulses
    assert impulses.shape == (1, 3, 3)
    assert impulses[0, 1, 1] == impulses.max() > impulses[0, 0, 0]
    assert_allclose(impulses, impulses[:, ::-1, ::-1])


@pytest.mark.filterwarnings("ignore:parameter set")
def test_the_response_of_a_mesh_to_the_pin_gives_thresholds(tmp_path):
    response = fb.PadProbe(pad=PAD).response
    # A flat round punch of 1 mm, before its edge meets the skin beside it; Boussinesq 1885.
    stiffness = response.force_n[1:4] / response.depth_um[1:4]
    assert_allclose(stiffness, 1e-3 * MODULUS_MPA * 1.0, rtol=0.01)
    write_map(tmp_path / "response.toml", response)
    thresholds = fb.threshold(response=tmp_path / "response.toml", frequencies_hz=[50])
    assert set(thresholds.table["afferent"]) == {"SA", "RA", "PC"}


# ---- Its file


def test_a_pad_comes_back_from_its_file_and_an_altered_one_does_not(tmp_path):
    path = tmp_path / "pad.npz"
    PAD.write(path)
    again = fb.Pad.read(path)
    assert_allclose(again.down_mm, PAD.down_mm, rtol=2**-15)
    for part in np.ndindex(PAD.stress.shape[:2]):  # as a whole it takes half a gigabyte
        ours, theirs = (stress[part].astype(np.float32) for stress in (again.stress, PAD.stress))
        assert_allclose(ours, theirs, rtol=2**-6, atol=1e-6)
    assert again.sites == PAD.sites and again.layers == PAD.layers
    with np.load(path) as stored:
        arrays = dict(stored)
    for name, altered in (
        ("mirror_node", np.roll(arrays["mirror_node"], 1)),
        ("mirror_point", arrays["mirror_point"] + 1),
        ("mirror_node", np.arange(PAD.node.size)),
        ("down_mm", 1.01 * arrays["down_mm"]),
        ("triangles", arrays["triangles"][:-1]),
        ("stress", arrays["stress"][:, :5]),
    ):
        np.savez_compressed(path, **{**arrays, name: altered})
        with pytest.raises(ResponseError, match=str(path)):
            fb.Pad.read(path)


@pytest.mark.parametrize("turn_deg", [0.0, 20.0])
def test_a_pad_that_is_its_own_mirror_image_is_stored_by_half(tmp_path, turn_deg):
    """Forces along the tangents change their sign across the finger, shear with x too."""
    rng = np.random.default_rng(6)
    pad = half_space(nodes=9, turn_deg=turn_deg)
    image = cKDTree(pad.position_mm).query(pad.position_mm * [-1.0, 1.0, 1.0])[1]
    points = cKDTree(pad.point_mm).query(pad.point_mm * [-1.0, 1.0, 1.0])[1]
    down_mm, stress = pad.down_mm.copy(), pad.stress.copy()
    for force, sign in ((0, -1.0), (2, 1.0)):
        table = rng.normal(size=down_mm[0].shape)
        down_mm[force] = table + sign * table[image][:, image]
        for component, turned in enumerate((1, 1, 1, -1, 1, -1)):
            table = rng.uniform(-0.4, 0.4, size=stress[0, 0].shape)
            stress[force, component] = table + sign * turned * table[points][:, image]
    replace(pad, down_mm=down_mm, stress=stress).write(tmp_path / "pad.npz")
    again = fb.Pad.read(tmp_path / "pad.npz")
    with np.load(tmp_path / "pad.npz") as stored:
        shapes = stored["down_mm"].shape, stored["stress"].shape
    half = (45, 45 * 3) if turn_deg == 0 else (81, 81 * 3)
    assert shapes == ((3, 81, half[0]), (3, 6, half[1], 81))
    assert_allclose(again.down_mm, down_mm, rtol=2**-6)
    assert_allclose(again.stress.astype(float), stress.astype(float), rtol=2**-6, atol=1e-6)


def test_two_layers_may_share_their_points_in_a_pad_that_is_its_own_mirror_image(tmp_path):
    pad = half_space(nodes=5, depths_mm=(0.5,))
    shared = replace(
        pad,
        point_mm=np.tile(pad.point_mm, (2, 1)),
        point_layer=np.repeat([0, 1], 25),
        point_depth_mm=np.full(50, 0.5),
        layers=("RUBBER", "SAME"),
        stress=np.concatenate([pad.stress, pad.stress], axis=2),
        stress_scale_pa=np.tile(pad.stress_scale_pa, (1, 1, 2, 1)),
    )
    shared.write(tmp_path / "pad.npz")
    with np.load(tmp_path / "pad.npz") as stored:
        assert stored["stress"].shape == (3, 6, 2 * 15, 25)
    again = fb.Pad.read(tmp_path / "pad.npz")
    assert_allclose(again.stress.astype(float), shared.stress.astype(float), rtol=2**-6, atol=1e-6)


def test_a_file_of_the_first_format_is_read(tmp_path):
    whole = half_space(nodes=9, turn_deg=20.0)
    path = tmp_path / "first.npz"
    whole.write(path)
    with np.load(path) as stored:
        arrays = {
            name: array
            for name, array in stored.items()
            if name not in ("mirror_node", "mirror_point", "outline_mm", "sha256")
        }
    about = json.loads(str(arrays.pop("about"))) | {"format": 1}
    text = json.dumps(about, sort_keys=True)
    np.savez_compressed(path, about=text, sha256=checksum(text, arrays), **arrays)
    again = fb.Pad.read(path)
    assert_allclose(again.down_mm, whole.down_mm, rtol=2**-15)
    assert again.outline_mm.shape == (0, 4)


# ---- Its parts


def natural_nodes(kind):
    """Natural coordinates of the nodes of an element."""
    square = ((-1, -1), (1, -1), (1, 1), (-1, 1))
    corners = {
        "tet": [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]],
        "wedge": [[x, y, z] for z in (-1, 1) for x, y in ((0, 0), (1, 0), (0, 1))],
        "hex": [[x, y, z] for z in (-1, 1) for x, y in square],
    }
    family = kind.rstrip("0123456789")
    at = np.array(corners[family], dtype=float)
    if int(kind.removeprefix(family)) > len(at):
        at = np.concatenate([at, [(at[a] + at[b]) / 2 for a, b in EDGES[family]]])
    return at


@pytest.mark.parametrize("kind", list(BEST_POINTS))
def test_shape_functions_are_one_at_their_node_and_slopes_are_theirs(kind):
    at = natural_nodes(kind)
    values = np.stack([shape_functions(kind, point)[0] for point in at])
    assert_allclose(values, np.eye(len(at)), atol=1e-12)
    point, step = np.array([0.2, 0.3, 0.15]), 1e-6
    slope = shape_functions(kind, point)[1]
    for axis in range(3):
        ahead, behind = (
            shape_functions(kind, point + sign * step * np.eye(3)[axis])[0] for sign in (1, -1)
        )
        assert_allclose(slope[:, axis], (ahead - behind) / (2 * step), atol=1e-8)


def test_hyperelastic_laws_begin_as_linear_elasticity():
    identity = np.eye(3)[None]
    shear, bulk = 0.07, 1.3
    linear = LinearElastic(
        9 * bulk * shear / (3 * bulk + shear), (3 * bulk - 2 * shear) / (6 * bulk + 2 * shear)
    )
    for law in (
        Polynomial(((1, 0, shear / 2),), (2 / bulk,)),
        Polynomial(((1, 0, shear / 3), (0, 1, shear / 6)), (2 / bulk,)),
        Ogden(((0.6 * shear, 3.0), (0.4 * shear, -2.0)), (2 / bulk,)),
    ):
        expected = stress_change(linear, identity)
        assert_allclose(stress_change(law, identity), expected, atol=1e-6 * bulk)


def test_ogden_with_power_two_is_neo_hooke_at_any_strain():
    gradient = np.eye(3) + np.random.default_rng(3).normal(scale=0.2, size=(5, 3, 3))
    neo_hooke = Polynomial(((1, 0, 0.05),), (1.0,))
    assert_allclose(
        Ogden(((0.1, 2.0),), (1.0,)).cauchy(gradient), neo_hooke.cauchy(gradient), rtol=1e-9
    )


def test_a_fit_brings_a_quadratic_back_in_space_and_on_a_surface():
    rng = np.random.default_rng(1)
    points, places = rng.uniform(-1, 1, (400, 3)), rng.uniform(-0.5, 0.5, (20, 3))

    def quadratic(at):
        x, y, z = at.T
        return 1 + 2 * x - y + 0.5 * z + x * y - z**2 + 0.3 * x * z

    near, weight = fit_weights(cKDTree(points), places, 32)
    assert_allclose((quadratic(points)[near] * weight).sum(axis=1), quadratic(places), atol=1e-4)
    points[:, 1] = 0.0
    near, weight = fit_weights(cKDTree(points), places * [1, 0, 1], 24)
    expected = quadratic(places * [1, 0, 1])
    assert_allclose((quadratic(points)[near] * weight).sum(axis=1), expected, atol=1e-4)


def test_the_place_of_the_skin_over_a_point_is_found_on_a_sphere():
    angle = np.linspace(-0.8, 0.8, 81)
    x, z = (each.ravel() for each in np.meshgrid(np.sin(angle), np.sin(angle)))
    x, z = x[np.hypot(x, z) < 0.85], z[np.hypot(x, z) < 0.85]
    normal = np.stack([x, np.sqrt(1 - x**2 - z**2), z], -1)
    skin = MappedSkin(4 * normal - [0, 4, 0], normal)
    directions = np.array([[0.1, 1, 0.2], [0.3, 1, -0.2]])
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    places, depth_mm = skin.below(3.2 * directions - [0, 4, 0])
    assert_allclose(places, 4 * directions[:, [0, 2]], atol=2e-3)
    assert_allclose(depth_mm, 0.8, atol=2e-3)


# ---- What is refused before anything is solved


@pytest.mark.parametrize(
    ("settings", "argument"),
    [
        ({"skin": None}, "skin"),
        ({"skin": "NOSE"}, "skin"),
        ({"skin": "INNER"}, "skin"),  # no outer face
        ({"after_step": 3}, "after_step"),
        ({"ridges": True}, "ridges"),
        ({"finger": "paper"}, "finger"),
        ({"afferents": {"XX": "0.5"}}, "afferents"),
        ({"afferents": "RUBBER:deep"}, "afferents"),
    ],
)
def test_a_request_that_a_deck_cannot_serve_is_refused(tmp_path, settings, argument):
    deck = tmp_path / "mine.inp"
    deck.write_text(block_deck())
    with pytest.raises((DeckError, UsageError)) as error:
        fb.make_pad(**{"base_deck": deck, "skin": "TOP", **settings})
    assert error.value.argument == argument


def test_steps_that_cannot_be_linearised_are_named_by_their_line(tmp_path):
    deck = tmp_path / "mine.inp"
    for step in ("*STEP\n*FREQUENCY\n2\n*END STEP\n", "*STEP, PERTURBATION\n*STATIC\n*END STEP\n"):
        text = block_deck(more=step)
        deck.write_text(text)
        with pytest.raises(
            DeckError, match=f"line {text[: text.index('*STEP')].count(chr(10)) + 1}"
        ):
            fb.make_pad(base_deck=deck, skin="TOP", after_step=1)
