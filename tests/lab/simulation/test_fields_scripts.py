"""The scripts that print how the fields compare: what they measure, on fields that are known."""

from tests.scripts import load_script

maps = load_script("field_maps")


def test_only_the_printed_cylinder_is_no_field():
    for patch in maps.all_patches(1):
        _, _, size, div, rot, added = maps.measure_patch(patch, 0.1, seed=0, count=300)
        assert size > 0
        assert added > 0
        printed = patch.name == "cylinder, as printed"
        assert (div > 0.1) == (rot > 0.1) == printed, patch.name
        assert printed or max(div, rot) < 1e-4, patch.name
