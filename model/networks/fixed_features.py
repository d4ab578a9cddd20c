"""A stand-in for an image encoder, so that a decoder is measured alone."""

from torch import Tensor, nn


class FixedFeatures(nn.Module):
    """Stand-in for an image encoder that returns the same features for every image."""

    def __init__(self, features: Tensor) -> None:
        super().__init__()
        self.features = features

    def forward(self, images: Tensor) -> Tensor:
        """Return the fixed features, whatever the images (b, 3, s, s) are."""
        return self.features
