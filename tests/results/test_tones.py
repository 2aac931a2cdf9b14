"""What stands in pictures of two tones."""

import numpy as np
import pytest

from sbfem_petsc.indicators import Sidebands
from sbfem_petsc.plot import plot_sidebands
from sbfem_petsc.plot.lines import _line_name


def test_sidebands():
    """Stems at carrier -+ n modulation, as high as the amplitudes, in kHz and nm."""
    found = Sidebands(3000.0, 400.0, 20e-9j, np.array([2e-9, 5e-10]), np.array([-3e-9, 4e-10j]))
    axes = plot_sidebands(found)
    x, y = axes.lines[0].get_data()
    np.testing.assert_allclose(x, [2.2, 2.6, 3.0, 3.4, 3.8], rtol=1e-12)
    np.testing.assert_allclose(y, [0.5, 2.0, 20.0, 3.0, 0.4], rtol=1e-12)
    assert axes.get_xlabel() == "frequency (kHz)" and axes.get_ylabel() == "amplitude (nm)"
    assert [text.get_text() for text in axes.texts] == ["−2", "−1", "carrier", "+1", "+2"]
    with pytest.raises(ValueError, match="sidebands is empty; give one Sidebands"):
        plot_sidebands({})


def test_names_of_lines():
    named = {(1, 0): "$f_1$", (0, 2): "2 $f_2$", (1, -1): "$f_1$ − $f_2$", (-2, 3): "3 $f_2$ − 2 $f_1$"}
    assert {line: _line_name(*line) for line in named} == named
