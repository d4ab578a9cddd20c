"""The matte network: shapes, and pixels that stay at their place."""

import pytest
import torch

from model.networks.matte import MatteNetwork, _taps


def test_taps_are_the_last_blocks_of_five_resolutions() -> None:
    assert _taps() == {0: 0, 2: 1, 4: 2, 10: 4, 15: 6}


@pytest.mark.parametrize("side", [32, 96])
def test_matte_network_gives_a_logit_for_each_pixel(side: int) -> None:
    assert MatteNetwork().eval()(torch.rand(2, 3, side, side)).shape == (2, 1, side, side)


def test_matte_network_answers_where_the_image_is_touched() -> None:
    torch.manual_seed(0)
    network = MatteNetwork().eval()
    image = torch.rand(1, 3, 128, 128)
    touched = image.clone()
    touched[..., 20:28, 90:98] = 1 - touched[..., 20:28, 90:98]
    with torch.no_grad():
        change = (network(touched) - network(image)).abs()[0, 0]
    row, column = divmod(int(change.argmax()), 128)
    assert 12 <= row < 36
    assert 82 <= column < 106
