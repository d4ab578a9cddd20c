"""Training losses: the symmetric Chamfer distance, early and late, and the projection regularization."""

from typing import Final

from torch import Tensor

from model.config import TrainConfig
from model.networks.ops.dispatch import nearest_index

SATURATION: Final = 0.02  # longest sides; the smooth F-score hardly changes beyond it
F_WEIGHT: Final = 0.1  # of that term; its slope at distance 0 is F_WEIGHT / SATURATION
BACKWARD: Final = 2  # true points matched to predicted ones, for each predicted point
TINY: Final = 1e-12  # squared longest sides: keeps the root's gradient finite at distance 0
LATE_SCALE: Final = 0.125  # of the late loss: its gradient becomes as large as the squared loss's, as Adam expects


def training_loss(config: TrainConfig, predicted: Tensor, canonical: Tensor, true: Tensor, progress: float) -> Tensor:
    """Return the loss of a batch at `progress` in [0, 1]: early or late, with the projection's share.

    Parameters
    ----------
    predicted, canonical : (b, n, 3), (b, n, d); d is 3 where `config.projection` is above 0.
    true : (b, m, 3).
    """
    loss = LATE_SCALE * late_chamfer(predicted, true) if config.is_late(progress) else chamfer(predicted, true)
    if config.projection:
        regularize = projection if config.projection_form == "travel" else nearest_projection
        loss = loss + config.projection * regularize(predicted, canonical, true)
    return loss


def chamfer(predicted: Tensor, true: Tensor) -> Tensor:
    """Return CD(P, T) + CD(T, P) of the paper's eq. 3 (squared distances), mean over the batch.

    Parameters
    ----------
    predicted : (b, n, 3), carries gradients.
    true : (b, m, 3).
    """
    return _squared_distances(predicted, true).mean() + _squared_distances(true, predicted).mean()


def late_chamfer(predicted: Tensor, true: Tensor) -> Tensor:
    """Return the mean of d + F_WEIGHT (1 - exp(-d / SATURATION)) over nearest distances d, both directions summed.

    The first term is cd_epcg. The second is a smooth F-score: it rewards close points and ignores far ones. Shapes as
    in `chamfer`. Predicted points are matched to all true points; of the true points, whose order must be random, only
    the first BACKWARD n are matched to predicted ones.
    """
    loss = predicted.new_zeros(())
    matched = true[:, : BACKWARD * predicted.shape[1]]
    for squared in (_squared_distances(predicted, true), _squared_distances(matched, predicted)):
        distance = (squared + TINY).sqrt()
        loss = loss + (distance + F_WEIGHT * (1 - (-distance / SATURATION).exp())).mean()
    return loss


def projection(predicted: Tensor, canonical: Tensor, _: Tensor | None = None) -> Tensor:
    """Return the mean squared distance that points travel (paper, eq. 6): (b, n, 3) both -> scalar."""
    return (predicted - canonical).square().sum(-1).mean()


def nearest_projection(predicted: Tensor, canonical: Tensor, true: Tensor) -> Tensor:
    """Return the mean squared distance to the true point nearest to a canonical one, the paper's stricter form."""
    return (predicted - gather(true, nearest_index(canonical, true))).square().sum(-1).mean()


def _squared_distances(queries: Tensor, targets: Tensor) -> Tensor:
    """Return the squared distance of each query (b, n, 3) to its nearest target (b, m, 3): (b, n)."""
    return (gather(targets, nearest_index(queries, targets)) - queries).square().sum(-1)


def gather(points: Tensor, index: Tensor) -> Tensor:
    """Gather points by index, per batch element: (b, m, 3), (b, n) int64 -> (b, n, 3)."""
    return points.gather(1, index.unsqueeze(-1).expand(-1, -1, 3))
