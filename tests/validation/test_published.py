"""ksd against every published and independent number."""

import pytest
from published_bank import ROWS


def test_every_number_has_its_own_name():
    assert len({(row.group, row.what) for row in ROWS}) == len(ROWS) > 100


@pytest.mark.parametrize("row", ROWS, ids=lambda row: f"{row.group}: {row.what}")
def test_number(row):
    assert row.ask() == pytest.approx(row.value, rel=row.within), row.source
