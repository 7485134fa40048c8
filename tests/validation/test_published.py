"""ksd against every published and independent number of `published_joints`, `published_beams` and `published_planar`."""

import published_beams
import published_joints
import published_planar
import pytest

ROWS = [*published_beams.ROWS, *published_joints.ROWS, *published_planar.ROWS]


def test_every_number_has_its_own_name():
    assert len({(row.group, row.what) for row in ROWS}) == len(ROWS) > 100


@pytest.mark.parametrize("row", ROWS, ids=lambda row: f"{row.group}: {row.what}")
def test_number(row):
    assert row.ask() == pytest.approx(row.value, rel=row.within), row.source
