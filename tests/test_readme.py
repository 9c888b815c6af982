"""The examples of README.md run as shown, one after the other, and say what they promise."""

import re
from pathlib import Path

import numpy as np
import pytest

README = Path(__file__).resolve().parents[1] / "README.md"
EXAMPLES = re.findall(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), re.DOTALL)


@pytest.mark.parametrize("example", EXAMPLES, ids=range(len(EXAMPLES)))
def test_examples_run_as_shown(example, capsys):
    exec(compile(example, str(README), "exec"), {})
    assert capsys.readouterr().out


def test_the_first_example_slides_and_the_second_carries_its_weight(capsys):
    first, second = {}, {}
    exec(EXAMPLES[0], first)
    exec(EXAMPLES[1], second)
    step = 9.81 / 240
    np.testing.assert_allclose(first["solution"].impulse, [[2 * step, -step, 0.0]], rtol=1e-7, atol=1e-12)
    np.testing.assert_allclose(second["load"] / 9.81, np.arange(30, 0, -1), rtol=1e-8)
    assert abs(second["world"].positions[-1, 2] - 29.5) < 1e-3


def test_every_picture_is_there():
    for picture in re.findall(r"!\[.*?\]\((.*?)\)", README.read_text(encoding="utf-8")):
        assert (README.parent / picture).is_file(), picture
