"""Where and how a run trains. None of it changes what is learned, so no checkpoint stores it."""

from dataclasses import dataclass
from typing import Literal

import torch

from model.config import option

Device = Literal["auto", "cpu", "cuda"]


@dataclass(frozen=True)
class DeviceOptions:
    """Options of a training run beside its config; each is a flag of `hof-model train`."""

    device: Device = option("auto", "device to train on; auto: CUDA if there is one")  # noqa: RUF009 - a field
    packed: str | None = option(None, "folder of `hof-model data pack` to train from, in place of --data")
    graphs: bool = option(default=True, text="replay each step as one CUDA graph")
    compile: bool = option(default=False, text="compile network and augmentation with torch.compile: slow to start")
    checkpoint_parts: bool = option(default=False, text="write checkpoints as files of at most 14 MB")
    stop_after: float | None = option(None, "minutes after which this call ends; a later one resumes the run", above=0)
    workers: int | None = option(None, "processes that decode a packed data set; default: one per core", least=1)

    @property
    def torch_device(self) -> torch.device:
        """The device to train on.

        Raises
        ------
        ValueError : CUDA is asked for and torch sees none.
        """
        has_cuda = torch.cuda.is_available()
        if self.device == "cuda" and not has_cuda:
            raise ValueError(f"--device cuda: torch {torch.__version__} sees no CUDA device; use --device cpu or auto")
        return torch.device("cuda" if has_cuda and self.device != "cpu" else "cpu")

    @property
    def uses_device_loop(self) -> bool:
        """Whether the device loop trains, not the CPU's own: on CUDA, and for packed data sets anywhere."""
        return self.packed is not None or self.torch_device.type == "cuda"
