"""Choice of the device that a run trains on, and of its loop."""

import torch

from model.config import DeviceOptions


def torch_device(options: DeviceOptions) -> torch.device:
    """Return the device to train on.

    Raises
    ------
    ValueError : CUDA is asked for and torch sees none.
    """
    has_cuda = torch.cuda.is_available()
    if options.device == "cuda" and not has_cuda:
        raise ValueError(f"--device cuda: torch {torch.__version__} sees no CUDA device; use --device cpu or auto")
    return torch.device("cuda" if has_cuda and options.device != "cpu" else "cpu")


def uses_device_loop(options: DeviceOptions) -> bool:
    """Return whether the device loop trains and not the CPU's own: on CUDA, and for packed data sets anywhere.

    Raises
    ------
    ValueError : as `torch_device`; or the CPU's own loop would ignore an option.
    """
    if torch_device(options).type == "cuda" or options.packed is not None:
        return True
    for flag, value in (("--checkpoint-parts", options.checkpoint_parts), ("--stop-after", options.stop_after)):
        if value:
            raise ValueError(f"{flag} goes with --device cuda or --packed: the CPU's own loop lacks it")
    return False
