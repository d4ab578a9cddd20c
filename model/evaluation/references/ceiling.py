"""The ceiling: the mapping function with theta fitted to the object itself, without any image."""

from typing import Final

import numpy as np
import numpy.typing as npt
import torch
from tqdm import tqdm

from model.networks.mapping import power
from model.training.losses import chamfer
from service.mapping.canonical import canonical_points
from service.mapping.spec import MappingSpec, initial_theta

Floats = npt.NDArray[np.float32]

STEPS: Final = 1_000
FIT_POINTS: Final = 1_000  # predicted and true, resampled in every step
LEARNING_RATE: Final = 3e-3
BATCH: Final = 13  # objects fitted at once


def fit(spec: MappingSpec, clouds: Floats, seed: int = 0, steps: int = STEPS) -> Floats:
    """Fit theta to each cloud by Adam on the Chamfer distance (paper, eq. 3) of f^k(X) to it.

    Every fit starts from the same initialization; the learning rate falls to 0 along a cosine.

    Parameters
    ----------
    clouds : (objects, m, 3) float32, object frame.
    steps : of Adam.

    Returns
    -------
    (objects, spec.size) float32.
    """
    batches = [clouds[start : start + BATCH] for start in range(0, len(clouds), BATCH)]
    with tqdm(total=len(batches) * steps, desc="fit", unit="step", disable=None) as bar:
        return np.concatenate([_fit(spec, batch, seed, steps, bar) for batch in batches])


def _fit(spec: MappingSpec, clouds: Floats, seed: int, steps: int, bar: "tqdm[None]") -> Floats:
    rng = np.random.default_rng(seed)
    theta = torch.from_numpy(np.stack([initial_theta(spec, seed)] * len(clouds))).requires_grad_()
    optimizer = torch.optim.Adam([theta], lr=LEARNING_RATE)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, steps)
    for _ in range(steps):
        canonical = canonical_points(spec.domain, FIT_POINTS, int(rng.integers(2**62)))
        true = torch.from_numpy(clouds[:, rng.integers(clouds.shape[1], size=FIT_POINTS)])
        predicted = power(spec, theta, torch.from_numpy(canonical).expand(len(clouds), -1, -1))
        optimizer.zero_grad(set_to_none=True)
        chamfer(predicted, true).backward()  # type: ignore[no-untyped-call]
        optimizer.step()
        schedule.step()
        bar.update()
    return theta.detach().numpy()
