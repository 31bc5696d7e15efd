"""The families: every stimulus of the catalogue once, in the panels of the paper."""

from decks.stimuli import CATALOGUE
from fembridge.validation.family import FAMILIES


def test_every_stimulus_of_the_catalogue_is_in_one_set_of_one_family():
    found = [id_ for family in FAMILIES for id_ in family.stimuli]
    assert found == [entry.id for entry in CATALOGUE]


def test_a_set_is_named_by_what_its_stimuli_share_and_its_levels_rise():
    for family in FAMILIES:
        for one in family.sets:
            assert all(id_.startswith(f"{one.name}_") for id_ in one.stimuli)
            assert list(one.level_um) == sorted(set(one.level_um))


def test_panels_are_titled_as_in_the_paper():
    titles = [[one.title for one in family.sets] for family in FAMILIES]
    assert titles == [
        ["20 Hz", "50 Hz", "100 Hz", "300 Hz"],
        ["10 + 50 Hz", "10 + 100 Hz", "50 + 250 Hz", "50 + 500 Hz"],
        ["5–25 Hz", "5–100 Hz", "25–250 Hz", "25–500 Hz", "50–500 Hz"],
    ]


def test_the_level_is_the_number_that_the_id_ends_in():
    for entry in CATALOGUE:
        assert float(entry.id.rpartition("_")[2]) == entry.level_um
