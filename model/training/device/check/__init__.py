"""`make gpu-check`: the device's operations against the CPU's, and how fast training is. Needs a GPU."""
