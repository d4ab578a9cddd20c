"""Check and measure on the CUDA device, print tables for the lab book, and fail where a limit does not hold."""

import argparse
import sys
import time

import torch

from model.training.device.check.parity import check_parity
from model.training.device.check.runs import check_runs
from model.training.device.check.speed import measure_parts, measure_training


def main() -> int:
    """Run the checks. Return the exit status: 0, or 1 where there is no GPU or a limit does not hold."""
    parser = argparse.ArgumentParser(prog="python -m model.training.device.check", description=__doc__)
    parser.add_argument("--size", type=int, default=128, help="pixels of an image's side; default: 128")
    parser.add_argument("--batch", type=int, default=256, help="images per step; default: 256")
    parser.add_argument("--steps", type=int, default=60, help="steps measured of each kind; default: 60")
    parser.add_argument("--compile", action="store_true", help="measure torch.compile too; takes minutes")
    parser.add_argument("--no-speed", action="store_true", help="check alone, measure nothing")
    arguments = parser.parse_args()
    if not torch.cuda.is_available():
        print(f"gpu-check: torch {torch.__version__} sees no CUDA device; nothing was checked", file=sys.stderr)
        return 1
    start, device = time.monotonic(), torch.device("cuda")
    print(
        f"{torch.cuda.get_device_name()}, torch {torch.__version__}, {arguments.size} pixels, batch {arguments.batch}\n"
    )
    holds = True
    for check in (check_parity, check_runs):
        table, passes = check(device)
        print(table, flush=True)
        holds &= passes
    if arguments.no_speed:
        return 0 if holds else 1
    print(measure_parts(device, arguments.size, arguments.batch), flush=True)
    print(measure_training(device, arguments.size, arguments.batch, arguments.steps, arguments.compile), flush=True)
    print(f"{'all limits hold' if holds else 'A LIMIT DOES NOT HOLD'}; {time.monotonic() - start:.0f} s")
    return 0 if holds else 1


if __name__ == "__main__":
    sys.exit(main())
