"""Small files in the layouts of ShapeNet's distributions: boxes, drawn as points."""

from pathlib import Path

import numpy as np
import numpy.typing as npt
import trimesh
from PIL import Image
from scipy.io import savemat

from tests.support.small import data as boxes

CLASS = "03001627"
SIZE = 64


def write_ptn(root: Path, clouds: bool = True) -> Path:
    """Write the layout of nips16_PTN: three models to train, one to validate, two to test; EPCG's clouds or voxels."""
    splits = {"trainids": ["a", "b", "c"], "valids": ["d"], "testids": ["e", "f"]}
    (root / "shapenetcore_ids").mkdir(parents=True)
    for name, models in splits.items():
        lines = "".join(f"{CLASS}/{model}\n" for model in models)
        (root / "shapenetcore_ids" / f"{CLASS}_{name}.txt").write_text(lines)
    for number, model in enumerate("abcdef"):
        points = 0.8 * boxes.box(number, 12_000) + np.float32(0.07)
        images = root / "shapenetcore_viewdata" / CLASS / model / "imgs"
        images.mkdir(parents=True)
        for view, pixels in enumerate(boxes.views(points, 24)):
            picture(pixels, "RGB").save(images / f"a{15 * view or 360:03d}_e030.jpg", quality=95)
        if clouds:
            target = root / f"{CLASS}_testGT" / f"{model}.mat"
            target.parent.mkdir(exist_ok=True)
            savemat(target, {"V": points[:2_000], "E": np.zeros((1, 2)), "F": np.zeros((1, 3)), "Vd": points[2_000:]})
        else:
            target = root / "shapenetcore_voxdata" / CLASS / model / "model_32.mat"
            target.parent.mkdir(parents=True)
            savemat(target, {"voxel": block().astype(np.uint8)})
    return root


def write_r2n2(root: Path, count: int = 10) -> Path:
    """Write the layout of 3D-R2N2: RGBA renderings with their cameras, and binvox files."""
    for number in range(count):
        model = f"m{number:02d}"
        folder = root / "ShapeNetRendering" / CLASS / model / "rendering"
        folder.mkdir(parents=True)
        lines = [f"{15.0 * view} 27.5 0 0.75 25" for view in range(24)]
        (folder / "rendering_metadata.txt").write_text("\n".join(lines) + "\n")
        (folder / "renderings.txt").write_text("\n".join(f"{view:02d}.png" for view in range(24)))
        for view, pixels in enumerate(boxes.views(boxes.box(number, 2_000), 24)):
            picture(pixels, "RGBA").save(folder / f"{view:02d}.png")
        target = root / "ShapeNetVox32" / CLASS / model / "model.binvox"
        target.parent.mkdir(parents=True)
        target.write_bytes(binvox(block()))
    return root


def write_what3d(root: Path, validation: bool = True) -> Path:
    """Write the layout of what3d: five views of each model, each with a cloud in its camera's frame."""
    models = {"train": ["a", "b"], "test": ["d"]} | ({"val": ["c"]} if validation else {})
    (root / "lists" / "chair").mkdir(parents=True)
    (root / "classes.txt").write_text("chair 03001627\n")
    for split, names in models.items():
        (root / "lists" / "chair" / f"{split}.txt").write_text("".join(f"{name}\n" for name in names))
        for name in names:
            for view in range(5):
                image = root / "renderings" / "chair" / name / f"{view}.png"
                cloud = root / "points" / "chair" / name / f"{view}.ply"
                for path in (image, cloud):
                    path.parent.mkdir(parents=True, exist_ok=True)
                points = boxes.box(view, 2_000)
                picture(boxes.views(points, 1)[0], "RGB").save(image)
                trimesh.PointCloud(points).export(cloud)
    return root


def picture(pixels: npt.NDArray[np.uint8], mode: str) -> Image.Image:
    """Return a view as an image, on white if it has no transparency."""
    image = Image.fromarray(pixels)
    white = Image.new("RGBA", image.size, "white")
    return image if mode == "RGBA" else Image.alpha_composite(white, image).convert("RGB")


def block() -> npt.NDArray[np.bool_]:
    """Return a block of 4 x 8 x 16 voxels (x, y, z), at one corner."""
    grid = np.zeros((32, 32, 32), bool)
    grid[:4, :8, :16] = True
    return grid


def binvox(grid: npt.NDArray[np.bool_]) -> bytes:
    """Encode voxels (x, y, z) as binvox does, of a cube of side 0.5 at (-0.25, -0.25, -0.25)."""
    values = grid.transpose(0, 2, 1).ravel().astype(np.uint8)
    runs = bytearray()
    start = 0
    while start < len(values):
        end = start
        while end < len(values) and values[end] == values[start] and end - start < 255:
            end += 1
        runs += bytes([values[start], end - start])
        start = end
    head = b"#binvox 1\ndim 32 32 32\ntranslate -0.25 -0.25 -0.25\nscale 0.5\ndata\n"
    return head + bytes(runs)
