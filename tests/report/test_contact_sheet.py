"""The contact sheet of a lift says what its colours mean."""

import numpy as np
import pytest

from cltransfer.report.contact_sheet import FOUND, GREEN, LEGEND, SEEN, _legend


@pytest.mark.parametrize("width", [320, 640, 2560])
def test_the_legend_is_a_line_in_the_colours_that_it_explains_and_fits(width: int) -> None:
    line = _legend(width)
    assert line.shape == (LEGEND, width, 3)
    assert not line[:, -4:].any()
    for colour in (GREEN, SEEN, FOUND):
        assert float(np.abs(line.reshape(-1, 3).astype(int) - colour).sum(1).min()) < 120
