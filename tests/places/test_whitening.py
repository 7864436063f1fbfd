"""What is compared: sources below and above a path, equal weight to all wavelengths, a quiet field without a say."""

from dataclasses import replace

import numpy as np

from fg_nav.places.signature import BLOCK, remove_common_field, whiten
from tests.places.floors import LOOP, OPEN, Floor, along, carry

BELOW, LEFT, ABOVE = 0, 1, 2


def test_features_have_unit_variance_and_whole_blocks_and_a_homogeneous_field_no_signal():
    floor = Floor.draw(2)
    features, quiet = (
        whiten(carry(one, along(OPEN))) for one in (floor, replace(floor, strength=0.0 * floor.strength))
    )
    assert len(features) % BLOCK == 0
    assert np.all(np.abs(features.values.std(axis=0) - 1.0) < 0.15)
    assert quiet.signal.mean() < 0.5 * features.signal.mean()


def test_a_source_under_the_path_is_seen_in_one_component():
    walk = carry(Floor.draw(2), along(OPEN))
    deviation = remove_common_field(walk.field, walk.heading)
    spectrum = np.fft.rfft(deviation * np.hanning(len(deviation))[:, None], axis=0)
    below, above = spectrum[:, 2] + 1j * spectrum[:, 0], spectrum[:, 2] - 1j * spectrum[:, 0]
    assert np.sum(np.abs(below) ** 2) > 2.0 * np.sum(np.abs(above) ** 2)


def test_the_reversed_walk_has_the_reversed_features():
    place = along(LOOP)
    there, back = (whiten(carry(Floor.draw(3), p, noise_uT=0.0)) for p in (place, place[::-1]))
    points = len(carry(Floor.draw(3), place))
    turned = back.reverse().values[-points:]
    for component in (BELOW, LEFT):
        one = there.values[30:150, component]
        shifted = [turned[30 + k : 150 + k, component] for k in (-1, 0, 1)]
        assert max(np.corrcoef(one, other)[0, 1] for other in shifted) > 0.9
