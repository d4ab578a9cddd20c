"""Clouds turned into the frame of the camera that took a view (paper, section on path generation).

x is the image's right, y its up, z points to the camera; the origin stays the center of the object's bounding box.
"""

import torch
from torch import Tensor


def to_camera(points: Tensor, cameras: Tensor) -> Tensor:
    """Turn clouds from the object frame: (b, m, 3), (b, 2) azimuth and elevation in degrees -> (b, m, 3)."""
    azimuth, elevation = torch.deg2rad(cameras[:, :2].to(points.dtype)).unbind(1)
    zero = torch.zeros_like(azimuth)
    right = torch.stack([azimuth.cos(), zero, -azimuth.sin()], dim=1)
    toward = torch.stack([azimuth.sin() * elevation.cos(), elevation.sin(), azimuth.cos() * elevation.cos()], dim=1)
    axes = torch.stack([right, torch.linalg.cross(toward, right), toward], dim=2)  # (b, 3, 3), a column each
    return points @ axes
