"""The precision in which networks train."""

from typing import Final

import torch

_CAPABILITIES: Final[dict[str, bool]] = getattr(
    torch.cpu, "get_capabilities", dict
)()  # torch 2.11 has no such function

HALF: Final = any(map(_CAPABILITIES.get, ("amx_bf16", "avx512_bf16")))  # bfloat16 is faster on this CPU


def trunk_precision(device: torch.device, training: bool) -> torch.autocast:
    """Return the context in which layers without theta compute.

    In training that is bfloat16 on a GPU, and on a CPU that gains by it; in evaluation it is float32 everywhere.
    """
    return torch.autocast(device.type, torch.bfloat16, enabled=training and (device.type == "cuda" or HALF))
